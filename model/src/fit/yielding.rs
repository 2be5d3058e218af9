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
        let mut best = ((1.0 - LEAST_GAIN) * before as f64, None);
        for (normal, at) in planes(piece) {
            let (low, high): (Vec<_>, Vec<_>) = points.iter().partition(|p| normal.dot(p) <= at);
            let left = (held(&low) + held(&high)) as f64;
            // of two planes that leave equally many, the one with the more equal sides
            let uneven = (low.len() as f64 - high.len() as f64).abs() / points.len() as f64;
            if left + 0.5 * uneven < best.0 {
                best = (left + 0.5 * uneven, Some((normal, at)));
            }
        }
        let piece = Piece { samples, ..piece.clone() };
        let (mut low, mut high) = match best.1 {
            Some((normal, at)) => halves_at(&piece, &normal, at, &self.filled)?,
            // no single plane opens the hollow, but parts that are nearer to the mesh may be parted further
            None => halves(&piece, PLANS[0], &self.filled).filter(|parts| are_nearer(parts, &piece))?,
        };
        low.hull = hulling::around(&low, self.slack);
        high.hull = hulling::around(&high, self.slack);
        Some((low, Some(high)))
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
