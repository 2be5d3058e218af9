//! I21: a motor that no open commit names does not leave its place. Its place is where it came to rest after
//! the last motion that named it, over the whole run, so that slow drift is found, too. No command except a
//! stop names such a motor. A motor that the journal reports as displaced loses its place.
//!
//! Needs the measured configurations, and a journal that records the motors of each commit (version 2). Both
//! the place and the current position are means of sixteen readings. The load of other motors' motion may move
//! a motor by the hold error of its servo, a prismatic joint by 2 mm. An encoder that jumps between two
//! readings, or during a gap in the readings, is no evidence of motion: the place is then taken again.

use super::window::Window;
use super::{FoundViolations, Invariant, PerRobot};
use crate::journal::JournalLine;
use mobee_contract::play;
use mobee_contract::{Cause, CommandKind, Event, MotorUnits, Pose, Time};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// Time in which a motor settles after the end of the motion that named it.
const SETTLES: Duration = Duration::from_secs(1);

/// Smallest step between two readings that counts as an encoder jump, in tolerances. Noise stays below it; an
/// offset that would break the promise exceeds it.
const JUMPS: f64 = 0.75;
/// Largest difference between the readings before and after a gap at which the place remains valid, in
/// tolerances.
const UNSEEN: f64 = 0.5;

#[derive(Default)]
pub(super) struct IdleMotorsStay {
    robots: BTreeMap<String, IdleWatch>,
}

#[derive(Default)]
struct IdleWatch {
    names: Vec<String>,
    units: MotorUnits,
    tolerance: f64,
    /// Deflection of a motor under the load of other motors' motion, rad.
    hold_error: f64,
    window: Window,
    motors: Vec<IdleMotor>,
    /// Time from which places are taken, after the robot has settled.
    settled: Time,
    /// True if the open commit does not state its motors.
    motors_unknown: bool,
    /// Motors that the last two commits named: a restored control mode may be recorded after the next commit
    /// has begun. `None` if unknown, as for a retreat that goes back beyond its commit.
    last: [Option<BTreeSet<usize>>; 2],
}

#[derive(Clone, Default)]
struct IdleMotor {
    /// True if the open commit names it.
    named: bool,
    place: Option<f64>,
}

impl IdleWatch {
    fn name(&mut self, motors: &[(usize, f64)]) {
        for (m, _) in motors {
            if let [Some(newest), _] = &mut self.last {
                newest.insert(*m);
            }
            if let Some(motor) = self.motors.get_mut(*m) {
                *motor = IdleMotor { named: true, place: None };
            }
        }
    }

    /// Violation if a command names a motor that no commit does.
    fn commanded(&self, robot: &str, kind: &str, motors: &[usize]) -> Option<String> {
        let [Some(newest), Some(before)] = &self.last else { return None };
        let idle = motors.iter().find(|m| !newest.contains(m) && !before.contains(m))?;
        let name = self.names.get(*idle).map_or("?", String::as_str);
        Some(format!("{robot}: a {kind} was written to {name}, which no commit names"))
    }

    fn judge(&mut self, robot: &str, at: Time) -> Vec<String> {
        let mut wrong = Vec::new();
        let settled = self.window.since() >= self.settled;
        for (m, motor) in self.motors.iter_mut().enumerate() {
            if motor.named || self.motors_unknown {
                continue;
            }
            let here = self.window.mean(m);
            let kink = self.window.kink(m);
            let gives = self.hold_error.max(play(self.units.of(m)));
            match motor.place {
                _ if self.window.jump(m) > JUMPS * self.tolerance => motor.place = None,
                None if settled && self.window.way(m).0 <= 0.25 * self.tolerance => motor.place = Some(here),
                Some(place) if (here - place).abs() > self.tolerance + kink + gives => {
                    motor.place = None;
                    let name = self.names.get(m).map_or("?", String::as_str);
                    let by = self.units.of(m).told((here - place).abs(), 3);
                    wrong.push(format!(
                        "{robot}: motor {name}, which no open commit names, is {by} from its place at {at}"
                    ));
                }
                _ => {}
            }
        }
        wrong
    }
}

impl Invariant for IdleMotorsStay {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, motors, sliding, period, tolerance, hold_error, .. } => {
                let n = motors.len();
                let known = self.robots.remove(robot).map(|r| r.motors).filter(|motors| motors.len() == n);
                let state = IdleWatch {
                    names: motors.clone(),
                    units: MotorUnits::new(n, sliding),
                    tolerance: *tolerance,
                    hold_error: *hold_error,
                    window: Window::new(*period),
                    motors: known.unwrap_or_else(|| vec![IdleMotor::default(); n]),
                    settled: line.at + SETTLES,
                    motors_unknown: false,
                    last: [None, None],
                };
                self.robots.insert(robot.clone(), state);
            }
            // The motors may have moved while no process ran.
            Event::Resumed { .. } => self.robots.values_mut().for_each(|r| r.motors.fill(IdleMotor::default())),
            Event::Commit { robot, motors, .. } => self.robots.of(robot, |r| {
                let [before, _] = std::mem::take(&mut r.last);
                r.last = [Some(BTreeSet::new()), before];
                r.motors_unknown = motors.is_empty();
                if r.motors_unknown {
                    r.motors.fill(IdleMotor::default());
                }
                r.name(motors);
            }),
            // The displacement was reported.
            Event::Displaced { robot, .. } | Event::Disabled { robot, cause: Cause::Displaced { .. }, .. } => {
                self.robots.of(robot, |r| r.motors.iter_mut().for_each(|m| m.place = None));
            }
            Event::SafePoseMoved { robot, .. } => self.robots.of(robot, |r| r.last = [None, None]),
            Event::Command { robot, kind, motors, .. } if *kind != CommandKind::Stop => {
                let wrong = self.robots.get(robot).and_then(|r| r.commanded(robot, kind.word(), motors));
                wrong.into_iter().for_each(|what| found.report(what));
            }
            Event::Streamed { robot, motors, .. } => {
                let wrong = self.robots.get(robot).and_then(|r| r.commanded(robot, "set-point", motors));
                wrong.into_iter().for_each(|what| found.report(what));
            }
            Event::RetreatJoined { robot, motors, .. } => self.robots.of(robot, |r| {
                r.name(&motors.iter().map(|m| (*m, 0.0)).collect::<Vec<_>>());
            }),
            Event::Amended { robot, motors, .. } => self.robots.of(robot, |r| r.name(motors)),
            Event::Outcome { robot, .. } => self.robots.of(robot, |r| {
                r.settled = line.at + SETTLES;
                r.motors_unknown = false;
                r.motors.iter_mut().for_each(|m| m.named = false);
            }),
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut FoundViolations<'_>) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        if let Some(before) = state.window.before_pause(at) {
            let unseen = UNSEEN * state.tolerance;
            let readings = state.motors.iter_mut().zip(before.iter().zip(q.iter()));
            readings.filter(|(_, (a, b))| (*a - *b).abs() > unseen).for_each(|(motor, _)| motor.place = None);
        }
        if state.window.take(at, q) {
            found.report_all(state.judge(robot, at));
        }
    }

    fn blind(&mut self, robot: &str) {
        self.robots.of(robot, |r| r.window.forget());
    }
}
