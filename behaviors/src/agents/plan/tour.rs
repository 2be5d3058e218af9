//! Which goal of the tour is next, and what was made of it so far.

use serde::{Deserialize, Serialize};

/// What a successor must know besides the map.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Going {
    pub next: usize,
    pub round: u32,
    pub reached: u32,
    pub missed: u32,
    /// Goals reached in this round: a round without any is the last.
    pub in_round: u32,
    /// Whether the robot is on its way to `next`.
    pub under_way: bool,
    /// Plans made for this goal, and those of them that found nothing.
    pub plans: u32,
    pub in_vain: u32,
    pub off_map: u32,
    pub escapes: u32,
    /// The world in which edges were removed.
    pub epoch: Option<u64>,
}

impl Going {
    /// Goes on to the next goal.
    pub fn advance(&mut self, reached: bool) {
        self.reached = self.reached.saturating_add(u32::from(reached));
        self.missed = self.missed.saturating_add(u32::from(!reached));
        self.in_round = self.in_round.saturating_add(u32::from(reached));
        (self.next, self.under_way) = (self.next + 1, false);
        (self.plans, self.in_vain, self.escapes) = (0, 0, 0);
    }

    /// The goal to go to, or why there is none any more. The tour is made `repeat` times, without end if that is 0.
    pub fn goal(&mut self, goals: &[u32], repeat: u32) -> Result<u32, &'static str> {
        if self.next >= goals.len() {
            if self.in_round == 0 {
                return Err("no goal can be reached any more");
            }
            (self.next, self.in_round) = (0, 0);
            self.round = self.round.saturating_add(1);
        }
        if repeat > 0 && self.round >= repeat {
            return Err("the tour is done");
        }
        self.under_way = true;
        goals.get(self.next).copied().ok_or("there is no goal")
    }
}
