//! I21: a motor that no open commit names does not leave its place: where it rested as the last motion that named it ended, over the
//! whole run, so that it does not walk either. No command but a stop names it. What the journal says was moved by others has no place.
//!
//! Wants the poses, and a journal that tells which motors a commit names (version 2). A place is the mean of sixteen readings, and so is
//! where the motor is now. The load of the others' motion may move it: by the hold error of its servo, a joint that slides by 2 mm. An encoder that jumps, from one reading to the next or while none came, says nothing of its motor, which has
//! its place where it is then said to be.

use super::window::Window;
use super::{Found, Invariant, PerRobot};
use crate::record::journal::JournalLine;
use mobee_contract::{Cause, CommandKind, Event, MotorUnits, Pose, Time};
use mobee_controller::play;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// How long a motor may take to come to rest after the motion that named it has ended.
const SETTLES: Duration = Duration::from_secs(1);

/// A step of so many tolerances between two readings that is none of a motion: noise stays below it, and an offset that would break
/// the promise does not.
const JUMPS: f64 = 0.75;
/// More than so many tolerances from the last reading before a pause to the first after it is no motion that was seen.
const UNSEEN: f64 = 0.5;

#[derive(Default)]
pub(super) struct IdleMotorsStay {
    robots: BTreeMap<String, Robot>,
}

#[derive(Default)]
struct Robot {
    names: Vec<String>,
    units: MotorUnits,
    tolerance: f64,
    /// By how much the load of the others' motion may move a motor, rad.
    hold_error: f64,
    window: Window,
    motors: Vec<Motor>,
    /// From when on places are taken: not before the robot has settled.
    settled: Time,
    /// Whether a commit is open that does not tell its motors.
    untold: bool,
    /// The motors that the last two commits named: a mode that is put back may be told after the next has begun. `None`: not told, as of
    /// a retreat that leads beyond its commit.
    last: [Option<BTreeSet<usize>>; 2],
}

#[derive(Clone, Default)]
struct Motor {
    /// Whether the open commit names it.
    named: bool,
    place: Option<f64>,
}

impl Robot {
    fn name(&mut self, motors: &[(usize, f64)]) {
        for (m, _) in motors {
            if let [Some(newest), _] = &mut self.last {
                newest.insert(*m);
            }
            if let Some(motor) = self.motors.get_mut(*m) {
                *motor = Motor { named: true, place: None };
            }
        }
    }

    /// What a command names that no commit does.
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
            if motor.named || self.untold {
                continue;
            }
            let (here, kink) = (self.window.mean(m), self.window.kink(m));
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
    fn on(&mut self, line: &JournalLine, found: &mut Found<'_>) {
        match &line.event {
            Event::Robot { robot, motors, sliding, period, tolerance, hold_error, .. } => {
                let window = Window::new(*period);
                let (names, n) = (motors.clone(), motors.len());
                let units = MotorUnits::new(n, sliding);
                let known = self.robots.remove(robot).map(|r| r.motors).filter(|motors| motors.len() == n);
                let motors = known.unwrap_or_else(|| vec![Motor::default(); n]);
                let (tolerance, hold_error, settled) = (*tolerance, *hold_error, line.at + SETTLES);
                self.robots.insert(
                    robot.clone(),
                    Robot {
                        names,
                        units,
                        tolerance,
                        hold_error,
                        window,
                        motors,
                        settled,
                        untold: false,
                        last: [None, None],
                    },
                );
            }
            // nobody saw where it was while no process ran
            Event::Resumed { .. } => self.robots.values_mut().for_each(|r| r.motors.fill(Motor::default())),
            Event::Commit { robot, motors, .. } => self.robots.of(robot, |r| {
                let [before, _] = std::mem::take(&mut r.last);
                r.last = [Some(BTreeSet::new()), before];
                r.untold = motors.is_empty();
                if r.untold {
                    r.motors.fill(Motor::default());
                }
                r.name(motors);
            }),
            // it was moved, and that was said
            Event::Displaced { robot, .. } | Event::Disabled { robot, cause: Cause::Displaced { .. }, .. } => {
                self.robots.of(robot, |r| r.motors.iter_mut().for_each(|m| m.place = None));
            }
            Event::SafePoseMoved { robot, .. } => self.robots.of(robot, |r| r.last = [None, None]),
            Event::Command { robot, kind, motors, .. } if *kind != CommandKind::Stop => {
                let wrong = self.robots.get(robot).and_then(|r| r.commanded(robot, kind.word(), motors));
                wrong.into_iter().for_each(|what| found.say(what));
            }
            Event::Streamed { robot, motors, .. } => {
                let wrong = self.robots.get(robot).and_then(|r| r.commanded(robot, "set-point", motors));
                wrong.into_iter().for_each(|what| found.say(what));
            }
            Event::Amended { robot, motors, .. } => self.robots.of(robot, |r| r.name(motors)),
            Event::Outcome { robot, .. } => self.robots.of(robot, |r| {
                r.settled = line.at + SETTLES;
                r.untold = false;
                r.motors.iter_mut().for_each(|m| m.named = false);
            }),
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut Found<'_>) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        if let Some(before) = state.window.before_pause(at) {
            let unseen = UNSEEN * state.tolerance;
            let readings = state.motors.iter_mut().zip(before.iter().zip(q.iter()));
            readings.filter(|(_, (a, b))| (*a - *b).abs() > unseen).for_each(|(motor, _)| motor.place = None);
        }
        if state.window.take(at, q) {
            found.say_all(state.judge(robot, at));
        }
    }

    fn blind(&mut self, robot: &str) {
        self.robots.of(robot, |r| r.window.forget());
    }
}
