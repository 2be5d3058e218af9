//! Speed of a robot computed from its measured configurations, independent of the speeds in the journal.

use super::near;
use crate::track::QUANTUM;
use mobee_contract::{Pose, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// Readings in the window for the speed.
const WINDOW: usize = 8;
/// Readings that follow within this time are skipped: the shorter the time, the more noise adds to the speed.
const CROWD: Duration = Duration::from_millis(7);
/// Readings that are stored: a decision may be based on one that is some periods old.
const MAX_READINGS: usize = 64;
/// Multiple of the rest speed that counts as motion: the recorded readings may differ slightly from those of
/// the decision.
const SLACK: f64 = 4.0;

/// The newest readings of a robot. The speed of a motor is the distance between the means of the two halves of
/// the window per time, as for noisy encoders.
#[derive(Default)]
pub(super) struct RecentReadings {
    rest_speed: f64,
    period: Duration,
    /// Resolution of the coarsest encoder, rad: it may show that much without motion.
    resolution: f64,
    readings: VecDeque<(Time, Pose)>,
}

impl RecentReadings {
    /// Creates the window for a robot with this rest speed (rad/s), control period (s) and encoder resolution
    /// (rad).
    pub fn new(rest_speed: f64, period: f64, resolution: f64) -> RecentReadings {
        let period = Duration::try_from_secs_f64(period).unwrap_or_default();
        RecentReadings { rest_speed, period, resolution, readings: VecDeque::new() }
    }

    /// Takes the next reading.
    pub fn take(&mut self, at: Time, q: &Pose) {
        // After a pause the earlier readings no longer apply.
        if self.readings.back().is_some_and(|(last, _)| at.since(*last) > self.period * 2) {
            self.readings.clear();
        }
        let crowd = CROWD.min(self.period.mul_f64(0.4));
        if self.readings.back().is_some_and(|(last, _)| at <= *last || at.since(*last) < crowd) {
            return;
        }
        if self.readings.len() == MAX_READINGS {
            self.readings.pop_front();
        }
        self.readings.push_back((at, q.clone()));
    }

    /// Drops the readings, because the next ones don't connect to them.
    pub fn forget(&mut self) {
        self.readings.clear();
    }

    /// Time at which this configuration was last read, if it is still stored. A decision records the
    /// configuration that it was based on.
    pub fn read_at(&self, q: &Pose) -> Option<Time> {
        self.readings.iter().rev().find(|(_, read)| near(read, q, QUANTUM)).map(|(at, _)| *at)
    }

    /// Greatest speed of a motor, rad/s, if the readings up to this time show that the robot moves.
    pub fn moves(&self, until: Time) -> Option<f64> {
        self.speed(until).filter(|v| *v > SLACK * self.rest_speed)
    }

    fn speed(&self, until: Time) -> Option<f64> {
        let half = WINDOW / 2;
        let end = self.readings.partition_point(|(at, _)| *at <= until);
        let window = self.readings.range(end.checked_sub(WINDOW)?..end);
        let first = window.clone().next()?;
        let last = window.clone().next_back()?;
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
