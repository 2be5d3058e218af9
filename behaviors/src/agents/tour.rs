//! A tour of goals: how its user wants it driven, and how far it has come.

use crate::group;
use crate::roadmap::Roadmap;
use mobee_contract::{KindError, Refusal};
use mobee_model::Robot;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::time::Duration;

/// Which goal is next, and what was made of the others.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Tour {
    pub next: usize,
    pub round: u32,
    pub reached: u32,
    pub missed: u32,
    /// Goals reached in this round: a round without any is the last.
    pub in_round: u32,
    /// Whether the robot is on its way to `next`.
    pub under_way: bool,
}

impl Tour {
    /// Goes on to the next goal.
    pub fn advance(&mut self, reached: bool) {
        self.reached = self.reached.saturating_add(u32::from(reached));
        self.missed = self.missed.saturating_add(u32::from(!reached));
        self.in_round = self.in_round.saturating_add(u32::from(reached));
        (self.next, self.under_way) = (self.next + 1, false);
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

    /// Whether the robot has come to where it was going.
    pub fn arrived(&self, goals: &[u32], at: u32) -> bool {
        self.under_way && goals.get(self.next) == Some(&at)
    }
}

/// How a tour is driven.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    /// Share of each motor's maximum speed.
    pub speed: f64,
    /// How near a vertex counts as at it, rad.
    pub tolerance: f64,
    /// How long to rest at each goal.
    pub wait: Duration,
    /// The marker that represents a pose in pictures, if one is named.
    pub hand: Option<usize>,
}

impl Pace {
    /// From settings of these names.
    ///
    /// # Errors
    /// Values out of bounds, and a marker that the robot does not have: all of them, with their path.
    pub fn new(
        speed: f64,
        tolerance_deg: f64,
        wait_s: f64,
        hand: Option<&str>,
        robot: &Robot,
    ) -> Result<Pace, KindError> {
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
        Ok(Pace { speed: speed?, tolerance: tolerance?, wait: wait?, hand: hand? })
    }
}

/// A predecessor's map, for an agent whose own map has these motors and goals.
///
/// # Errors
/// If it is broken, one of other motors, or lacks a goal.
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
