//! I17: an outcome is given only while the robot is measured to be at rest.
//!
//! Needs the measured configurations. The robot must be at rest by the reading whose configuration is recorded,
//! or by the newest one; the reading of the decision lies between them. (I8 checks that it was fresh.) A
//! cancel, a swap and the end of a run wait for outcomes, so they are covered. A run that is ended immediately,
//! and a supervision group that gave up, can't wait.

use super::measured::RecentReadings;
use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{Event, Hold, MotorUnits, Pose, Status, Time};
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct RestAtTheEnd {
    robots: BTreeMap<String, Newest>,
    gave_up: bool,
}

#[derive(Default)]
struct Newest {
    units: MotorUnits,
    measured: RecentReadings,
    ending: bool,
}

impl Invariant for RestAtTheEnd {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, motors, sliding, rest_speed, period, resolution, .. } => {
                let measured = RecentReadings::new(*rest_speed, *period, *resolution);
                let units = MotorUnits::new(motors.len(), sliding);
                self.robots.insert(robot.clone(), Newest { units, measured, ending: false });
            }
            Event::State { robot, status } => {
                let newest = self.robots.entry(robot.clone()).or_default();
                newest.ending |= *status == Status::Holding(Hold::ShuttingDown);
            }
            Event::GaveUp { .. } => self.gave_up = true,
            Event::Outcome { robot, id, q, .. } if !self.gave_up => {
                let Some(newest) = self.robots.get(robot).filter(|n| !n.ending) else { return };
                // The reflex decides by the reading after the one whose configuration is recorded.
                let recorded = newest.measured.read_at(q).unwrap_or(line.at);
                let both = newest.measured.moves(recorded).zip(newest.measured.moves(line.at));
                let Some((speed, _)) = both else { return };
                let id = id.0;
                let speed = newest.units.told_speed(speed, 2);
                found.report(format!("{robot}: the outcome of commit {id} was given at {speed}"));
            }
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, _found: &mut FoundViolations<'_>) {
        if let Some(newest) = self.robots.get_mut(robot) {
            newest.measured.take(at, q);
        }
    }

    fn blind(&mut self, robot: &str) {
        if let Some(newest) = self.robots.get_mut(robot) {
            newest.measured.forget();
        }
    }
}
