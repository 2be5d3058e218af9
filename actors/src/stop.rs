//! A stop that was told, and whether the readings show its effect: one that was lost, or that the board did not heed, is said again.

use crate::controller::Rules;
use crate::pulse::Pulse;
use mobee_contract::Time;
use std::time::Duration;

/// How long a stop may take to show beyond a command's own time: the speed is estimated from several readings.
const SHOWS: Duration = Duration::from_millis(200);
/// The greatest share of its speed that a robot may still have then.
const LESS: f64 = 0.9;

/// A stop that was told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    told: Time,
    /// How fast the robot was in the first reading after it, rad/s.
    speed: Option<f64>,
}

impl Stop {
    /// Told now.
    pub fn told(now: Time) -> Stop {
        Stop { told: now, speed: None }
    }

    /// Whether this reading shows a robot that has not become slower since: then the stop counts as told again.
    pub fn is_ignored(&mut self, pulse: &Pulse, rules: &Rules, now: Time) -> bool {
        let at = pulse.sample.at;
        if at <= self.told {
            return false;
        }
        let before = *self.speed.get_or_insert(pulse.speed);
        if pulse.speed < rules.rest_speed || at < self.told + rules.reaction() + SHOWS {
            return false;
        }
        *self = Stop { told: now, speed: Some(pulse.speed) };
        pulse.speed > LESS * before
    }
}
