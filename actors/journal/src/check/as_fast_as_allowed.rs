//! I20: no motor is measured to be faster than the open commit allows, averaged over sixteen readings.
//!
//! Needs the measured configurations, and a journal that records the allowed speeds (version 2). For a while
//! after an amendment the previous speed remains allowed, because the motor brakes. With streamed set-points a
//! motor may be faster, because it catches up with late ones, and it is not judged shortly after the board
//! dropped some. A move that the driver makes of set-points counts as streamed. During the retreat a motor may
//! be as fast as any commit has ever allowed. A kink of the readings does not count as motion. Motors that
//! no commit names are judged by I21.
//!
//! A joint that something pushes moves as fast as it is pushed, and springs back by the deflection of its
//! servo. It is not judged if the filter closes for that contact within half a second, until the filter opens
//! again.

use super::window::Window;
use super::{FoundViolations, Invariant, PerRobot};
use crate::journal::JournalLine;
use mobee_contract::{Cause, CommandKind, Event, MotorUnits, Pose, Time, Writer};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// Tolerance of a board over the commanded speed, as a factor and in rad/s.
const BOARD: (f64, f64) = (1.05, 0.25 * DEGREE);
/// The same where set-points are streamed, by any writer. Late set-points are one and a half control periods
/// apart and are made up in three quarters of one, and a slow line delivers them in bursts.
const CATCHES_UP: (f64, f64) = (2.75, 0.25 * DEGREE);
/// Time for which the previous limit remains valid after an amendment or the end of a motion.
const BRAKES: Duration = Duration::from_secs(1);

/// Longest time from a push until the filter closes for it.
const NOTICED: Duration = Duration::from_millis(500);

#[derive(Default)]
pub(super) struct AsFastAsAllowed {
    robots: BTreeMap<String, SpeedWatch>,
}

struct SpeedWatch {
    window: Window,
    units: MotorUnits,
    motors: Vec<MotorSpeed>,
    /// True if a commit that states the allowed speeds is open.
    open: bool,
    /// True if the filter is closed.
    closed: bool,
    /// True if the motion is one of the board's own moves, not a stream of set-points.
    moves: bool,
    /// Deflection by which its joints spring back when a push ends, rad.
    springs: f64,
    /// True if the filter has closed because something pushes the robot.
    pushed: bool,
    /// Excess speeds that become violations unless the filter soon closes for a push.
    pending: Vec<(Time, String)>,
    /// End of the interval in which the motors may catch up with set-points that the board dropped.
    behind: Time,
}

#[derive(Clone, Default)]
struct MotorSpeed {
    name: String,
    /// Speed that the open commit allows, rad/s.
    allowed: f64,
    /// Speeds allowed before, each with the time until which it was, rad/s.
    before: VecDeque<(Time, f64)>,
    /// Greatest speed that any commit has allowed, rad/s.
    ever: f64,
    /// Greatest kink of its readings in this motion, rad: a retreat follows the recorded readings.
    kink: f64,
    /// True if a violation was already reported for this motion.
    reported: bool,
}

impl MotorSpeed {
    fn allow(&mut self, at: Time, speed: f64) {
        self.before.push_back((at, self.allowed));
        self.allowed = speed;
        self.ever = self.ever.max(speed);
    }

    /// Greatest speed that is allowed since then, rad/s; `None` if the journal does not state one.
    fn most(&mut self, since: Time, back: bool, streamed: bool) -> Option<f64> {
        while self.before.front().is_some_and(|(until, _)| *until + BRAKES < since) {
            self.before.pop_front();
        }
        let (share, more) = if streamed { CATCHES_UP } else { BOARD };
        let before = self.before.iter().map(|(_, speed)| *speed).fold(self.allowed, f64::max);
        let most = if back { self.ever } else { before };
        (most > 0.0).then_some(most * share + more)
    }
}

impl SpeedWatch {
    fn allow(&mut self, at: Time, motors: &[(usize, f64)]) {
        for (motor, speed) in motors {
            self.motors.iter_mut().skip(*motor).take(1).for_each(|motor| motor.allow(at, *speed));
        }
    }

    fn ended(&mut self, at: Time) {
        self.motors.iter_mut().filter(|motor| motor.allowed > 0.0).for_each(|motor| motor.allow(at, 0.0));
    }

    /// Takes the excess speeds that are older than [`NOTICED`], so that no contact explains them.
    fn due(&mut self, at: Time) -> Vec<String> {
        let due = self.pending.iter().take_while(|(since, _)| *since + NOTICED <= at).count();
        self.pending.drain(..due).map(|(_, wrong)| wrong).collect()
    }

    fn judge(&mut self, robot: &str, at: Time) -> Vec<String> {
        let since = self.window.since();
        let back = self.closed;
        let streamed = back || !self.moves;
        let springs = self.springs;
        let mut wrong = Vec::new();
        if since < self.behind || self.pushed {
            return wrong;
        }
        for (m, motor) in self.motors.iter_mut().enumerate() {
            let ((way, secs), kink) = (self.window.way(m), self.window.kink(m));
            motor.kink = motor.kink.max(kink);
            let kink = if streamed { motor.kink } else { kink };
            let Some(most) =
                motor.most(since, back, streamed).filter(|most| !motor.reported && way > most * secs + kink + springs)
            else {
                continue;
            };
            motor.reported = true;
            let name = &motor.name;
            let is = self.units.of(m).told_speed(way / secs, 3);
            let most = most.to_degrees();
            wrong.push(format!("{robot}: motor {name} was measured at {is} at {at}, {most:.3} are allowed"));
        }
        wrong
    }
}

impl Invariant for AsFastAsAllowed {
    fn on(&mut self, line: &JournalLine, _found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, motors, sliding, period, hold_error, deflection, .. } => {
                let known = self.robots.remove(robot).map(|r| r.motors).filter(|known| known.len() == motors.len());
                let motor = |name: &String| MotorSpeed { name: name.clone(), ..MotorSpeed::default() };
                let motors = known.unwrap_or_else(|| motors.iter().map(motor).collect());
                let robot_state = SpeedWatch {
                    window: Window::new(*period),
                    units: MotorUnits::new(motors.len(), sliding),
                    motors,
                    open: false,
                    closed: true,
                    moves: false,
                    springs: hold_error.max(*deflection),
                    pushed: false,
                    pending: Vec::new(),
                    behind: Time::ZERO,
                };
                self.robots.insert(robot.clone(), robot_state);
            }
            Event::Commit { robot, motors, .. } => self.robots.of(robot, |r| {
                (r.open, r.moves) = (!motors.is_empty(), false);
                r.motors.iter_mut().for_each(|motor| (motor.reported, motor.kink) = (false, 0.0));
                r.ended(line.at);
                r.allow(line.at, motors);
            }),
            Event::Amended { robot, motors, .. } => self.robots.of(robot, |r| {
                if r.open {
                    r.allow(line.at, motors);
                }
            }),
            Event::Command { robot, writer: Writer::Agent, kind, led: false, .. } if *kind == CommandKind::Move => {
                self.robots.of(robot, |r| r.moves = true);
            }
            Event::Enabled { robot, .. } => self.robots.of(robot, |r| {
                (r.closed, r.pushed) = (false, false);
                r.window.forget();
            }),
            Event::Disabled { robot, cause, .. } => self.robots.of(robot, |r| {
                r.closed = true;
                if matches!(cause, Cause::Stall { .. } | Cause::ExternalTorque { .. } | Cause::Displaced { .. }) {
                    r.pushed = true;
                    r.pending.clear();
                }
            }),
            Event::CommandDropped { robot, .. } => self.robots.of(robot, |r| r.behind = line.at + BRAKES),
            Event::Outcome { robot, .. } => self.robots.of(robot, |r| r.ended(line.at)),
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut FoundViolations<'_>) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        if state.window.take(at, q) {
            let wrong = state.judge(robot, at);
            state.pending.extend(wrong.into_iter().map(|wrong| (at, wrong)));
        }
        found.report_all(state.due(at));
    }

    fn end(&mut self, found: &mut FoundViolations<'_>) {
        for state in self.robots.values_mut() {
            found.report_all(state.pending.drain(..).map(|(_, wrong)| wrong));
        }
    }

    fn blind(&mut self, robot: &str) {
        self.robots.of(robot, |r| r.window.forget());
    }
}
