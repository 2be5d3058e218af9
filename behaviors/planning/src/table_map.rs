//! A map of pre-grasp poses over a table: the hand slightly above it, palm down, at every position
//! that it can reach.
//!
//! The paper's equations (1)-(4) are combined into one fitness, minimized pose by pose with natural
//! evolution strategies:
//!
//! ```text
//! (1) near home   (2) at a given height over the table   (3) palm toward the table   (4) a given step from its neighbors
//!
//! cell of the table ──growth──> wish ──pose search──> pose, or none ──growth──> next cell ... ──> vertices, k nearest joined
//! ```
//!
//! Equation (4) alone requires only *one* neighbor at the right distance, and poses accumulate on
//! circles. Therefore every search is also given a cell of the table without a pose: cells cover
//! the table without gaps, each is tried from poses of different neighbors, and a cell that stays
//! empty is known to have been tried.
//!
//! [`Growth`] is a state machine that takes the result of each search, independent of the searcher:
//! an interrupted build resumes by replaying the recorded results.

mod cells;
mod growth;
mod hand;
mod pose_search;
mod statistics;

pub use growth::{Growth, PoseWish, Trial};
pub use hand::{HandChain, HandPose};
pub use pose_search::{ACCEPT_ANGLE, ACCEPT_OFFSET, ACCEPT_SPACING, FoundPose, PoseSearch};
pub use statistics::{TableMapFigures, figures};

use crate::group;
use mobee_contract::KindError;
use mobee_model::{Robot, Scene};
use nalgebra::{Unit, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Maximum number of cells of a table.
const MAX_CELLS: f64 = 1e6;

/// Settings of a map, the input file of `mobee roadmap build`.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TableMapSettings {
    /// Seed of all randomness.
    #[serde(default = "one")]
    pub seed: u64,
    /// Robot XML, relative to this file.
    pub robot: PathBuf,
    /// World XML, relative to this file; default: an empty world.
    #[serde(default)]
    pub world: Option<PathBuf>,
    /// Names of parts or motors that the poses differ in; the others stay at home.
    pub motors: Vec<String>,
    /// Marker that represents the hand; default: the marker that most of the motors move.
    #[serde(default)]
    pub hand: Option<String>,
    /// Direction out of the palm in the marker's frame; default: the marker's normal.
    #[serde(default)]
    pub palm: Option<[f64; 3]>,
    /// The table.
    pub table: TableArea,
    /// Height of the hand over the table, millimeters.
    #[serde(default = "eighty")]
    pub offset_mm: f64,
    /// Distance of neighboring poses, measured at the hand, millimeters.
    #[serde(default = "ten")]
    pub spacing_mm: f64,
    /// Maximum number of poses to find.
    #[serde(default = "five_thousand")]
    pub vertices: u32,
    /// Number of nearest poses that every pose is joined to.
    #[serde(default = "eight")]
    pub neighbors: usize,
    /// Minimum distance between all shapes in a pose, millimeters: the reflex's margin plus 2 mm.
    #[serde(default = "twelve")]
    pub clearance_mm: f64,
}

/// Part of a horizontal plane over which poses are searched for, world frame.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TableArea {
    /// Height of the table's top, meters.
    pub height_m: f64,
    /// Range along x, meters.
    pub x_m: [f64; 2],
    /// Range along y, meters.
    pub y_m: [f64; 2],
}

fn one() -> u64 {
    1
}
fn eighty() -> f64 {
    80.0
}
fn ten() -> f64 {
    10.0
}
fn twelve() -> f64 {
    12.0
}
fn five_thousand() -> u32 {
    5000
}
fn eight() -> usize {
    8
}

/// The settings with all names resolved and all numbers checked.
#[derive(Clone, Debug)]
pub struct TableMapPlan {
    /// Motors that the poses differ in, indices into `Robot::motors`.
    pub motors: Vec<usize>,
    /// Marker of the hand, an index into `Robot::markers`.
    pub hand: usize,
    /// Direction out of the palm, in the marker's frame.
    pub palm: Unit<Vector3<f64>>,
    /// The table.
    pub table: TableArea,
    /// Height of the hand over the table, meters.
    pub offset: f64,
    /// Distance between poses, meters.
    pub spacing: f64,
    /// Maximum number of poses.
    pub vertices: usize,
    /// Number of nearest poses that each is joined to.
    pub neighbors: usize,
    /// Clearance between shapes, meters.
    pub clearance: f64,
    /// The seed.
    pub seed: u64,
}

impl TableMapSettings {
    /// Resolves all names for the robot, which must be the first of the scene, and checks all
    /// numbers.
    ///
    /// # Errors
    /// All errors, each with the path of its setting.
    pub fn plan(&self, robot: &Robot) -> Result<TableMapPlan, KindError> {
        let motors = group::motors("motors", &self.motors, robot);
        let hand = group::marker("hand", self.hand.as_deref(), robot);
        let palm = self.palm.map(|[x, y, z]| Unit::try_new(Vector3::new(x, y, z), 1e-6));
        let no_palm = || KindError::new("palm", "this direction has no length", "give a vector, such as [0, -1, 0]");
        let numbers = [
            (within("offset_mm", self.offset_mm, 0.0, 1000.0)),
            (within("spacing_mm", self.spacing_mm, 1.0, 200.0)),
            (within("clearance_mm", self.clearance_mm, 0.0, 500.0)),
            (within("vertices", f64::from(self.vertices), 1.0, 100_000.0)),
            (within("neighbors", self.neighbors as f64, 1.0, 64.0)),
            (within("table.height_m", self.table.height_m, -10.0, 10.0)),
            side("table.x_m", self.table.x_m),
            side("table.y_m", self.table.y_m),
            self.cells(),
        ];
        let lost = matches!(palm, Some(None)).then(no_palm).map_or(Ok(()), Err);
        let checked = [motors.clone().map(drop), hand.clone().map(drop), lost];
        KindError::gather(checked.into_iter().chain(numbers))?;
        let motors = motors?;
        let none = || KindError::new("hand", "the robot has no marker", "add a <marker> to the hand in its file");
        let hand = hand?.or_else(|| group::hand(robot, &motors)).ok_or_else(none)?;
        let marker = robot.markers.get(hand).ok_or_else(none)?;
        Ok(TableMapPlan {
            palm: palm.flatten().unwrap_or(marker.normal),
            motors,
            hand,
            table: self.table,
            offset: self.offset_mm * 1e-3,
            spacing: self.spacing_mm * 1e-3,
            vertices: self.vertices as usize,
            neighbors: self.neighbors,
            clearance: self.clearance_mm * 1e-3,
            seed: self.seed,
        })
    }

    fn cells(&self) -> Result<(), KindError> {
        let along = |[from, to]: [f64; 2]| (to - from) / (self.spacing_mm * 1e-3);
        let cells = along(self.table.x_m) * along(self.table.y_m);
        if cells <= MAX_CELLS || !cells.is_finite() {
            return Ok(());
        }
        let what = format!("the table has {cells:.0} places at this spacing, more than {MAX_CELLS:.0}");
        Err(KindError::new("spacing_mm", what, "choose a larger spacing, or a smaller table"))
    }
}

impl TableMapPlan {
    /// Creates the kinematics of the hand in a scene with the plan's robot as its first.
    pub fn chain(&self, scene: &Scene) -> HandChain {
        HandChain::new(scene, self.hand, self.palm)
    }
}

fn within(path: &str, value: f64, low: f64, high: f64) -> Result<(), KindError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(KindError::new(path, format!("{value} is out of bounds"), format!("give a number from {low} to {high}")))
}

fn side(path: &str, [from, to]: [f64; 2]) -> Result<(), KindError> {
    if from.abs() <= 10.0 && to.abs() <= 10.0 && from < to {
        return Ok(());
    }
    let what = format!("[{from}, {to}] is not a valid side of a table");
    Err(KindError::new(path, what, "give two numbers in meters from -10 to 10, the smaller one first"))
}
