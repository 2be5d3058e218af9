//! I25: a constraint that is violated closes the filter, at rest and in motion, and during the retreat it stops the robot.
//!
//! Wants the poses, and a journal that tells the robot's constraints. What was violated already as a retreat set out is excused while
//! that goes on: it may be what the robot comes out of. An escape may violate as much as it did when it set out, and no more. A controller
//! without a reflex promises nothing of this.

use super::{Found, Invariant, PerRobot};
use crate::record::journal::JournalLine;
use mobee_contract::{Clauses, Event, Pose, Status, Time};
use std::collections::BTreeMap;
use std::time::Duration;

/// How many control periods it may take until the filter is closed, or the retreat stopped.
const PERIODS: u32 = 3;
/// A clause below this counts as violated, degrees times its coefficients: measured poses are kept rounded.
const SURELY: f64 = -0.001;
/// How much more an escape may violate than as it set out, in the same units: encoders' noise, in its first reading and on its way.
const NOISE: f64 = 0.15;

#[derive(Default)]
pub(super) struct ConstraintsClose {
    robots: BTreeMap<String, Robot>,
}

#[derive(Default)]
struct Robot {
    clauses: Clauses,
    period: Duration,
    no_reflex: bool,
    watch: Watch,
    /// Whether the newest reading violates, and whether none has come since the watch began.
    violates: bool,
    begins: bool,
    /// While it escapes: the least value that a clause may have.
    escape: Option<f64>,
    /// Since when it does while it is watched.
    since: Option<Time>,
}

/// What a violation is to do.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Watch {
    /// Nothing: the filter is closed, and nothing is driven.
    #[default]
    Nothing,
    /// Close the filter.
    Close,
    /// Stop the retreat, or the escape.
    Stop,
}

impl Robot {
    fn watch(&mut self, watch: Watch) {
        self.escape = None;
        // what was violated from the start of a retreat is excused
        self.watch = if watch == Watch::Stop && self.violates { Watch::Nothing } else { watch };
        (self.since, self.begins) = (None, true);
    }

    /// An escape sets out.
    fn escapes(&mut self) {
        (self.watch, self.escape) = (Watch::Stop, Some(0.0));
        (self.since, self.begins) = (None, true);
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose) -> Option<String> {
        let least = self.clauses.iter().map(|clause| value(clause, q)).fold(f64::INFINITY, f64::min);
        if let Some(allowed) = self.escape.as_mut().filter(|_| self.begins) {
            *allowed = least.min(0.0) - NOISE;
            self.begins = false;
        }
        self.violates = least < self.escape.unwrap_or(SURELY);
        // the first reading on the way is the one that those are judged by who drive it
        if std::mem::take(&mut self.begins) && self.violates && self.watch == Watch::Stop {
            self.watch = Watch::Nothing;
        }
        if !self.violates || self.no_reflex || self.watch == Watch::Nothing {
            self.since = None;
            return None;
        }
        let since = *self.since.get_or_insert(at);
        (at.since(since) > self.period * PERIODS).then(|| {
            let what = if self.watch == Watch::Close { "the filter is open" } else { "the robot is driven on" };
            // it is told once
            self.watch = Watch::Nothing;
            format!("{robot}: a constraint is violated since {since}, and {what} at {at}")
        })
    }
}

/// The value of a clause, its largest member; above zero it holds.
fn value(clause: &[(Vec<(usize, f64)>, f64)], q: &Pose) -> f64 {
    let member = |(terms, b): &(Vec<(usize, f64)>, f64)| {
        let term = |(m, a): &(usize, f64)| a * q.get(*m).copied().unwrap_or(0.0).to_degrees();
        b + terms.iter().map(term).sum::<f64>()
    };
    clause.iter().map(member).fold(f64::NEG_INFINITY, f64::max)
}

impl Invariant for ConstraintsClose {
    fn on(&mut self, line: &JournalLine, _found: &mut Found<'_>) {
        match &line.event {
            Event::Robot { robot, period, constraints, .. } => {
                let state = self.robots.entry(robot.clone()).or_default();
                state.clauses.clone_from(constraints);
                state.period = Duration::try_from_secs_f64(*period).unwrap_or_default();
            }
            Event::Controller { robot, reflex, .. } => self.robots.of(robot, |r| r.no_reflex = !reflex),
            Event::Enabled { robot, .. } => self.robots.of(robot, |r| r.watch(Watch::Close)),
            Event::Commit { robot, escape: true, .. } => self.robots.of(robot, Robot::escapes),
            Event::RetreatBegan { robot, .. } => self.robots.of(robot, |r| r.watch(Watch::Stop)),
            Event::Outcome { robot, .. } => {
                self.robots.of(robot, |r| {
                    if r.watch == Watch::Stop {
                        r.watch(Watch::Nothing);
                    }
                });
            }
            Event::State { robot, status: Status::Rest } => self.robots.of(robot, |r| r.watch(Watch::Close)),
            Event::Disabled { robot, .. } | Event::RetreatStopped { robot, .. } => {
                self.robots.of(robot, |r| r.watch(Watch::Nothing));
            }
            Event::Resumed { .. } => self.robots.values_mut().for_each(|r| r.watch(Watch::Nothing)),
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut Found<'_>) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        found.say_all(state.pose(robot, at, q));
    }

    fn blind(&mut self, robot: &str) {
        self.robots.of(robot, |r| r.since = None);
    }
}
