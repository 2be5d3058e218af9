//! A stop that was told, and whether the readings show its effect: one that was lost, or that the board did not heed,
//! is said again.
//!
//! A message to a board may be lost without anybody hearing of it, and a stop is the one that must not be (I17). Saying
//! it again is safe at any time, saying it at every reading would bury the board in stops; so it is judged by its
//! effect.

use crate::Rules;
use crate::pulse::Pulse;
use mobee_contract::Time;
use std::time::Duration;

/// How long a stop may take to show beyond a command's own time: the speed is estimated from several readings.
const SHOWS: Duration = Duration::from_millis(200);
/// The greatest share of its speed that a robot may still have then: a tenth less is more than the estimate's noise.
const LESS: f64 = 0.9;

/// A stop that was told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// When, by the clock.
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
        let sampled_at = pulse.sample.at;
        if sampled_at <= self.told {
            return false;
        }
        // one that brakes slowly, or down a long way, has lost a share of its speed; at rest there is nothing left to
        // lose
        let before = *self.speed.get_or_insert(pulse.speed);
        if pulse.speed < rules.rest_speed || sampled_at < self.told + rules.reaction() + SHOWS {
            return false;
        }
        *self = Stop { told: now, speed: Some(pulse.speed) };
        pulse.speed > LESS * before
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint_retreat::tests::rules;
    use mobee_contract::Sample;

    /// At which milliseconds (of every 10) a stop is said again, of a robot that is so fast.
    fn again(speed: impl Fn(u64) -> f64) -> Vec<u64> {
        let (rules, mut stop) = (rules(true), Stop::told(Time::ZERO));
        let mut said = |ms: u64| {
            let at = Time(ms * 1_000_000);
            let sample = Sample { seq: ms, at, q: vec![0.0].into(), done: vec![false], ..Sample::default() };
            let mut pulse = Pulse::new(sample, &Vec::new().into());
            pulse.speed = speed(ms);
            stop.is_ignored(&pulse, &rules, at)
        };
        (0..100).map(|k| 10 * k).filter(|ms| said(*ms)).collect()
    }

    #[test]
    fn a_stop_that_does_not_show_in_time_is_said_again() {
        let rules = rules(true);
        let shows = (rules.reaction() + SHOWS).as_millis() as u64;
        let often: Vec<u64> = (1..).map(|k| k * shows).take_while(|ms| *ms < 1000).collect();
        assert_eq!(again(|_| 0.5), often, "as often as it may have been lost");
        assert_eq!(again(|ms| if ms < shows { 0.5 } else { 0.45 }), often[1..], "a tenth slower: it shows");
        assert_eq!(again(|ms| if ms < shows { 0.5 } else { 0.46 }), often, "that could be noise");
        let no: [u64; 0] = [];
        // what is seen in the very instant that it is told says nothing of it
        assert_eq!(again(|ms| if ms == 0 { 0.1 } else { 0.5 * 0.997_f64.powf(ms as f64) }), no);
        assert_eq!(again(|_| 0.9 * rules.rest_speed), no, "it rests");
        assert_eq!(again(|_| rules.rest_speed), often);
    }
}
