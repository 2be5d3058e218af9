//! Slow search for a possible reach, the reference that the agent is scored against.

use super::{ReachAgent, choice};
use mobee_contract::View;
use mobee_planning::planners::{Planner, PlanningProblem, RrtConnect};
use nalgebra::Vector3;
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// Maximum number of straight lines checked for one path to a posture.
const LINE_BUDGET: u64 = 200_000;
/// Number of plans for each posture, each with its own seed.
const PLANS_PER_POSTURE: u64 = 3;
/// Maximum number of postures.
const MAX_POSTURES: usize = 5;

impl ReachAgent {
    /// Returns whether a hand can be brought, without a collision, from the robot's configuration
    /// to the grasp posture for an object at this position (world frame, meters). It searches for
    /// postures from every vertex of the map and plans to each. For benchmarks.
    pub fn can_reach(&mut self, object: [f64; 3], view: &View) -> bool {
        self.prepare(view);
        self.look_at_scene(view);
        let places = self.places(Vector3::from(object));
        let (Some(ready), Some(space)) = (&self.ready, self.space.as_mut()) else { return false };
        let all = [24, 120, 600, self.walker.map.len()];
        let start = space.within(&self.walker.map.group(view.pose()));
        let mut tried = BTreeSet::new();
        for _ in 0..MAX_POSTURES {
            let Ok(choice) = choice::choose(&self.walker.map, &ready.hands, space, view, (&places, &all, &tried))
            else {
                break;
            };
            space.hold(ready.hands.get(choice.hand).map_or(&[], |hand| &hand.others));
            let is_reached = (0..PLANS_PER_POSTURE).any(|seed| {
                let problem = PlanningProblem {
                    start: start.clone(),
                    goals: vec![choice.pre.clone()],
                    seed,
                    budget: LINE_BUDGET,
                };
                RrtConnect::default().plan(space, &problem, &mut |_| ControlFlow::Continue(())).is_ok()
            });
            if is_reached {
                return true;
            }
            tried.insert(choice.vertex);
        }
        false
    }
}
