//! Estimate of each motor's speed and acceleration.

use mobee_contract::{Pose, Sample, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// Number of readings in an estimate.
const READINGS: usize = 8;
/// Least interval between these readings: at a thousand readings per second, the difference of two is noise.
const MIN_INTERVAL: Duration = Duration::from_millis(8);

/// Motion of a motor at the newest reading.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct MovingMotor {
    /// Speed, rad/s.
    pub speed: f64,
    /// Acceleration, rad/s^2.
    pub gain: f64,
}

/// Latest readings.
#[derive(Clone, Debug, Default)]
pub(super) struct Course {
    /// Oldest first; all but the newest at least [`MIN_INTERVAL`] apart.
    readings: VecDeque<(Time, Pose)>,
    /// Recent longest interval between two readings, s.
    period: f64,
}

impl Course {
    /// Adds a reading. If the previous reading was stale by then, the estimate starts again.
    pub fn push(&mut self, sample: &Sample, fresh: Duration) {
        if let Some((last, q)) = self.readings.back() {
            if sample.at > *last + fresh || q.len() != sample.q.len() {
                self.readings.clear();
            } else if sample.at <= *last {
                return;
            }
        }
        let n = self.readings.len();
        let is_close = |(before, last): (&(Time, Pose), &(Time, Pose))| last.0 < before.0 + MIN_INTERVAL;
        if n >= 2 && self.readings.get(n - 2).zip(self.readings.back()).is_some_and(is_close) {
            self.readings.pop_back();
        }
        if let Some((last, _)) = self.readings.back() {
            let pause = sample.at.since(*last).as_secs_f64();
            self.period = pause.max(self.period + 0.05 * (pause - self.period));
        }
        self.readings.push_back((sample.at, sample.q.clone()));
        if self.readings.len() > READINGS {
            self.readings.pop_front();
        }
    }

    /// Estimates the motion at the newest reading, by a least-squares parabola per motor. Zero before there are
    /// enough readings.
    ///
    /// Uses polynomials that are orthogonal on the readings' times: 1, `p = t - mean` and `r = p^2 - skew p -
    /// spread`.
    pub fn now(&self) -> CurrentMotion {
        let motors = self.readings.back().map_or(0, |(_, q)| q.len());
        let still = CurrentMotion { motors: vec![MovingMotor::default(); motors], period: self.period };
        let Some((newest, _)) = self.readings.back().filter(|_| self.readings.len() == READINGS) else { return still };
        let n = READINGS as f64;
        let times = || self.readings.iter().map(|(at, _)| -newest.since(*at).as_secs_f64());
        let mean = times().sum::<f64>() / n;
        let sum = |power: i32| times().map(|t| (t - mean).powi(power)).sum::<f64>();
        let squares = sum(2);
        let cubes = sum(3);
        let skew = cubes / squares;
        let spread = squares / n;
        let curved = |t: f64| (t - mean).powi(2) - skew * (t - mean) - spread;
        let norm = times().map(|t| curved(t).powi(2)).sum::<f64>();
        if !(squares > 0.0 && norm > 0.0) {
            return still;
        }
        let of = |motor: usize| {
            let on = |f: &dyn Fn(f64) -> f64| -> f64 {
                times().zip(&self.readings).map(|(t, (_, q))| f(t) * q.get(motor).copied().unwrap_or_default()).sum()
            };
            let slope = on(&|t| t - mean) / squares;
            let bend = on(&curved) / norm;
            MovingMotor { speed: slope + bend * (-2.0 * mean - skew), gain: 2.0 * bend }
        };
        CurrentMotion { motors: (0..motors).map(of).collect(), period: self.period }
    }
}

/// Motion of a robot at its newest reading.
#[derive(Clone, Debug, Default)]
pub(super) struct CurrentMotion {
    /// One entry per motor.
    pub motors: Vec<MovingMotor>,
    /// Time until the next reading, seconds.
    pub period: f64,
}
