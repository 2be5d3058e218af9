//! Motors that turn without end: positions a full turn apart are one, and the way between two is the short one.
//!
//! Such a motor still has limits (its encoder counts turns, and counts no farther), so that everything that asks for limits goes on
//! as it is. Where it matters which of many equal positions is meant, this is asked.

use crate::{Motor, Robot};
use std::f64::consts::{PI, TAU};

impl Motor {
    /// The range that poses are drawn from, rad of encoder: its limits, or one turn about home for a motor without end.
    pub fn range(&self) -> (f64, f64) {
        if self.continuous {
            (self.min.max(self.home - PI), self.max.min(self.home + PI))
        } else {
            (self.min, self.max)
        }
    }

    /// Of the positions that are the same as `goal`, the one within the limits that is nearest to `from`, rad of encoder; `goal`
    /// itself for a motor with an end, and where it is the nearest.
    pub fn nearest_equivalent(&self, from: f64, goal: f64) -> f64 {
        let turns = ((from - goal) / TAU).round();
        if !self.continuous || turns == 0.0 || !turns.is_finite() {
            return goal;
        }
        // Beyond a limit there is nothing: the last turn within it.
        let (fewest, most) = (((self.min - goal) / TAU).ceil(), ((self.max - goal) / TAU).floor());
        goal + turns.min(most).max(fewest) * TAU
    }

    /// How far it is from one position to another the way the motor takes, rad of encoder.
    pub fn way(&self, from: f64, to: f64) -> f64 {
        self.nearest_equivalent(from, to) - from
    }
}

impl Robot {
    /// Of the poses that are the same as `goal`, the nearest to `from`: see [`Motor::nearest_equivalent`]. As long as `goal`.
    pub fn nearest_equivalent(&self, from: &[f64], goal: &[f64]) -> Vec<f64> {
        let of = |(i, goal): (usize, &f64)| match (self.motors.get(i), from.get(i)) {
            (Some(motor), Some(from)) => motor.nearest_equivalent(*from, *goal),
            _ => *goal,
        };
        goal.iter().enumerate().map(of).collect()
    }
}
