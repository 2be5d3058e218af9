//! Shapes that give way to places which others claim.

use super::piece::Piece;
use super::probe;
use super::search::{PLANS, area, halves, halves_at, planes, samples};
use super::{Cover, Fit, hulling};
use nalgebra::Vector3;

/// So many points stand for the surface of a piece that is looked at anew.
const SAMPLES: f64 = 400.0;
/// A shape that gives way as a whole must hold less than this share of what was claimed, or it is parted.
const MOST_LEFT: f64 = 0.3;
/// What is gained by two shapes instead of one must be this share of what was claimed.
const LEAST_GAIN: f64 = 0.1;
/// A hull is parted no more often than this in a row if its parts hold as much of what was claimed.
const IN_VAIN: u8 = 3;
/// Rows of points at which the space that a shape shares with another is looked at.
const ROWS: usize = 6;

impl Fit {
    /// Makes a primitive give way to places that should be free (in the frame of the meshes): by another shape in its stead, or by
    /// two. All other primitives stay, and together they still contain every triangle. The second of two comes last.
    ///
    /// # Returns
    /// Whether it gave way; if not, nothing has changed.
    pub(crate) fn yield_to(&mut self, primitive: usize, claimed: Vec<Vector3<f64>>) -> bool {
        self.filled.claimed = claimed;
        let instead = self.pieces.get(primitive).and_then(|piece| self.instead(piece));
        self.filled.claimed.clear();
        let Some((first, second)) = instead else { return false };
        self.pieces[primitive] = first;
        self.pieces.extend(second);
        true
    }

    /// What takes the place of a piece: itself in another shape, or its parts.
    fn instead(&self, piece: &Piece) -> Option<(Piece, Option<Piece>)> {
        if piece.hull.is_some() {
            return self.parted(piece);
        }
        let taken = |piece: &Piece| self.filled.taken(&piece.tried.cover);
        let before = taken(piece);
        let total: f64 = piece.triangles.iter().map(area).sum();
        let points = samples(&piece.triangles, total, SAMPLES);
        let again = Piece::new(piece.triangles.clone(), points, &piece.tried.cover.pose.rotation, &self.filled)?;
        // once: other places are claimed each time, and the shape could go to and fro
        if !piece.reshaped && taken(&again) < MOST_LEFT * before {
            return Some((Piece { reshaped: true, ..again }, None));
        }
        let (low, high) = halves(&again, PLANS[0], &self.filled)?;
        let parts = (low, high);
        let nearer = are_nearer(&parts, piece);
        let (low, high) = parts;
        (nearer || taken(&low) + taken(&high) < (1.0 - LEAST_GAIN) * before).then_some((low, Some(high)))
    }

    /// The parts of a piece whose hull gives way, at the plane that leaves the fewest of the claimed places to the hulls of both.
    fn parted(&self, piece: &Piece) -> Option<(Piece, Option<Piece>)> {
        let total: f64 = piece.triangles.iter().map(area).sum();
        let samples = samples(&piece.triangles, total, SAMPLES);
        let points: Vec<Vector3<f64>> = samples.iter().chain(&piece.extremes).copied().collect();
        let held = |points: &[Vector3<f64>]| hulling::held(points, &self.filled.claimed);
        let before = held(&points);
        let mut best = (f64::INFINITY, None);
        for (normal, at) in planes(piece) {
            let (low, high): (Vec<_>, Vec<_>) = points.iter().partition(|p| normal.dot(p) <= at);
            let left = (held(&low) + held(&high)) as f64;
            // of two planes that leave equally many, the one with the more equal sides
            let uneven = (low.len() as f64 - high.len() as f64).abs() / points.len() as f64;
            if left + 0.5 * uneven < best.0 {
                best = (left + 0.5 * uneven, Some((normal, at)));
            }
        }
        let (left, plane) = best;
        // no single plane opens a ring or a cup, but the parts of its parts hold nothing that is within
        let in_vain = if left < (1.0 - LEAST_GAIN) * before as f64 { 0 } else { piece.in_vain + 1 };
        let (normal, at) = plane.filter(|_| in_vain <= IN_VAIN)?;
        let (mut low, mut high) = halves_at(&Piece { samples, ..piece.clone() }, &normal, at, &self.filled)?;
        (low.in_vain, high.in_vain) = (in_vain, in_vain);
        low.hull = hulling::around(&low, self.slack);
        high.hull = hulling::around(&high, self.slack);
        Some((low, Some(high)))
    }

    /// Points of what a primitive encloses, in the frame of the meshes.
    pub(crate) fn points(&self, primitive: usize) -> impl Iterator<Item = &Vector3<f64>> {
        self.pieces.get(primitive).into_iter().flat_map(|piece| piece.samples.iter().chain(&piece.extremes))
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

/// Whether two parts of a piece are nearer to the mesh than its own shape.
fn are_nearer((low, high): &(Piece, Piece), piece: &Piece) -> bool {
    let far = |p: &Piece| p.tried.worst + p.tried.mean;
    far(low).max(far(high)) < 0.98 * far(piece)
}

/// Places on the surface of either primitive that the other contains.
pub(crate) fn shared(a: &crate::Primitive, b: &crate::Primitive) -> Vec<Vector3<f64>> {
    let [a, b] = [a, b].map(|p| Cover { shape: p.shape, pose: p.pose });
    let on_a = probe::points(&a, ROWS).into_iter().filter(|p| b.contains(p));
    let on_b = probe::points(&b, ROWS).into_iter().filter(|p| a.contains(p));
    on_a.chain(on_b).collect()
}
