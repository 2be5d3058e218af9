//! Shapes that give way to places which others claim.

use super::filled::{Claims, Filled};
use super::piece::Piece;
use super::probe;
use super::search::{PLANS, area, halves, samples};
use super::{Cover, Fit};
use nalgebra::Vector3;

/// So many points stand for the surface of a piece that is looked at anew.
const SAMPLES: f64 = 400.0;
/// A shape that gives way as a whole must hold less than this share of what was claimed, or it is parted.
const MOST_LEFT: f64 = 0.3;
/// What is gained by two shapes instead of one must be this share of what was claimed.
const LEAST_GAIN: f64 = 0.05;
/// What a shape costs that holds all claimed places, meters: beside its distance from the mesh, and more if that leads nowhere.
const CLAIMED: [f64; 3] = [0.006, 0.06, 0.6];
/// Where two shapes share fewer sampled places than this, more are looked for.
const FEW: usize = 16;
/// Rows of points from which they are looked for, and how often from one shape to the other.
const STARTS: (usize, usize) = (3, 30);
/// Rows of points at which the space that a shape shares with another is looked at.
const ROWS: usize = 6;

impl Fit {
    /// Makes a primitive give way to places that should be free (in the frame of the meshes): by another shape in its stead, or by
    /// two. All other primitives stay, and together they still contain every triangle. The second of two comes last.
    ///
    /// # Returns
    /// Whether it gave way; if not, nothing has changed.
    pub(crate) fn yield_to(&mut self, primitive: usize, claimed: Vec<Vector3<f64>>) -> bool {
        let Some(piece) = self.pieces.get(primitive) else { return false };
        self.filled.claims.places = claimed;
        let instead = CLAIMED.iter().find_map(|weight| {
            self.filled.claims.weight = *weight;
            instead(piece, &self.filled)
        });
        self.filled.claims = Claims::default();
        let Some((first, second)) = instead else { return false };
        self.pieces[primitive] = first;
        self.pieces.extend(second);
        true
    }

    /// How many primitives there are.
    pub(crate) fn count(&self) -> usize {
        self.pieces.len()
    }

    /// How far a place is from the mesh, meters, as [`super::filled::Exact::gap`].
    pub(crate) fn gap(&self, place: &Vector3<f64>) -> f64 {
        self.exact.gap(place, &self.filled)
    }

    /// How far a place is from the nearest triangle, meters.
    pub(crate) fn distance(&self, place: &Vector3<f64>) -> f64 {
        self.exact.distance(place).unwrap_or(0.0)
    }
}

/// What takes the place of a piece: itself in another shape, or its parts.
fn instead(piece: &Piece, filled: &Filled) -> Option<(Piece, Option<Piece>)> {
    let taken = |piece: &Piece| filled.claims.taken(&piece.tried.cover);
    let before = taken(piece);
    let total: f64 = piece.triangles.iter().map(area).sum();
    let points = samples(&piece.triangles, total, SAMPLES);
    let again = Piece::new(piece.triangles.clone(), points, &piece.tried.cover.pose.rotation, filled)?;
    // once: other places are claimed each time, and the shape could go to and fro
    if !piece.reshaped && taken(&again) < MOST_LEFT * before {
        return Some((Piece { reshaped: true, ..again }, None));
    }
    let (low, high) = halves(&again, PLANS[0], filled)?;
    let parts = [&low, &high].map(|p| p.tried.worst + p.tried.mean);
    let nearer = parts[0].max(parts[1]) < 0.98 * (piece.tried.worst + piece.tried.mean);
    (nearer || taken(&low) + taken(&high) < (1.0 - LEAST_GAIN) * before).then_some((low, Some(high)))
}

/// Places that two primitives share, or would if they were nearer by a margin, meters.
///
/// Those on the surface of one that the other contains; where these are few, also such as one comes to from places on either by going
/// to the nearest one of the other, in turns (projections onto convex sets end in both, if they meet).
pub(crate) fn shared(a: &crate::Primitive, b: &crate::Primitive, margin: f64) -> Vec<Vector3<f64>> {
    let [a, b] = [a, b].map(|p| Cover { shape: p.shape, pose: p.pose }.grown(margin / 2.0));
    let on_a = probe::points(&a, ROWS).into_iter().filter(|p| b.contains(p));
    let on_b = probe::points(&b, ROWS).into_iter().filter(|p| a.contains(p));
    let mut found: Vec<Vector3<f64>> = on_a.chain(on_b).collect();
    if found.len() < FEW {
        let (rows, turns) = STARTS;
        let starts = [&a, &b].into_iter().flat_map(|c| probe::points(c, rows));
        let meet = |start: Vector3<f64>| {
            let path = std::iter::successors(Some(start), |place| Some(b.nearest(&a.nearest(place))));
            path.skip(1).take(turns).find(|place| a.contains(place))
        };
        found.extend(starts.filter_map(meet));
    }
    found
}
