//! A stop command and its effect in the readings: a stop that was lost or ignored by the board is sent again.
//!
//! A message to a board may be lost without notification, and a stop must not be lost (I17). Repeating it is always
//! safe, but a stop at every reading would flood the board. Therefore a stop is repeated only if the readings do not
//! show its effect.

use crate::Rules;
use crate::pulse::Pulse;
use mobee_contract::Time;
use std::time::Duration;

/// Longest time for a stop to show in the speed estimate, beyond the reaction time: the estimate uses several
/// readings.
const EFFECT_TIME: Duration = Duration::from_millis(200);
/// Greatest speed after an effective stop, as a share of the speed before: a decrease of a tenth exceeds the noise of
/// the estimate.
const MAX_SPEED_RATIO: f64 = 0.9;

/// A stop command that was sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Time of sending, by the clock.
    sent_at: Time,
    /// Speed of the robot in the first reading after it, rad/s.
    speed: Option<f64>,
}

impl Stop {
    /// A stop sent now.
    pub fn sent(now: Time) -> Stop {
        Stop { sent_at: now, speed: None }
    }

    /// Returns whether this reading shows that the robot has not slowed down since the stop. The stop then counts as
    /// sent again.
    pub fn is_ignored(&mut self, pulse: &Pulse, rules: &Rules, now: Time) -> bool {
        let sampled_at = pulse.sample.at;
        if sampled_at <= self.sent_at {
            return false;
        }
        // A robot that brakes slowly, or over a long distance, has lost a share of its speed by now. A robot at rest
        // has no speed to lose.
        let before = *self.speed.get_or_insert(pulse.speed);
        if pulse.speed < rules.rest_speed || sampled_at < self.sent_at + rules.reaction() + EFFECT_TIME {
            return false;
        }
        *self = Stop { sent_at: now, speed: Some(pulse.speed) };
        pulse.speed > MAX_SPEED_RATIO * before
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint_retreat::tests::rules;
    use mobee_contract::Sample;

    /// Returns the times, ms (tested every 10 ms), at which a stop is repeated for a robot with this speed over time.
    fn repeats(speed: impl Fn(u64) -> f64) -> Vec<u64> {
        let rules = rules(true);
        let mut stop = Stop::sent(Time::ZERO);
        let mut is_repeated = |ms: u64| {
            let at = Time(ms * 1_000_000);
            let sample = Sample { seq: ms, at, q: vec![0.0].into(), done: vec![false], ..Sample::default() };
            let mut pulse = Pulse::new(sample, &Vec::new().into());
            pulse.speed = speed(ms);
            stop.is_ignored(&pulse, &rules, at)
        };
        (0..100).map(|k| 10 * k).filter(|ms| is_repeated(*ms)).collect()
    }

    #[test]
    fn a_stop_without_effect_in_time_is_repeated() {
        let rules = rules(true);
        let effect_time = (rules.reaction() + EFFECT_TIME).as_millis() as u64;
        let often: Vec<u64> = (1..).map(|k| k * effect_time).take_while(|ms| *ms < 1000).collect();
        assert_eq!(repeats(|_| 0.5), often, "as often as it may have been lost");
        assert_eq!(repeats(|ms| if ms < effect_time { 0.5 } else { 0.45 }), often[1..], "a tenth slower: effective");
        assert_eq!(repeats(|ms| if ms < effect_time { 0.5 } else { 0.46 }), often, "may be noise");
        let no: [u64; 0] = [];
        // a reading taken at the time of the stop does not show its effect
        assert_eq!(repeats(|ms| if ms == 0 { 0.1 } else { 0.5 * 0.997_f64.powf(ms as f64) }), no);
        assert_eq!(repeats(|_| 0.9 * rules.rest_speed), no, "at rest");
        assert_eq!(repeats(|_| rules.rest_speed), often);
    }
}
