//! SRDF: what a person, or MoveIt's set-up assistant, knows of a robot beyond its URDF: groups of joints, named poses, and pairs of
//! links that need no test, each with its reason.
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

/// What an SRDF says. Names are those of the URDF; which of them the URDF does not have was warned about when it was read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Srdf {
    /// The robot's name.
    pub name: String,
    /// Groups in file order.
    pub groups: Vec<SrdfGroup>,
    /// Named poses in file order; a name may stand for a pose of each of several groups.
    pub states: Vec<SrdfState>,
    /// Pairs of links that need no test, each once with the names in alphabetical order, and why.
    pub disabled: BTreeMap<(String, String), String>,
    /// What the robot stands on.
    pub virtual_joints: Vec<VirtualJoint>,
    /// Hands.
    pub end_effectors: Vec<EndEffector>,
    /// Joints that nothing drives.
    pub passive_joints: Vec<String>,
    /// What is not used of the file, a line each.
    pub notes: Vec<String>,
}

/// A set of joints that move together, such as an arm. What it names in several ways counts once.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SrdfGroup {
    /// Its name.
    pub name: String,
    /// Joints.
    pub joints: Vec<String>,
    /// Links: the joint that leads to each.
    pub links: Vec<String>,
    /// Chains from a base link to a tip link: all joints between.
    pub chains: Vec<(String, String)>,
    /// Other groups, with all of their joints.
    pub groups: Vec<String>,
}

/// A named pose of a group.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SrdfState {
    /// Its name, such as `home`.
    pub name: String,
    /// The group it is a pose of; some files name none.
    pub group: Option<String>,
    /// Positions by joint, radians or meters; several numbers where a joint has several degrees of freedom.
    pub positions: BTreeMap<String, Vec<f64>>,
}

/// How the robot's root stands in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualJoint {
    /// Its name.
    pub name: String,
    /// `fixed`, `planar` or `floating`.
    pub joint_type: String,
    /// The frame that it leaves.
    pub parent_frame: String,
    /// The link that it leads to.
    pub child_link: String,
}

/// A group that ends another one: a hand at an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct EndEffector {
    /// Its name.
    pub name: String,
    /// The link that it hangs on.
    pub parent_link: String,
    /// Its own group.
    pub group: String,
    /// The group of what it hangs on, if the file says so.
    pub parent_group: Option<String>,
}
