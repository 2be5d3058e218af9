//! Convex shapes, with their bounding and inscribed capsules.

use nalgebra::{Isometry3, Vector3};
use std::f64::consts::PI;

/// A convex shape, centered at its origin. Sizes in meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A flat-ended cylinder along local y.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Full height.
        height: f64,
    },
    /// A box with full edge lengths along x, y, z.
    Box {
        /// Full edge lengths.
        size: Vector3<f64>,
    },
    /// A capsule along local y (extension of the original format).
    Capsule {
        /// Radius.
        radius: f64,
        /// Distance between the centers of its two end balls.
        height: f64,
    },
}

/// A shape and its pose on its node (or object).
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// The shape.
    pub shape: Shape,
    /// `node_from_shape` (or `object_from_shape`).
    pub pose: Isometry3<f64>,
}

/// A capsule that contains a shape, in the shape's frame and centered at its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingCapsule {
    /// From the origin to the center of one end ball, meters; zero for a ball.
    pub half_axis: Vector3<f64>,
    /// Radius, meters.
    pub radius: f64,
}

/// A capsule inside a solid, on the axis of the capsule that contains its shape and with the same midpoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InnerCapsule {
    /// Length of its axis as a fraction of the outer capsule's, 0 to 1.
    pub share: f64,
    /// Radius, meters; minus infinity if no such capsule is known.
    pub radius: f64,
}

impl InnerCapsule {
    /// Value for a solid without a known inner capsule.
    pub const NONE: Self = Self { share: 0.0, radius: f64::NEG_INFINITY };
}

impl Shape {
    /// Depth of a point (in the shape's frame, meters) inside: its distance from the nearest side; negative outside.
    pub fn depth(&self, p: &Vector3<f64>) -> f64 {
        match *self {
            Self::Sphere { radius } => radius - p.norm(),
            Self::Box { size } => (size / 2.0 - p.abs()).min(),
            Self::Cylinder { radius, height } => (radius - p.x.hypot(p.z)).min(height / 2.0 - p.y.abs()),
            Self::Capsule { radius, height } => {
                radius - Vector3::new(p.x, (p.y.abs() - height / 2.0).max(0.0), p.z).norm()
            }
        }
    }

    /// Its volume, m^3.
    pub fn volume(&self) -> f64 {
        match *self {
            Self::Sphere { radius } => 4.0 / 3.0 * PI * radius.powi(3),
            Self::Cylinder { radius, height } => PI * radius * radius * height,
            Self::Box { size } => size.x * size.y * size.z,
            Self::Capsule { radius, height } => PI * radius * radius * height + 4.0 / 3.0 * PI * radius.powi(3),
        }
    }

    /// The radius of the smallest ball around the shape's origin that holds it, meters.
    pub fn bounding_radius(&self) -> f64 {
        match *self {
            Self::Sphere { radius } => radius,
            Self::Cylinder { radius, height } => radius.hypot(height / 2.0),
            Self::Box { size } => size.norm() / 2.0,
            Self::Capsule { radius, height } => radius + height / 2.0,
        }
    }

    /// Extent from its origin in a direction of unit length, meters.
    pub fn extent(&self, toward: &Vector3<f64>) -> f64 {
        match *self {
            Self::Sphere { radius } => radius,
            Self::Box { size } => toward.abs().dot(&size) / 2.0,
            Self::Cylinder { radius, height } => radius * toward.x.hypot(toward.z) + height / 2.0 * toward.y.abs(),
            Self::Capsule { radius, height } => radius + height / 2.0 * toward.y.abs(),
        }
    }

    /// A bounding capsule about the shape's origin: exact for balls and capsules, along the longest edge of a box, and
    /// longer than a cylinder by its radius at each end.
    pub fn bounding_capsule(&self) -> BoundingCapsule {
        match *self {
            Self::Sphere { radius } => BoundingCapsule { half_axis: Vector3::zeros(), radius },
            Self::Cylinder { radius, height } | Self::Capsule { radius, height } => {
                BoundingCapsule { half_axis: Vector3::y() * (height / 2.0), radius }
            }
            Self::Box { size } => {
                let half = size / 2.0;
                // Along the longest edge the capsule's radius has to cover only the two shorter ones, so it is
                // thinnest.
                let long = half.imax();
                let mut half_axis = Vector3::zeros();
                let mut across = half;
                half_axis[long] = half[long];
                across[long] = 0.0;
                BoundingCapsule { half_axis, radius: across.norm() }
            }
        }
    }

    /// A capsule inside the shape: the shape itself if it is a capsule.
    pub fn inner_capsule(&self) -> InnerCapsule {
        match *self {
            Self::Sphere { radius } => InnerCapsule { share: 0.0, radius },
            Self::Capsule { radius, .. } => InnerCapsule { share: 1.0, radius },
            Self::Cylinder { radius, height } => {
                let half = height / 2.0;
                // A long cylinder contains a capsule of its own radius, a flat one only the ball between its two faces.
                if half > radius {
                    InnerCapsule { share: (half - radius) / half, radius }
                } else {
                    InnerCapsule { share: 0.0, radius: half }
                }
            }
            Self::Box { size } => {
                let long = size.max() / 2.0;
                let thin = size.min() / 2.0;
                let share = if long > 0.0 { (long - thin) / long } else { 0.0 };
                InnerCapsule { share, radius: thin }
            }
        }
    }
}
