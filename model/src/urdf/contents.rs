//! The links and joints of a URDF as the file gives them, each with its place.

use super::words::Unused;
use crate::error::FileError;
use nalgebra::{Isometry3, Vector3};
use std::ops::Range;

/// A URDF, as far as it matters here.
#[derive(Debug)]
pub(super) struct Document {
    /// The robot's name, or `robot`.
    pub name: String,
    /// Where the outermost tag stands.
    pub at: Range<usize>,
    /// The links in file order; no two of one name.
    pub links: Vec<Link>,
    /// The joints in file order; no two of one name.
    pub joints: Vec<Joint>,
    /// What of the file's words is not used.
    pub unused: Unused,
    /// What is odd about its places.
    pub warnings: Vec<FileError>,
}

/// A rigid body.
#[derive(Debug)]
pub(super) struct Link {
    /// Its name, not empty.
    pub name: String,
    /// Where its start tag stands.
    pub at: Range<usize>,
    /// The shapes that collide.
    pub collisions: Vec<Collision>,
    /// Its center of mass in its frame, if it says that it has mass there.
    pub center: Option<Vector3<f64>>,
    /// Whether it has a shape to be looked at, and none that collides.
    pub bare: bool,
}

/// A shape that collides.
#[derive(Debug)]
pub(super) struct Collision {
    /// Where its geometry's tag stands.
    pub at: Range<usize>,
    /// `link_from_shape`.
    pub origin: Isometry3<f64>,
    /// The shape.
    pub geometry: Geometry,
}

/// A shape in its own frame, lengths in meters as the file gives them, not yet checked.
#[derive(Debug)]
pub(super) enum Geometry {
    /// Edge lengths.
    Box { size: Vector3<f64> },
    /// Along z.
    Cylinder { radius: f64, length: f64 },
    /// Along z; the length is that between the centers of its ends.
    Capsule { radius: f64, length: f64 },
    /// A ball.
    Sphere { radius: f64 },
    /// A file, and what its coordinates are multiplied by.
    Mesh { filename: String, scale: Vector3<f64> },
}

impl Geometry {
    /// The word for it.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Box { .. } => "box",
            Self::Cylinder { .. } => "cylinder",
            Self::Capsule { .. } => "capsule",
            Self::Sphere { .. } => "sphere",
            Self::Mesh { .. } => "mesh",
        }
    }
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JointType {
    /// Not at all.
    Fixed,
    /// Turns between limits.
    Revolute,
    /// Turns without limits.
    Continuous,
    /// Slides between limits.
    Prismatic,
    /// Slides in a plane and turns in it.
    Planar,
    /// Any motion.
    Floating,
}

/// What two links hang on each other by.
#[derive(Debug)]
pub(super) struct Joint {
    /// Its name, not empty.
    pub name: String,
    /// Where its start tag stands.
    pub at: Range<usize>,
    /// How it moves.
    pub joint_type: JointType,
    /// `parent_from_joint` at zero.
    pub origin: Isometry3<f64>,
    /// Name of the link it leaves.
    pub parent: String,
    /// Name of the link it leads to.
    pub child: String,
    /// Its axis in its own frame, finite, not normalized.
    pub axis: Vector3<f64>,
    /// Its limits as written, radians or meters.
    pub limit: Option<Limit>,
    /// Its soft limits.
    pub safety: Option<Safety>,
    /// The joint it follows.
    pub mimic: Option<Mimic>,
}

/// A joint's limits, radians or meters, as far as the file gives them. May be infinite or in reverse order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limit {
    /// The lower one.
    pub lower: Option<f64>,
    /// The upper one.
    pub upper: Option<f64>,
    /// The maximum speed, rad/s or m/s.
    pub velocity: Option<f64>,
}

/// The limits that a joint's controller keeps to, radians or meters, as far as the file gives them.
#[derive(Clone, Debug)]
pub(super) struct Safety {
    /// Where they stand.
    pub at: Range<usize>,
    /// The lower one.
    pub lower: Option<f64>,
    /// The upper one.
    pub upper: Option<f64>,
}

/// A joint follows another one: `multiplier * q + offset`.
#[derive(Debug)]
pub(super) struct Mimic {
    /// Name of the leader.
    pub joint: String,
    /// 1 where the file gives none. May not be finite.
    pub multiplier: f64,
    /// 0 where the file gives none. May not be finite.
    pub offset: f64,
}
