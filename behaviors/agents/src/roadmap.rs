//! The roadmap agent: CONNECT and GOTO over given poses, for a tour of goals (Algorithms 1-3,
//! figure 5).

use super::named::{self, NamedPose};
use super::tour::defaults::{half, once, tenth};
use super::tour::{Tour, TourPace, predecessors_map};
use super::{open, seal};
use mobee_contract::*;
use mobee_model::Robot;
use mobee_planning::group;
use mobee_planning::roadmap::Roadmap;
use mobee_planning::roadmap::validation::Validation;
use mobee_planning::roadmap::walk::{WalkProgress, WalkStep, Walker};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;

/// Settings of the kind `roadmap`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoadmapSettings {
    /// Poses of the roadmap, each with a unique name.
    #[serde(default)]
    pub poses: Vec<NamedPose>,
    /// Pairs of poses to join, in both directions, such as `[["a", "b"], ["b", "c"]]`.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub edges: Vec<[String; 2]>,
    /// Number of nearest poses that every pose is joined to, in addition to `edges`.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub neighbors: usize,
    /// Roadmap to start from: a map file, as `mobee roadmap build` or a run wrote it, or its JSON.
    /// Goals and edges refer to its poses by name or number.
    #[serde(default)]
    #[schemars(extend("format" = "roadmap"))]
    pub map: Option<Value>,
    /// Names of parts or motors that the roadmap moves; default: those that the poses name.
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
    /// Validation of edges: `optimistic` tries them without a check, `lazy` certifies them in the
    /// model before they are driven, `verified` before they are used in a plan.
    #[serde(default)]
    pub validation: Validation,
    /// Join parts of the map that can't be reached from the robot's position to the rest by a
    /// planner (RRT-Connect and shortcuts, certified in the model), if no path leads to a goal.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub join: bool,
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

/// Tours its goals over a roadmap.
pub struct RoadmapAgent {
    robot: Arc<Robot>,
    walker: Walker,
    /// Number of vertices that its settings name: the last ones.
    own: usize,
    goals: Vec<u32>,
    repeat: u32,
    pace: TourPace,
    join: bool,
    /// True if the hand positions of the vertices, for drawings, have been computed.
    placed: bool,
    tour: Tour,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RoadmapAgentState {
    map: Value,
    progress: WalkProgress,
    tour: Tour,
}

impl RoadmapAgent {
    /// Creates an agent from its settings.
    ///
    /// # Errors
    /// Unknown motors and poses, positions outside the limits, duplicate names and a broken map,
    /// each with its path.
    pub fn new(settings: RoadmapSettings, context: &Context) -> Result<RoadmapAgent, KindError> {
        let robot = context.robot.clone();
        let hand = settings.hand.as_deref();
        let pace = TourPace::new(settings.speed, settings.tolerance_deg, settings.wait_s, hand, &robot);
        let tour = map(&settings, &robot).and_then(|map| Ok((goals(&settings, &map)?, map)));
        KindError::gather([
            pace.as_ref().map(drop).map_err(Clone::clone),
            tour.as_ref().map(drop).map_err(Clone::clone),
        ])?;
        let pace = pace?;
        let (goals, map) = tour?;
        let walker = Walker::new(map, pace.speed, pace.tolerance, context.seed).with_validation(settings.validation);
        let own = settings.poses.len();
        Ok(RoadmapAgent {
            robot,
            walker,
            own,
            goals,
            repeat: settings.repeat,
            pace,
            join: settings.join,
            placed: false,
            tour: Tour::default(),
        })
    }

    /// The current roadmap.
    pub fn map(&self) -> &Roadmap {
        &self.walker.map
    }

    fn summary(&mut self, text: &str) -> Intent {
        self.walker.show(Vec::new());
        let progress = self.walker.progress();
        let edges = self.walker.map.edges();
        let removed = edges.iter().filter(|(.., e)| e.state == EdgeState::Removed).count();
        let figures = [
            ("goals_reached", f64::from(self.tour.reached)),
            ("goals_missed", f64::from(self.tour.missed)),
            ("edges_removed", removed as f64),
            ("motions_along_edges", f64::from(progress.driven)),
            ("motions_failed", f64::from(progress.failed)),
        ];
        let blocked = edges.iter().filter(|(.., e)| e.state == EdgeState::Blocked).count();
        let blocked = self.walker.validator().certifies().then_some(("edges_blocked", blocked as f64));
        let figures = figures.into_iter().chain(blocked).map(|(name, n)| (name.to_owned(), n)).collect();
        Intent::Done(Summary { text: text.to_owned(), figures })
    }
}

impl Agent for RoadmapAgent {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        let hand = self.pace.hand.or_else(|| group::hand(&self.robot, self.walker.map.motors()));
        if !self.placed {
            self.walker.map.place(|q| group::marker_at(view, hand, q));
            self.placed = true;
        }
        let mut last = last;
        // A tour that needs no motion would loop forever: after each round it waits a second.
        for _ in 0..=2 * self.goals.len() {
            match self.walker.step(last.take(), view) {
                WalkStep::Do(intent) => return intent,
                WalkStep::Lost(why) => return self.summary(&why),
                WalkStep::Unreachable(goal) if self.join && self.walker.join_islands(view, hand) => {
                    self.walker.goto(goal);
                    continue;
                }
                WalkStep::Unreachable(goal) => {
                    self.walker.log(format!("no way leads to goal {goal}"));
                    self.tour.advance(false);
                }
                WalkStep::At(at) if self.tour.arrived(&self.goals, at) => {
                    self.tour.advance(true);
                    if !self.pace.wait.is_zero() {
                        return Intent::Wait(self.pace.wait);
                    }
                }
                WalkStep::At(_) => {}
            }
            match self.tour.goal(&self.goals, self.repeat) {
                Ok(goal) => self.walker.goto(goal),
                Err(why) => return self.summary(why),
            }
        }
        Intent::Wait(Duration::from_secs(1))
    }

    fn revise(&mut self, view: &View) -> Option<Intent> {
        self.walker.revise(view)
    }

    fn notes(&mut self) -> Vec<Note> {
        self.walker.notes()
    }

    fn recall(&mut self, past: &[Note]) {
        self.walker.map.recall(past);
    }

    fn requirements(&self) -> Requirements {
        let all = self.walker.map.len();
        named::requirements(&self.walker.map, all.saturating_sub(self.own)..all)
    }

    fn export(&self) -> Snapshot {
        let map = self.walker.map.export(&self.robot);
        seal(
            "roadmap",
            1,
            &RoadmapAgentState { map, progress: self.walker.progress().clone(), tour: self.tour.clone() },
        )
    }

    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        let state: RoadmapAgentState = open(&from, "roadmap", 1)?;
        let map = predecessors_map(&state.map, &self.walker.map, &self.goals, &self.robot)?;
        self.walker.resume(map, state.progress);
        (self.placed, self.tour) = (true, state.tour);
        Ok(())
    }
}

fn map(settings: &RoadmapSettings, robot: &Robot) -> Result<Roadmap, KindError> {
    let mut map = named::map(settings.map.as_ref(), &settings.motors, &settings.poses, robot)?;
    let edges = settings.edges.iter().enumerate().map(|(i, [a, b])| {
        let ends = KindError::gather([
            named::find(&map, &format!("edges[{i}][0]"), a),
            named::find(&map, &format!("edges[{i}][1]"), b),
        ])?;
        if a == b {
            let what = format!("this edge leads from {a:?} to itself");
            return Err(KindError::new(format!("edges[{i}]"), what, "name two poses"));
        }
        Ok(ends)
    });
    for ends in KindError::gather(edges)? {
        if let [a, b] = ends[..] {
            map.join(a, b);
        }
    }
    if settings.neighbors > 0 {
        map.join_nearest(settings.neighbors);
    }
    Ok(map)
}

/// Looks up the goals. Without a given map, each must be reachable from the first.
fn goals(settings: &RoadmapSettings, map: &Roadmap) -> Result<Vec<u32>, KindError> {
    let goals = named::goals(map, &settings.goals)?;
    let Some(first) = goals.first() else { return Ok(goals) };
    if settings.map.is_some() {
        // An earlier run may rightly have removed the last path to a goal.
        return Ok(goals);
    }
    let reach = map.reach(*first);
    KindError::gather(goals.iter().zip(&settings.goals).enumerate().map(|(i, (goal, name))| {
        if reach.contains_key(goal) {
            return Ok(());
        }
        let what = format!("no path leads from {:?} to {name:?}", settings.goals.first().map_or("", |g| g));
        Err(KindError::new(format!("goals[{i}]"), what, "join the poses by `edges`, or set `neighbors`"))
    }))?;
    Ok(goals)
}

fn build(value: &Value, context: &Context) -> Result<Box<dyn Agent>, KindError> {
    Ok(Box::new(RoadmapAgent::new(settings(value)?, context)?))
}

inventory::submit! {
    Registered(&Kind::<dyn Agent> {
        name: "roadmap",
        doc: "Tours goals over a roadmap of given poses. Every edge is assumed to be feasible until it \
              fails; then that edge is removed, the robot returns to the start of the edge, and the next \
              best path is planned.",
        schema: || schemars::schema_for!(RoadmapSettings),
        example: |robot| {
            let pose = |name, share| json!({ "name": name, "q_deg": group::example_pose(robot, share) });
            Ok(json!({
                "poses": [pose("rest", 0.0), pose("half_way", 0.1), pose("out", 0.2)],
                "edges": [["rest", "half_way"], ["half_way", "out"]],
                "goals": ["out", "rest"], "wait_s": 0.5, "repeat": 0, "speed": 0.1,
            }))
        },
        build,
    })
}
