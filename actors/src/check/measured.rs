//! How fast a robot is by the readings of its poses, for those who want no word for it.

use super::near;
use crate::record::track::QUANTUM;
use mobee_contract::{Pose, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// How many readings are looked at.
const WINDOW: usize = 8;
/// Readings that come sooner after one another are too many: noise counts by the time that it is divided by.
const CROWD: Duration = Duration::from_millis(7);
/// How many readings are kept: a decision may be made by one that is some periods old.
const KEPT: usize = 64;
/// How many times the speed that counts as rest is too much, since the readings that were told may not be quite those decided by.
const SLACK: f64 = 4.0;

/// The newest readings of a robot. The speed of a motor is the way between the means of their two halves, as for encoders with noise.
#[derive(Default)]
pub(super) struct Measured {
    rest_speed: f64,
    period: Duration,
    /// The smallest difference that the coarsest encoder shows, rad: it may show that much of nothing.
    resolution: f64,
    readings: VecDeque<(Time, Pose)>,
}

impl Measured {
    /// Those of a robot that rests below this speed, rad/s, is controlled with this period, seconds, and read with this resolution, rad.
    pub fn new(rest_speed: f64, period: f64, resolution: f64) -> Measured {
        let period = Duration::try_from_secs_f64(period).unwrap_or_default();
        Measured { rest_speed, period, resolution, readings: VecDeque::new() }
    }

    /// Takes the next reading.
    pub fn take(&mut self, at: Time, q: &Pose) {
        // after a pause the readings before say nothing
        if self.readings.back().is_some_and(|(last, _)| at.since(*last) > self.period * 2) {
            self.readings.clear();
        }
        let crowd = CROWD.min(self.period.mul_f64(0.4));
        if self.readings.back().is_some_and(|(last, _)| at <= *last || at.since(*last) < crowd) {
            return;
        }
        if self.readings.len() == KEPT {
            self.readings.pop_front();
        }
        self.readings.push_back((at, q.clone()));
    }

    /// The readings that come next are not known: those before say nothing of them.
    pub fn forget(&mut self) {
        self.readings.clear();
    }

    /// When this very pose was read last, as far as it was kept; a decision tells the pose that it was made by.
    pub fn read_at(&self, q: &Pose) -> Option<Time> {
        self.readings.iter().rev().find(|(_, read)| near(read, q, QUANTUM)).map(|(at, _)| *at)
    }

    /// The greatest speed of a motor, rad/s, if the readings up to this time tell that the robot moved.
    pub fn moves(&self, until: Time) -> Option<f64> {
        self.speed(until).filter(|v| *v > SLACK * self.rest_speed)
    }

    fn speed(&self, until: Time) -> Option<f64> {
        let half = WINDOW / 2;
        let end = self.readings.partition_point(|(at, _)| *at <= until);
        let window = self.readings.range(end.checked_sub(WINDOW)?..end);
        let (first, last) = (window.clone().next()?, window.clone().next_back()?);
        let secs = last.0.since(first.0).as_secs_f64() * half as f64 / (WINDOW - 1) as f64;
        let mean = |motor: usize, skip: usize| -> f64 {
            let readings = window.clone().skip(skip).take(half);
            readings.filter_map(|(_, q)| q.get(motor)).sum::<f64>() / half as f64
        };
        let fastest = (0..last.1.len())
            .map(|m| ((mean(m, half) - mean(m, 0)).abs() - self.resolution).max(0.0) / secs)
            .fold(0.0, f64::max);
        (secs > 0.0).then_some(fastest)
    }
}
