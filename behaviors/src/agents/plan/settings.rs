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

/// The largest budget: a typing error must not stop the robot for hours.
const MOST_BUDGET: u64 = 10_000_000;

impl PlanSettings {
    /// Checks the budget.
    ///
    /// # Errors
    /// Nothing, or more than [`MOST_BUDGET`].
    pub(super) fn check_budget(&self) -> Result<(), KindError> {
        let budget = self.budget;
        if (1..=MOST_BUDGET).contains(&budget) {
            return Ok(());
        }
        let help = format!("give a number of straight lines from 1 to {MOST_BUDGET}, such as 20000");
        Err(KindError::new("budget", format!("{budget} is not a valid budget"), help))
    }
}
