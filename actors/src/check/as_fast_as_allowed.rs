//! I20: no motor is measured to go faster than the open commit allows it, in the mean over sixteen readings.
//!
//! Wants the poses, and a journal that tells what is allowed (version 2). For a while after an amendment what was allowed before still
//! is: the motor brakes. On the way back each motor may be as fast as any commit has allowed it to be, and a little faster, as it
//! catches up with its set-points. What no commit names is a matter of I21.

use super::window::Window;
use super::{Found, Invariant};
use crate::journal::Line;
use mobee_contract::{Event, Pose, Time};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// What a board may add to what it was told: the share by which a measured speed may exceed what is allowed.
const BOARD: f64 = 0.05;
/// The same on the way back, where set-points that come late are caught up with.
const CATCHES_UP: f64 = 0.5;
/// How long what was allowed before an amendment, or the end of a motion, counts on.
const BRAKES: Duration = Duration::from_secs(1);

#[derive(Default)]
pub(super) struct AsFastAsAllowed {
    robots: BTreeMap<String, Robot>,
    found: Vec<String>,
}

#[derive(Default)]
struct Robot {
    motors: Vec<String>,
    window: Window,
    /// What is allowed now, per motor, if a commit is open that tells it.
    allowed: Option<Vec<f64>>,
    /// What was allowed before, and until when.
    before: VecDeque<(Time, Vec<f64>)>,
    /// The most that any commit has allowed.
    ever: Vec<f64>,
    /// Whether the filter is closed.
    closed: bool,
    /// What was told of the motion under way: a motor is told once.
    told: Vec<bool>,
}

impl Robot {
    fn allow(&mut self, at: Time, motors: &[(usize, f64)], anew: bool) {
        let mut allowed = vec![0.0; self.motors.len()];
        if let Some(before) = self.allowed.take() {
            self.before.push_back((at, before.clone()));
            allowed = if anew { allowed } else { before };
        }
        for (motor, speed) in motors {
            if let (Some(slot), Some(ever)) = (allowed.get_mut(*motor), self.ever.get_mut(*motor)) {
                *slot = *speed;
                *ever = f64::max(*ever, *speed);
            }
        }
        self.allowed = Some(allowed);
    }

    /// The most that a motor may do in the readings of the window.
    fn most(&self, motor: usize) -> f64 {
        let of = |all: &Vec<f64>| all.get(motor).copied().unwrap_or(0.0);
        if self.closed {
            return of(&self.ever) * (1.0 + CATCHES_UP);
        }
        let before = self.before.iter().map(|(_, allowed)| of(allowed));
        before.chain(self.allowed.as_ref().map(of)).fold(0.0, f64::max) * (1.0 + BOARD)
    }

    fn judge(&mut self, robot: &str, at: Time) -> Vec<String> {
        let since = self.window.since();
        while self.before.front().is_some_and(|(until, _)| *until + BRAKES < since) {
            self.before.pop_front();
        }
        let mut wrong = Vec::new();
        for motor in 0..self.motors.len() {
            let most = self.most(motor);
            let (way, secs) = self.window.way(motor);
            let told = self.told.get(motor).copied().unwrap_or(true);
            if most == 0.0 || told || way <= most * secs + self.window.kink(motor) {
                continue;
            }
            self.told.iter_mut().skip(motor).take(1).for_each(|told| *told = true);
            let (name, [is, most]) = (self.motors.get(motor).map_or("?", String::as_str), [way / secs, most]);
            let [is, most] = [is, most].map(f64::to_degrees);
            wrong.push(format!("{robot}: motor {name} was measured at {is:.3} deg/s at {at}, {most:.3} are allowed"));
        }
        wrong
    }
}

impl Invariant for AsFastAsAllowed {
    fn on(&mut self, line: &Line, found: &mut Found<'_>) {
        self.found.drain(..).for_each(|what| found.say(what));
        match &line.event {
            Event::Robot { robot, motors, period, .. } => {
                let (n, motors) = (motors.len(), motors.clone());
                let known = self.robots.remove(robot).map(|r| r.ever).filter(|ever| ever.len() == n);
                let ever = known.unwrap_or_else(|| vec![0.0; n]);
                let window = Window::new(*period);
                self.robots.insert(
                    robot.clone(),
                    Robot { motors, window, ever, closed: true, told: vec![false; n], ..Robot::default() },
                );
            }
            Event::Commit { robot, motors, .. } if !motors.is_empty() => self.of(robot, |r| {
                r.told.fill(false);
                r.allow(line.at, motors, true);
            }),
            Event::Amended { robot, motors, .. } if !motors.is_empty() => self.of(robot, |r| {
                if r.allowed.is_some() {
                    r.allow(line.at, motors, false);
                }
            }),
            Event::Enabled { robot, .. } => self.of(robot, |r| {
                r.closed = false;
                r.window.forget();
            }),
            Event::Disabled { robot, .. } => self.of(robot, |r| r.closed = true),
            Event::Outcome { robot, .. } => self.of(robot, |r| {
                if let Some(allowed) = r.allowed.take() {
                    r.before.push_back((line.at, allowed));
                }
            }),
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        if state.window.take(at, q) {
            self.found.extend(state.judge(robot, at));
        }
    }

    fn blind(&mut self, robot: &str) {
        self.of(robot, |r| r.window.forget());
    }

    fn end(&mut self, found: &mut Found<'_>) {
        self.found.drain(..).for_each(|what| found.say(what));
    }
}

impl AsFastAsAllowed {
    fn of(&mut self, robot: &str, change: impl FnOnce(&mut Robot)) {
        if let Some(robot) = self.robots.get_mut(robot) {
            change(robot);
        }
    }
}
