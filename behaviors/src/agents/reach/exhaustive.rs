//! Whether a reach can succeed at all: a slow search, to judge the agent by.

use super::{ReachAgent, choice};
use crate::planners::{Planner, PlanningProblem, RrtConnect};
use mobee_contract::View;
use nalgebra::Vector3;
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// Straight lines that the way to the posture may cost.
const BUDGET: u64 = 200_000;
/// Plans with seeds of their own, for each of so many postures.
const PLANS: u64 = 3;
const GOALS: usize = 5;

impl ReachAgent {
    /// Whether a hand can be brought from where the robot is to an object there, freely and to the grasp posture: postures are begun from
    /// every vertex of the map, and the way is planned whatever it costs. For benchmarks.
    pub fn can_reach(&mut self, object: [f64; 3], view: &View) -> bool {
        self.prepare(view);
        self.look_at_scene(view);
        let places = self.places(Vector3::from(object));
        let (Some(ready), Some(space)) = (&self.ready, self.space.as_mut()) else { return false };
        let all = [24, 120, 600, self.walker.map.len()];
        let start = space.within(&self.walker.map.group(view.pose()));
        let mut tried = BTreeSet::new();
        for _ in 0..GOALS {
            let Ok(choice) = choice::choose(&self.walker.map, &ready.hands, space, view, (&places, &all, &tried))
            else {
                break;
            };
            space.hold(ready.hands.get(choice.hand).map_or(&[], |hand| &hand.others));
            let is_reached = (0..PLANS).any(|seed| {
                let problem = PlanningProblem { start: start.clone(), goal: choice.pre.clone(), seed, budget: BUDGET };
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
