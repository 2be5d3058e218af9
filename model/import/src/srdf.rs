//! SRDF: semantic description of a robot in addition to its URDF, written by hand or by MoveIt's setup assistant:
//! groups of joints, named poses, and disabled pairs of links, each with a reason.
//!
//! ```text
//! robot.urdf ──load_link_tree──> LinkTree ──┐
//! robot.srdf ──load_srdf───────────────────┴─> Srdf ──(Robot)──> motors of a group, home pose, pairs by link names
//! ```

mod parts;
mod read;
mod resolve;

pub use read::{load_srdf, parse_srdf};
pub use resolve::{LinkTree, load_link_tree, parse_link_tree};

use std::collections::BTreeMap;

/// Contents of an SRDF. Names are those of the URDF; the reader has warned about names that the URDF does not have.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Srdf {
    /// The robot's name.
    pub name: String,
    /// Groups in file order.
    pub groups: Vec<SrdfGroup>,
    /// Named poses in file order; several groups may have poses of the same name.
    pub states: Vec<SrdfState>,
    /// Disabled pairs of links, each once with the names in alphabetical order, with the reason.
    pub disabled: BTreeMap<(String, String), String>,
    /// Virtual joints, which attach the robot's root to the world.
    pub virtual_joints: Vec<VirtualJoint>,
    /// End effectors.
    pub end_effectors: Vec<EndEffector>,
    /// Passive joints.
    pub passive_joints: Vec<String>,
    /// Unused parts of the file, one line each.
    pub notes: Vec<String>,
}

/// A set of joints that move together, such as an arm. A joint that is included in several ways counts once.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SrdfGroup {
    /// Its name.
    pub name: String,
    /// Joints.
    pub joints: Vec<String>,
    /// Links; each stands for the joint that it is the child of.
    pub links: Vec<String>,
    /// Chains from a base link to a tip link: all joints between them.
    pub chains: Vec<(String, String)>,
    /// Other groups, with all of their joints.
    pub groups: Vec<String>,
}

/// A named pose of a group.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SrdfState {
    /// Its name, such as `home`.
    pub name: String,
    /// The group of the pose; some files do not name one.
    pub group: Option<String>,
    /// Positions by joint, radians or meters; several numbers for a joint with several degrees of freedom.
    pub positions: BTreeMap<String, Vec<f64>>,
}

/// Attachment of the robot's root to the world.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualJoint {
    /// Its name.
    pub name: String,
    /// `fixed`, `planar` or `floating`.
    pub joint_type: String,
    /// The parent frame.
    pub parent_frame: String,
    /// The child link.
    pub child_link: String,
}

/// A group that is the end effector of another one, such as a hand of an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct EndEffector {
    /// Its name.
    pub name: String,
    /// The link that it is attached to.
    pub parent_link: String,
    /// Its own group.
    pub group: String,
    /// The group of the parent link, if the file names it.
    pub parent_group: Option<String>,
}
