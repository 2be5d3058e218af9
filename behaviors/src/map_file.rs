//! Map files: poses, edges, what was certified of them and what was tried, for one robot in one world.
//!
//! ```text
//! text ──parse──> MapFile ──check(robot)──> roadmap ──> an agent plans ──> Roadmap::export ──┐
//!                 MapFile, MapFile ──merge──> MapFile ──text──> file     <──────────────────┘
//!                 of two limbs     ──unite──> of both
//! ```
//!
//! One format serves builders, agents and runs: JSON with one vertex, edge or trial on a line, so that two files can be
//! compared line by line and a complaint names its line. What a robot *is* for a map, and what a world is, is a digest:
//! a map whose robot has changed since is refused and not driven.
//!
//! # Layout, version 2
//! | key | meaning |
//! |---|---|
//! | `version`, `robot`, `motors` | version, the robot's name, the motors that the poses differ in |
//! | `robot_sha256`, `world_sha256` | see [`robot_digest`], [`world_digest`]; a run knows no world, as it may change |
//! | `hand` | the marker whose place `at_m` is |
//! | `certified` | clearance and world for which the edges' verdicts hold |
//! | `vertices` | `id` from 0, `name`, `q_rad` of all of the robot's motors, `at_m` |
//! | `edges` | `from`, `to`, `state`, whether itself `driven`, `cause` of its failure, `verdict` |
//! | `tried` | motions along edges with their outcomes, in order; only ever appended to |
//!
//! Version 1, as earlier runs wrote it, has no digests, verdicts and trials; it is read as it always was.

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

/// The version that is written.
pub const VERSION: u32 = 2;

/// A map file's contents.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapFile {
    /// Version of the layout.
    pub version: u32,
    /// The robot's name.
    pub robot: String,
    /// Digest of the robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_sha256: Option<String>,
    /// Digest of the world that the map was built in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_sha256: Option<String>,
    /// The motors that the poses differ in, by name.
    pub motors: Vec<String>,
    /// The marker whose place is shown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hand: Option<String>,
    /// What the verdicts hold for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certified: Option<Certified>,
    /// Poses, numbered from 0.
    pub vertices: Vec<MapVertex>,
    /// Directed edges.
    pub edges: Vec<MapEdge>,
    /// What was tried.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<TriedMotion>,
}

impl MapFile {
    /// Names the run that made the trials which name none.
    pub fn label(&mut self, run: &str) {
        let new = self.tried.iter_mut().filter(|t| t.run.is_none());
        new.for_each(|t| t.run = Some(run.to_owned()));
    }
}

/// What verdicts hold for.
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
    /// Its number, counted from 0.
    pub id: u32,
    /// Its name, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Positions of all of the robot's motors, rad of encoder.
    pub q_rad: Vec<f64>,
    /// Where the hand is, meters.
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
    /// What is believed of it.
    pub state: EdgeState,
    /// Whether it was itself driven.
    #[serde(default, skip_serializing_if = "is_false")]
    pub driven: bool,
    /// What stood in the way when it failed, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// What it was certified to be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<StoredVerdict>,
}

/// What an edge was certified to be, under what [`MapFile::certified`] says.
#[derive(Clone, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(deny_unknown_fields, tag = "is", rename_all = "snake_case")]
pub enum StoredVerdict {
    /// Free all along.
    Free,
    /// Something is in the way.
    Blocked {
        /// Where it begins, as a share of the way.
        at: f64,
        /// The two shapes, by name; none if a limit or a constraint forbids the place.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        between: Option<[String; 2]>,
        /// The object that is one of them.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        object: Option<String>,
    },
    /// Neither could be shown; counts as blocked.
    Uncertified {
        /// Where, as a share of the way.
        at: f64,
    },
}

impl StoredVerdict {
    /// What is in the way, for people: an object's name, `itself`, `a limit`, `uncertified`; none if nothing is.
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
    /// The run that tried it, once it is over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// From vertex.
    pub from: u32,
    /// To vertex.
    pub to: u32,
    /// Whether it was driven to its end; else it failed.
    pub reached: bool,
    /// What stood in the way, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_false(value: &bool) -> bool {
    !value
}
