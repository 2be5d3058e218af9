//! Motion along a roadmap: CONNECT, GOTO and WAITFORMOTION (Algorithms 1-3) as one small state
//! machine.
//!
//! ```text
//!          in contact at rest      not at a vertex              at a vertex
//!  step ──> escape ──────> step ──> CONNECT(q_current) ──> step ──> GOTO(goal): plan, drive one edge ──> step ...
//! ```
//!
//! With a validation mode, paths are certified before they are followed, and a motion is stopped
//! when an object enters its path (`validation.rs`). The walker replans at every vertex and commits
//! edge by edge, so the robot's safe pose is always a vertex. WAITFORMOTION is the [`MotionEnd`]
//! passed to the next [`Walker::step`]. The robot's vertex is determined from its configuration
//! alone.

mod far;

use crate::group::cause;
use crate::planners::escape::{caught, escape, line_free};
use crate::planners::{JointSpace, RrtConnect};
use crate::roadmap::join::JoinSettings;
use crate::roadmap::validation::{Blame, EdgeChange, FailedEdge, Validation, Validator};
use crate::roadmap::{Roadmap, Vertex};
use crate::short_way::{nearest_position, nearest_target};
use mobee_contract::{EdgeState, Intent, MotionEnd, Note, Target, View};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Maximum number of escapes in a row before the walker waits for help.
const MAX_ESCAPES: u32 = 20;
/// Maximum number of waits, one second each, for the object in contact to be removed.
const MAX_WAITS: u32 = 60;
/// Maximum number of times in a row that CONNECT may reach its target without being at the vertex.
const MAX_CONNECTS: u32 = 10;
/// Maximum number of times that parts of the map are joined.
const MAX_JOINS: u32 = 10;
/// Number of nearest vertices that CONNECT checks in the scene before it tries the nearest
/// unchecked.
const CHECKED_VERTICES: usize = 50;

/// Result of a step, for the agent.
#[derive(Clone, Debug, PartialEq)]
pub enum WalkStep {
    /// Return this intent; then step again with the end of the motion.
    Do(Intent),
    /// The robot rests at this vertex without a goal: choose one.
    At(u32),
    /// No path leads from the robot's vertex to this goal, which is dropped: choose another.
    Unreachable(u32),
    /// The robot can't be brought to the map, with the reason.
    Lost(String),
}

/// Current activity; part of an agent's state, so that a successor can interpret the end of the
/// open motion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Doing {
    #[default]
    Nothing,
    Escaping,
    Connecting {
        to: u32,
        rest: Vec<u32>,
    },
    Driving {
        from: u32,
        to: u32,
    },
    /// A motion that is not along an edge: it was redirected on the way, or aborted.
    Turned,
}

/// State that a successor needs besides the map.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WalkProgress {
    doing: Doing,
    goal: Option<u32>,
    /// Last vertex at which the robot rested.
    last: Option<u32>,
    escapes: u32,
    waits: u32,
    connects: u32,
    /// Number of motions committed along edges.
    pub driven: u32,
    /// Number of motions that failed, of any kind.
    pub failed: u32,
    /// Edges that failed, with the objects that must change before they are tried again; empty if
    /// nothing is certified.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    causes: Vec<FailedEdge>,
    /// Obstacles of edges that failed, checked although nothing is certified.
    #[serde(default, skip_serializing_if = "Blame::is_empty")]
    blame: Blame,
    /// Number of times that parts of the map were joined by a planner.
    #[serde(default, skip_serializing_if = "is_none")]
    joins: u32,
}

fn is_none(joins: &u32) -> bool {
    *joins == 0
}

/// A roadmap, and the robot's motion on it.
pub struct Walker {
    /// The map.
    pub map: Roadmap,
    speed: f64,
    tolerance: f64,
    seed: u64,
    validator: Validator,
    /// Skip vertices of a path if a straight line is free.
    leaps: bool,
    progress: WalkProgress,
    plan: Vec<u32>,
    notes: Vec<Note>,
    last_log: String,
}

impl Walker {
    /// Creates a walker. `speed`: share of the maximum speed. `tolerance`: maximum distance of
    /// every motor from a vertex to count as at it, rad. `seed`: for escapes and joins.
    pub fn new(map: Roadmap, speed: f64, tolerance: f64, seed: u64) -> Walker {
        Walker {
            validator: Validator::new(Validation::Optimistic, map.motors()),
            map,
            speed,
            tolerance,
            seed,
            leaps: false,
            progress: WalkProgress::default(),
            plan: Vec::new(),
            notes: Vec::new(),
            last_log: String::new(),
        }
    }

    /// Sets the validation mode.
    pub fn with_validation(mut self, mode: Validation) -> Walker {
        self.validator = Validator::new(mode, self.map.motors());
        self
    }

    /// Makes it check the obstacles of failed edges even if nothing is certified.
    pub fn with_blame(mut self) -> Walker {
        self.validator = self.validator.blaming();
        self
    }

    /// Validator of the map.
    pub fn validator(&self) -> &Validator {
        &self.validator
    }

    /// Sets the goal of the following steps (GOTO).
    pub fn goto(&mut self, goal: u32) {
        self.progress.goal = Some(goal);
    }

    /// Drives an edge that starts at the robot's vertex; `None` if it is blocked.
    pub fn drive(&mut self, from: u32, to: u32, view: &View) -> Option<Intent> {
        let admitted = self.validator.admits(&mut self.map, &[from, to], view);
        admitted.then(|| self.follow(vec![from, to], view))
    }

    /// Progress so far.
    pub fn progress(&self) -> &WalkProgress {
        &self.progress
    }

    /// Takes over another walker's map and progress.
    pub fn resume(&mut self, map: Roadmap, progress: WalkProgress) {
        self.validator = self.validator.renewed(&map);
        self.validator.remember(&progress.causes);
        self.validator.take_blame(&progress.blame);
        self.map = map;
        self.progress = progress;
    }

    /// Assigns the number of a vertex that is not needed ([`Walker::needs`]) to another
    /// configuration.
    pub fn replace(&mut self, id: u32, vertex: Vertex) {
        self.map.replace(id, vertex);
        self.validator.forget(id);
        self.progress.causes = self.validator.causes();
        self.progress.last = self.progress.last.filter(|last| *last != id);
    }

    /// Returns whether the current activity involves a vertex.
    pub fn needs(&self, id: u32) -> bool {
        let doing = match &self.progress.doing {
            Doing::Driving { from, to } => [*from, *to].contains(&id),
            Doing::Connecting { to, rest } => *to == id || rest.contains(&id),
            Doing::Nothing | Doing::Escaping | Doing::Turned => false,
        };
        doing || self.progress.goal == Some(id)
    }

    /// Joins parts of the map that can't be reached from one another, in the view's scene, by a
    /// planner. `hand`: marker that represents a configuration. Returns whether the number of parts
    /// decreased; does nothing after ten calls.
    pub fn join_islands(&mut self, view: &View, hand: Option<usize>) -> bool {
        let space = (self.progress.joins < MAX_JOINS).then(|| JointSpace::of(view, self.map.motors(), 0.0));
        let (Some(Ok(mut space)), Some(rest)) = (space, view.poses.get(view.robot)) else { return false };
        self.progress.joins += 1;
        let seed = self.seed.wrapping_add(u64::from(self.progress.joins));
        let settings = JoinSettings { seed, ..JoinSettings::default() };
        let shown = |q: &[f64]| crate::group::marker_at(view, hand, q);
        let planner = RrtConnect::default();
        let report = self.map.join_islands(&mut space, &planner, settings, rest, &shown, &mut |_| {});
        let (before, after) = report.islands;
        let vertices = report.vertices;
        self.log(format!("parts of the map: {before}, joined to {after} by {vertices} more vertices"));
        after < before
    }

    /// Returns the changes since the last call, those of the map first.
    pub fn notes(&mut self) -> Vec<Note> {
        let mut all = self.map.notes();
        all.append(&mut self.notes);
        all
    }

    /// Logs a line, unless it equals the last one: a commit that has to wait is repeated.
    pub fn log(&mut self, text: impl Into<String>) {
        let text = text.into();
        if self.last_log != text {
            self.last_log.clone_from(&text);
            self.notes.push(Note::Log { text });
        }
    }

    /// Advances while the robot rests; `last`: the end of the last motion.
    pub fn step(&mut self, last: Option<MotionEnd>, view: &View) -> WalkStep {
        let rest = self.settle(last, view);
        self.look(view);
        if caught(view) {
            return self.escape(view);
        }
        (self.progress.escapes, self.progress.waits) = (0, 0);
        // Of several vertices at the same configuration, the goal has priority.
        let there = self.progress.goal.filter(|goal| self.map.is_at(*goal, view.pose(), self.tolerance));
        let Some(at) = there.or_else(|| self.map.at(view.pose(), self.tolerance)) else {
            return self.connect(rest, view);
        };
        (self.progress.last, self.progress.connects) = (Some(at), 0);
        match self.progress.goal {
            Some(goal) if goal != at => match self.plan(at, goal, view) {
                Some(path) => {
                    let path = if self.leaps { self.leap(path, view) } else { path };
                    WalkStep::Do(self.follow(path, view))
                }
                None => {
                    self.progress.goal = None;
                    self.show(Vec::new());
                    WalkStep::Unreachable(goal)
                }
            },
            _ => {
                self.progress.goal = None;
                WalkStep::At(at)
            }
        }
    }

    /// Reacts to a change of the world during a motion: stops if the rest of the path is no longer
    /// free.
    pub fn revise(&mut self, view: &View) -> Option<Intent> {
        self.look(view);
        let to = match &self.progress.doing {
            Doing::Driving { from, to } => self.is_blocked(*from, *to).then_some(*to),
            Doing::Connecting { to, .. } => self.validator.certifies().then_some(*to),
            Doing::Nothing | Doing::Escaping | Doing::Turned => None,
        }?;
        // The obstacle of the edge may be behind the robot.
        let blocked = self.whole(to, view).is_some_and(|q| !line_free(view, &q));
        blocked.then(|| {
            self.log("something came into the way: stopping");
            Intent::Stop
        })
    }

    fn look(&mut self, view: &View) {
        let EdgeChange { blocked, freed } = self.validator.look(&mut self.map, view);
        self.progress.causes = self.validator.causes();
        if blocked + freed > 0 {
            self.log(format!("edges that the world blocks: {blocked} more, {freed} again free"));
        }
    }

    fn is_blocked(&self, from: u32, to: u32) -> bool {
        self.map.edge(from, to).is_some_and(|e| e.state == EdgeState::Blocked)
    }

    /// Returns the shortest path with certified edges, if certification is required.
    fn plan(&mut self, from: u32, to: u32, view: &View) -> Option<Vec<u32>> {
        loop {
            // Each iteration removes an edge from the map, so the loop terminates.
            let path = self.map.plan(from, to)?;
            if self.validator.admits(&mut self.map, &path, view) {
                return Some(path);
            }
        }
    }

    /// Evaluates the motion that ended; `None`: none was started, or its end is unknown. Returns
    /// the vertices that CONNECT has not tried yet, if the motion was one of CONNECT.
    fn settle(&mut self, last: Option<MotionEnd>, view: &View) -> Option<Vec<u32>> {
        if last == Some(MotionEnd::Failed) {
            self.progress.failed = self.progress.failed.saturating_add(1);
        }
        let doing = std::mem::take(&mut self.progress.doing);
        match (&doing, last) {
            (_, None) => {}
            (Doing::Driving { .. }, _) => self.progress.driven = self.progress.driven.saturating_add(1),
            (Doing::Connecting { .. }, Some(MotionEnd::Reached)) => self.progress.connects += 1,
            (Doing::Escaping, _) => self.progress.escapes += 1,
            _ => {}
        }
        match (doing, last) {
            (Doing::Driving { from, to }, Some(MotionEnd::Reached)) => self.map.succeeded(from, to),
            (Doing::Driving { from, to }, Some(MotionEnd::Failed)) => {
                let certified = self.map.edge(from, to).filter(|e| e.state == EdgeState::Blocked);
                let cause = cause(view).or_else(|| certified.and_then(|e| e.cause.clone()));
                let why = cause.as_deref().map(|c| format!(": {c}")).unwrap_or_default();
                self.log(format!("edge {from} -> {to} failed and is removed{why}"));
                self.validator.failed(from, to, view);
                self.progress.blame.clone_from(self.validator.blame());
                self.map.failed(from, to, cause);
            }
            (Doing::Connecting { rest, .. }, Some(MotionEnd::Failed)) => return Some(rest),
            _ => {}
        }
        None
    }

    fn escape(&mut self, view: &View) -> WalkStep {
        let nearest = |q: &Vec<f64>| q.iter().enumerate().map(|(m, q)| nearest_position(view, m, *q)).collect();
        let last = self.progress.last.and_then(|id| self.map.vertex(id));
        let toward: Vec<Vec<f64>> = last.map(|v| nearest(&v.q)).into_iter().collect();
        let tries = self.progress.escapes;
        let seed = self.seed.wrapping_add(u64::from(tries));
        let way = (tries < MAX_ESCAPES).then(|| escape(view, self.map.motors(), &toward, self.speed, seed)).flatten();
        self.show(Vec::new());
        if let Some(target) = way {
            self.progress.doing = Doing::Escaping;
            self.log("something touches the resting robot: escaping");
            return WalkStep::Do(Intent::MoveTo(target));
        }
        self.progress.waits += 1;
        if self.progress.waits > MAX_WAITS {
            return WalkStep::Lost("something touches the resting robot, and every way out makes it worse".to_owned());
        }
        self.progress.escapes = 0;
        WalkStep::Do(Intent::Wait(Duration::from_secs(1)))
    }

    /// CONNECT(q_current): drives to the nearest vertex with a line that is free in the scene;
    /// without one, to the nearest that was not tried yet.
    fn connect(&mut self, rest: Option<Vec<u32>>, view: &View) -> WalkStep {
        if self.progress.connects > MAX_CONNECTS {
            return WalkStep::Lost(
                "motions end, but not within `tolerance_deg` of their vertex: make it larger".to_owned(),
            );
        }
        let mut rest = rest.unwrap_or_else(|| self.map.by_distance(view.pose()));
        let free = |id: &u32| self.whole(*id, view).is_some_and(|q| line_free(view, &q));
        let chosen = rest.iter().take(CHECKED_VERTICES).position(free);
        let chosen = if self.validator.certifies() {
            // Otherwise back to its last vertex.
            let last = rest.iter().position(|id| Some(*id) == self.progress.last && free(id));
            let none = || rest.len();
            chosen.or(last).unwrap_or_else(none)
        } else {
            chosen.unwrap_or(0)
        };
        if chosen >= rest.len() {
            // Too close to something for a plan, but not in contact.
            if !line_free(view, view.pose()) {
                return self.escape(view);
            }
            return WalkStep::Lost("no vertex of the roadmap can be reached from where the robot rests".to_owned());
        }
        let to = rest.remove(chosen);
        let Some(target) = self.target(to, view) else {
            return WalkStep::Lost(format!("there is no vertex {to}"));
        };
        self.log(format!("connecting to vertex {to}"));
        self.progress.doing = Doing::Connecting { to, rest };
        self.show(vec![to]);
        WalkStep::Do(Intent::MoveTo(target))
    }

    /// Returns the robot's configuration with the group at a vertex.
    fn whole(&self, id: u32, view: &View) -> Option<Vec<f64>> {
        Some(self.target(id, view)?.pose(view.pose()).to_vec())
    }

    /// Returns the target of a commit to a vertex, by the short way from the robot's configuration.
    fn target(&self, to: u32, view: &View) -> Option<Target> {
        Some(nearest_target(view, self.map.target(to, self.speed)?))
    }

    /// Drives the first edge of a path that starts at the robot's vertex.
    pub fn follow(&mut self, path: Vec<u32>, view: &View) -> Intent {
        let (Some(from), Some(to)) = (path.first().copied(), path.get(1).copied()) else { return Intent::Stop };
        let Some(target) = self.target(to, view) else { return Intent::Stop };
        self.progress.doing = Doing::Driving { from, to };
        self.show(path);
        Intent::MoveTo(target)
    }

    /// Notes the plan if it is new (empty: there is no plan any longer); the rest of the previous
    /// plan is not new.
    pub fn show(&mut self, path: Vec<u32>) {
        if !(path.len() > 1 && self.plan.ends_with(&path)) && self.plan != path {
            self.notes.push(Note::Plan { path: path.clone() });
        }
        self.plan = path;
    }

    /// Returns the end vertices of edges that leave a vertex and are in this state, nearest first.
    pub fn untried(&self, from: u32, state: EdgeState) -> Vec<u32> {
        self.map.out(from).into_iter().filter(|(_, e)| e.state == state).map(|(to, _)| to).collect()
    }
}
