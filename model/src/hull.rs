//! Hulls: what a shape around a part of a mesh really holds.
//!
//! ```text
//! shape (ball, capsule, cylinder, box)   quick to reject, larger than what it was put around
//!   └── hull: some points and a radius   what touches
//! ```

use crate::Shape;
use nalgebra::{Isometry3, Point3};
use std::sync::Arc;

/// A hull may have so many points at most: each is looked at several times whenever it is measured, and an attribute of a file has its
/// bounds, too.
pub(crate) const MOST_POINTS: usize = 112;
/// How far a hull may stick out of its shape, meters: what rounding makes of a pose that was written as heading and angle.
const ROUNDING: f64 = 1e-6;

/// The convex hull of points, blown up by a radius: a solid within a shape, on the same node.
///
/// The shape is what everybody draws, and what is looked at first; where it may touch, its hull decides. So a hull never makes
/// a contact that its shape would not make.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// `node` frame, meters; at least one.
    points: Vec<Point3<f64>>,
    /// Meters.
    radius: f64,
}

/// The hulls of a node's shapes: which shape, by its number among the node's solids, has which.
pub type Hulls = std::collections::BTreeMap<usize, Arc<Hull>>;

impl Hull {
    /// The hull of these points, meters, blown up by a radius, meters.
    ///
    /// # Errors
    /// The end of a sentence that begins with the hull: no points or too many, or numbers that are no places or no radius.
    pub fn new(points: Vec<Point3<f64>>, radius: f64) -> Result<Self, String> {
        if points.is_empty() || points.len() > MOST_POINTS {
            return Err(format!("has {} points; 1 to {MOST_POINTS} make one", points.len()));
        }
        if !(points.iter().all(|p| p.iter().all(|x| x.is_finite())) && radius.is_finite() && radius >= 0.0) {
            return Err("has numbers that are not finite, or a radius below zero".to_owned());
        }
        Ok(Self { points, radius })
    }

    /// Its points, meters.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// What it is blown up by, meters.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The same in another frame.
    pub fn moved(&self, to_from_here: &Isometry3<f64>) -> Self {
        Self { points: self.points.iter().map(|p| to_from_here * p).collect(), radius: self.radius }
    }

    /// Whether it lies within a shape, given the shape's pose in the hull's frame.
    pub fn is_within(&self, shape: &Shape, pose: &Isometry3<f64>) -> bool {
        let depth = |p: &Point3<f64>| shape.depth(&pose.inverse_transform_point(p).coords);
        self.points.iter().all(|p| depth(p) >= self.radius - ROUNDING)
    }
}
