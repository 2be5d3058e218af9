//! Continuous motors: positions a full turn apart are equivalent, and motions take the shorter direction.
//!
//! Such a motor still has limits, since its encoder counts turns only up to a bound, so all code that uses limits works
//! unchanged. The functions here choose among equivalent positions.

use crate::{Motor, Robot};
use std::f64::consts::{PI, TAU};

impl Motor {
    /// The range for random positions, rad of encoder: its limits, or one turn about home for a continuous motor.
    pub fn range(&self) -> (f64, f64) {
        if self.continuous {
            (self.min.max(self.home - PI), self.max.min(self.home + PI))
        } else {
            (self.min, self.max)
        }
    }

    /// Of the positions equivalent to `goal`, the one within the limits that is nearest to `from`, rad of encoder;
    /// `goal` itself for a motor that is not continuous, or if it is the nearest.
    #[inline]
    pub fn nearest_equivalent(&self, from: f64, goal: f64) -> f64 {
        if !self.continuous {
            return goal;
        }
        let turns = ((from - goal) / TAU).round();
        if turns == 0.0 || !turns.is_finite() {
            return goal;
        }
        // Not beyond a limit: the last turn within it.
        let fewest = ((self.min - goal) / TAU).ceil();
        let most = ((self.max - goal) / TAU).floor();
        goal + turns.min(most).max(fewest) * TAU
    }

    /// Displacement from one position to another in the direction that the motor takes, rad of encoder.
    pub fn way(&self, from: f64, to: f64) -> f64 {
        self.nearest_equivalent(from, to) - from
    }
}

impl Robot {
    /// Of the configurations equivalent to `goal`, the nearest to `from`: see [`Motor::nearest_equivalent`]. Same
    /// length as `goal`.
    pub fn nearest_equivalent(&self, from: &[f64], goal: &[f64]) -> Vec<f64> {
        let nearest = |(i, goal): (usize, &f64)| match (self.motors.get(i), from.get(i)) {
            (Some(motor), Some(from)) => motor.nearest_equivalent(*from, *goal),
            _ => *goal,
        };
        goal.iter().enumerate().map(nearest).collect()
    }
}
