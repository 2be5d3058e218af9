//! Requests to the world, and its replies.

use mobee_model::{ObjectClass, SceneError, Shape};
use nalgebra::{Isometry3, Vector3};

/// A request to the world. Lengths in m; angles in degrees, because people type them; all in the world frame.
#[derive(Clone, Debug, PartialEq)]
pub enum WorldRequest {
    /// List of the requests.
    Help,
    /// Names of all objects.
    List,
    /// Make an obstacle, named by its geometry and a number.
    Make {
        /// Shape and size.
        geometry: Geometry,
        /// True if its name begins with `s`, which in the original's simulator kept it from falling. No other
        /// effect.
        fixed: bool,
        /// Position of its center.
        at: [f64; 3],
    },
    /// A request about one object.
    Object {
        /// Name of the object.
        name: String,
        /// Request.
        ask: ObjectRequest,
    },
    /// Remove all objects that are not persistent.
    Clear,
    /// Synchronize with a simulator; accepted for compatibility with the original, without effect.
    Synchronize,
    /// Undo the last change.
    Undo,
    /// Write the world to a file of this bare name.
    Save(String),
    /// Replace the world by that of a file.
    Load(String),
    /// A request that a bridge could not parse.
    Malformed {
        /// Object that it concerns. If there is none of that name, this is reported instead.
        object: Option<String>,
        /// Error in the request.
        why: WorldRefusal,
    },
}

/// A request about one object.
#[derive(Clone, Debug, PartialEq)]
pub enum ObjectRequest {
    /// Its pose.
    Get,
    /// Set its position; the rotation is unchanged.
    Put([f64; 3]),
    /// Set its rotation to Rx Ry Rz of these angles; the position is unchanged.
    Turn([f64; 3]),
    /// Set its rotation to this matrix, row by row; the position is unchanged.
    TurnTo([f64; 9]),
    /// Set its pose from the iCub simulator's numbers: a position in the simulator's frame, and angles.
    FromSimulator([f64; 6]),
    /// Set its class.
    Class(ObjectClass),
    /// Remove it.
    Remove,
    /// Let it follow a robot's marker; release it if the robot has no such marker.
    Grab {
        /// Name of the robot.
        robot: String,
        /// Name of the marker.
        marker: String,
    },
}

/// Geometry of a new object; sizes in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Geometry {
    /// A ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A cylinder along its y axis.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Full height.
        height: f64,
    },
    /// A box.
    Box {
        /// Full edge lengths along x, y, z.
        size: [f64; 3],
    },
}

/// A size of a [`Geometry`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Radius of a sphere.
    SphereRadius,
    /// Radius of a cylinder.
    CylinderRadius,
    /// Height of a cylinder.
    CylinderHeight,
    /// Edge of a box along x.
    BoxWidth,
    /// Edge of a box along y.
    BoxHeight,
    /// Edge of a box along z.
    BoxDepth,
}

/// An answer of the world.
#[derive(Clone, Debug, PartialEq)]
pub enum WorldReply {
    /// List of the requests, in the bridge's own words.
    Help,
    /// Names of all objects.
    Names(Vec<String>),
    /// An object of this name was made.
    Made(String),
    /// The object was found, with the outcome of the request.
    Found {
        /// Name of the object.
        name: String,
        /// Outcome.
        outcome: Result<ObjectReply, WorldRefusal>,
    },
    /// All objects that are not persistent were removed.
    Cleared,
    /// There is no simulator to synchronize with.
    Synchronized,
    /// This change was undone.
    Undone(Change),
    /// The world was written to this file.
    Saved(String),
    /// The world was replaced by a file's.
    Loaded {
        /// The file.
        file: String,
        /// Number of objects in it.
        objects: usize,
    },
}

/// An answer about one object.
#[derive(Clone, Debug, PartialEq)]
pub enum ObjectReply {
    /// Its `world_from_object`.
    Pose(Isometry3<f64>),
    /// It was moved.
    Put,
    /// Its rotation was set by angles.
    Turned,
    /// Its rotation was set by a matrix.
    TurnedTo,
    /// Its pose is the simulator's.
    AsSimulated,
    /// Its class is this one now.
    Class(ObjectClass),
    /// It was removed.
    Removed,
    /// It follows the marker.
    Grabbed,
    /// The robot has no such marker: the object was released.
    Released,
}

/// A change that can be undone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Change {
    /// This object was made.
    Made(String),
    /// This object was moved, rotated, removed, or changed in class.
    Changed(String),
    /// All objects were removed.
    Cleared,
    /// The world was replaced by this file's.
    Loaded(String),
}

/// Reason why the world does not execute a request.
#[derive(Clone, Debug, PartialEq)]
pub enum WorldRefusal {
    /// There is no such request.
    Unknown,
    /// There is no such geometry.
    UnknownGeometry,
    /// A size is not above zero.
    NotPositive(Size),
    /// A new object needs this number of sizes and a position, and nothing else.
    NewObject {
        /// Number of sizes of its geometry.
        sizes: usize,
    },
    /// All numbers for names of objects are used.
    NoNumberLeft,
    /// A position must be three numbers.
    Position,
    /// A rotation must be three angles, or a rotation matrix.
    Rotation,
    /// The simulator's pose must be six numbers.
    SimulatorPose,
    /// There is no such class of objects.
    UnknownClass,
    /// The period of a synchronization must be a number.
    Period,
    /// A file name must be bare.
    FileName,
    /// There is no object of this name.
    NoObject(String),
    /// The object is persistent and can't be removed.
    Persistent,
    /// There is no such robot.
    NoRobot,
    /// The scene rejects the change.
    Scene(SceneError),
    /// The world is full.
    Full {
        /// Largest number of objects.
        most: usize,
    },
    /// There is no change to undo.
    NothingToUndo,
    /// The last change can't be undone now.
    NotUndone(Box<WorldRefusal>),
    /// Changes arrive too quickly.
    Busy {
        /// Largest number per second.
        per_second: f64,
    },
    /// The model did not make the change, for this reason.
    Model(String),
    /// The model does not answer; the world may have changed in part.
    ModelSilent,
    /// There is no folder to save worlds in.
    FilesOff,
    /// The file could not be written, for this reason.
    NotSaved(String),
    /// The file could not be read, for this reason.
    NotLoaded(String),
    /// Writing or reading was aborted, for this reason.
    NotDone(String),
}

impl WorldRequest {
    /// True if it may change the world or a file. A malformed request counts as its intended kind.
    pub fn is_change(&self) -> bool {
        match self {
            WorldRequest::Help | WorldRequest::List | WorldRequest::Synchronize => false,
            // a grabbed object moves later, and its moves are counted then
            WorldRequest::Object { ask, .. } => !matches!(ask, ObjectRequest::Get | ObjectRequest::Grab { .. }),
            WorldRequest::Malformed { why, .. } => !matches!(why, WorldRefusal::Unknown | WorldRefusal::Period),
            WorldRequest::Make { .. }
            | WorldRequest::Clear
            | WorldRequest::Undo
            | WorldRequest::Save(_)
            | WorldRequest::Load(_) => true,
        }
    }
}

impl Geometry {
    /// Shape in the model.
    ///
    /// # Errors
    /// The first size that is not above zero.
    pub fn shape(&self) -> Result<Shape, WorldRefusal> {
        let sizes: &[(f64, Size)] = match *self {
            Geometry::Sphere { radius } => &[(radius, Size::SphereRadius)],
            Geometry::Cylinder { radius, height } => &[(radius, Size::CylinderRadius), (height, Size::CylinderHeight)],
            Geometry::Box { size: [x, y, z] } => &[(x, Size::BoxWidth), (y, Size::BoxHeight), (z, Size::BoxDepth)],
        };
        match sizes.iter().find(|(length, _)| *length <= 0.0) {
            Some((_, size)) => Err(WorldRefusal::NotPositive(*size)),
            None => Ok(match *self {
                Geometry::Sphere { radius } => Shape::Sphere { radius },
                Geometry::Cylinder { radius, height } => Shape::Cylinder { radius, height },
                Geometry::Box { size } => Shape::Box { size: Vector3::from(size) },
            }),
        }
    }
}
