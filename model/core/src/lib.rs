//! Geometric model: robots, world and collision engine.
//!
//! Contains the reader of robot files (ZRP XML), forward kinematics, the tables of pairs that may touch, and the
//! collision engine. Input: files and configurations; output: transforms, contacts and distances. It does not depend on
//! actors, clocks or drivers.
//!
//! ```text
//! robot.xml ──zrp──> Robot ──┐
//! robot.urdf ───────> Robot ──┤   (by `mobee-import`: with disabled pairs and a collision-free home)
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
mod field;
mod hull;
mod kinematics;
mod law;
mod mesh;
mod parts;
mod random_poses;
mod robot;
mod scene;
mod shape;
mod shared_list;
mod sweep;
mod watch;
mod zrp;

pub use engine::{
    Collider, DefaultEngine, Engine, IndexPair, LineQuery, LineResult, Near, PairProximity, Proximity, ScalarEngine,
    SweptPair, distance, distances_from_hull,
};
pub use field::Field;
pub use hull::{Hull, Hulls, MAX_HULL_POINTS};
pub use kinematics::MarkerPose;
pub use law::{ForceLaw, Influences, JointLaw};
pub use mesh::Mesh;
pub use mobee_text::{
    Excerpt, FileError, Loaded, file, hidden_in, is_hidden, nearest, printable, readable, suggestion,
};
pub use parts::RobotParts;
pub use random_poses::random_poses;
pub use robot::*;
pub use scene::*;
pub use shape::{BoundingCapsule, InnerCapsule, Primitive, Shape};
pub use sweep::Sweep;
pub use watch::{PairGroups, Watch, WatchCounters};
pub use zrp::{load_robot, load_world, parse_robot, parse_world, write_robot, write_world};
