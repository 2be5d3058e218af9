//! Refits shapes around points that others claim as free space.

use super::piece::Piece;
use super::probe;
use super::search::{PLANS, area, halves, halves_at, planes, samples};
use super::{Cover, Fit, piece_hulls};
use nalgebra::Vector3;

/// Number of points that represent the surface of a piece while it is refitted.
const SAMPLES: f64 = 400.0;
/// A shape that is refitted as a whole must contain less than this share of the claimed points it contained before;
/// otherwise it is split.
const MAX_REMAINING_SHARE: f64 = 0.3;
/// Minimum share of the claimed points that two shapes instead of one must free.
const MIN_GAIN: f64 = 0.1;
/// Maximum number of consecutive splits of a hull that do not reduce the claimed points inside.
const MAX_FAILED_SPLITS: u8 = 3;
/// Rows of sample points for the space that two shapes share.
const ROWS: usize = 6;

impl Fit {
    /// Refits a primitive around points that should be free (in the frame of the meshes), as another shape or as two.
    /// All other primitives are unchanged, and together they still contain every triangle. The second of two is
    /// appended to the list.
    ///
    /// # Returns
    /// True if it was refitted; if false, nothing has changed.
    pub(crate) fn yield_to(&mut self, primitive: usize, claimed: Vec<Vector3<f64>>) -> bool {
        self.filled.claimed = claimed;
        let instead = self.pieces.get(primitive).and_then(|piece| self.instead(piece));
        self.filled.claimed.clear();
        let Some((first, second)) = instead else { return false };
        self.pieces[primitive] = first;
        self.pieces.extend(second);
        true
    }

    /// The replacement of a piece: itself in another shape, or its two parts.
    fn instead(&self, piece: &Piece) -> Option<(Piece, Option<Piece>)> {
        if piece.hull.is_some() {
            return self.parted(piece);
        }
        let taken = |piece: &Piece| self.filled.taken(&piece.fit.cover);
        let before = taken(piece);
        let total: f64 = piece.triangles.iter().map(area).sum();
        let points = samples(&piece.triangles, total, SAMPLES);
        let again = Piece::new(piece.triangles.clone(), points, &piece.fit.cover.pose.rotation, &self.filled)?;
        // Only once per piece: the claimed points differ each time, and the shape could oscillate.
        if !piece.reshaped && taken(&again) < MAX_REMAINING_SHARE * before {
            return Some((Piece { reshaped: true, ..again }, None));
        }
        let (low, high) = halves(&again, PLANS[0], &self.filled)?;
        let parts = (low, high);
        let nearer = are_nearer(&parts, piece);
        let (low, high) = parts;
        (nearer || taken(&low) + taken(&high) < (1.0 - MIN_GAIN) * before).then_some((low, Some(high)))
    }

    /// The parts of a piece with a hull, split at the plane that leaves the fewest claimed points inside the hulls of
    /// both.
    fn parted(&self, piece: &Piece) -> Option<(Piece, Option<Piece>)> {
        let total: f64 = piece.triangles.iter().map(area).sum();
        let samples = samples(&piece.triangles, total, SAMPLES);
        let points: Vec<Vector3<f64>> = samples.iter().chain(&piece.extremes).copied().collect();
        let held = |points: &[Vector3<f64>]| piece_hulls::held(points, &self.filled.claimed);
        let before = held(&points);
        let mut best = (f64::INFINITY, None);
        for (normal, at) in planes(piece) {
            let (low, high): (Vec<_>, Vec<_>) = points.iter().partition(|p| normal.dot(p) <= at);
            let left = (held(&low) + held(&high)) as f64;
            // Of two planes that leave equally many, prefer the one with more balanced sides.
            let uneven = (low.len() as f64 - high.len() as f64).abs() / points.len() as f64;
            if left + 0.5 * uneven < best.0 {
                best = (left + 0.5 * uneven, Some((normal, at)));
            }
        }
        let (left, plane) = best;
        // A single plane can't open a ring or a cup, but the parts of its parts no longer contain the hollow.
        let failed_splits = if left < (1.0 - MIN_GAIN) * before as f64 { 0 } else { piece.failed_splits + 1 };
        let (normal, at) = plane.filter(|_| failed_splits <= MAX_FAILED_SPLITS)?;
        let (mut low, mut high) = halves_at(&Piece { samples, ..piece.clone() }, &normal, at, &self.filled)?;
        low.failed_splits = failed_splits;
        high.failed_splits = failed_splits;
        low.hull = piece_hulls::around(&low, self.slack);
        high.hull = piece_hulls::around(&high, self.slack);
        Some((low, Some(high)))
    }

    /// Sample points of the piece that a primitive encloses, in the frame of the meshes.
    pub(crate) fn points(&self, primitive: usize) -> impl Iterator<Item = &Vector3<f64>> {
        self.pieces.get(primitive).into_iter().flat_map(|piece| piece.samples.iter().chain(&piece.extremes))
    }

    /// Number of primitives.
    pub(crate) fn count(&self) -> usize {
        self.pieces.len()
    }

    /// Distance of a point from the mesh, meters; zero inside. See [`super::filled::Exact::gap`].
    pub(crate) fn gap(&self, place: &Vector3<f64>) -> f64 {
        self.exact.gap(place, &self.filled)
    }

    /// Unsigned distance of a point from the nearest triangle, meters.
    pub(crate) fn distance(&self, place: &Vector3<f64>) -> f64 {
        self.exact.distance(place).unwrap_or(0.0)
    }
}

/// True if two parts of a piece are nearer to the mesh than its own shape.
fn are_nearer((low, high): &(Piece, Piece), piece: &Piece) -> bool {
    let far = |p: &Piece| p.fit.worst + p.fit.mean;
    far(low).max(far(high)) < 0.98 * far(piece)
}

/// Sample points on the surface of either primitive that the other contains.
pub(crate) fn shared(a: &mobee_model::Primitive, b: &mobee_model::Primitive) -> Vec<Vector3<f64>> {
    let [a, b] = [a, b].map(|p| Cover { shape: p.shape, pose: p.pose });
    let on_a = probe::points(&a, ROWS).into_iter().filter(|p| b.contains(p));
    let on_b = probe::points(&b, ROWS).into_iter().filter(|p| a.contains(p));
    on_a.chain(on_b).collect()
}
