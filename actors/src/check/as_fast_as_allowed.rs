//! I20: no motor is measured to go faster than the open commit allows it, in the mean over sixteen readings.
//!
//! Wants the poses, and a journal that tells what is allowed (version 2). For a while after an amendment what was allowed before still
//! is: the motor brakes. Where set-points are streamed it may be faster, as it catches up with those that came late, and as fast as it
//! can if the board did not take some; a move that the driver makes of set-points counts as streamed; during the retreat it may be so fast as any commit has allowed it to be. A kink of its readings is no motion. What no commit names is a matter of I21.
//!
//! A joint that something pushes is as fast as that makes it: it springs back by what its servo gave way, and it is not judged for a contact
//! that the filter closes for within half a second, until that is open again.

use super::window::Window;
use super::{Found, Invariant, PerRobot};
use crate::record::journal::JournalLine;
use mobee_contract::{Cause, CommandKind, Event, MotorUnits, Pose, Time, Writer};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// What a board may add to what it was told, as a share and in rad/s.
const BOARD: (f64, f64) = (1.05, 0.25 * DEGREE);
/// The same where set-points are streamed, by whoever: those that come late are one and a half of a control period apart, in three quarters of one, and a
/// slow line brings them in bunches.
const CATCHES_UP: (f64, f64) = (2.75, 0.25 * DEGREE);
/// How long what was allowed before an amendment, or the end of a motion, counts on.
const BRAKES: Duration = Duration::from_secs(1);

/// Longest time from a push until the filter closes for it.
const NOTICED: Duration = Duration::from_millis(500);

#[derive(Default)]
pub(super) struct AsFastAsAllowed {
    robots: BTreeMap<String, Robot>,
}

struct Robot {
    window: Window,
    units: MotorUnits,
    motors: Vec<Motor>,
    /// Whether a commit is open that tells what is allowed; and whether the filter is closed.
    open: bool,
    closed: bool,
    /// Whether the motion is one of the board's own moves, and no stream of set-points.
    moves: bool,
    /// By how much its joints spring back where a push ends, rad.
    springs: f64,
    /// Whether the filter has closed for something that pushes it; and what is wrong unless it does so soon.
    pushed: bool,
    pending: Vec<(Time, String)>,
    /// Until when set-points that the board did not take may be caught up with.
    behind: Time,
}

#[derive(Clone, Default)]
struct Motor {
    name: String,
    /// What the open commit allows it, rad/s; what was allowed before, and until when; and the most that any commit has.
    allowed: f64,
    before: VecDeque<(Time, f64)>,
    ever: f64,
    /// The greatest kink of its readings in this motion, rad: during the retreat it is led along them.
    kink: f64,
    /// Whether it was told in this motion.
    told: bool,
}

impl Motor {
    fn allow(&mut self, at: Time, speed: f64) {
        self.before.push_back((at, self.allowed));
        self.allowed = speed;
        self.ever = self.ever.max(speed);
    }

    /// The most that it may do since then, rad/s, if that is known.
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

impl Robot {
    fn allow(&mut self, at: Time, motors: &[(usize, f64)]) {
        for (motor, speed) in motors {
            self.motors.iter_mut().skip(*motor).take(1).for_each(|motor| motor.allow(at, *speed));
        }
    }

    fn ended(&mut self, at: Time) {
        self.motors.iter_mut().filter(|motor| motor.allowed > 0.0).for_each(|motor| motor.allow(at, 0.0));
    }

    /// What has been wrong for so long that no contact was the reason.
    fn due(&mut self, at: Time) -> Vec<String> {
        let due = self.pending.iter().take_while(|(since, _)| *since + NOTICED <= at).count();
        self.pending.drain(..due).map(|(_, wrong)| wrong).collect()
    }

    fn judge(&mut self, robot: &str, at: Time) -> Vec<String> {
        let (since, back) = (self.window.since(), self.closed);
        let (streamed, springs) = (back || !self.moves, self.springs);
        let mut wrong = Vec::new();
        if since < self.behind || self.pushed {
            return wrong;
        }
        for (m, motor) in self.motors.iter_mut().enumerate() {
            let ((way, secs), kink) = (self.window.way(m), self.window.kink(m));
            motor.kink = motor.kink.max(kink);
            let kink = if streamed { motor.kink } else { kink };
            let Some(most) =
                motor.most(since, back, streamed).filter(|most| !motor.told && way > most * secs + kink + springs)
            else {
                continue;
            };
            motor.told = true;
            let (name, is, most) = (&motor.name, self.units.of(m).told_speed(way / secs, 3), most.to_degrees());
            wrong.push(format!("{robot}: motor {name} was measured at {is} at {at}, {most:.3} are allowed"));
        }
        wrong
    }
}

impl Invariant for AsFastAsAllowed {
    fn on(&mut self, line: &JournalLine, _found: &mut Found<'_>) {
        match &line.event {
            Event::Robot { robot, motors, sliding, period, hold_error, deflection, .. } => {
                let known = self.robots.remove(robot).map(|r| r.motors).filter(|known| known.len() == motors.len());
                let motor = |name: &String| Motor { name: name.clone(), ..Motor::default() };
                let motors = known.unwrap_or_else(|| motors.iter().map(motor).collect());
                let (window, units) = (Window::new(*period), MotorUnits::new(motors.len(), sliding));
                let (springs, pending) = (hold_error.max(*deflection), Vec::new());
                let (open, closed, moves, pushed, behind) = (false, true, false, false, Time::ZERO);
                let robot_state =
                    Robot { window, units, motors, open, closed, moves, springs, pushed, pending, behind };
                self.robots.insert(robot.clone(), robot_state);
            }
            Event::Commit { robot, motors, .. } => self.robots.of(robot, |r| {
                (r.open, r.moves) = (!motors.is_empty(), false);
                r.motors.iter_mut().for_each(|motor| (motor.told, motor.kink) = (false, 0.0));
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

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut Found<'_>) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        if state.window.take(at, q) {
            let wrong = state.judge(robot, at);
            state.pending.extend(wrong.into_iter().map(|wrong| (at, wrong)));
        }
        found.say_all(state.due(at));
    }

    fn end(&mut self, found: &mut Found<'_>) {
        for state in self.robots.values_mut() {
            found.say_all(state.pending.drain(..).map(|(_, wrong)| wrong));
        }
    }

    fn blind(&mut self, robot: &str) {
        self.robots.of(robot, |r| r.window.forget());
    }
}
