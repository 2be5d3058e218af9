//! I17: an outcome is given only while the robot is measured to rest.
//!
//! Wants the poses: the speed of a motor is the way between the means of two halves of the newest readings, as for encoders with
//! noise. A cancel, a swap and the end of a run wait for outcomes, so they are covered. A run that is ended at once, and a group
//! that gave up, can't wait.

use super::{Found, Invariant};
use crate::journal::Line;
use mobee_contract::{Event, Hold, Pose, Status, Time};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// How many readings are looked at.
const WINDOW: usize = 8;
/// How many times the speed that counts as rest is too much, since the readings that were told may not be quite those decided by.
const SLACK: f64 = 4.0;

#[derive(Default)]
pub(super) struct RestAtTheEnd {
    robots: BTreeMap<String, Newest>,
    gave_up: bool,
}

#[derive(Default)]
struct Newest {
    rest_speed: f64,
    period: Duration,
    readings: VecDeque<(Time, Pose)>,
    ending: bool,
}

impl Newest {
    /// The greatest speed of a motor, rad/s, if the readings tell.
    fn speed(&self) -> Option<f64> {
        let half = WINDOW / 2;
        let (first, last) = (self.readings.front()?, self.readings.back()?);
        let secs = last.0.since(first.0).as_secs_f64() * half as f64 / (WINDOW - 1) as f64;
        if self.readings.len() < WINDOW || secs <= 0.0 {
            return None;
        }
        let mean = |motor: usize, skip: usize| -> f64 {
            let readings = self.readings.iter().skip(skip).take(half);
            readings.filter_map(|(_, q)| q.get(motor)).sum::<f64>() / half as f64
        };
        Some((0..last.1.len()).map(|m| (mean(m, half) - mean(m, 0)).abs() / secs).fold(0.0, f64::max))
    }
}

impl Invariant for RestAtTheEnd {
    fn on(&mut self, line: &Line, found: &mut Found<'_>) {
        match &line.event {
            Event::Robot { robot, rest_speed, period, .. } => {
                let period = Duration::try_from_secs_f64(*period).unwrap_or_default();
                let newest = Newest { rest_speed: *rest_speed, period, ..Newest::default() };
                self.robots.insert(robot.clone(), newest);
            }
            Event::State { robot, status } => {
                let newest = self.robots.entry(robot.clone()).or_default();
                newest.ending |= *status == Status::Holding(Hold::ShuttingDown);
            }
            Event::GaveUp { .. } => self.gave_up = true,
            Event::Outcome { robot, id, .. } if !self.gave_up => {
                let Some(newest) = self.robots.get(robot).filter(|n| !n.ending) else { return };
                let Some(speed) = newest.speed().filter(|v| *v > SLACK * newest.rest_speed) else { return };
                let (id, deg) = (id.0, speed.to_degrees());
                found.say(format!("{robot}: the outcome of commit {id} was given at {deg:.2} deg/s"));
            }
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose) {
        let Some(newest) = self.robots.get_mut(robot) else { return };
        // after a pause the readings before say nothing
        if newest.readings.back().is_some_and(|(last, _)| at.since(*last) > newest.period * 2) {
            newest.readings.clear();
        }
        if newest.readings.back().is_some_and(|(last, _)| at <= *last) {
            return;
        }
        if newest.readings.len() == WINDOW {
            newest.readings.pop_front();
        }
        newest.readings.push_back((at, q.clone()));
    }
}
