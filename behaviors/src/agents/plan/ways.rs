//! Ways to a goal: a known one if it is free now, or a new one by RRT-Connect.

use crate::planners::{JointPath, JointSpace, NoPath, Planner, PlanningProblem, RrtConnect, shorten};
use crate::roadmap::Roadmap;
use mobee_contract::{EdgeState, View};
use mobee_fast::FastError;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// How near its middle other ways may not pass a straight line that failed, as a share of its length.
const AVOID: f64 = 0.2;

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
        Ways { seed, budget, space: None, spent: Spent::default() }
    }

    /// The scene as it is now, in which the middles of the edges that failed are avoided.
    ///
    /// # Errors
    /// A clearance that is none.
    pub fn look(&mut self, leg: &Leg, view: &View) -> Result<(), FastError> {
        let kept = self.space.take().filter(|space| space.fits(view, leg.map.motors()));
        let mut space = kept.map_or_else(|| JointSpace::of(view, leg.map.motors()), Ok)?;
        space.stand(&view.scene, &view.poses);
        space.forgive();
        for (from, to, _) in leg.map.edges().into_iter().filter(|(.., e)| e.state == EdgeState::Removed) {
            let (Some(from), Some(to), Some(goal)) = (leg.pose(from), leg.pose(to), leg.pose(leg.goal)) else {
                continue;
            };
            let to = space.toward(&from, &to);
            let middle: Vec<f64> = from.iter().zip(&to).map(|(a, b)| (a + b) / 2.0).collect();
            // the robot must be able to leave, and to arrive
            let ends = [leg.here, &goal].map(|q| space.metric().distance(q, &middle) / 2.0);
            let radius = ends.into_iter().fold(AVOID * space.metric().distance(&from, &to), f64::min);
            space.avoid(middle, radius);
        }
        self.space = Some(space);
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
        let Some(space) = self.space.as_mut() else { return Err(NoPath::Cancelled) };
        let begun = space.evaluations();
        let problem = PlanningProblem { start: space.within(leg.here), goal, seed, budget: self.budget };
        let found = RrtConnect::default().plan(space, &problem, &mut |_| ControlFlow::Continue(()));
        let found = found.map(|path| {
            let left = self.budget.saturating_sub(path.evaluations);
            shorten(space, path, seed, left)
        });
        self.spent.lines = self.spent.lines.saturating_add(space.evaluations() - begun);
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
