//! Jogging: moves a few motors at a time by velocity streams, position setpoints or moves, like an
//! operator at a panel.

use super::{Dice, open, seal};
use mobee_contract::*;
use mobee_planning::group;
use mobee_planning::short_way::{nearest_position, nearest_target};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::Duration;

/// Settings of the kind `jog`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JogSettings {
    /// Names of parts or motors to move, such as `["torso", "r_elbow"]`; a part stands for all of its motors.
    pub motors: Vec<String>,
    /// Ways to move, one of which is drawn for each motion.
    #[serde(default = "velocities")]
    pub by: Vec<JogBy>,
    /// Maximum number of motors to move at once; the others stay where they are.
    #[serde(default = "two")]
    pub at_once: usize,
    /// Number of motions to make; 0: unlimited.
    #[serde(default = "ten")]
    pub count: u32,
    /// Maximum share of a motor's maximum speed, above 0 and up to 1. Each motor's own speed is
    /// drawn between a third of this and all of it.
    #[serde(default = "tenth")]
    pub speed: f64,
    /// Duration of a stream, seconds: minimum and maximum.
    #[serde(default = "some_seconds")]
    pub lasts_s: [f64; 2],
    /// Ranges to stay in, in degrees, by motor, such as `{ torso_yaw = [-20, 20] }`; default: the motor's limits. A stream
    /// reverses at their ends.
    #[serde(default)]
    pub range_deg: BTreeMap<String, [f64; 2]>,
    /// Seed of the motions; default: derived from the run's seed.
    #[serde(default)]
    pub seed: Option<u64>,
}

/// Command mode of a jogging motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JogBy {
    /// A stream of velocities.
    Velocity,
    /// A stream of position setpoints, which the board follows at once. Requires a board that
    /// accepts them.
    Position,
    /// A move in which each motor has its own speed. Combined with other modes, it also takes
    /// motors over from a stream.
    Move,
}

fn velocities() -> Vec<JogBy> {
    vec![JogBy::Velocity]
}

fn two() -> usize {
    2
}

fn ten() -> u32 {
    10
}

fn tenth() -> f64 {
    0.1
}

fn some_seconds() -> [f64; 2] {
    [1.0, 4.0]
}

/// Minimum share of the setting `speed` that a motor is given.
const MIN_SPEED_SHARE: f64 = 1.0 / 3.0;
/// Time until other motors join a stream or its motors change their speeds, seconds: minimum and
/// maximum.
const JOIN_INTERVAL_S: std::ops::Range<f64> = 0.3..1.5;
/// Longest time that a setpoint advances by, seconds: after a pause in the readings a stream
/// continues from its last setpoint.
const MAX_STEP_S: f64 = 0.05;

/// Moves a few motors at a time.
pub struct Jog {
    /// Motor, and lower and upper bound of its range, rad.
    ranges: Vec<(usize, f64, f64)>,
    settings: JogSettings,
    seed: u64,
    rng: ChaCha8Rng,
    reached: u32,
    failed: u32,
    stream: Option<JogStream>,
}

/// A stream in progress.
struct JogStream {
    by: JogBy,
    /// Time at which it ends.
    until: Time,
    /// Time at which the next motors join.
    turn: Time,
    /// Time of its last setpoint.
    at: Time,
    motors: BTreeMap<usize, JoggedMotor>,
}

/// A motor of a stream.
struct JoggedMotor {
    range: (f64, f64),
    /// Commanded position, rad.
    q: f64,
    /// Commanded velocity, rad/s.
    speed: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct JogState {
    dice: Dice,
    reached: u32,
    failed: u32,
}

impl Jog {
    /// Creates an agent from its settings.
    ///
    /// # Errors
    /// An unknown motor, or an invalid speed, number or time, each with the path of its setting.
    pub fn new(settings: JogSettings, context: &Context) -> Result<Jog, KindError> {
        let motors = group::motors("motors", &settings.motors, &context.robot);
        let [least, most] = settings.lasts_s;
        let lasts = group::seconds("lasts_s[0]", least).and_then(|_| group::seconds("lasts_s[1]", most));
        KindError::gather([
            motors.clone().map(drop),
            group::speed("speed", settings.speed).map(drop),
            lasts.map(drop),
            some("by", !settings.by.is_empty(), "give at least one of velocity, position and move"),
            some("at_once", settings.at_once > 0, "give at least 1"),
            some("lasts_s", least <= most, "give the shorter time first"),
        ])?;
        let ranges = group::ranges("range_deg", &settings.range_deg, &motors?, &context.robot)?;
        let seed = settings.seed.unwrap_or(context.seed);
        let rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(Jog { ranges, settings, seed, rng, reached: 0, failed: 0, stream: None })
    }

    /// Draws some of the motors, each once, with its range, rad, and a speed of its own, rad/s.
    fn draw(&mut self, view: &View) -> Vec<(usize, (f64, f64), f64)> {
        let n = self.rng.random_range(1..=self.settings.at_once.min(self.ranges.len()).max(1));
        let mut left = self.ranges.clone();
        let mut drawn = Vec::new();
        while drawn.len() < n && !left.is_empty() {
            let (m, min, max) = left.swap_remove(self.rng.random_range(0..left.len()));
            let share = self.settings.speed * self.rng.random_range(MIN_SPEED_SHARE..=1.0);
            let speed = share * view.axes.get(m).map_or(0.0, |axis| axis.max_speed);
            drawn.push((m, group::allowed((min, max), view.axes.get(m)), speed));
        }
        drawn
    }

    fn a_move(&mut self, view: &View) -> Intent {
        let drawn = self.draw(view);
        let q = drawn.iter().map(|(_, (min, max), _)| self.rng.random_range(*min..=*max)).collect();
        let motors = drawn.iter().map(|(m, ..)| *m).collect();
        let speeds = drawn.iter().map(|(.., speed)| *speed).collect();
        Intent::MoveEach(nearest_target(view, Target { motors, q, speed: self.settings.speed }), speeds)
    }

    /// Adds motors to the stream, or changes their speeds.
    fn lead(&mut self, stream: &mut JogStream, view: &View) {
        for (m, range, speed) in self.draw(view) {
            let speed = if self.rng.random() { speed } else { -speed };
            let q = view.pose().get(m).copied().unwrap_or(range.0);
            // The range, shifted to the turn that the motor is in.
            let middle = (range.0 + range.1) / 2.0;
            let turns = nearest_position(view, m, middle) - middle;
            let range = group::allowed((range.0 + turns, range.1 + turns), view.axes.get(m));
            stream.motors.entry(m).or_insert(JoggedMotor { range, q, speed }).speed = speed;
        }
        let turn = self.rng.random_range(JOIN_INTERVAL_S);
        stream.turn = view.at + Duration::from_secs_f64(turn);
    }
}

impl JogStream {
    /// Computes the next setpoints.
    fn step(&mut self, view: &View) -> Setpoints {
        let secs = view.at.since(self.at).as_secs_f64().min(MAX_STEP_S);
        self.at = view.at;
        let by_velocity = self.by == JogBy::Velocity;
        for (m, led) in &mut self.motors {
            let (min, max) = led.range;
            let here = if by_velocity { view.pose().get(*m).copied() } else { None }.unwrap_or(led.q);
            if here >= max {
                led.speed = -led.speed.abs();
            } else if here <= min {
                led.speed = led.speed.abs();
            }
            let limits = view.axes.get(*m).map_or((min, max), |axis| (axis.min, axis.max));
            led.q = (led.q + led.speed * secs).clamp(limits.0, limits.1);
        }
        let motors = self.motors.keys().copied().collect();
        let values = match self.by {
            JogBy::Velocity => Values::Velocity(self.motors.values().map(|led| led.speed).collect()),
            JogBy::Position | JogBy::Move => Values::Position(self.motors.values().map(|led| led.q).collect()),
        };
        Setpoints { motors, values }
    }
}

fn some(path: &str, is_right: bool, help: &str) -> Result<(), KindError> {
    if is_right { Ok(()) } else { Err(KindError::new(path, format!("{path} can't be used as it is"), help)) }
}

impl Agent for Jog {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        match last {
            Some(MotionEnd::Reached) => self.reached = self.reached.saturating_add(1),
            Some(MotionEnd::Failed) => self.failed = self.failed.saturating_add(1),
            None => {}
        }
        self.stream = None;
        if self.settings.count > 0 && self.reached.saturating_add(self.failed) >= self.settings.count {
            return Intent::Done(Summary {
                text: format!("{} motions went as they were led, {} did not", self.reached, self.failed),
                figures: vec![("reached".into(), self.reached.into()), ("missed".into(), self.failed.into())],
            });
        }
        let k = self.rng.random_range(0..self.settings.by.len().max(1));
        let by = self.settings.by.get(k).copied().unwrap_or(JogBy::Move);
        if by == JogBy::Move {
            return self.a_move(view);
        }
        let [least, most] = self.settings.lasts_s;
        let until = view.at + Duration::from_secs_f64(self.rng.random_range(least..=most));
        let mut stream = JogStream { by, until, turn: view.at, at: view.at, motors: BTreeMap::new() };
        self.lead(&mut stream, view);
        let first = stream.step(view);
        self.stream = Some(stream);
        Intent::Stream(first)
    }

    fn revise(&mut self, view: &View) -> Option<Intent> {
        let mut stream = self.stream.take_if(|stream| view.at < stream.until)?;
        if view.at >= stream.turn {
            self.lead(&mut stream, view);
            if self.settings.by.contains(&JogBy::Move) && self.rng.random_range(0..4) == 0 {
                // The move ends a stream of positions; a stream of velocities continues with the
                // other motors.
                self.stream = Some(stream).filter(|stream| stream.by == JogBy::Velocity);
                return Some(self.a_move(view));
            }
        }
        let next = stream.step(view);
        self.stream = Some(stream);
        Some(Intent::Stream(next))
    }

    fn requirements(&self) -> Requirements {
        Requirements { motors: self.ranges.iter().map(|(m, ..)| *m).collect(), poses: Vec::new() }
    }

    fn export(&self) -> Snapshot {
        let dice = Dice::of(self.seed, &self.rng);
        seal("jog", 1, &JogState { dice, reached: self.reached, failed: self.failed })
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        let state: JogState = open(&from, "jog", 1)?;
        (self.seed, self.rng) = (state.dice.seed, state.dice.rng());
        (self.reached, self.failed, self.stream) = (state.reached, state.failed, None);
        Ok(())
    }
}

fn build(value: &Value, context: &Context) -> Result<Box<dyn Agent>, KindError> {
    Ok(Box::new(Jog::new(settings(value)?, context)?))
}

inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: "jog",
        doc: "Moves a few motors at a time, each at its own speed, and leaves the others alone: by streams of velocities or \
              positions that go quiet after some seconds, or by moves. It does not check for obstacles.",
        schema: || schemars::schema_for!(JogSettings),
        example: |robot| {
            let part = group::example_part(robot).map(|p| &p.name);
            Ok(json!({ "motors": [part], "by": ["velocity", "position", "move"], "count": 0, "speed": 0.2 }))
        },
        build,
    })
}
