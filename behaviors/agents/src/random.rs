//! Random moves: for demonstrations, for running in a robot, or for collecting data.

use super::{Dice, open, seal};
use mobee_contract::*;
use mobee_planning::group;
use mobee_planning::short_way::nearest_target;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::Duration;

/// Settings of the kind `random`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RandomSettings {
    /// Names of parts or motors to move, such as `["torso", "r_elbow"]`; a part stands for all of its motors.
    pub motors: Vec<String>,
    /// Number of moves to make; 0: unlimited.
    #[serde(default = "ten")]
    pub count: u32,
    /// Share of each motor's maximum speed, above 0 and up to 1.
    #[serde(default = "tenth")]
    pub speed: f64,
    /// Ranges to sample poses from, in degrees, by motor, such as `{ torso_yaw = [-20, 20] }`; default: the motor's limits.
    #[serde(default)]
    pub range_deg: BTreeMap<String, [f64; 2]>,
    /// Time to rest at each pose that was reached, seconds.
    #[serde(default)]
    pub wait_s: f64,
    /// Go only to poses that are free in the scene and satisfy the constraints. The path to them is
    /// not checked.
    #[serde(default)]
    pub checked: bool,
    /// Seed of the moves; default: derived from the run's seed.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub seed: Option<u64>,
}

fn ten() -> u32 {
    10
}

fn tenth() -> f64 {
    0.1
}

/// Maximum number of poses drawn for one move before the agent waits a second for the world to
/// change.
const MAX_DRAWS: usize = 1000;

/// Moves to random configurations within the ranges of its motors.
pub struct Random {
    motors: Vec<usize>,
    /// Motor, and lower and upper bound of its range, rad.
    ranges: Vec<(usize, f64, f64)>,
    wait: Duration,
    settings: RandomSettings,
    seed: u64,
    rng: ChaCha8Rng,
    reached: u32,
    failed: u32,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RandomAgentState {
    dice: Dice,
    reached: u32,
    failed: u32,
}

impl Random {
    /// Creates an agent from its settings.
    ///
    /// # Errors
    /// An unknown motor, or an invalid speed or time, each with the path of its setting.
    pub fn new(settings: RandomSettings, context: &Context) -> Result<Random, KindError> {
        let motors = group::motors("motors", &settings.motors, &context.robot);
        let wait = group::seconds("wait_s", settings.wait_s);
        let speed = group::speed("speed", settings.speed);
        KindError::gather([motors.clone().map(drop), speed.map(drop), wait.clone().map(drop)])?;
        let motors = motors?;
        let wait = wait?;
        let ranges = group::ranges("range_deg", &settings.range_deg, &motors, &context.robot)?;
        let seed = settings.seed.unwrap_or(context.seed);
        let rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(Random { motors, ranges, wait, settings, seed, rng, reached: 0, failed: 0 })
    }

    fn draw(&mut self, view: &View) -> Target {
        let allowed = self.ranges.iter().map(|(m, min, max)| group::allowed((*min, *max), view.axes.get(*m)));
        let q = allowed.map(|(min, max)| self.rng.random_range(min..=max)).collect();
        nearest_target(view, Target { motors: self.motors.clone(), q, speed: self.settings.speed })
    }
}

impl Agent for Random {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        match last {
            Some(MotionEnd::Reached) => self.reached = self.reached.saturating_add(1),
            Some(MotionEnd::Failed) => self.failed = self.failed.saturating_add(1),
            None => {}
        }
        if self.settings.count > 0 && self.reached.saturating_add(self.failed) >= self.settings.count {
            return Intent::Done(Summary {
                text: format!("{} random moves ended at their target, {} did not", self.reached, self.failed),
                figures: vec![("reached".into(), self.reached.into()), ("missed".into(), self.failed.into())],
            });
        }
        if last == Some(MotionEnd::Reached) && !self.wait.is_zero() {
            return Intent::Wait(self.wait);
        }
        for _ in 0..MAX_DRAWS {
            let target = self.draw(view);
            if !self.settings.checked || group::free(view, &target.pose(view.pose())) {
                return Intent::MoveTo(target);
            }
        }
        Intent::Wait(Duration::from_secs(1))
    }

    fn requirements(&self) -> Requirements {
        Requirements { motors: self.motors.clone(), poses: Vec::new() }
    }

    fn export(&self) -> Snapshot {
        let dice = Dice::of(self.seed, &self.rng);
        seal("random", 1, &RandomAgentState { dice, reached: self.reached, failed: self.failed })
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        let state: RandomAgentState = open(&from, "random", 1)?;
        (self.seed, self.rng) = (state.dice.seed, state.dice.rng());
        (self.reached, self.failed) = (state.reached, state.failed);
        Ok(())
    }
}

fn build(value: &Value, context: &Context) -> Result<Box<dyn Agent>, KindError> {
    Ok(Box::new(Random::new(settings(value)?, context)?))
}

inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: "random",
        doc: "Goes to random poses within the limits of a group of motors, a given number of times or forever; if asked to, \
              only to poses that are free in the scene. It leaves collisions on the way to the reflex.",
        schema: || schemars::schema_for!(RandomSettings),
        example: |robot| {
            let motors = [group::example_part(robot).map(|p| &p.name)];
            Ok(json!({ "motors": motors, "count": 0, "speed": 0.1 }))
        },
        build,
    })
}
