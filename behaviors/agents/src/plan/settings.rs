//! Settings of the planning agent.

use crate::named::NamedPose;
use crate::tour::defaults::{half, once, tenth};
use mobee_contract::KindError;
use mobee_planning::planners::PlannerKind;
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Settings of the kind `plan`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanSettings {
    /// Poses that can be goals, each with a unique name.
    pub poses: Vec<NamedPose>,
    /// Names of parts or motors that the planner moves; default: those that the poses name. The
    /// other motors stay where they are.
    #[serde(default)]
    pub motors: Vec<String>,
    /// Names of the poses to go to, in order.
    pub goals: Vec<String>,
    /// Number of times to repeat the tour; 0: unlimited.
    #[serde(default = "once")]
    pub repeat: u32,
    /// Time to rest at each goal, seconds.
    #[serde(default)]
    pub wait_s: f64,
    /// Share of each motor's maximum speed, above 0 and up to 1.
    #[serde(default = "tenth")]
    pub speed: f64,
    /// Maximum distance of every motor from a pose for the robot to count as at that pose, degrees.
    #[serde(default = "half")]
    #[schemars(extend("expert" = true))]
    pub tolerance_deg: f64,
    /// Pairs `A:B` that may touch in plans, such as the gripper and the object to be picked: names of links, parts and
    /// markers of the robot, of objects, and of other robots. The reflex monitors these pairs as before.
    #[serde(default)]
    pub may_touch: Vec<String>,
    /// Clearances of pairs `A:B` in plans where they are lower than that of all others, mm.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub pair_clearance_mm: BTreeMap<String, f64>,
    /// Planner: `rrt_connect` stops at the first path; `aorrtc` also searches for shorter ones, for 2,000 random configurations or as long as
    /// half of the budget lasts.
    #[serde(default)]
    pub planner: PlannerKind,
    /// Maximum number of straight lines between two poses that the planner may check for one plan.
    #[serde(default = "budget")]
    #[schemars(extend("expert" = true))]
    pub budget: u64,
    /// Maximum number of poses in the map, the named ones included. Once it is full, a new waypoint
    /// replaces the least recently used one.
    #[serde(default = "vertices")]
    #[schemars(extend("expert" = true))]
    pub vertices: usize,
    /// Seed of the plans; default: derived from the run's seed.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub seed: Option<u64>,
    /// Marker that represents each pose in drawings of the plans; default: the marker that most of the
    /// motors move.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub hand: Option<String>,
}

fn budget() -> u64 {
    20_000
}

fn vertices() -> usize {
    500
}

/// Upper bound of the setting `vertices`.
const MAX_VERTICES: usize = 100_000;
/// Minimum number of vertices besides the named ones: room for the longest plan.
const MIN_FREE_VERTICES: usize = 50;
/// Upper bound of the setting `budget`: a typing error must not stop the robot for hours.
const MAX_BUDGET: u64 = 10_000_000;

impl PlanSettings {
    /// Checks the bounds of `budget` and `vertices`.
    ///
    /// # Errors
    /// A budget of 0 or above [`MAX_BUDGET`]; a map without room for a plan, or of more than
    /// [`MAX_VERTICES`] vertices.
    pub(super) fn check_bounds(&self) -> Result<(), KindError> {
        let within = |path: &str, n: u64, from: u64, to: u64, help: String| {
            let what = format!("{n} is not from {from} to {to}");
            if (from..=to).contains(&n) { Ok(()) } else { Err(KindError::new(path, what, help)) }
        };
        let help = "give a number of straight lines, such as 20000".to_owned();
        let budget = within("budget", self.budget, 1, MAX_BUDGET, help);
        let least = self.poses.len() + MIN_FREE_VERTICES;
        let help = format!("give a number of poses, at least {MIN_FREE_VERTICES} more than are named, such as 500");
        let size = within("vertices", self.vertices as u64, least as u64, MAX_VERTICES.max(least) as u64, help);
        KindError::gather([budget, size]).map(drop)
    }
}
