//! I31: the filter closes if a robot at rest is moved by something other than its commands. After a
//! displacement beyond the tolerance it does not stay open, and a displacement by that much is never reported
//! with the filter open.
//!
//! Needs the measured configurations. The place of a rest is its first reading; one or two readings that jump
//! are noise. A motor of a board that does not hold exactly may also move by its hold error, as the load changes with
//! the motion of the others.

use super::{FoundViolations, Invariant, PerRobot};
use crate::journal::JournalLine;
use mobee_contract::{Event, MotorUnits, Pose, Status, Time};
use std::collections::BTreeMap;
use std::time::Duration;

/// Longest time, and most readings, for which the filter may stay open.
const MAX_OPEN: (Duration, u32) = (Duration::from_millis(500), 8);

#[derive(Default)]
pub(super) struct MovedAtRest {
    robots: BTreeMap<String, RestWatch>,
}

#[derive(Default)]
struct RestWatch {
    names: Vec<String>,
    units: MotorUnits,
    tolerance: f64,
    /// Distance by which a changed load moves a motor, rad.
    hold_error: f64,
    open: bool,
    rest: Option<RobotAtRest>,
}

#[derive(Default)]
struct RobotAtRest {
    place: Option<Pose>,
    /// Start of the displacement, and the number of readings since.
    away: Option<(Time, u32)>,
}

impl RestWatch {
    fn judge(&mut self, robot: &str, at: Time, q: &Pose) -> Option<String> {
        let rest = self.rest.as_mut()?;
        let place = rest.place.get_or_insert_with(|| q.clone());
        let ways = q.iter().zip(place.iter()).map(|(q, place)| (q - place).abs()).enumerate();
        let (motor, by) = ways.max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        if by <= self.tolerance + self.hold_error {
            rest.away = None;
            return None;
        }
        let (since, readings) = rest.away.map_or((at, 1), |(since, readings)| (since, readings + 1));
        rest.away = Some((since, readings));
        if at.since(since) <= MAX_OPEN.0 || readings <= MAX_OPEN.1 {
            return None;
        }
        self.rest = None;
        let name = self.names.get(motor).map_or("?", String::as_str);
        let by = self.units.of(motor).told(by, 3);
        Some(format!("{robot}: motor {name} was moved by {by} at rest, and the filter is open at {at}"))
    }
}

impl Invariant for MovedAtRest {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, motors, sliding, tolerance, hold_error, .. } => {
                let units = MotorUnits::new(motors.len(), sliding);
                let open = self.robots.get(robot).is_some_and(|r| r.open);
                let state = RestWatch {
                    names: motors.clone(),
                    units,
                    tolerance: *tolerance,
                    hold_error: *hold_error,
                    open,
                    rest: None,
                };
                self.robots.insert(robot.clone(), state);
            }
            Event::State { robot, status } => {
                let rest = (*status == Status::Rest).then(RobotAtRest::default);
                self.robots.of(robot, |r| r.rest = rest);
            }
            Event::Enabled { robot, .. } => self.robots.of(robot, |r| r.open = true),
            Event::Disabled { robot, .. } => self.robots.of(robot, |r| (r.open, r.rest) = (false, None)),
            Event::Displaced { robot, motor, by, motion }
                if self.robots.get(robot).is_some_and(|r| r.open && *by > r.tolerance) =>
            {
                let by = motion.told(*by, 3);
                found.report(format!("{robot}: motor {motor} was moved by {by}, and the filter stays open"));
            }
            Event::Commit { robot, .. } => self.robots.of(robot, |r| r.rest = None),
            Event::Resumed { .. } => self.robots.values_mut().for_each(|r| (r.open, r.rest) = (false, None)),
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut FoundViolations<'_>) {
        let wrong = self.robots.get_mut(robot).and_then(|state| state.judge(robot, at, q));
        wrong.into_iter().for_each(|what| found.report(what));
    }

    fn blind(&mut self, robot: &str) {
        self.robots.of(robot, |r| r.rest.iter_mut().for_each(|rest| rest.away = None));
    }
}
