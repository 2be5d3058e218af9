//! Ways to a goal: a known one if it is free now, or a new one by RRT-Connect.

use crate::planners::{JointPath, JointSpace, NoPath, Planner, PlanningProblem, RrtConnect, shorten};
use crate::roadmap::Roadmap;
use mobee_contract::{EdgeState, View};
use mobee_fast::FastError;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// How near its middle other ways may not pass a straight line that failed, as a share of its length.
const AVOID: f64 = 0.2;

/// How much more room than the view's clearance plans leave if they can, meters: a robot does not follow a line exactly.
const ROOM: f64 = 0.006;

/// What was spent on plans: part of an agent's state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Spent {
    pub plans: u32,
    pub lines: u64,
}

/// Finds ways in the scene as it is.
pub(super) struct Ways {
    seed: u64,
    budget: u64,
    space: Option<JointSpace>,
    /// The same with [`ROOM`].
    roomy: Option<JointSpace>,
    pub spent: Spent,
}

/// One question: from where the robot is to a vertex of the map.
pub(super) struct Leg<'a> {
    pub map: &'a Roadmap,
    /// The vertex where the robot rests, and the group's pose as it really is.
    pub at: u32,
    pub here: &'a [f64],
    pub goal: u32,
}

impl Leg<'_> {
    fn pose(&self, id: u32) -> Option<Vec<f64>> {
        self.map.vertex(id).map(|v| self.map.group(&v.q))
    }
}

impl Ways {
    pub fn new(seed: u64, budget: u64) -> Ways {
        Ways { seed, budget, space: None, roomy: None, spent: Spent::default() }
    }

    /// The scene as it is now, in which the middles of the edges that failed are avoided.
    ///
    /// # Errors
    /// A clearance that is none.
    pub fn look(&mut self, leg: &Leg, view: &View) -> Result<(), FastError> {
        for (kept, room) in [(&mut self.space, 0.0), (&mut self.roomy, ROOM)] {
            let motors = leg.map.motors();
            let mut space = JointSpace::renewed(kept.take(), view, motors, room)?;
            space.stand(&view.scene, &view.poses);
            avoid_failed(&mut space, leg);
            *kept = Some(space);
        }
        Ok(())
    }

    /// Whether the first edge of a route is not removed, and free from where the robot really is.
    pub fn passable(&mut self, leg: &Leg, route: &[u32]) -> bool {
        let [from, to, ..] = route[..] else { return false };
        let known = leg.map.edge(from, to).is_some_and(|e| e.state != EdgeState::Removed);
        known && self.free(leg, &[from, to])
    }

    /// The shortest way of the map, if all of it is free now.
    pub fn known(&mut self, leg: &Leg) -> Option<Vec<u32>> {
        leg.map.plan(leg.at, leg.goal).filter(|way| self.free(leg, way))
    }

    /// Whether a way over vertices is free from where the robot really is.
    fn free(&mut self, leg: &Leg, way: &[u32]) -> bool {
        let Some(space) = self.space.as_mut() else { return false };
        let mut poses = vec![leg.here.to_vec()];
        for q in way.iter().skip(1).filter_map(|id| leg.pose(*id)) {
            poses.push(space.toward(poses.last().unwrap_or(&q), &q));
        }
        space.all_free(poses.iter().zip(poses.iter().skip(1)).map(|(a, b)| (a.as_slice(), b.as_slice())))
    }

    /// A new way, shortened. Every call has a seed of its own.
    pub fn plan(&mut self, leg: &Leg) -> Result<JointPath, NoPath> {
        let seed = self.seed.wrapping_add(u64::from(self.spent.plans));
        self.spent.plans = self.spent.plans.saturating_add(1);
        let goal = leg.pose(leg.goal).unwrap_or_default();
        let mut left = self.budget;
        let mut found = Err(NoPath::Cancelled);
        // Half of what may be spent is for a way with room; where an end has none there is none.
        for (space, budget) in [(&mut self.roomy, left / 2), (&mut self.space, left)] {
            let Some(space) = space else { continue };
            let begun = space.evaluations();
            let problem =
                PlanningProblem { start: space.within(leg.here), goal: goal.clone(), seed, budget: budget.min(left) };
            found = RrtConnect::default().plan(space, &problem, &mut |_| ControlFlow::Continue(()));
            left = left.saturating_sub(space.evaluations() - begun);
            let judged = space.evaluations();
            found = found.map(|path| shorten(space, path, seed, left));
            left = left.saturating_sub(space.evaluations() - judged);
            if found.is_ok() {
                break;
            }
        }
        self.spent.lines = self.spent.lines.saturating_add(self.budget - left);
        found
    }

    /// Length of a way over vertices from where the robot is, and of the straight line to the goal, rad.
    pub fn lengths(&self, leg: &Leg, way: &[u32]) -> (f64, f64) {
        let Some(metric) = self.space.as_ref().map(JointSpace::metric) else { return (0.0, 0.0) };
        let far = |a: &[f64], b: Option<Vec<f64>>| b.map_or(0.0, |b| metric.distance(a, &b));
        let along = way.windows(2).filter_map(|w| Some(far(&leg.pose(w[0])?, leg.pose(w[1]))));
        (along.sum(), far(leg.here, leg.pose(leg.goal)))
    }
}

/// The middles of edges that failed are avoided, and nothing else.
fn avoid_failed(space: &mut JointSpace, leg: &Leg) {
    space.forgive();
    for (from, to, _) in leg.map.edges().into_iter().filter(|(.., e)| e.state == EdgeState::Removed) {
        let (Some(from), Some(to), Some(goal)) = (leg.pose(from), leg.pose(to), leg.pose(leg.goal)) else { continue };
        let to = space.toward(&from, &to);
        let middle: Vec<f64> = from.iter().zip(&to).map(|(a, b)| (a + b) / 2.0).collect();
        // the robot must be able to leave, and to arrive
        let ends = [leg.here, &goal].map(|q| space.metric().distance(q, &middle) / 2.0);
        let radius = ends.into_iter().fold(AVOID * space.metric().distance(&from, &to), f64::min);
        space.avoid(middle, radius);
    }
}
