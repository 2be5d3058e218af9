//! Map files: poses, edges, their certificates and the motions tried, for one robot in one world.
//!
//! ```text
//! text ──parse──> MapFile ──check(robot)──> roadmap ──> an agent plans ──> Roadmap::export ──┐
//!                 MapFile, MapFile ──merge──> MapFile ──text──> file     <──────────────────┘
//!                 of two limbs     ──unite──> of both
//! ```
//!
//! Builders, agents and runs use one format: JSON with one vertex, edge or trial per line, so that
//! two files can be compared line by line and an error names its line. Robot and world are
//! identified by digests: a map of a robot that has changed since is rejected.
//!
//! # Layout, version 2
//! | key | meaning |
//! |---|---|
//! | `version`, `robot`, `motors` | version, the robot's name, the motors that the poses differ in |
//! | `robot_sha256`, `world_sha256` | see [`robot_digest`], [`world_digest`]; a run writes no world, as it may change |
//! | `hand` | the marker at position `at_m` |
//! | `certified` | clearance and world for which the verdicts of the edges hold |
//! | `vertices` | `id` from 0, `name`, `q_rad` of all of the robot's motors, `at_m` |
//! | `edges` | `from`, `to`, `state`, whether `driven` itself, `cause` of its failure, `verdict` |
//! | `tried` | motions along edges with their outcomes, in order; append-only |
//!
//! Version 1, written by earlier versions of the program, has no digests, verdicts and trials; it
//! is still read.

mod certify;
mod identity;
mod merge;
mod place;
mod read;
mod text;
mod unite;

pub use certify::certify;
pub use identity::{robot_digest, world_digest};
pub use merge::{MergeRefusal, merge};
pub use place::span;
pub use read::MapFault;
pub use unite::unite;

use mobee_contract::EdgeState;
use serde::{Deserialize, Serialize};

/// Version that is written.
pub const VERSION: u32 = 2;

/// Contents of a map file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapFile {
    /// Version of the format.
    pub version: u32,
    /// Name of the robot.
    pub robot: String,
    /// Digest of the robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_sha256: Option<String>,
    /// Digest of the world that the map was built in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_sha256: Option<String>,
    /// Names of the motors that the poses differ in.
    pub motors: Vec<String>,
    /// Marker that represents a pose in drawings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hand: Option<String>,
    /// Conditions under which the verdicts hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certified: Option<Certified>,
    /// Poses, numbered from 0.
    pub vertices: Vec<MapVertex>,
    /// Directed edges.
    pub edges: Vec<MapEdge>,
    /// Motions that were tried.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<TriedMotion>,
}

impl MapFile {
    /// Sets the run of the trials that have none.
    pub fn label(&mut self, run: &str) {
        let new = self.tried.iter_mut().filter(|t| t.run.is_none());
        new.for_each(|t| t.run = Some(run.to_owned()));
    }
}

/// Conditions under which verdicts hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certified {
    /// Digest of the world.
    pub world_sha256: String,
    /// Clearance between shapes, meters.
    pub clearance_m: f64,
}

/// A pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapVertex {
    /// Number of the pose, counted from 0.
    pub id: u32,
    /// Name of the pose, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Positions of all of the robot's motors, rad at the encoder.
    pub q_rad: Vec<f64>,
    /// Position of the hand, meters.
    pub at_m: [f64; 3],
}

/// A directed edge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapEdge {
    /// From vertex.
    pub from: u32,
    /// To vertex.
    pub to: u32,
    /// State of the edge.
    pub state: EdgeState,
    /// The edge itself was driven.
    #[serde(default, skip_serializing_if = "is_false")]
    pub driven: bool,
    /// Obstacle at its failure, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// Its certificate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<StoredVerdict>,
}

/// Certificate of an edge, under the conditions of [`MapFile::certified`].
#[derive(Clone, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(deny_unknown_fields, tag = "is", rename_all = "snake_case")]
pub enum StoredVerdict {
    /// Free along its whole length.
    Free,
    /// Blocked by an obstacle.
    Blocked {
        /// Position of the obstacle, as a share of the edge.
        at: f64,
        /// Names of the two shapes; `None` if a limit or a constraint is violated.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        between: Option<[String; 2]>,
        /// Name of the object that is one of them.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        object: Option<String>,
    },
    /// Neither could be proved; counts as blocked.
    Uncertified {
        /// Position of the unproved part, as a share of the edge.
        at: f64,
    },
}

impl StoredVerdict {
    /// Names the obstacle, for people: an object's name, `itself`, `a limit`, `uncertified`; `None`
    /// if the edge is free.
    pub fn blocked_by(&self) -> Option<&str> {
        match self {
            StoredVerdict::Free => None,
            StoredVerdict::Uncertified { .. } => Some("uncertified"),
            StoredVerdict::Blocked { object: Some(object), .. } => Some(object),
            StoredVerdict::Blocked { between: Some(_), .. } => Some("itself"),
            StoredVerdict::Blocked { .. } => Some("a limit"),
        }
    }
}

/// A motion along an edge that was tried.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TriedMotion {
    /// Run that tried it, once it is over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// From vertex.
    pub from: u32,
    /// To vertex.
    pub to: u32,
    /// The motion ended at `to`; otherwise it failed.
    pub reached: bool,
    /// Obstacle, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_false(value: &bool) -> bool {
    !value
}
