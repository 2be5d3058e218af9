//! A tour of goals: its parameters, and its progress.

use mobee_contract::{KindError, Refusal};
use mobee_model::Robot;
use mobee_planning::group;
use mobee_planning::roadmap::Roadmap;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::time::Duration;

/// Progress of a tour: the next goal, and counts of the previous ones.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Tour {
    pub next: usize,
    pub round: u32,
    pub reached: u32,
    pub missed: u32,
    /// Goals reached in this round; a round without any is the last.
    pub in_round: u32,
    /// True if the robot is on its way to `next`.
    pub under_way: bool,
}

impl Tour {
    /// Proceeds to the next goal.
    pub fn advance(&mut self, reached: bool) {
        self.reached = self.reached.saturating_add(u32::from(reached));
        self.missed = self.missed.saturating_add(u32::from(!reached));
        self.in_round = self.in_round.saturating_add(u32::from(reached));
        (self.next, self.under_way) = (self.next + 1, false);
    }

    /// Returns the current goal, or the reason why the tour has ended. The tour is made `repeat`
    /// times, or without end if `repeat` is 0.
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

    /// Returns whether the robot has arrived at its goal.
    pub fn arrived(&self, goals: &[u32], at: u32) -> bool {
        self.under_way && goals.get(self.next) == Some(&at)
    }
}

/// Parameters of a tour.
#[derive(Clone, Copy, Debug)]
pub(super) struct TourPace {
    /// Share of each motor's maximum speed.
    pub speed: f64,
    /// Maximum distance of every motor from a vertex to count as at it, rad.
    pub tolerance: f64,
    /// Time to rest at each goal.
    pub wait: Duration,
    /// Marker that represents a pose in drawings, if one is named.
    pub hand: Option<usize>,
}

impl TourPace {
    /// Creates the parameters from settings of these names.
    ///
    /// # Errors
    /// Values out of bounds, and a marker that the robot does not have: all of them, each with its
    /// path.
    pub fn new(
        speed: f64,
        tolerance_deg: f64,
        wait_s: f64,
        hand: Option<&str>,
        robot: &Robot,
    ) -> Result<TourPace, KindError> {
        let speed = group::speed("speed", speed);
        let tolerance = group::tolerance("tolerance_deg", tolerance_deg);
        let wait = group::seconds("wait_s", wait_s);
        let hand = group::marker("hand", hand, robot);
        KindError::gather([
            speed.clone().map(drop),
            tolerance.clone().map(drop),
            wait.clone().map(drop),
            hand.clone().map(drop),
        ])?;
        Ok(TourPace { speed: speed?, tolerance: tolerance?, wait: wait?, hand: hand? })
    }
}

/// Imports a predecessor's map, which must have the motors of the agent's own map and the goals.
///
/// # Errors
/// A broken map, other motors, or a missing goal.
pub(super) fn predecessors_map(map: &Value, own: &Roadmap, goals: &[u32], robot: &Robot) -> Result<Roadmap, Refusal> {
    let map = Roadmap::import(map, robot).map_err(group::state)?;
    if map.motors() != own.motors() || goals.iter().any(|g| map.vertex(*g).is_none()) {
        let what = "map: the roadmap is one of other motors, or lacks a goal".to_owned();
        return Err(Refusal::State { what });
    }
    Ok(map)
}

/// Defaults of the settings that agents with a roadmap share.
pub(super) mod defaults {
    pub fn once() -> u32 {
        1
    }

    pub fn tenth() -> f64 {
        0.1
    }

    pub fn half() -> f64 {
        0.5
    }
}
