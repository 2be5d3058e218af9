//! Map of the reaching agent: postures, rest posture and planned waypoints as vertices of the given
//! roadmap.

use super::aim::ReachHand;
use super::choice::{self, HandChoice};
use super::look::{Gaze, limits};
use super::{ReachAgent, ReachHardware, ReachSettings, ReachTarget};
use mobee_contract::{EdgeState, KindError, Note, View};
use mobee_model::Robot;
use mobee_planning::group;
use mobee_planning::inverse_kinematics::MotorGroup;
use mobee_planning::map_file::{MapFile, unite};
use mobee_planning::planners::{JointSpace, Planner, PlanningProblem, RrtConnect, shorten};
use mobee_planning::roadmap::{Roadmap, Vertex};
use mobee_planning::table_map::HandChain;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// Name of the vertex of the rest posture.
const REST_NAME: &str = "rest";
/// Number of nearest vertices, for each hand, to which lines from the rest posture are certified.
const REST_CANDIDATES: usize = 200;
/// Maximum number of these lines that become edges.
const MAX_REST_EDGES: usize = 12;
/// Maximum number of vertices that the agent adds; after that, each replaces the oldest.
const MAX_OWN_VERTICES: usize = 120;

/// Vertices that the agent added, oldest first: part of its state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Own(Vec<u32>);

/// Creates the initial map and returns it with the vertex of its rest posture.
///
/// # Errors
/// Unknown motors, positions outside the limits, a broken map and an empty group, each with its
/// path.
pub(super) fn begin(settings: &ReachSettings, robot: &Robot) -> Result<(Roadmap, u32), KindError> {
    let mut map = match &settings.map {
        Some(value) => {
            let mut map = Roadmap::of_file(&file(value)?, robot).map_err(|e| e.under("map"))?;
            // Discard its notes: the map's file already records them.
            map.notes();
            map
        }
        None => Roadmap::new(group::motors("motors", &settings.motors, robot)?, robot),
    };
    if settings.map.is_some() && !settings.motors.is_empty() {
        let named = group::motors("motors", &settings.motors, robot)?;
        if named != map.motors() {
            let help = "leave `motors` out: the map defines the motors that it moves";
            return Err(KindError::new("motors", "the map moves other motors", help));
        }
    }
    let mut q = group::home(robot);
    if !settings.rest_deg.is_empty() {
        for (motor, at) in group::positions("rest_deg", &settings.rest_deg, robot)? {
            if !map.motors().contains(&motor) {
                let name = robot.motors.get(motor).map_or("?", |m| m.name.as_str());
                let help = "remove it, or take a map that moves it";
                return Err(KindError::new("rest_deg", format!("the map does not move {name}"), help));
            }
            if let Some(slot) = q.get_mut(motor) {
                *slot = at;
            }
        }
    }
    let known = map.vertices().find(|(_, v)| v.name.as_deref() == Some(REST_NAME) && v.q == q).map(|(id, _)| id);
    let rest = known.unwrap_or_else(|| map.add(Vertex { name: Some(REST_NAME.to_owned()), q, at: [0.0; 3] }));
    Ok((map, rest))
}

/// Reads the given map: one, or the maps of several arms combined.
fn file(value: &Value) -> Result<MapFile, KindError> {
    let Value::Array(values) = value else { return MapFile::from_value(value).map_err(|e| e.under("map")) };
    let read = |(i, value): (usize, &Value)| MapFile::from_value(value).map_err(|e| e.under(&format!("map[{i}]")));
    let maps = KindError::gather(values.iter().enumerate().map(read))?;
    let help = "give maps that `mobee roadmap build` made for this robot in one world, one for each arm";
    unite(&maps).map_err(|e| KindError::new("map", e.to_string(), help))
}

impl ReachAgent {
    /// Initializes, once, everything that depends on robot and board, the positions at which the
    /// map's vertices are drawn, and the edges of the rest posture.
    pub(super) fn prepare(&mut self, view: &View) {
        if self.ready.is_some() {
            return;
        }
        let hands: Vec<ReachHand> = (0..self.hands.len()).filter_map(|i| self.ready_hand(i, view)).collect();
        let of = |q: &[f64]| hands.get(choice::side(&hands, q).unwrap_or(0));
        self.walker.map.place(|q| of(q).map_or([0.0; 3], |hand| hand.chain.at(q).at.coords.into()));
        let gaze = self.gaze_plan.clone().map(|plan| Gaze::new(plan, &self.robot, view));
        self.ready = Some(ReachHardware { hands, gaze });
        if !std::mem::replace(&mut self.mind.joined, true) {
            self.join_rest(view);
        }
    }

    /// Returns a hand of the agent, an index, with the motors that may move it: those of the map
    /// that do not move only another hand.
    fn ready_hand(&self, hand: usize, view: &View) -> Option<ReachHand> {
        let (marker, palm) = *self.hands.get(hand)?;
        let movers = |marker: usize| -> BTreeSet<usize> {
            let marker = self.robot.markers.get(marker);
            marker.into_iter().flat_map(|marker| group::movers(&self.robot, marker.node)).collect()
        };
        let own = movers(marker);
        let other = self.hands.iter().flat_map(|(other, _)| movers(*other)).filter(|m| !own.contains(m));
        let other: BTreeSet<usize> = other.collect();
        let rest = self.walker.map.vertex(self.rest).map_or(&[][..], |v| &v.q);
        let (others, motors): (Vec<usize>, Vec<usize>) =
            self.walker.map.motors().iter().partition(|m| other.contains(m));
        let others = others.into_iter().map(|m| (m, rest.get(m).copied().unwrap_or(0.0))).collect();
        let chain = HandChain::of_robot(&view.scene, view.robot, marker, palm);
        let group = MotorGroup { limits: limits(&motors, &self.robot, view), motors };
        Some(ReachHand { chain, group, others, palm: self.palm_toward })
    }

    /// Joins the rest posture, for each hand, to nearby vertices that a free line leads to.
    fn join_rest(&mut self, view: &View) {
        self.look_at_scene(view);
        let (map, Some(space), Some(ready)) = (&mut self.walker.map, self.space.as_mut(), &self.ready) else { return };
        let Some(rest) = map.vertex(self.rest).map(|v| v.q.clone()) else { return };
        let from = map.group(&rest);
        let all: Vec<u32> = map.by_distance(&rest).into_iter().filter(|id| *id != self.rest).collect();
        for hand in 0..ready.hands.len() {
            let is_of = |id: &u32| map.vertex(*id).is_some_and(|v| choice::side(&ready.hands, &v.q) == Some(hand));
            let near: Vec<u32> = all.iter().copied().filter(is_of).take(REST_CANDIDATES).collect();
            let to: Vec<Vec<f64>> = near.iter().filter_map(|id| Some(map.group(&map.vertex(*id)?.q))).collect();
            let free = space.free_lines(to.iter().map(|to| (from.as_slice(), to.as_slice())));
            for (id, _) in near.iter().zip(free).filter(|(_, free)| *free).take(MAX_REST_EDGES) {
                map.join(self.rest, *id);
            }
        }
    }

    /// Updates the joint space of the map's motors to the current scene.
    pub(super) fn look_at_scene(&mut self, view: &View) {
        let motors = self.walker.map.motors();
        let mut space = JointSpace::renewed(self.space.take(), view, motors, 0.0).ok();
        if let Some(space) = &mut space {
            space.stand(&view.scene, &view.poses);
        }
        self.space = space;
    }

    /// Adds a vertex for a posture: a new one, or a replacement of the agent's oldest vertex that
    /// is not in use.
    fn add(&mut self, q: &[f64], view: &View) -> u32 {
        let pose = self.walker.map.whole(view.pose(), q);
        // An encoder may read slightly beyond a limit.
        let pose: Vec<f64> = pose.iter().zip(&self.robot.motors).map(|(q, m)| q.max(m.min).min(m.max)).collect();
        let hands = self.ready.as_ref().map_or(&[][..], |ready| &ready.hands);
        let hand = hands.get(choice::side(hands, &pose).unwrap_or(0));
        let at = hand.map_or([0.0; 3], |hand| hand.chain.at(&pose).at.coords.into());
        let vertex = Vertex { name: None, q: pose, at };
        let here = self.walker.map.at(view.pose(), f64::to_radians(1.0));
        let place = self.mind.place.clone();
        let used = |id: u32| {
            place.as_ref().is_some_and(|p| p.pre == id || p.grasp == id) || self.walker.needs(id) || here == Some(id)
        };
        let room = self.mind.own.0.len() < MAX_OWN_VERTICES;
        let oldest = self.mind.own.0.iter().position(|id| !used(*id)).filter(|_| !room);
        let id = match oldest {
            Some(i) => {
                let id = self.mind.own.0.remove(i);
                self.walker.replace(id, vertex);
                id
            }
            None => self.walker.map.add(vertex),
        };
        self.noted.remove(&id);
        self.mind.own.0.push(id);
        id
    }

    /// Adds postures to the map.
    pub(super) fn enter(&mut self, choice: HandChoice, object: Vector3<f64>, view: &View) -> ReachTarget {
        let pre = self.add(&choice.pre, view);
        let grasp = self.add(&choice.grasp, view);
        if choice.is_joined {
            self.walker.map.join(choice.vertex, pre);
        }
        self.walker.map.join(pre, grasp);
        ReachTarget { object: object.into(), hand: choice.hand, from: choice.vertex, pre, grasp }
    }

    /// Returns whether the straight line from the robot's configuration to a vertex is free.
    pub(super) fn is_straight(&mut self, to: u32, view: &View) -> bool {
        self.look_at_scene(view);
        let Some(q) = self.walker.map.vertex(to).map(|v| self.walker.map.group(&v.q)) else { return false };
        let here = self.walker.map.group(view.pose());
        let Some(space) = self.space.as_mut() else { return false };
        let here = space.within(&here);
        let q = space.toward(&here, &q);
        space.all_free([(here.as_slice(), q.as_slice())])
    }

    /// Plans from the robot's vertex to a vertex that no path leads to, and adds the path to the
    /// map. `None`: planning is not possible; otherwise the outcome, with the reason of a failure.
    pub(super) fn plan(&mut self, goal: u32, view: &View) -> Option<Result<(), String>> {
        self.look_at_scene(view);
        let at = self.walker.map.at(view.pose(), self.settings.tolerance_deg.to_radians())?;
        let goal_pose = self.walker.map.vertex(goal).map(|v| v.q.clone())?;
        let to = self.walker.map.group(&goal_pose);
        let here = self.walker.map.group(view.pose());
        let space = self.space.as_mut()?;
        // An arm that rests is not moved by another arm's plan.
        let is_its = |hand: &&ReachHand| hand.is_alone(view.pose()) && hand.is_alone(&goal_pose);
        let hand = self.ready.as_ref().and_then(|ready| ready.hands.iter().find(is_its));
        space.hold(hand.map_or(&[], |hand| &hand.others));
        let seed = self.seed.wrapping_add(u64::from(self.mind.counts.planned)).wrapping_add(u64::from(self.mind.plans));
        let budget = self.settings.budget;
        let problem = PlanningProblem { start: space.within(&here), goals: vec![to], seed, budget };
        let path = match RrtConnect::default().plan(space, &problem, &mut |_| ControlFlow::Continue(())) {
            Ok(path) => shorten(space, path, seed, budget),
            Err(why) => return Some(Err(why.text(&view.scene, view.robot))),
        };
        self.mind.counts.planned += 1;
        let inner = path.poses.len().saturating_sub(2);
        let failed = self.walker.map.edge(at, goal).is_some_and(|e| e.state == EdgeState::Removed);
        if inner == 0 && failed {
            return Some(Err("the straight line is free, and yet it failed".to_owned()));
        }
        let mut before = at;
        for pose in path.poses.iter().skip(1).take(inner) {
            let id = self.add(pose, view);
            self.walker.map.join(before, id);
            before = id;
        }
        self.walker.map.join(before, goal);
        self.walker.log(format!("no way over the map: a plan of {inner} way-points leads there"));
        Some(Ok(()))
    }

    /// Returns the notes of walker and agent. Vertices of a plan that were not noted yet, such as
    /// those of the map's file, are noted before it.
    pub(super) fn pending_notes(&mut self) -> Vec<Note> {
        let mut all = Vec::new();
        for note in self.walker.notes() {
            match &note {
                Note::Vertex { id, .. } => drop(self.noted.insert(*id)),
                Note::Plan { path } => {
                    for id in path.iter().filter(|id| !self.noted.contains(id)) {
                        let vertex = self.walker.map.vertex(*id);
                        all.extend(vertex.map(|v| Note::Vertex { id: *id, q: v.q.clone(), at: v.at }));
                    }
                    self.noted.extend(path);
                }
                _ => {}
            }
            all.push(note);
        }
        all
    }
}
