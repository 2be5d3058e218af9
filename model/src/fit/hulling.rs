//! The hulls of what the primitives enclose.

use super::Fit;
use super::piece::{self, Piece};
use crate::engine::distances_from_hull;
use crate::hull::{Hull, MOST_POINTS};
use nalgebra::{Point3, Vector3};

/// Along how many directions its first points are looked for.
const DIRECTIONS: usize = 24;
/// How many points it gets at once, and how far these are from each other, meters.
const AT_ONCE: usize = 8;
const APART: f64 = 0.004;
/// How near a hull comes to the corners that are none of its points, meters.
const NEAR: f64 = 1e-4;
/// Coordinates have so many steps to the meter in a file, so that it is not longer than need be.
const STEPS: f64 = 1e5;
/// By how much rounding to steps can move a point, meters, and a little more.
pub(super) const ROUNDED: f64 = 1e-5;

/// A coordinate in whole steps.
pub(crate) fn rounded(x: f64) -> f64 {
    (x * STEPS).round() / STEPS
}

/// So near to the hull of some points a place is in the hull of all, about, meters.
const HELD: f64 = 2e-3;

impl Fit {
    /// From now on of each primitive only the hull of what it encloses is solid.
    pub(crate) fn hull_all(&mut self) {
        let slack = self.slack;
        self.pieces.iter_mut().filter(|p| p.hull.is_none()).for_each(|p| p.hull = around(p, slack));
    }

    /// How many of the primitives have hulls.
    pub(crate) fn hulled(&self) -> usize {
        self.pieces.iter().filter(|p| p.hull.is_some()).count()
    }

    /// The hulls of those that have one, each with its primitive's number, in the frame of the meshes. Their points may be
    /// [`rounded`].
    pub(crate) fn hulls(&self) -> impl Iterator<Item = (usize, &Hull)> {
        self.pieces.iter().enumerate().filter_map(|(i, p)| Some((i, p.hull.as_ref()?)))
    }
}

/// The hull of a piece: few of its corners, and a radius that reaches all others.
pub(super) fn around(piece: &Piece, slack: f64) -> Option<Hull> {
    let mut corners: Vec<Vector3<f64>> = piece.triangles.iter().flatten().copied().collect();
    corners.sort_by(piece::in_order);
    corners.dedup();
    let mut points = piece::extremes(DIRECTIONS, corners.iter());
    let mut within = 0.0_f64;
    let far = loop {
        // what is near stays near while the hull grows
        let distances: Vec<f64> = distances_from_hull(&points, &corners).collect();
        let mut beyond: Vec<(f64, Vector3<f64>)> = Vec::new();
        for (distance, corner) in distances.into_iter().zip(&corners) {
            if distance > NEAR { beyond.push((distance, *corner)) } else { within = within.max(distance) }
        }
        beyond.sort_by(|a, b| b.0.total_cmp(&a.0).then(piece::in_order(&a.1, &b.1)));
        let far = beyond.first().map_or(0.0, |(distance, _)| *distance);
        let mut new: Vec<Vector3<f64>> = Vec::new();
        for (_, corner) in beyond.iter().filter(|(distance, _)| *distance > far / 2.0) {
            let room = points.len() + new.len() < MOST_POINTS && new.len() < AT_ONCE;
            if room && new.iter().all(|p| (p - corner).norm() > APART) {
                new.push(*corner);
            }
        }
        if new.is_empty() {
            break far.max(within);
        }
        points.extend(new);
        corners = beyond.into_iter().map(|(_, corner)| corner).collect();
    };
    let radius = ((far + slack + ROUNDED) * STEPS).ceil() / STEPS;
    Hull::new(points.into_iter().map(Point3::from).collect(), radius).ok()
}

/// How many of these places the hull of points holds.
pub(super) fn held(points: &[Vector3<f64>], places: &[Vector3<f64>]) -> usize {
    let points = piece::extremes(DIRECTIONS, points.iter());
    if points.is_empty() { 0 } else { distances_from_hull(&points, places).filter(|far| *far <= HELD).count() }
}
