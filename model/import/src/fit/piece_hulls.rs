//! Hulls of the pieces that the primitives enclose.

use super::Fit;
use super::piece::{self, Piece};
use mobee_model::distances_from_hull;
use mobee_model::{Hull, MAX_HULL_POINTS};
use nalgebra::{Point3, Vector3};

/// Number of axes along which the initial points of a hull are searched.
const DIRECTIONS: usize = 24;
/// Maximum number of points added per round.
const POINTS_PER_ROUND: usize = 8;
/// Minimum distance between points added in one round, meters.
const MIN_SPACING_M: f64 = 0.004;
/// Distance, meters, within which a corner counts as covered by the hull.
const COVERED_M: f64 = 1e-4;
/// Resolution of coordinates in a file, steps per meter; limits its length.
const STEPS_PER_M: f64 = 1e5;
/// Upper bound of the displacement of a point by rounding, meters.
pub(super) const ROUNDING_M: f64 = 1e-5;

/// Rounds a coordinate to whole steps.
pub(crate) fn rounded(x: f64) -> f64 {
    (x * STEPS_PER_M).round() / STEPS_PER_M
}

/// Distance from the hull of a few extreme points, meters, within which a point counts as inside the hull of all
/// points.
const INSIDE_M: f64 = 2e-3;

impl Fit {
    /// Adds a hull to every primitive without one: from now on only the hull of the enclosed piece is solid.
    pub(crate) fn hull_all(&mut self) {
        let slack = self.slack;
        self.pieces.iter_mut().filter(|p| p.hull.is_none()).for_each(|p| p.hull = around(p, slack));
    }

    /// Number of primitives with a hull.
    pub(crate) fn hulled(&self) -> usize {
        self.pieces.iter().filter(|p| p.hull.is_some()).count()
    }

    /// The hulls, each with the index of its primitive, in the frame of the meshes. Their points may be [`rounded`].
    pub(crate) fn hulls(&self) -> impl Iterator<Item = (usize, &Hull)> {
        self.pieces.iter().enumerate().filter_map(|(i, p)| Some((i, p.hull.as_ref()?)))
    }
}

/// The hull of a piece: a few of its corners, and a radius that covers all others.
pub(super) fn around(piece: &Piece, slack: f64) -> Option<Hull> {
    let mut corners: Vec<Vector3<f64>> = piece.triangles.iter().flatten().copied().collect();
    corners.sort_by(piece::in_order);
    corners.dedup();
    let mut points = piece::extremes(DIRECTIONS, corners.iter());
    let mut within = 0.0_f64;
    let far = loop {
        // Corners that are covered remain covered while the hull grows, and are dropped.
        let distances: Vec<f64> = distances_from_hull(&points, &corners).collect();
        let mut beyond: Vec<(f64, Vector3<f64>)> = Vec::new();
        for (distance, corner) in distances.into_iter().zip(&corners) {
            if distance > COVERED_M { beyond.push((distance, *corner)) } else { within = within.max(distance) }
        }
        beyond.sort_by(|a, b| b.0.total_cmp(&a.0).then(piece::in_order(&a.1, &b.1)));
        let far = beyond.first().map_or(0.0, |(distance, _)| *distance);
        let mut new: Vec<Vector3<f64>> = Vec::new();
        for (_, corner) in beyond.iter().filter(|(distance, _)| *distance > far / 2.0) {
            let has_room = points.len() + new.len() < MAX_HULL_POINTS && new.len() < POINTS_PER_ROUND;
            if has_room && new.iter().all(|p| (p - corner).norm() > MIN_SPACING_M) {
                new.push(*corner);
            }
        }
        if new.is_empty() {
            break far.max(within);
        }
        points.extend(new);
        corners = beyond.into_iter().map(|(_, corner)| corner).collect();
    };
    let radius = ((far + slack + ROUNDING_M) * STEPS_PER_M).ceil() / STEPS_PER_M;
    Hull::new(points.into_iter().map(Point3::from).collect(), radius).ok()
}

/// Number of `places` inside the hull of `points`, approximately.
pub(super) fn held(points: &[Vector3<f64>], places: &[Vector3<f64>]) -> usize {
    let points = piece::extremes(DIRECTIONS, points.iter());
    if points.is_empty() { 0 } else { distances_from_hull(&points, places).filter(|far| *far <= INSIDE_M).count() }
}
