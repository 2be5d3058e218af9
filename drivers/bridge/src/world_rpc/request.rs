//! What the world can be asked, and what it answers.

use mobee_model::{ObjectClass, SceneError, Shape};
use nalgebra::{Isometry3, Vector3};

/// A request to the world. Lengths in m; angles in degrees, since people say them; all in the world's frame.
#[derive(Clone, Debug, PartialEq)]
pub enum WorldRequest {
    /// What can be asked.
    Help,
    /// The names of all objects.
    List,
    /// Make an obstacle, named by its geometry and a number.
    Make {
        /// What it is like.
        geometry: Geometry,
        /// Whether its name begins with `s`: the original's simulator did not let such a one fall. Nothing else comes of it.
        fixed: bool,
        /// Where its center is to be.
        at: [f64; 3],
    },
    /// Something about one object.
    Object {
        /// Its name.
        name: String,
        /// What.
        ask: ObjectRequest,
    },
    /// Remove all objects that are not persistent.
    Clear,
    /// Keep in step with a simulator; taken for the original's sake, as there is none.
    Synchronize,
    /// Take back the last change.
    Undo,
    /// Write the world to a file of this bare name.
    Save(String),
    /// Replace the world by such a file's.
    Load(String),
    /// A request that a bridge could make nothing of.
    Malformed {
        /// The object that it was about. If there is none of that name, this is what is said.
        object: Option<String>,
        /// What is wrong with the request.
        why: WorldRefusal,
    },
}

/// A request about one object.
#[derive(Clone, Debug, PartialEq)]
pub enum ObjectRequest {
    /// Its pose.
    Get,
    /// Put it there; its rotation stays.
    Put([f64; 3]),
    /// Turn it to Rx Ry Rz of these angles; its position stays.
    Turn([f64; 3]),
    /// Turn it to this rotation matrix, row by row; its position stays.
    TurnTo([f64; 9]),
    /// Set its pose as the iCub simulator gives it: a position in the simulator's frame, and angles.
    FromSimulator([f64; 6]),
    /// Make it one of these.
    Class(ObjectClass),
    /// Remove it.
    Remove,
    /// Let it follow a robot's marker; release it if the robot has no such marker.
    Grab {
        /// The robot's name.
        robot: String,
        /// The marker's.
        marker: String,
    },
}

/// What an object can be made as; its sizes, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Geometry {
    /// A ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A cylinder along its y.
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
    /// What can be asked, in the bridge's own words.
    Help,
    /// The names of all objects.
    Names(Vec<String>),
    /// An object of this name was made.
    Made(String),
    /// The object was found, and what then came of the request.
    Found {
        /// Its name.
        name: String,
        /// What came of it.
        outcome: Result<ObjectReply, WorldRefusal>,
    },
    /// All objects that are not persistent are gone.
    Cleared,
    /// There is no simulator to keep in step with.
    Synchronized,
    /// This change was taken back.
    Undone(Change),
    /// The world was written to this file.
    Saved(String),
    /// The world was replaced by a file's.
    Loaded {
        /// The file.
        file: String,
        /// How many objects it holds.
        objects: usize,
    },
}

/// An answer about one object.
#[derive(Clone, Debug, PartialEq)]
pub enum ObjectReply {
    /// Its `world_from_object`.
    Pose(Isometry3<f64>),
    /// It was put elsewhere.
    Put,
    /// It was turned to angles.
    Turned,
    /// It was turned to a rotation matrix.
    TurnedTo,
    /// Its pose is the simulator's.
    AsSimulated,
    /// It is one of these now.
    Class(ObjectClass),
    /// It is gone.
    Removed,
    /// It follows the marker.
    Grabbed,
    /// The robot has no such marker: nothing holds the object any longer.
    Released,
}

/// A change that can be taken back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Change {
    /// This object was made.
    Made(String),
    /// This object was moved, turned, removed, or made of another class.
    Changed(String),
    /// All objects were removed.
    Cleared,
    /// The world was replaced by this file's.
    Loaded(String),
}

/// Why the world does not do what it was asked.
#[derive(Clone, Debug, PartialEq)]
pub enum WorldRefusal {
    /// There is no such request.
    Unknown,
    /// There is no such geometry.
    UnknownGeometry,
    /// A size is not above zero.
    NotPositive(Size),
    /// A new object needs so many sizes and a position, and nothing else.
    NewObject {
        /// How many sizes its geometry has.
        sizes: usize,
    },
    /// No number is left to name an object by.
    NoNumberLeft,
    /// A position is three numbers.
    Position,
    /// A rotation is three angles, or a matrix that is one.
    Rotation,
    /// The simulator's pose is six numbers.
    SimulatorPose,
    /// There is no such class of objects.
    UnknownClass,
    /// The period of a synchronization is a number.
    Period,
    /// A file is a bare name.
    FileName,
    /// There is no object of this name.
    NoObject(String),
    /// The object is persistent and stays.
    Persistent,
    /// There is no such robot.
    NoRobot,
    /// The scene does not take the change.
    Scene(SceneError),
    /// There are as many objects as there may be.
    Full {
        /// How many.
        most: usize,
    },
    /// There is no change to take back.
    NothingToUndo,
    /// The last change can't be taken back now.
    NotUndone(Box<WorldRefusal>),
    /// Changes come too quickly.
    Busy {
        /// How many may come in a second.
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
    /// Writing or reading broke off, for this reason.
    NotDone(String),
}

impl WorldRequest {
    /// Whether it may change something, the world or a file; what is malformed counts as what it was meant to be.
    pub fn is_change(&self) -> bool {
        match self {
            WorldRequest::Help | WorldRequest::List | WorldRequest::Synchronize => false,
            // what is grabbed is brought after its marker later, and counted then
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
    /// The shape in the model.
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
