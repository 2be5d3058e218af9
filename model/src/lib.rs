//! Geometric model: robots, world and collision engine.
//!
//! Contains the readers of robot files (ZRP XML, URDF), forward kinematics, the tables of pairs that may touch, and the
//! collision engine. Input: files and configurations; output: transforms, contacts and distances. It does not depend on
//! actors, clocks or drivers.
//!
//! ```text
//! robot.xml ──zrp──> Robot ──┐
//! robot.urdf ─urdf─> Robot ──┤   (import: with disabled pairs and a collision-free home)
//! world.xml ──world─> Object ┴─> Scene ──(poses)──> transforms, contacts, clearance
//! ```
//!
//! All collision queries go through [`Engine`]. [`DefaultEngine`] selects the implementation in one place, and the
//! types that use it ([`Scene`], [`Watch`], [`Field`]) accept another engine as a type parameter.
//!
//! Units: radians, meters. A motor's position is its encoder value (degrees, or millimeters for prismatic motors) times
//! pi/180.
//! Frames: `world` is the root frame of the first robot; a node's transform is its frame *before* its own motion.

mod continuous_joints;
mod disabled_pairs;
mod engine;
mod error;
mod field;
pub mod file;
mod fit;
mod hull;
mod import;
mod kinematics;
mod law;
mod mesh;
mod parts;
mod printable;
mod robot;
mod scene;
mod shape;
mod shared_list;
mod spelling;
mod srdf;
mod surface;
mod survey;
mod sweep;
mod urdf;
mod watch;
mod xml;
mod zrp;

pub use engine::{
    Collider, DefaultEngine, Engine, IndexPair, LineQuery, LineResult, Near, PairProximity, Proximity, ScalarEngine,
    SweptPair, distance,
};
pub use error::{Excerpt, FileError, Loaded};
pub use field::Field;
pub use fit::{Fit, FitOptions, Fitted, fit_link};
pub use hull::{Hull, Hulls};
pub use import::{IMPORT_SEED, ImportError, ImportOptions, Imported, plain_name, ros_package_folders};
pub use kinematics::MarkerPose;
pub use law::{ForceLaw, Influences, JointLaw};
pub use mesh::Mesh;
pub use parts::RobotParts;
pub use printable::{hidden_in, is_hidden, printable, readable};
pub use robot::*;
pub use scene::*;
pub use shape::{BoundingCapsule, InnerCapsule, Primitive, Shape};
pub use spelling::{nearest, suggestion};
pub use srdf::{
    EndEffector, LinkTree, Srdf, SrdfGroup, SrdfState, VirtualJoint, load_link_tree, load_srdf, parse_link_tree,
    parse_srdf,
};
pub use surface::{LinkSurface, Surfaces, random_poses};
pub use survey::{
    Comparison, ContactCounts, HomePose, PairSurvey, RefitLimits, Refitted, compare, find_disabled_pairs, find_home,
    fit_closer,
};
pub use sweep::Sweep;
pub use urdf::{
    UpAxis, UrdfOptions, UrdfRobot, load_mesh, load_surfaces, load_urdf, load_urdf_with_surfaces, parse_urdf,
};
pub use watch::{PairGroups, Watch, WatchCounters};
pub use zrp::{load_robot, load_world, parse_robot, parse_world, write_robot, write_world};
