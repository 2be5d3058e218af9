//! The planning agent: a tour of goals by a planner alone, for a robot without a map; it builds a
//! map from its plans.
//!
//! ```text
//!             known path, certified           none, or a detour
//!  at ──> goal ──────────────────> drive it      │
//!    ^       └──────────────> RRT-Connect, shorten ──> waypoints become vertices ──> drive it
//!    └── an edge failed: it is removed, its middle is avoided, another seed ──┘
//! ```
//!
//! As for every agent with a map, the [`Walker`] tracks the robot's vertex and the outcome of
//! motions. In addition, an edge is driven only if it has been certified in the current scene. An
//! edge that failed stays removed, and its middle stays avoided, until an object in its way changes
//! (I11). Once the map is full, waypoints that have not been used for the longest time are replaced
//! by new ones.

mod served;
mod settings;
mod ways;

pub use settings::PlanSettings;

use super::tour::{Tour, TourPace, predecessors_map};
use super::{named, open, seal};
use mobee_contract::*;
use mobee_model::{Motor, Robot};
use mobee_planning::group;
use mobee_planning::pair_rules::pair_rules;
use mobee_planning::planners::escape::{caught, escape};
use mobee_planning::planners::{JointPath, NoPath, PathEnd};
use mobee_planning::roadmap::validation::Validation;
use mobee_planning::roadmap::walk::{WalkProgress, WalkStep, Walker};
use mobee_planning::roadmap::{Roadmap, Vertex};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use served::Served;
use std::sync::Arc;
use std::time::Duration;
use ways::{PathQuery, Spent, Ways};

/// Maximum number of plans for one goal; after that the goal counts as missed.
const MAX_PLANS: u32 = 20;
/// Number of plans that exhaust their budget after which the goal counts as missed.
const MAX_EXHAUSTED_PLANS: u32 = 3;
/// Maximum number of motions in a row that end elsewhere than at their vertex.
const MAX_OFF_MAP: u32 = 10;
/// Maximum number of escapes in a row from a start that is too close to an obstacle to plan.
const MAX_ESCAPES: u32 = 20;
/// Maximum length of a known path relative to the straight line or to a new plan; a longer one is a
/// detour.
const MAX_DETOUR: f64 = 1.2;

/// Tours its goals, planning a path to each.
pub struct PlanAgent {
    robot: Arc<Robot>,
    walker: Walker,
    /// Number of vertices that its settings name: the first ones.
    own: usize,
    /// Maximum number of vertices.
    most: usize,
    served: Served,
    goals: Vec<u32>,
    repeat: u32,
    pace: TourPace,
    seed: u64,
    placed: bool,
    ways: Ways,
    /// Vertices still to be visited; the first is the robot's.
    route: Vec<u32>,
    tour: Tour,
    tries: Tries,
    /// Reason why the last missed goal was abandoned.
    why: String,
}

/// Attempts made for the current goal.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tries {
    /// Plans made.
    plans: u32,
    /// Plans that exhausted their budget.
    in_vain: u32,
    /// Motions in a row that ended elsewhere than at their vertex.
    off_map: u32,
    escapes: u32,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanState {
    map: Value,
    progress: WalkProgress,
    tour: Tour,
    tries: Tries,
    spent: Spent,
    served: Served,
}

impl PlanAgent {
    /// Creates an agent from its settings.
    ///
    /// # Errors
    /// Unknown motors and poses, positions outside the limits, duplicate names and a budget of 0,
    /// each with its path.
    pub fn new(settings: PlanSettings, context: &Context) -> Result<PlanAgent, KindError> {
        let robot = context.robot.clone();
        let hand = settings.hand.as_deref();
        let pace = TourPace::new(settings.speed, settings.tolerance_deg, settings.wait_s, hand, &robot);
        let bounds = settings.check_bounds();
        let rules = pair_rules(&settings.may_touch, &settings.pair_clearance_mm);
        let map = named::map(None, &settings.motors, &settings.poses, &robot);
        let tour = map.and_then(|map| Ok((named::goals(&map, &settings.goals)?, map)));
        KindError::gather([
            pace.as_ref().map(drop).map_err(Clone::clone),
            bounds,
            rules.as_ref().map(drop).map_err(Clone::clone),
            tour.as_ref().map(drop).map_err(Clone::clone),
        ])?;
        let pace = pace?;
        let (goals, map) = tour?;
        let seed = settings.seed.unwrap_or(context.seed);
        // Every edge is certified when it is planned. The validator decides what must change before
        // a failed edge is tried again.
        let walker = Walker::new(map, pace.speed, pace.tolerance, seed).with_validation(Validation::Lazy);
        Ok(PlanAgent {
            robot,
            walker,
            own: settings.poses.len(),
            most: settings.vertices,
            served: Served::default(),
            goals,
            repeat: settings.repeat,
            pace,
            seed,
            placed: false,
            ways: Ways::new(settings.planner, seed, settings.budget, rules?),
            route: Vec::new(),
            tour: Tour::default(),
            tries: Tries::default(),
            why: String::new(),
        })
    }

    /// Returns the reason why the last missed goal was abandoned; `None`: no goal was missed.
    pub(super) fn why_missed(&self) -> Option<&str> {
        Some(self.why.as_str()).filter(|why| !why.is_empty())
    }

    /// The map built so far.
    pub fn map(&self) -> &Roadmap {
        &self.walker.map
    }

    /// Makes the robot's configuration a vertex, so that no path has to lead to the map first.
    /// Returns `false` if too many motions in a row ended elsewhere than at their vertex.
    fn stand(&mut self, last: Option<MotionEnd>, view: &View) -> bool {
        let at = self.walker.map.at(view.pose(), self.pace.tolerance);
        if let (Some(MotionEnd::Reached), Some(to)) = (last, self.route.get(1)) {
            self.tries.off_map = if at == Some(*to) { 0 } else { self.tries.off_map + 1 };
        }
        if at.is_none() && self.tries.off_map <= MAX_OFF_MAP {
            self.add(view.pose(), view);
        }
        self.tries.off_map <= MAX_OFF_MAP
    }

    /// Returns the next motion for a robot that rests at the vertex `at`. `None`: this goal is
    /// abandoned.
    fn go(&mut self, at: u32, goal: u32, view: &View) -> Option<Intent> {
        if self.route.get(1) == Some(&at) {
            self.route.remove(0);
        }
        let here = self.walker.map.group(view.pose());
        let leg = PathQuery { map: &self.walker.map, at, here: &here, goal };
        if let Err(e) = self.ways.look(&leg, view) {
            return Some(self.summary(&e.to_string()));
        }
        let on_route = self.route.first() == Some(&at) && self.route.last() == Some(&goal);
        if !(on_route && self.ways.passable(&leg, &self.route)) {
            self.route = self.ways.known(&leg).unwrap_or_default();
            let (length, straight) = self.ways.lengths(&leg, &self.route);
            if self.route.is_empty() || length > MAX_DETOUR * straight {
                if self.tries.plans >= MAX_PLANS {
                    self.why = format!("{MAX_PLANS} plans failed");
                    self.walker.log(format!("goal {goal} is given up after {MAX_PLANS} plans"));
                    return None;
                }
                self.tries.plans += 1;
                match self.ways.plan(&leg) {
                    Ok(path) if self.route.is_empty() || MAX_DETOUR * path.length() < length => {
                        self.enter(&path, at, goal, view)
                    }
                    Err(why) if self.route.is_empty() => return self.without_path(why, goal, view),
                    _ => {}
                }
            }
        }
        self.served.on_the_way(&self.route);
        Some(self.walker.follow(self.route.clone(), view))
    }

    /// Adds a plan to the map and makes it the route.
    fn enter(&mut self, path: &JointPath, at: u32, goal: u32, view: &View) {
        let text = format!("a plan of {} way-points, {:.2} rad", path.poses.len(), path.length());
        self.walker.log(format!("{text}, after {} straight lines", path.evaluations));
        // Extend the route with each vertex: vertices on the route are never replaced.
        self.route = vec![at];
        let inner = path.poses.len().saturating_sub(2);
        for pose in path.poses.iter().skip(1).take(inner) {
            let target = Target { motors: self.walker.map.motors().to_vec(), q: pose.clone(), speed: self.pace.speed };
            let id = self.add(&target.pose(view.pose()), view);
            self.route.push(id);
        }
        self.route.push(goal);
        for (from, to) in self.route.iter().zip(self.route.iter().skip(1)) {
            self.walker.map.join(*from, *to);
        }
    }

    /// Adds a vertex. If the map is full, it replaces the least recently used one.
    fn add(&mut self, q: &[f64], view: &View) -> u32 {
        // An encoder may read slightly beyond a limit.
        let within = |(q, m): (&f64, &Motor)| q.clamp(m.min, m.max);
        let q: Vec<f64> = q.iter().zip(&self.robot.motors).map(within).collect();
        let hand = self.pace.hand.or_else(|| group::hand(&self.robot, self.walker.map.motors()));
        let at = group::marker_at(view, hand, &q);
        let vertex = Vertex { name: None, q, at };
        let id = match self.least() {
            Some(id) => {
                self.walker.replace(id, vertex);
                id
            }
            None => self.walker.map.add(vertex),
        };
        self.served.on_the_way(&[id]);
        id
    }

    /// Returns the vertex to replace if the map is full: never one that the settings name or that
    /// is in use.
    fn least(&self) -> Option<u32> {
        let map = &self.walker.map;
        let named = |id: u32| map.vertex(id).is_none_or(|v| v.name.is_some());
        let may_go = |id: u32| {
            id as usize >= self.own
                && !(named(id) || self.goals.contains(&id) || self.route.contains(&id) || self.walker.needs(id))
        };
        (map.len() >= self.most).then(|| self.served.least(map, may_go)).flatten()
    }

    /// Returns the next step if no plan was found. `None`: the goal is abandoned for now.
    fn without_path(&mut self, why: NoPath, goal: u32, view: &View) -> Option<Intent> {
        let text = why.text(&view.scene, view.robot);
        match why {
            NoPath::Blocked { end: PathEnd::Start, .. } if self.tries.escapes < MAX_ESCAPES => {
                self.tries.escapes += 1;
                let seed = self.seed.wrapping_add(u64::from(self.tries.escapes));
                self.walker.log(format!("no plan: {text}"));
                let out = escape(view, self.walker.map.motors(), &[], self.pace.speed, seed);
                Some(out.map_or(Intent::Wait(Duration::from_secs(1)), Intent::MoveTo))
            }
            NoPath::Exhausted { .. } if self.tries.in_vain + 1 < MAX_EXHAUSTED_PLANS => {
                self.tries.in_vain += 1;
                self.walker.log(format!("no plan to goal {goal}: {text}"));
                Some(Intent::Wait(Duration::from_secs(1)))
            }
            _ => {
                self.walker.log(format!("no plan to goal {goal}, which is given up: {text}"));
                self.why = format!("there is no plan: {text}");
                None
            }
        }
    }

    /// Proceeds to the next goal of the tour.
    fn advance(&mut self, reached: bool) {
        self.tour.advance(reached);
        (self.tries.plans, self.tries.in_vain, self.tries.escapes) = (0, 0, 0);
        self.route.clear();
    }

    fn summary(&mut self, text: &str) -> Intent {
        self.walker.show(Vec::new());
        let progress = self.walker.progress();
        let figures = [
            ("goals_reached", f64::from(self.tour.reached)),
            ("goals_missed", f64::from(self.tour.missed)),
            ("plans", f64::from(self.ways.spent.plans)),
            ("lines_judged", self.ways.spent.lines as f64),
            ("motions_along_edges", f64::from(progress.driven)),
            ("motions_failed", f64::from(progress.failed)),
        ];
        let figures = figures.into_iter().map(|(name, n)| (name.to_owned(), n)).collect();
        Intent::Done(Summary { text: text.to_owned(), figures })
    }
}

impl Agent for PlanAgent {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        let view = &self.ways.ruled(view);
        if !self.placed {
            let hand = self.pace.hand.or_else(|| group::hand(&self.robot, self.walker.map.motors()));
            self.walker.map.place(|q| group::marker_at(view, hand, q));
            self.placed = true;
        }
        if !caught(view) && !self.stand(last, view) {
            return self.summary("motions end, but not within `tolerance_deg` of their pose: make it larger");
        }
        let mut last = last;
        // A tour that needs no motion would loop forever: after each round it waits a second.
        for _ in 0..=2 * self.goals.len() {
            let at = match self.walker.step(last.take(), view) {
                WalkStep::Do(intent) => {
                    // An escape: afterwards the robot rests elsewhere.
                    self.route.clear();
                    return intent;
                }
                WalkStep::Lost(why) => return self.summary(&why),
                WalkStep::Unreachable(_) => continue,
                WalkStep::At(at) => at,
            };
            if self.tour.arrived(&self.goals, at) {
                self.advance(true);
                if !self.pace.wait.is_zero() {
                    return Intent::Wait(self.pace.wait);
                }
            }
            match self.tour.goal(&self.goals, self.repeat) {
                Err(why) => return self.summary(why),
                Ok(goal) if goal == at => {}
                Ok(goal) => match self.go(at, goal, view) {
                    Some(intent) => return intent,
                    None => self.advance(false),
                },
            }
        }
        Intent::Wait(Duration::from_secs(1))
    }

    fn notes(&mut self) -> Vec<Note> {
        self.walker.notes()
    }

    fn recall(&mut self, past: &[Note]) {
        self.walker.map.recall(past);
    }

    fn requirements(&self) -> Requirements {
        named::requirements(&self.walker.map, 0..self.own)
    }

    fn export(&self) -> Snapshot {
        let map = self.walker.map.export(&self.robot);
        let progress = self.walker.progress().clone();
        let spent = self.ways.spent;
        let tour = self.tour.clone();
        let tries = self.tries.clone();
        let served = self.served.clone();
        seal("plan", 2, &PlanState { map, progress, tour, tries, spent, served })
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        let state: PlanState = open(&from, "plan", 2)?;
        let map = predecessors_map(&state.map, &self.walker.map, &self.goals, &self.robot)?;
        self.walker.resume(map, state.progress);
        (self.placed, self.tour, self.tries) = (true, state.tour, state.tries);
        (self.ways.spent, self.served) = (state.spent, state.served);
        self.route.clear();
        Ok(())
    }
}

fn build(value: &Value, context: &Context) -> Result<Box<dyn Agent>, KindError> {
    Ok(Box::new(PlanAgent::new(settings(value)?, context)?))
}

inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: "plan",
        doc: "Tours goals, planning a path to each: RRT-Connect and shortcuts, on straight lines that are \
              certified free in the current scene. It needs no map; paths that it has found are used again \
              while they are free. After a failed motion it plans around the place of the failure.",
        schema: || schemars::schema_for!(PlanSettings),
        example: |robot| {
            let pose = |name, share| json!({ "name": name, "q_deg": group::example_pose(robot, share) });
            Ok(json!({
                "poses": [pose("rest", 0.0), pose("out", 0.2)],
                "goals": ["out", "rest"], "wait_s": 0.5, "repeat": 0, "speed": 0.1,
            }))
        },
        build,
    })
}
