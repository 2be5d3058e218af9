//! Planners: ways through a scene that is known.
//!
//! All of them share one small contract, [`Planner`]: a [`PlanningProblem`] in a [`JointSpace`] goes in, and a [`JointPath`] or the
//! reason why there is none, [`NoPath`], comes out. They are pure: randomness comes from the problem's seed, and what they may spend
//! is counted in straight lines that are judged, not in time, so that equal problems have equal answers on every machine.
//!
//! ```text
//! View, motors ──> JointSpace (scene compiled once) <──certify── RrtConnect ──> JointPath ──> shorten ──> JointPath
//! ```
//!
//! [`escape`](mod@escape) is older and asks for less: the way out of a contact.

mod ao_rrt_connect;
pub mod escape;
mod rrt_connect;
mod shortcut;
mod space;
mod tree;

pub use ao_rrt_connect::AoRrtConnect;
pub use rrt_connect::RrtConnect;
pub use shortcut::shorten;
pub use space::JointSpace;

use mobee_model::{Pair, Scene};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::str::FromStr;

/// From where to where, and what it may cost.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanningProblem {
    /// Where the motors of the space are, rad.
    pub start: Vec<f64>,
    /// Where they are to go, rad. Of a motor that turns without end any turn will do.
    pub goal: Vec<f64>,
    /// Seed of everything random.
    pub seed: u64,
    /// The most straight lines that may be judged.
    pub budget: u64,
}

/// How far a planner has come: what a progress bar shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlanProgress {
    /// Straight lines judged so far.
    pub evaluations: u64,
    /// Poses found so far that can be reached from either end.
    pub poses: usize,
}

/// Poses to go through, one after the other: each straight line between two of them was certified free.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPath {
    /// The motors of the space at each way-point, start and goal included, rad; each in the turn that is the shortest way from the
    /// one before.
    pub poses: Vec<Vec<f64>>,
    /// Straight lines that were judged to find it.
    pub evaluations: u64,
}

impl JointPath {
    /// The straight lines that it is made of.
    pub fn edges(&self) -> impl Iterator<Item = (&[f64], &[f64])> {
        self.poses.iter().zip(self.poses.iter().skip(1)).map(|(a, b)| (a.as_slice(), b.as_slice()))
    }

    /// Its length in joint space, rad.
    pub fn length(&self) -> f64 {
        self.edges().map(|(a, b)| apart(a, b)).sum()
    }
}

/// One of the two ends of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PathEnd {
    /// Where the robot is.
    Start,
    /// Where it is to go.
    Goal,
}

/// Why there is no path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoPath {
    /// An end has another number of positions than the space has motors, or one that is no number.
    Malformed(PathEnd),
    /// An end is outside the limits of robot or board.
    Limits {
        /// Which end.
        end: PathEnd,
        /// The motor that can't be there, an index into `Robot::motors`.
        motor: usize,
    },
    /// An end is not free: nearer to something than the clearance, or outside the robot's constraints.
    Blocked {
        /// Which end.
        end: PathEnd,
        /// The two that are too near, unless it is a constraint.
        pair: Option<Pair>,
    },
    /// The budget is spent. There may be a path all the same.
    Exhausted {
        /// Straight lines that were judged.
        evaluations: u64,
    },
    /// Whoever watched it told it to stop.
    Cancelled,
}

impl NoPath {
    /// In words, for people.
    ///
    /// # Arguments
    /// * `scene`, `robot`: those of the space.
    pub fn text(&self, scene: &Scene, robot: usize) -> String {
        let which = |end: &PathEnd| if *end == PathEnd::Start { "where the robot is" } else { "the goal" };
        match self {
            NoPath::Malformed(end) => format!("{} is not a pose of the motors that are moved", which(end)),
            NoPath::Limits { end, motor } => {
                let motors = scene.robots().get(robot).map(|r| &r.motors);
                let name = motors.and_then(|m| m.get(*motor)).map_or("a motor", |m| m.name.as_str());
                format!("{} is outside the limits of {name}", which(end))
            }
            NoPath::Blocked { end, pair: Some((a, b)) } => {
                format!("{} is not free: {} is too near to {}", which(end), scene.shape_name(*a), scene.shape_name(*b))
            }
            NoPath::Blocked { end, pair: None } => format!("{} violates a constraint, or is hardly free", which(end)),
            NoPath::Exhausted { evaluations } => format!("none was found within {evaluations} straight lines"),
            NoPath::Cancelled => "the search was stopped".to_owned(),
        }
    }
}

/// Finds a way from one pose to another.
pub trait Planner {
    /// A path whose straight lines are all certified free in this space.
    ///
    /// # Arguments
    /// * `watch`: told of the progress before each batch of straight lines; a planner stops where it says so.
    ///
    /// # Errors
    /// [`NoPath`] says why there is none. Only ends that are malformed, blocked or outside their limits are final.
    fn plan(
        &self,
        space: &mut JointSpace,
        problem: &PlanningProblem,
        watch: &mut dyn FnMut(PlanProgress) -> ControlFlow<()>,
    ) -> Result<JointPath, NoPath>;
}

/// A planner by its name, as settings and arguments have it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlannerKind {
    /// The first path that is found: [`RrtConnect`].
    #[default]
    RrtConnect,
    /// Shorter paths for more time: [`AoRrtConnect`].
    Aorrtc,
}

impl PlannerKind {
    /// The planner, with its own step.
    ///
    /// # Arguments
    /// * `iterations`: random configurations that AORRTC may spend after the first path.
    pub fn planner(self, iterations: u64) -> Box<dyn Planner + Send> {
        match self {
            PlannerKind::RrtConnect => Box::new(RrtConnect::default()),
            PlannerKind::Aorrtc => Box::new(AoRrtConnect { iterations, ..AoRrtConnect::default() }),
        }
    }
}

impl FromStr for PlannerKind {
    type Err = String;

    fn from_str(name: &str) -> Result<PlannerKind, String> {
        match name {
            "rrt_connect" => Ok(PlannerKind::RrtConnect),
            "aorrtc" => Ok(PlannerKind::Aorrtc),
            _ => Err("the planners are `rrt_connect` and `aorrtc`".to_owned()),
        }
    }
}

/// Length of the straight line between two poses as they are, turns included, rad.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (b - a) * (b - a)).sum::<f64>().sqrt()
}

/// The pose at a share of the straight line.
fn between(a: &[f64], b: &[f64], share: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + (b - a) * share).collect()
}
