//! I26: encoders that freeze during a move are noticed. Readings that stay bit-identical while the motors
//! should move end the motion within a time limit. The limit is half a second, or the time in which the motor
//! with the longest path should have moved one degree at its mean speed, whichever is longer, plus half a
//! second to react. With coarse encoders (a joint with 4,096 counts) a fifth of the motion's duration is added,
//! because the motion starts slowly.
//!
//! Needs the measured configurations. The journal does not record the set-points of a stream. Frozen encoders
//! in a stream or a retreat are therefore judged by the oracle of a simulation, which has the true joint
//! positions.

use super::{FoundViolations, Invariant, PerRobot};
use crate::journal::JournalLine;
use mobee_contract::distance;
use mobee_contract::{CommandKind, Event, MotorUnits, Pose, Status, Time, Writer};
use std::collections::BTreeMap;
use std::time::Duration;

/// Time for which readings may always be equal, and the time allowed for the reaction, s.
const STILL: f64 = 0.5;
/// Most that one interval between two readings contributes: nothing can be noticed without a reading, and a
/// process may be suspended.
const GAP: Duration = Duration::from_millis(250);
/// Share of a motion's duration in which a coarse encoder may not show any motion yet.
const BEGINS: f64 = 0.2;
/// Distance from the target within which a motion is about to end, rad (2 deg).
const APPROACH_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;

#[derive(Default)]
pub(super) struct FrozenIsNoticed {
    robots: BTreeMap<String, FreezeWatch>,
}

#[derive(Default)]
struct FreezeWatch {
    units: MotorUnits,
    /// True if its encoders are so coarse that they may show no change while a motion begins.
    coarse: bool,
    /// Position error at which a motor may rest, rad.
    hold_error: f64,
    newest: Option<EqualReadings>,
    course: Option<WatchedMove>,
}

/// The newest reading, and the time for which readings have been equal since the move began.
struct EqualReadings {
    q: Pose,
    at: Time,
    still: Duration,
}

/// A move under way.
struct WatchedMove {
    target: Vec<(usize, f64)>,
    /// Time for which readings may be equal.
    within: Duration,
}

impl FreezeWatch {
    /// Starts tracking a move from the robot's current configuration.
    fn course(&mut self, now: Time, q: &[(usize, f64)], speed: &[(usize, f64)]) -> Option<WatchedMove> {
        let newest = self.newest.as_mut()?;
        (newest.at, newest.still) = (now, Duration::ZERO);
        let way = |(m, q): &(usize, f64)| Some((q - newest.q.get(*m)?).abs());
        let farthest = q.iter().filter_map(way).fold(0.0, f64::max);
        // The mean speed is half of the peak speed.
        let secs = q.iter().zip(speed).filter_map(|(q, (_, v))| Some(2.0 * way(q)? / v.max(1e-6))).fold(0.0, f64::max);
        let degree = secs * 1f64.to_radians() / farthest.max(1e-9);
        let begins = if self.coarse { BEGINS * secs } else { 0.0 };
        let within = Duration::try_from_secs_f64(STILL.max(degree) + STILL + begins).ok()?;
        Some(WatchedMove { target: q.to_vec(), within })
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose) -> Option<String> {
        let still = match &mut self.newest {
            Some(newest) if newest.q == *q => {
                newest.still += at.since(newest.at).min(GAP);
                newest.at = at;
                newest.still
            }
            newest => {
                *newest = Some(EqualReadings { q: q.clone(), at, still: Duration::ZERO });
                return None;
            }
        };
        let course = self.course.as_ref()?;
        let of = |(m, _): &(usize, f64)| q.get(*m).copied().unwrap_or_default();
        let here: Vec<f64> = course.target.iter().map(of).collect();
        let there: Vec<f64> = course.target.iter().map(|(_, q)| *q).collect();
        let away = distance(&here, &there);
        if still <= course.within || away < APPROACH_RAD + self.hold_error {
            return None;
        }
        let secs = still.as_secs_f64();
        let within = course.within.as_secs_f64();
        let away = self.units.told(away, 1);
        self.course = None;
        Some(format!(
            "{robot}: the readings are equal for {secs:.2} s at {at}, {away} from the target of a move, and {within:.2} s are allowed"
        ))
    }
}

impl Invariant for FrozenIsNoticed {
    fn on(&mut self, line: &JournalLine, _found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, motors, sliding, resolution, hold_error, .. } => {
                let robot = self.robots.entry(robot.clone()).or_default();
                robot.hold_error = *hold_error;
                (robot.units, robot.coarse) = (MotorUnits::new(motors.len(), sliding), *resolution > 0.0);
            }
            Event::Command { robot, writer: Writer::Agent, kind, q, speed, .. } => {
                self.robots.of(robot, |r| {
                    r.course = if *kind == CommandKind::Move { r.course(line.at, q, speed) } else { None }
                });
            }
            Event::Disabled { robot, .. } | Event::Outcome { robot, .. } => self.robots.of(robot, |r| r.course = None),
            Event::State { robot, status } if !matches!(status, Status::Moving | Status::Escaping) => {
                self.robots.of(robot, |r| r.course = None);
            }
            Event::Resumed { .. } => self.robots.values_mut().for_each(|r| r.course = None),
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut FoundViolations<'_>) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        found.report_all(state.pose(robot, at, q));
    }

    fn blind(&mut self, robot: &str) {
        self.robots.of(robot, |r| r.newest = None);
    }
}
