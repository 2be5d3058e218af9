//! Walking a roadmap: CONNECT, GOTO and WAITFORMOTION (Algorithms 1-3) as one small machine.
//!
//! ```text
//!          caught at rest          away from the map            at a vertex
//!  step ──> escape ──────> step ──> CONNECT(q_current) ──> step ──> GOTO(goal): plan, drive one edge ──> step ...
//! ```
//!
//! With a validation mode, paths are certified before they are followed, and what is under way is stopped when an object comes in
//! its way (`validation.rs`). It plans anew at every vertex and commits edge by edge, so the robot's safe pose is always a vertex. WAITFORMOTION is
//! the [`MotionEnd`] that the next [`Walker::step`] is given. Nothing but the pose says where the robot is.

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

/// Escapes tried in a row before the walker waits for help.
const ESCAPES: u32 = 20;
/// How often it waits a second for somebody to take away what holds the robot.
const WAITS: u32 = 60;
/// How often CONNECT may end at its target and yet not at the vertex, in a row.
const CONNECTS: u32 = 10;
/// How often parts of the map are joined.
const JOINS: u32 = 10;
/// How many of the nearest vertices CONNECT checks in the scene before it just tries the nearest.
const CHECKED: usize = 50;

/// What a walker says to its agent.
#[derive(Clone, Debug, PartialEq)]
pub enum WalkStep {
    /// Give this intent; then step again with the motion's end.
    Do(Intent),
    /// The robot rests at this vertex, and no goal is left: choose one.
    At(u32),
    /// No way leads from where the robot rests to this goal, which is dropped: choose another.
    Unreachable(u32),
    /// The robot can't be brought to the map.
    Lost(String),
}

/// What is being done; part of an agent's state, so that a successor understands how the open motion ends.
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
    /// A motion that is no edge: where it leads to was changed on the way, or it was given up.
    Turned,
}

/// What a successor must know besides the map.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WalkProgress {
    doing: Doing,
    goal: Option<u32>,
    /// The last vertex where the robot rested.
    last: Option<u32>,
    escapes: u32,
    waits: u32,
    connects: u32,
    /// Motions committed along edges.
    pub driven: u32,
    /// Motions that failed, of any sort.
    pub failed: u32,
    /// Edges that failed, and what must change before they are tried again; nothing if nothing is certified.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    causes: Vec<FailedEdge>,
    /// What was in the way of edges that failed, where nothing is certified and that is minded.
    #[serde(default, skip_serializing_if = "Blame::is_nobody")]
    blame: Blame,
    /// How often parts of the map were joined by a planner.
    #[serde(default, skip_serializing_if = "is_none")]
    joins: u32,
}

fn is_none(joins: &u32) -> bool {
    *joins == 0
}

/// A roadmap and where on it the robot is going.
pub struct Walker {
    /// The map.
    pub map: Roadmap,
    speed: f64,
    tolerance: f64,
    seed: u64,
    validator: Validator,
    /// Whether vertices on the way are left out where a straight line will do.
    leaps: bool,
    progress: WalkProgress,
    plan: Vec<u32>,
    notes: Vec<Note>,
    said: String,
}

impl Walker {
    /// A walker that moves at this share of the greatest speed, and takes a pose within `tolerance` (rad, every motor) of
    /// a vertex for that vertex. The seed serves escapes.
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
            said: String::new(),
        }
    }

    /// The same with this validation.
    pub fn with_validation(mut self, mode: Validation) -> Walker {
        self.validator = Validator::new(mode, self.map.motors());
        self
    }

    /// The same; where nothing is certified, what was in the way of an edge that failed is minded from then on.
    pub fn with_blame(mut self) -> Walker {
        self.validator = self.validator.blaming();
        self
    }

    /// What is certified of the map.
    pub fn validator(&self) -> &Validator {
        &self.validator
    }

    /// GOTO(goal): taken up by the following steps.
    pub fn goto(&mut self, goal: u32) {
        self.progress.goal = Some(goal);
    }

    /// Drives an edge that begins where the robot rests; `None` if it is found to be blocked instead.
    pub fn drive(&mut self, from: u32, to: u32, view: &View) -> Option<Intent> {
        let admitted = self.validator.admits(&mut self.map, &[from, to], view);
        admitted.then(|| self.follow(vec![from, to], view))
    }

    /// What it has done so far.
    pub fn progress(&self) -> &WalkProgress {
        &self.progress
    }

    /// Takes over another walker's map and progress.
    pub fn resume(&mut self, map: Roadmap, progress: WalkProgress) {
        self.validator = self.validator.renewed(&map);
        self.validator.remember(&progress.causes);
        self.validator.take_blame(&progress.blame);
        (self.map, self.progress) = (map, progress);
    }

    /// Gives the number of a vertex that is not needed ([`Walker::needs`]) to another pose.
    pub fn replace(&mut self, id: u32, vertex: Vertex) {
        self.map.replace(id, vertex);
        self.validator.forget(id);
        self.progress.causes = self.validator.causes();
        self.progress.last = self.progress.last.filter(|last| *last != id);
    }

    /// Whether a vertex has to do with what is being done.
    pub fn needs(&self, id: u32) -> bool {
        let doing = match &self.progress.doing {
            Doing::Driving { from, to } => [*from, *to].contains(&id),
            Doing::Connecting { to, rest } => *to == id || rest.contains(&id),
            Doing::Nothing | Doing::Escaping | Doing::Turned => false,
        };
        doing || self.progress.goal == Some(id)
    }

    /// Joins parts of the map that can't be reached from one another, in the view's scene, by a planner. `hand`: the marker that stands
    /// for a pose. Answers whether there are fewer parts now; after ten times it lets things be as they are.
    pub fn join_islands(&mut self, view: &View, hand: Option<usize>) -> bool {
        let space = (self.progress.joins < JOINS).then(|| JointSpace::of(view, self.map.motors(), 0.0));
        let (Some(Ok(mut space)), Some(rest)) = (space, view.poses.get(view.robot)) else { return false };
        self.progress.joins += 1;
        let seed = self.seed.wrapping_add(u64::from(self.progress.joins));
        let settings = JoinSettings { seed, ..JoinSettings::default() };
        let shown = |q: &[f64]| crate::group::marker_at(view, hand, q);
        let planner = RrtConnect::default();
        let report = self.map.join_islands(&mut space, &planner, settings, rest, &shown, &mut |_| {});
        let ((before, after), vertices) = (report.islands, report.vertices);
        self.log(format!("parts of the map: {before}, joined to {after} by {vertices} more vertices"));
        after < before
    }

    /// What changed since the last call, the map's changes first.
    pub fn notes(&mut self) -> Vec<Note> {
        let mut all = self.map.notes();
        all.append(&mut self.notes);
        all
    }

    /// A line for the event log, unless it was the last one already: a commit that has to wait is given again and again.
    pub fn log(&mut self, text: impl Into<String>) {
        let text = text.into();
        if self.said != text {
            self.said.clone_from(&text);
            self.notes.push(Note::Log { text });
        }
    }

    /// The robot rests; `last` says how the last motion ended.
    pub fn step(&mut self, last: Option<MotionEnd>, view: &View) -> WalkStep {
        let rest = self.settle(last, view);
        self.look(view);
        if caught(view) {
            return self.escape(view);
        }
        (self.progress.escapes, self.progress.waits) = (0, 0);
        // of vertices at one pose the goal is the one that was meant
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

    /// The world may have changed in mid-motion: stops if the rest of the way is not free any more.
    pub fn revise(&mut self, view: &View) -> Option<Intent> {
        self.look(view);
        let to = match &self.progress.doing {
            Doing::Driving { from, to } => self.is_blocked(*from, *to).then_some(*to),
            Doing::Connecting { to, .. } => self.validator.certifies().then_some(*to),
            Doing::Nothing | Doing::Escaping | Doing::Turned => None,
        }?;
        // what blocks an edge may be behind the robot
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

    /// The shortest way of which every edge is certified, if that is asked for.
    fn plan(&mut self, from: u32, to: u32, view: &View) -> Option<Vec<u32>> {
        loop {
            // each turn takes an edge out of the map, so it ends
            let path = self.map.plan(from, to)?;
            if self.validator.admits(&mut self.map, &path, view) {
                return Some(path);
            }
        }
    }

    /// Draws the conclusion from the motion that ended (from `None`, none: it was never begun, or nobody knows); the vertices that CONNECT has not tried yet, if it was at it.
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
        let way = (tries < ESCAPES).then(|| escape(view, self.map.motors(), &toward, self.speed, seed)).flatten();
        self.show(Vec::new());
        if let Some(target) = way {
            self.progress.doing = Doing::Escaping;
            self.log("something touches the resting robot: escaping");
            return WalkStep::Do(Intent::MoveTo(target));
        }
        self.progress.waits += 1;
        if self.progress.waits > WAITS {
            return WalkStep::Lost("something touches the resting robot, and every way out makes it worse".to_owned());
        }
        self.progress.escapes = 0;
        WalkStep::Do(Intent::Wait(Duration::from_secs(1)))
    }

    /// CONNECT(q_current): drives to the nearest vertex whose line is free in the scene; if there is none, to the
    /// nearest that was not tried yet.
    fn connect(&mut self, rest: Option<Vec<u32>>, view: &View) -> WalkStep {
        if self.progress.connects > CONNECTS {
            return WalkStep::Lost(
                "motions end, but not within `tolerance_deg` of their vertex: make it larger".to_owned(),
            );
        }
        let mut rest = rest.unwrap_or_else(|| self.map.by_distance(view.pose()));
        let free = |id: &u32| self.whole(*id, view).is_some_and(|q| line_free(view, &q));
        let chosen = rest.iter().take(CHECKED).position(free);
        let chosen = if self.validator.certifies() {
            // back to where it came from
            let last = rest.iter().position(|id| Some(*id) == self.progress.last && free(id));
            let none = || rest.len();
            chosen.or(last).unwrap_or_else(none)
        } else {
            chosen.unwrap_or(0)
        };
        if chosen >= rest.len() {
            // nearer to something than a plan may be, though not as near as a contact
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

    /// The robot's pose with the group at a vertex.
    fn whole(&self, id: u32, view: &View) -> Option<Vec<f64>> {
        Some(self.target(id, view)?.pose(view.pose()).to_vec())
    }

    /// The commit that drives to a vertex, the short way from where the robot is.
    fn target(&self, to: u32, view: &View) -> Option<Target> {
        Some(nearest_target(view, self.map.target(to, self.speed)?))
    }

    /// Drives the first edge of a path that begins where the robot rests.
    pub fn follow(&mut self, path: Vec<u32>, view: &View) -> Intent {
        let (Some(from), Some(to)) = (path.first().copied(), path.get(1).copied()) else { return Intent::Stop };
        let Some(target) = self.target(to, view) else { return Intent::Stop };
        self.progress.doing = Doing::Driving { from, to };
        self.show(path);
        Intent::MoveTo(target)
    }

    /// Tells the plan if it is news (empty: there is none any more); the rest of the plan that was told before is no news.
    pub fn show(&mut self, path: Vec<u32>) {
        if !(path.len() > 1 && self.plan.ends_with(&path)) && self.plan != path {
            self.notes.push(Note::Plan { path: path.clone() });
        }
        self.plan = path;
    }

    /// Edges out of a vertex that were never tried and are in this state, nearest end first.
    pub fn untried(&self, from: u32, state: EdgeState) -> Vec<u32> {
        self.map.out(from).into_iter().filter(|(_, e)| e.state == state).map(|(to, _)| to).collect()
    }
}
