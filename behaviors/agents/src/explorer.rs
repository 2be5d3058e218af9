//! The explorer: builds a roadmap of random configurations and drives its edges until its feasible
//! part is determined (paper, 3.1).

use super::tour::defaults::{half, tenth};
use super::{Dice, open, seal};
use mobee_contract::*;
use mobee_model::{Motor, Robot};
use mobee_planning::group;
use mobee_planning::roadmap::validation::Validation;
use mobee_planning::roadmap::walk::{WalkProgress, WalkStep, Walker};
use mobee_planning::roadmap::{Roadmap, Vertex};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Settings of the kind `explorer`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExplorerSettings {
    /// Names of parts or motors to explore with, such as
    /// `["torso", "r_shoulder_pitch", "r_elbow"]`; a part stands for all of its motors. The other
    /// motors stay where they are.
    pub motors: Vec<String>,
    /// Number of random poses in the roadmap.
    #[serde(default = "twenty")]
    pub vertices: usize,
    /// Number of nearest poses that each pose is joined to, in both directions.
    #[serde(default = "ten")]
    #[schemars(extend("expert" = true))]
    pub neighbors: usize,
    /// Share of each motor's maximum speed, above 0 and up to 1.
    #[serde(default = "tenth")]
    pub speed: f64,
    /// Ranges to sample poses from, in degrees, by motor, such as `{ torso_yaw = [-20, 20] }`; default: the motor's limits.
    #[serde(default)]
    pub range_deg: BTreeMap<String, [f64; 2]>,
    /// Maximum number of random poses drawn. Poses that collide or violate a constraint are
    /// discarded.
    #[serde(default = "many")]
    #[schemars(extend("expert" = true))]
    pub samples: usize,
    /// Validation of edges: `optimistic` tries them without a check, `lazy` certifies them in the
    /// model before they are driven, `verified` before they are used in a plan.
    #[serde(default)]
    pub validation: Validation,
    /// Join parts of the map that can't be reached from the robot's position to the rest by a
    /// planner (RRT-Connect and shortcuts, certified in the model), once no other edge is left to
    /// try.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub join: bool,
    /// Seed of all randomness; default: derived from the run's seed.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub seed: Option<u64>,
    /// Maximum distance of every motor from a pose of the roadmap for the robot to count as at that
    /// pose, degrees.
    #[serde(default = "half")]
    #[schemars(extend("expert" = true))]
    pub tolerance_deg: f64,
    /// Marker that represents each pose in drawings of the roadmap; default: the marker that most of the
    /// motors move.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub hand: Option<String>,
}

fn twenty() -> usize {
    20
}

fn ten() -> usize {
    10
}

fn many() -> usize {
    100_000
}

/// Upper bound of the setting `vertices`: a typing error must not exhaust the memory.
const MAX_VERTICES: usize = 100_000;
/// Number of nearest vertices with untried edges that a goal is drawn from, so that the exploration
/// spreads.
const GOAL_CHOICES: usize = 3;
/// Number of rounds, one second apart, that the samples are spread over while fewer than two of
/// them are free: the world may be cleared in the meantime.
const SAMPLING_ROUNDS: usize = 60;

/// Drives untried edges, near ones first, until no untried edge can be reached any more.
pub struct Explorer {
    robot: Arc<Robot>,
    /// Motor, and lower and upper bound of its samples, rad.
    ranges: Vec<(usize, f64, f64)>,
    settings: ExplorerSettings,
    /// Marker that the setting `hand` names.
    hand: Option<usize>,
    walker: Walker,
    /// Number of samples drawn so far.
    drawn: usize,
    /// True if sampling is finished.
    sampled: bool,
    seed: u64,
    rng: ChaCha8Rng,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ExplorerState {
    map: Value,
    progress: WalkProgress,
    #[serde(default)]
    drawn: usize,
    sampled: bool,
    dice: Dice,
}

impl Explorer {
    /// Creates an agent from its settings.
    ///
    /// # Errors
    /// Unknown motors, ranges that are reversed or outside the limits, and numbers out of bounds,
    /// each with the path of its setting.
    pub fn new(settings: ExplorerSettings, context: &Context) -> Result<Explorer, KindError> {
        let robot = context.robot.clone();
        let motors = group::motors("motors", &settings.motors, &robot);
        let ranges = motors.clone().and_then(|motors| group::ranges("range_deg", &settings.range_deg, &motors, &robot));
        let speed = group::speed("speed", settings.speed);
        let tolerance = group::tolerance("tolerance_deg", settings.tolerance_deg);
        let hand = group::marker("hand", settings.hand.as_deref(), &robot);
        KindError::gather([
            ranges.clone().map(drop),
            speed.clone().map(drop),
            tolerance.clone().map(drop),
            hand.clone().map(drop),
            counts(&settings),
        ])?;
        let motors = motors?;
        let ranges = ranges?;
        let speed = speed?;
        let tolerance = tolerance?;
        let hand = hand?;
        let seed = settings.seed.unwrap_or(context.seed);
        let walker = Walker::new(Roadmap::new(motors, &robot), speed, tolerance, seed);
        let walker = walker.with_validation(settings.validation);
        let rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(Explorer { robot, ranges, settings, hand, walker, drawn: 0, sampled: false, seed, rng })
    }

    /// The current roadmap.
    pub fn map(&self) -> &Roadmap {
        &self.walker.map
    }

    /// Adds random configurations that are free at the view's clearance and satisfy all
    /// constraints, and joins each to its nearest ones by optimistic edges. While the map has fewer
    /// than two vertices, a call draws only its round's share of the samples.
    fn sample(&mut self, view: &View) {
        let hand = self.hand.or_else(|| group::hand(&self.robot, self.walker.map.motors()));
        // A motor outside the group that is at home except for encoder noise counts as at home.
        let near_home = 1f64.to_radians();
        let at_home = |(q, m): (&f64, &Motor)| if m.way(*q, m.home).abs() <= near_home { m.home } else { *q };
        let base: Vec<f64> = view.pose().iter().zip(&self.robot.motors).map(at_home).collect();
        let all = self.settings.samples;
        let round = self.drawn.saturating_add(all.div_ceil(SAMPLING_ROUNDS));
        while self.walker.map.len() < self.settings.vertices
            && self.drawn < if self.walker.map.len() < 2 { round.min(all) } else { all }
        {
            self.drawn += 1;
            let mut q = base.clone();
            for (m, min, max) in &self.ranges {
                let (min, max) = group::allowed((*min, *max), view.axes.get(*m));
                let value = if max > min { self.rng.random_range(min..=max) } else { min };
                if let Some(slot) = q.get_mut(*m) {
                    *slot = value;
                }
            }
            if group::free(view, &q) {
                let at = group::marker_at(view, hand, &q);
                self.walker.map.add(Vertex { name: None, q, at });
            }
        }
        self.sampled = self.walker.map.len() >= 2 || self.drawn >= all;
        if !self.sampled {
            self.walker.log("fewer than two free poses were found: looking again, in case the world is cleared");
            return;
        }
        self.walker.map.join_nearest(self.settings.neighbors);
        let vertices = self.walker.map.len();
        let edges = self.walker.map.edges().len();
        let drawn = self.drawn;
        self.walker.log(format!("roadmap of {vertices} poses from {drawn} samples, {edges} directed edges"));
    }

    /// Chooses the next step from a vertex: an optimistic edge that starts here, otherwise the path
    /// to a nearby vertex that has one. Doubtful edges come last. Returns `None` if no untried edge
    /// can be reached.
    fn choose(&mut self, at: u32) -> Option<ExplorerChoice> {
        for state in [EdgeState::Optimistic, EdgeState::Doubtful] {
            let here = self.walker.untried(at, state);
            if let Some(to) = self.one_of(&here) {
                return Some(ExplorerChoice::Drive(to));
            }
            let reach = self.walker.map.reach(at);
            let mut open: Vec<_> = reach
                .iter()
                .filter(|(id, cost)| cost.doubtful == 0 && !self.walker.untried(**id, state).is_empty())
                .map(|(id, cost)| (cost.length, *id))
                .collect();
            open.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let open: Vec<u32> = open.into_iter().map(|(_, id)| id).collect();
            if let Some(goal) = self.one_of(&open) {
                return Some(ExplorerChoice::Goto(goal));
            }
        }
        None
    }

    /// Joins vertices that can't be reached from the rest of the map, or can't be left. Returns
    /// whether the number of disconnected parts decreased.
    fn join(&mut self, view: &View) -> bool {
        let hand = self.hand.or_else(|| group::hand(&self.robot, self.walker.map.motors()));
        self.walker.map.islands().len() > 1 && self.walker.join_islands(view, hand)
    }

    fn one_of(&mut self, nearest_first: &[u32]) -> Option<u32> {
        let n = nearest_first.len().min(GOAL_CHOICES);
        (n > 0).then(|| self.rng.random_range(0..n)).and_then(|i| nearest_first.get(i).copied())
    }

    fn summary(&mut self, at: Option<u32>, text: &str) -> Summary {
        self.walker.show(Vec::new());
        let map = &self.walker.map;
        let reach = at.map(|at| map.reach(at)).unwrap_or_default();
        let lost: Vec<u32> = map.vertices().map(|(id, _)| id).filter(|id| !reach.contains_key(id)).collect();
        let edges = map.edges();
        let in_state = |s: EdgeState| edges.iter().filter(|(.., e)| e.state == s).count();
        let driven = edges.iter().filter(|(.., e)| e.driven).count();
        let open: Vec<String> = edges
            .iter()
            .filter(|(.., e)| matches!(e.state, EdgeState::Optimistic | EdgeState::Doubtful))
            .map(|(a, b, _)| format!("{a} -> {b}"))
            .collect();
        let progress = self.walker.progress();
        let figures = [
            ("vertices", map.len()),
            ("edges", edges.len()),
            ("edges_driven", driven),
            ("edges_feasible", in_state(EdgeState::Feasible)),
            ("edges_removed", in_state(EdgeState::Removed)),
            ("edges_unreachable", open.len()),
            ("vertices_unreachable", lost.len()),
            ("motions_along_edges", progress.driven as usize),
            ("motions_failed", progress.failed as usize),
        ];
        let blocked = [("edges_blocked", in_state(EdgeState::Blocked))];
        let blocked = blocked.into_iter().filter(|_| self.walker.validator().certifies());
        let figures = figures.into_iter().chain(blocked).map(|(name, n)| (name.to_owned(), n as f64)).collect();
        if !lost.is_empty() {
            let names: Vec<String> = lost.iter().map(u32::to_string).collect();
            self.walker.log(format!("vertices that can't be reached: {}", names.join(", ")));
        }
        if !open.is_empty() {
            self.walker.log(format!("edges that can't be reached: {}", open.join(", ")));
        }
        Summary { text: text.to_owned(), figures }
    }
}

enum ExplorerChoice {
    Drive(u32),
    Goto(u32),
}

impl Agent for Explorer {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        if !self.sampled {
            self.sample(view);
            if !self.sampled {
                return Intent::Wait(Duration::from_secs(1));
            }
        }
        if self.walker.map.len() < 2 {
            return Intent::Done(
                self.summary(None, "fewer than two free poses were found: widen the ranges or clear the world"),
            );
        }
        let mut last = last;
        loop {
            match self.walker.step(last.take(), view) {
                WalkStep::Do(intent) => return intent,
                WalkStep::At(at) => match self.choose(at) {
                    Some(ExplorerChoice::Drive(to)) => {
                        if let Some(intent) = self.walker.drive(at, to, view) {
                            return intent;
                        }
                    }
                    Some(ExplorerChoice::Goto(goal)) => self.walker.goto(goal),
                    None if self.settings.join && self.join(view) => {}
                    None => {
                        return Intent::Done(
                            self.summary(Some(at), "the feasible part of the roadmap is completely determined"),
                        );
                    }
                },
                WalkStep::Unreachable(_) => {}
                WalkStep::Lost(why) => return Intent::Done(self.summary(None, &why)),
            }
        }
    }

    fn revise(&mut self, view: &View) -> Option<Intent> {
        self.walker.revise(view)
    }

    fn notes(&mut self) -> Vec<Note> {
        self.walker.notes()
    }

    fn recall(&mut self, past: &[Note]) {
        self.walker.map.recall(past);
        self.sampled = self.walker.map.len() >= 2;
    }

    fn requirements(&self) -> Requirements {
        Requirements { motors: self.walker.map.motors().to_vec(), poses: Vec::new() }
    }

    fn export(&self) -> Snapshot {
        let map = self.walker.map.export(&self.robot);
        let progress = self.walker.progress().clone();
        let dice = Dice::of(self.seed, &self.rng);
        seal("explorer", 1, &ExplorerState { map, progress, drawn: self.drawn, sampled: self.sampled, dice })
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        let state: ExplorerState = open(&from, "explorer", 1)?;
        let map = Roadmap::import(&state.map, &self.robot).map_err(group::state)?;
        if map.motors() != self.walker.map.motors() {
            return Err(Refusal::State { what: "map.motors: the roadmap is one of other motors".to_owned() });
        }
        self.walker.resume(map, state.progress);
        (self.drawn, self.sampled) = (state.drawn, state.sampled);
        (self.seed, self.rng) = (state.dice.seed, state.dice.rng());
        Ok(())
    }
}

/// Checks the numbers of poses, neighbors and samples.
fn counts(settings: &ExplorerSettings) -> Result<(), KindError> {
    let unless = |good: bool, path: &str, what: String, help: &str| {
        if good { Ok(()) } else { Err(KindError::new(path, what, help)) }
    };
    let ExplorerSettings { vertices, neighbors, samples, .. } = settings;
    let help = format!("give a number from 2 to {MAX_VERTICES}, such as 20");
    let size = (2..=MAX_VERTICES).contains(vertices);
    KindError::gather([
        unless(size, "vertices", format!("{vertices} is not a valid roadmap size"), &help),
        unless(
            *neighbors > 0,
            "neighbors",
            "poses without neighbors are never left".into(),
            "give 1 or more, such as 10",
        ),
        unless(
            !size || samples >= vertices,
            "samples",
            format!("{samples} samples can't give {vertices} vertices"),
            "give at least as many samples as vertices, or leave it out",
        ),
    ])?;
    Ok(())
}

fn build(value: &Value, context: &Context) -> Result<Box<dyn Agent>, KindError> {
    Ok(Box::new(Explorer::new(settings(value)?, context)?))
}

inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: "explorer",
        doc: "Builds a roadmap of random free poses, joins each to its nearest ones by unchecked edges, and drives these \
              until every reachable edge is known to be feasible or not. An edge that fails is removed; its opposite \
              is tried last.",
        schema: || schemars::schema_for!(ExplorerSettings),
        example: |robot| {
            let motors = [group::example_part(robot).map(|p| &p.name)];
            Ok(json!({ "motors": motors, "vertices": 12, "neighbors": 4, "speed": 0.1 }))
        },
        build,
    })
}
