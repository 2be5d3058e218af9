//! I4: a safe pose is taken only from a fresh reading, at rest, free of contact, with no transaction open.
//!
//! The one exception is `SafePoseMoved` in an open transaction. An escape has no safe pose and is never rolled
//! back; every other commit has one. A controller without a reflex does not promise that its safe poses are
//! free of contact. If measured configurations are available, the speed is computed from them as well as read
//! from the event.

use super::measured::RecentReadings;
use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{Event, MotorUnits, Outcome, Pose, Time};
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct HonestSafePose {
    robots: BTreeMap<String, SafePoseWatch>,
}

#[derive(Default)]
struct SafePoseWatch {
    units: MotorUnits,
    fresh: f64,
    rest_speed: f64,
    measured: RecentReadings,
    /// True if its controller has no reflex: then no component checks that a configuration is free of contact.
    no_reflex: bool,
    has_safe: bool,
    /// The open commit, if any: `true` if it is an escape.
    open: Option<bool>,
}

impl Invariant for HonestSafePose {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, motors, sliding, fresh, rest_speed, period, resolution, .. } => {
                let rest = self.robots.entry(robot.clone()).or_default();
                rest.fresh = *fresh;
                rest.rest_speed = *rest_speed;
                rest.units = MotorUnits::new(motors.len(), sliding);
                rest.measured = RecentReadings::new(*rest_speed, *period, *resolution);
            }
            Event::Controller { robot, reflex, .. } => {
                self.robots.entry(robot.clone()).or_default().no_reflex = !reflex;
            }
            Event::SafePose { robot, age, speed, free, .. } => {
                let rest = self.robots.entry(robot.clone()).or_default();
                rest.has_safe = true;
                let by = Time::from_secs((line.at.secs() - age).max(0.0));
                let mut wrong = |what: String| found.report(format!("{robot}: a safe pose was taken {what}"));
                if rest.open.is_some() {
                    wrong("with a transaction open".into());
                }
                if *age > rest.fresh {
                    wrong(format!("from a reading {age:.3} s old; {:.3} s is fresh", rest.fresh));
                }
                if *speed > rest.rest_speed {
                    wrong(format!("at {}", rest.units.told_speed(*speed, 3)));
                } else if let Some(speed) = rest.measured.moves(by) {
                    wrong(format!("as the poses moved at {}", rest.units.told_speed(speed, 3)));
                }
                if !free && !rest.no_reflex {
                    wrong("in contact".into());
                }
            }
            Event::SafePoseMoved { robot, .. }
                if self.robots.get(robot).is_none_or(|rest| rest.open != Some(false)) =>
            {
                found.report(format!("{robot}: a safe pose was moved with no transaction open that has one"));
            }
            Event::Commit { robot, id, escape, .. } => {
                let rest = self.robots.entry(robot.clone()).or_default();
                rest.open = Some(*escape);
                if !escape && !rest.has_safe {
                    found.report(format!("{robot}: commit {} was accepted without a safe pose", id.0));
                }
            }
            Event::Outcome { robot, id, outcome, safe, .. } => {
                let escape = self.robots.entry(robot.clone()).or_default().open.take().unwrap_or(false);
                if escape && (safe.is_some() || *outcome == Outcome::RolledBack) {
                    found.report(format!("{robot}: commit {} was an escape, but was given a safe pose", id.0));
                }
                if !escape && safe.is_none() {
                    found.report(format!("{robot}: the outcome of commit {} does not name its safe pose", id.0));
                }
            }
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, _found: &mut FoundViolations<'_>) {
        if let Some(rest) = self.robots.get_mut(robot) {
            rest.measured.take(at, q);
        }
    }

    fn blind(&mut self, robot: &str) {
        if let Some(rest) = self.robots.get_mut(robot) {
            rest.measured.forget();
        }
    }
}
