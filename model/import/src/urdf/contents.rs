//! Contents of a URDF: links and joints as given by the file, with their locations.

use super::words::Unused;
use mobee_text::FileError;
use nalgebra::{Isometry3, Vector3};
use std::ops::Range;

/// The parts of a URDF that are used.
#[derive(Debug)]
pub(super) struct Document {
    /// The robot's name, or `robot`.
    pub name: String,
    /// Location of the root tag.
    pub at: Range<usize>,
    /// The links in file order; names are unique.
    pub links: Vec<UrdfLink>,
    /// The joints in file order; names are unique.
    pub joints: Vec<UrdfJoint>,
    /// The unused elements and attributes of the file.
    pub unused: Unused,
    /// Warnings about the origins in the file.
    pub warnings: Vec<FileError>,
}

/// A rigid body.
#[derive(Debug)]
pub(super) struct UrdfLink {
    /// Its name, not empty.
    pub name: String,
    /// Location of its start tag.
    pub at: Range<usize>,
    /// The collision shapes.
    pub collisions: Vec<UrdfCollision>,
    /// Its center of mass in its frame; `None` if the file gives no mass.
    pub center: Option<Vector3<f64>>,
    /// True if it has a visual shape but no collision shape.
    pub bare: bool,
}

/// A collision shape.
#[derive(Debug)]
pub(super) struct UrdfCollision {
    /// Location of its geometry's tag.
    pub at: Range<usize>,
    /// `link_from_shape`.
    pub origin: Isometry3<f64>,
    /// The shape.
    pub geometry: UrdfGeometry,
}

/// A shape in its own frame, lengths in meters, not yet checked.
#[derive(Debug)]
pub(super) enum UrdfGeometry {
    /// Edge lengths.
    Box { size: Vector3<f64> },
    /// Along z.
    Cylinder { radius: f64, length: f64 },
    /// Along z; `length` is the distance between the centers of its end balls.
    Capsule { radius: f64, length: f64 },
    /// A ball.
    Sphere { radius: f64 },
    /// Path of a mesh file, and the factors for its coordinates.
    Mesh { filename: String, scale: Vector3<f64> },
}

impl UrdfGeometry {
    /// The name of its element.
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

/// Type of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JointType {
    /// No motion.
    Fixed,
    /// Rotation between limits.
    Revolute,
    /// Rotation without limits.
    Continuous,
    /// Translation between limits.
    Prismatic,
    /// Translation and rotation in a plane.
    Planar,
    /// Any motion, six degrees of freedom.
    Floating,
}

/// A joint between two links.
#[derive(Debug)]
pub(super) struct UrdfJoint {
    /// Its name, not empty.
    pub name: String,
    /// Location of its start tag.
    pub at: Range<usize>,
    /// Its type.
    pub joint_type: JointType,
    /// `parent_from_joint` at zero.
    pub origin: Isometry3<f64>,
    /// Name of the parent link.
    pub parent: String,
    /// Name of the child link.
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

/// A joint's limits, radians or meters, if the file gives them. May be infinite or in reverse order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limit {
    /// The lower one.
    pub lower: Option<f64>,
    /// The upper one.
    pub upper: Option<f64>,
    /// The maximum speed, rad/s or m/s.
    pub velocity: Option<f64>,
}

/// Soft limits of a joint's controller, radians or meters, if the file gives them.
#[derive(Clone, Debug)]
pub(super) struct Safety {
    /// Location of their tag.
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
    /// Factor; 1 if the file gives none. May not be finite.
    pub multiplier: f64,
    /// Offset, radians or meters; 0 if the file gives none. May not be finite.
    pub offset: f64,
}
