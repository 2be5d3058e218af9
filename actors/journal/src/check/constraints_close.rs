//! I25: a violated constraint closes the filter, at rest and in motion; during the retreat it stops the robot.
//!
//! Needs the measured configurations, and a journal that records the robot's constraints. A violation that
//! exists when a retreat starts is excused while it lasts, because the retreat may lead out of it. An escape
//! may violate as much as at its start, and no more. A controller without a reflex does not promise this.

use super::{FoundViolations, Invariant, PerRobot};
use crate::journal::JournalLine;
use mobee_contract::{Clauses, Event, Pose, Status, Time};
use std::collections::BTreeMap;
use std::time::Duration;

/// Most control periods until the filter is closed, or the retreat stopped.
const PERIODS: u32 = 3;
/// A clause below this value counts as violated, degrees times its coefficients: measured configurations are
/// rounded.
const SURELY: f64 = -0.001;
/// Amount by which an escape may exceed the violation at its start, in the same units: encoder noise in its
/// first reading and on its path.
const NOISE: f64 = 0.15;

#[derive(Default)]
pub(super) struct ConstraintsClose {
    robots: BTreeMap<String, ConstraintWatch>,
}

#[derive(Default)]
struct ConstraintWatch {
    clauses: Clauses,
    period: Duration,
    no_reflex: bool,
    watch: RequiredReaction,
    /// True if the newest reading violates a constraint.
    violates: bool,
    /// True if no reading has come since the watch began.
    begins: bool,
    /// Least allowed value of a clause during an escape.
    escape: Option<f64>,
    /// Start of the current violation while it is watched.
    since: Option<Time>,
}

/// Required reaction to a violation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum RequiredReaction {
    /// None: the filter is closed, and no motor is driven.
    #[default]
    Nothing,
    /// Close the filter.
    Close,
    /// Stop the retreat or the escape.
    Stop,
}

impl ConstraintWatch {
    fn watch(&mut self, watch: RequiredReaction) {
        self.escape = None;
        // A violation that exists when a retreat starts is excused.
        self.watch = if watch == RequiredReaction::Stop && self.violates { RequiredReaction::Nothing } else { watch };
        (self.since, self.begins) = (None, true);
    }

    /// An escape starts.
    fn escapes(&mut self) {
        (self.watch, self.escape) = (RequiredReaction::Stop, Some(0.0));
        (self.since, self.begins) = (None, true);
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose) -> Option<String> {
        let least = self.clauses.iter().map(|clause| value(clause, q)).fold(f64::INFINITY, f64::min);
        if let Some(allowed) = self.escape.as_mut().filter(|_| self.begins) {
            *allowed = least.min(0.0) - NOISE;
            self.begins = false;
        }
        self.violates = least < self.escape.unwrap_or(SURELY);
        // The reflex judges a retreat by the first reading after its start: a violation in that reading is
        // excused, too.
        if std::mem::take(&mut self.begins) && self.violates && self.watch == RequiredReaction::Stop {
            self.watch = RequiredReaction::Nothing;
        }
        if !self.violates || self.no_reflex || self.watch == RequiredReaction::Nothing {
            self.since = None;
            return None;
        }
        let since = *self.since.get_or_insert(at);
        (at.since(since) > self.period * PERIODS).then(|| {
            let what =
                if self.watch == RequiredReaction::Close { "the filter is open" } else { "the robot is driven on" };
            // Reported once.
            self.watch = RequiredReaction::Nothing;
            format!("{robot}: a constraint is violated since {since}, and {what} at {at}")
        })
    }
}

/// Value of a clause: that of its largest member, degrees times its coefficients; the clause holds if it is
/// positive.
fn value(clause: &[(Vec<(usize, f64)>, f64)], q: &Pose) -> f64 {
    let member = |(terms, b): &(Vec<(usize, f64)>, f64)| {
        let term = |(m, a): &(usize, f64)| a * q.get(*m).copied().unwrap_or(0.0).to_degrees();
        b + terms.iter().map(term).sum::<f64>()
    };
    clause.iter().map(member).fold(f64::NEG_INFINITY, f64::max)
}

impl Invariant for ConstraintsClose {
    fn on(&mut self, line: &JournalLine, _found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, period, constraints, .. } => {
                let state = self.robots.entry(robot.clone()).or_default();
                state.clauses.clone_from(constraints);
                state.period = Duration::try_from_secs_f64(*period).unwrap_or_default();
            }
            Event::Controller { robot, reflex, .. } => self.robots.of(robot, |r| r.no_reflex = !reflex),
            Event::Enabled { robot, .. } => self.robots.of(robot, |r| r.watch(RequiredReaction::Close)),
            Event::Commit { robot, escape: true, .. } => self.robots.of(robot, ConstraintWatch::escapes),
            Event::RetreatBegan { robot, .. } => self.robots.of(robot, |r| r.watch(RequiredReaction::Stop)),
            Event::Outcome { robot, .. } => {
                self.robots.of(robot, |r| {
                    if r.watch == RequiredReaction::Stop {
                        r.watch(RequiredReaction::Nothing);
                    }
                });
            }
            Event::State { robot, status: Status::Rest } => self.robots.of(robot, |r| r.watch(RequiredReaction::Close)),
            Event::Disabled { robot, .. } | Event::RetreatStopped { robot, .. } => {
                self.robots.of(robot, |r| r.watch(RequiredReaction::Nothing));
            }
            Event::Resumed { .. } => self.robots.values_mut().for_each(|r| r.watch(RequiredReaction::Nothing)),
            _ => {}
        }
    }

    fn pose(&mut self, robot: &str, at: Time, q: &Pose, found: &mut FoundViolations<'_>) {
        let Some(state) = self.robots.get_mut(robot) else { return };
        found.report_all(state.pose(robot, at, q));
    }

    fn blind(&mut self, robot: &str) {
        self.robots.of(robot, |r| r.since = None);
    }
}
