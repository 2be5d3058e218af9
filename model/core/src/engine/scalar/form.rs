//! Shapes prepared for queries.

use super::closed::Segment;
use crate::hull::Hull;
use crate::shape::{BoundingCapsule, InnerCapsule, Shape};
use nalgebra::{Isometry3, Vector3};
use parry3d_f64::math::Vector;
use std::sync::Arc;

/// A convex set without its radius, centered at the origin, meters.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Core {
    /// The origin.
    Point,
    /// From -half to +half along y.
    Segment { half: f64 },
    /// Half edge lengths.
    Box { half: Vector3<f64> },
    /// A flat-ended cylinder along y.
    Cylinder { half: f64, radius: f64 },
    /// The convex hull of points at arbitrary positions.
    Hull { points: Arc<[Vector]> },
}

/// A shape prepared for queries: its core, with bounding and inscribed shapes. Meters, in the shape's frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Form {
    /// The shape without its radius.
    pub core: Core,
    /// Radius by which the core is dilated.
    pub radius: f64,
    /// Radius of the bounding ball about the origin.
    pub ball: f64,
    /// Bounding capsule of the shape.
    pub outer: BoundingCapsule,
    /// Capsule inside the shape.
    pub inner: InnerCapsule,
    /// Half edge lengths if the shape is a box.
    pub boxed: Option<Vector3<f64>>,
}

impl Form {
    /// Computes all that does not depend on the pose.
    pub fn new(shape: &Shape) -> Self {
        let (core, radius) = match *shape {
            Shape::Sphere { radius } => (Core::Point, radius),
            Shape::Capsule { radius, height } => (Core::Segment { half: height / 2.0 }, radius),
            Shape::Cylinder { radius, height } => (Core::Cylinder { half: height / 2.0, radius }, 0.0),
            Shape::Box { size } => (Core::Box { half: size / 2.0 }, 0.0),
        };
        let boxed = if let Core::Box { half } = core { Some(half) } else { None };
        Form {
            core,
            radius,
            ball: shape.bounding_radius(),
            outer: shape.bounding_capsule(),
            inner: shape.inner_capsule(),
            boxed,
        }
    }

    /// Restricts the solid part to a hull within the shape, with `inner` inside that hull. The bounds of the whole
    /// shape stay valid.
    pub fn hollowed(self, hull: &Hull, shape_from_hull: &Isometry3<f64>, inner: InnerCapsule) -> Self {
        let local = |p: &nalgebra::Point3<f64>| Vector::from((shape_from_hull * p).coords);
        let core = Core::Hull { points: hull.points().iter().map(local).collect() };
        Form { core, radius: hull.radius(), inner, ..self }
    }

    /// True if the outer capsule is the shape itself.
    pub fn is_capsule(&self) -> bool {
        matches!(self.core, Core::Point | Core::Segment { .. })
    }

    /// The axis of the inner capsule, given that of the outer one in any frame.
    pub fn inner(&self, outer: &Segment) -> Segment {
        Segment { middle: outer.middle, half_axis: outer.half_axis * self.inner.share }
    }
}
