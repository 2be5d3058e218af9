//! Planners: paths through a known scene.
//!
//! All planners implement [`Planner`]: they take a [`PlanningProblem`] in a [`JointSpace`], and
//! return a [`JointPath`] or the reason why there is none, [`NoPath`]. They are pure: randomness
//! comes from the problem's seed, and the budget is counted in checked straight lines, not in time,
//! so that equal problems have equal results on every machine.
//!
//! ```text
//! View, motors ──> JointSpace (scene compiled once) <──certify── RrtConnect ──> JointPath ──> shorten ──> JointPath
//! ```
//!
//! [`escape`](mod@escape) is older and simpler: it finds the way out of a contact.

mod ao_rrt_connect;
mod draws;
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

/// Start, goals and budget of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanningProblem {
    /// Start positions of the motors of the space, rad.
    pub start: Vec<f64>,
    /// Goals, one at least: positions of the motors, rad, any of which will do. For a continuous joint any turn is
    /// accepted. Goals that can't be used are left out if another one can: [`PlanEnds::refused`].
    pub goals: Vec<Vec<f64>>,
    /// Seed of all randomness.
    pub seed: u64,
    /// Maximum number of straight lines that may be checked.
    pub budget: u64,
}

/// The ends of a problem that a planner can use.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanEnds {
    /// Start, rad.
    pub start: Vec<f64>,
    /// Goals, the one nearest to the start first: each with its index among the problem's goals, and in the turn
    /// nearest to the start.
    pub goals: Vec<(usize, Vec<f64>)>,
    /// Goals that can't be used, by index, each with the reason.
    pub refused: Vec<(usize, NoPath)>,
}

/// Progress of a planner, for a progress bar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlanProgress {
    /// Number of straight lines checked so far.
    pub evaluations: u64,
    /// Number of poses found so far that can be reached from either end.
    pub poses: usize,
}

/// A sequence of configurations. Each straight line between two consecutive ones was certified
/// free.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPath {
    /// Positions of the motors of the space at each waypoint, including start and goal, rad; each
    /// in the turn that is closest to the previous one.
    pub poses: Vec<Vec<f64>>,
    /// Goal that it leads to, an index into [`PlanningProblem::goals`].
    pub goal: usize,
    /// Number of straight lines checked to find it.
    pub evaluations: u64,
}

impl JointPath {
    /// Returns its straight lines.
    pub fn edges(&self) -> impl Iterator<Item = (&[f64], &[f64])> {
        self.poses.iter().zip(self.poses.iter().skip(1)).map(|(a, b)| (a.as_slice(), b.as_slice()))
    }

    /// Returns its length in joint space, rad.
    pub fn length(&self) -> f64 {
        self.edges().map(|(a, b)| apart(a, b)).sum()
    }
}

/// One of the two ends of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PathEnd {
    /// Start configuration.
    Start,
    /// Goal configuration.
    Goal,
}

/// Reason why there is no path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoPath {
    /// An end has another number of positions than the space has motors, or a position that is NaN
    /// or infinite.
    Malformed(PathEnd),
    /// An end is outside the limits of robot or board.
    Limits {
        /// The end.
        end: PathEnd,
        /// The motor outside its limits, an index into `Robot::motors`.
        motor: usize,
    },
    /// An end is not free: a pair is closer than the clearance, or a constraint of the robot is
    /// violated.
    Blocked {
        /// The end.
        end: PathEnd,
        /// The pair that is too close; `None` for a constraint.
        pair: Option<Pair>,
    },
    /// The budget is spent. A path may still exist.
    Exhausted {
        /// Number of straight lines checked.
        evaluations: u64,
    },
    /// The caller stopped the planner.
    Cancelled,
}

impl NoPath {
    /// Describes it for people.
    ///
    /// # Arguments
    /// * `scene`, `robot`: those of the planner's space.
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

/// Finds a path from one configuration to another.
pub trait Planner {
    /// Returns a path of straight lines that are all certified free in this space.
    ///
    /// # Arguments
    /// * `watch`: called with the progress before each batch of straight lines; the planner stops
    ///   if it breaks.
    ///
    /// # Errors
    /// [`NoPath`], the reason why there is none. Only ends that are malformed, blocked or outside
    /// their limits are final.
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

/// Returns the length of the straight line between two configurations, full turns included, rad.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (b - a) * (b - a)).sum::<f64>().sqrt()
}

/// Returns the configuration at a share of the straight line.
fn between(a: &[f64], b: &[f64], share: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + (b - a) * share).collect()
}
