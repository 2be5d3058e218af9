//! What a user can tell the planning agent.

use crate::agents::named::NamedPose;
use crate::agents::tour::defaults::{half, once, tenth};
use mobee_contract::KindError;
use schemars::JsonSchema;
use serde::Deserialize;

/// Settings of the kind `plan`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanSettings {
    /// The poses that can be gone to, each with a unique name.
    pub poses: Vec<NamedPose>,
    /// Names of parts or motors that the planner moves; default: those that the poses name. The other motors stay where they are.
    #[serde(default)]
    pub motors: Vec<String>,
    /// The poses to go to, in order.
    pub goals: Vec<String>,
    /// How many times to repeat the tour; 0: forever.
    #[serde(default = "once")]
    pub repeat: u32,
    /// How long to rest at each goal, seconds.
    #[serde(default)]
    pub wait_s: f64,
    /// Share of each motor's maximum speed, above 0 and up to 1.
    #[serde(default = "tenth")]
    pub speed: f64,
    /// How near every motor must be to a pose for the robot to count as at that pose, degrees.
    #[serde(default = "half")]
    pub tolerance_deg: f64,
    /// The most straight lines between two poses that the planner may judge for one plan.
    #[serde(default = "budget")]
    pub budget: u64,
    /// The most poses that its map may hold, those named here included. Beyond that, a new way-point takes the place of the one that
    /// was not on the way for the longest time.
    #[serde(default = "vertices")]
    pub vertices: usize,
    /// Seed of the plans; default: derived from the run's seed.
    #[serde(default)]
    pub seed: Option<u64>,
    /// The marker whose position represents each pose in pictures of the plans; default: the one that most of the motors move.
    #[serde(default)]
    pub hand: Option<String>,
}

fn budget() -> u64 {
    20_000
}

fn vertices() -> usize {
    500
}

/// The most vertices, and how many there are beside the named ones at least: room for the longest plan.
const MOST_VERTICES: usize = 100_000;
const ROOM: usize = 50;
/// The largest budget: a typing error must not stop the robot for hours.
const MOST_BUDGET: u64 = 10_000_000;

impl PlanSettings {
    /// Checks budget and size.
    ///
    /// # Errors
    /// A budget of nothing, or of more than [`MOST_BUDGET`]; a map without room, or of more than [`MOST_VERTICES`].
    pub(super) fn check_bounds(&self) -> Result<(), KindError> {
        let within = |path: &str, n: u64, from: u64, to: u64, help: String| {
            let what = format!("{n} is not from {from} to {to}");
            if (from..=to).contains(&n) { Ok(()) } else { Err(KindError::new(path, what, help)) }
        };
        let help = "give a number of straight lines, such as 20000".to_owned();
        let budget = within("budget", self.budget, 1, MOST_BUDGET, help);
        let least = self.poses.len() + ROOM;
        let help = format!("give a number of poses, at least {ROOM} more than are named, such as 500");
        let size = within("vertices", self.vertices as u64, least as u64, MOST_VERTICES.max(least) as u64, help);
        KindError::gather([budget, size]).map(drop)
    }
}
