//! Paths to a goal: a known one if it is free now, otherwise a new one by RRT-Connect.

use mobee_contract::{EdgeState, View};
use mobee_fast::FastError;
use mobee_model::{PairRule, Scene};
use mobee_planning::planners::{AoRrtConnect, JointPath, JointSpace, NoPath, PlannerKind, PlanningProblem, shorten};
use mobee_planning::roadmap::Roadmap;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::sync::Arc;

/// Radius around the middle of a failed edge that new paths avoid, as a share of the edge's length.
const AVOID_RADIUS_SHARE: f64 = 0.2;

/// Extra clearance that plans leave if possible, meters: a robot does not follow a line exactly.
const EXTRA_CLEARANCE_M: f64 = 0.006;

/// Plans made and straight lines checked so far; part of an agent's state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Spent {
    pub plans: u32,
    pub lines: u64,
}

/// Finds paths in the current scene.
pub(super) struct Ways {
    planner: PlannerKind,
    seed: u64,
    budget: u64,
    /// Rules for pairs, and the last scene with them.
    rules: Vec<PairRule>,
    ruled: Option<Arc<Scene>>,
    space: Option<JointSpace>,
    /// The same space with [`EXTRA_CLEARANCE_M`] added to the clearance.
    roomy: Option<JointSpace>,
    pub spent: Spent,
}

/// A planning query: from the robot's configuration to a vertex of the map.
pub(super) struct PathQuery<'a> {
    pub map: &'a Roadmap,
    /// Vertex where the robot rests.
    pub at: u32,
    /// Measured configuration of the group, rad.
    pub here: &'a [f64],
    pub goal: u32,
}

impl PathQuery<'_> {
    fn pose(&self, id: u32) -> Option<Vec<f64>> {
        self.map.vertex(id).map(|v| self.map.group(&v.q))
    }
}

impl Ways {
    pub fn new(planner: PlannerKind, seed: u64, budget: u64, rules: Vec<PairRule>) -> Ways {
        Ways { planner, seed, budget, rules, ruled: None, space: None, roomy: None, spent: Spent::default() }
    }

    /// Updates the planning spaces to the current scene; the middles of failed edges are avoided.
    ///
    /// # Errors
    /// An invalid clearance.
    pub fn look(&mut self, leg: &PathQuery, view: &View) -> Result<(), FastError> {
        for (kept, room) in [(&mut self.space, 0.0), (&mut self.roomy, EXTRA_CLEARANCE_M)] {
            let motors = leg.map.motors();
            let mut space = JointSpace::renewed(kept.take(), view, motors, room)?;
            space.stand(&view.scene, &view.poses);
            avoid_failed(&mut space, leg);
            *kept = Some(space);
        }
        Ok(())
    }

    /// Returns a view with the rules for pairs in its scene.
    pub fn ruled(&mut self, view: &View) -> View {
        if self.rules.is_empty() {
            return view.clone();
        }
        let known = self.ruled.take().filter(|known| known.epoch() == view.scene.epoch());
        // Names were checked with the configuration; an object may be absent now.
        let rule = || Arc::new(view.scene.with_pair_rules_of_present(view.robot, &self.rules));
        let scene = known.unwrap_or_else(rule);
        self.ruled = Some(scene.clone());
        View { scene, ..view.clone() }
    }

    /// Returns whether the first edge of a route is not removed, and is free from the measured
    /// configuration.
    pub fn passable(&mut self, leg: &PathQuery, route: &[u32]) -> bool {
        let [from, to, ..] = route[..] else { return false };
        let known = leg.map.edge(from, to).is_some_and(|e| e.state != EdgeState::Removed);
        known && self.free(leg, &[from, to])
    }

    /// Returns the shortest path of the map if all of it is free now.
    pub fn known(&mut self, leg: &PathQuery) -> Option<Vec<u32>> {
        leg.map.plan(leg.at, leg.goal).filter(|way| self.free(leg, way))
    }

    /// Returns whether a path over vertices is free from the measured configuration.
    fn free(&mut self, leg: &PathQuery, way: &[u32]) -> bool {
        let Some(space) = self.space.as_mut() else { return false };
        let mut poses = vec![leg.here.to_vec()];
        for q in way.iter().skip(1).filter_map(|id| leg.pose(*id)) {
            poses.push(space.toward(poses.last().unwrap_or(&q), &q));
        }
        space.all_free(poses.iter().zip(poses.iter().skip(1)).map(|(a, b)| (a.as_slice(), b.as_slice())))
    }

    /// Plans and shortens a new path. Every call uses another seed.
    pub fn plan(&mut self, leg: &PathQuery) -> Result<JointPath, NoPath> {
        let seed = self.seed.wrapping_add(u64::from(self.spent.plans));
        self.spent.plans = self.spent.plans.saturating_add(1);
        let goal = leg.pose(leg.goal).unwrap_or_default();
        let planner = self.planner.planner(AoRrtConnect::default().iterations);
        let mut left = self.budget;
        let mut found = Err(NoPath::Cancelled);
        // The plan with extra clearance may spend half of the budget. It fails at once if an end lacks
        // that clearance.
        for (space, budget) in [(&mut self.roomy, left / 2), (&mut self.space, left)] {
            let Some(space) = space else { continue };
            let before_plan = space.evaluations();
            let problem = PlanningProblem {
                start: space.within(leg.here),
                goals: vec![goal.clone()],
                seed,
                budget: budget.min(left),
            };
            found = planner.plan(space, &problem, &mut |_| ControlFlow::Continue(()));
            left = left.saturating_sub(space.evaluations() - before_plan);
            let before_shortcuts = space.evaluations();
            found = found.map(|path| shorten(space, path, seed, left));
            left = left.saturating_sub(space.evaluations() - before_shortcuts);
            if found.is_ok() {
                break;
            }
        }
        self.spent.lines = self.spent.lines.saturating_add(self.budget - left);
        found
    }

    /// Returns the lengths, rad, of a path over vertices from the measured configuration and of the
    /// straight line to the goal.
    pub fn lengths(&self, leg: &PathQuery, way: &[u32]) -> (f64, f64) {
        let Some(metric) = self.space.as_ref().map(JointSpace::metric) else { return (0.0, 0.0) };
        let far = |a: &[f64], b: Option<Vec<f64>>| b.map_or(0.0, |b| metric.distance(a, &b));
        let along = way.windows(2).filter_map(|w| Some(far(&leg.pose(w[0])?, leg.pose(w[1]))));
        (along.sum(), far(leg.here, leg.pose(leg.goal)))
    }
}

/// Makes a space avoid the middles of failed edges, and nothing else.
fn avoid_failed(space: &mut JointSpace, leg: &PathQuery) {
    space.forgive();
    for (from, to, _) in leg.map.edges().into_iter().filter(|(.., e)| e.state == EdgeState::Removed) {
        let (Some(from), Some(to), Some(goal)) = (leg.pose(from), leg.pose(to), leg.pose(leg.goal)) else { continue };
        let to = space.toward(&from, &to);
        let middle: Vec<f64> = from.iter().zip(&to).map(|(a, b)| (a + b) / 2.0).collect();
        // Shrink the radius so that the robot can leave its start and arrive at the goal.
        let ends = [leg.here, &goal].map(|q| space.metric().distance(q, &middle) / 2.0);
        let radius = ends.into_iter().fold(AVOID_RADIUS_SHARE * space.metric().distance(&from, &to), f64::min);
        space.avoid(middle, radius);
    }
}
