//! I5: every value that leaves the filter is finite, within its motor's limits, and not faster than the motor
//! may move.
//!
//! The target of a commit contains readings for the motors that it does not name; these may lie beyond a limit.
//! Motors that the open transaction has named may exceed a limit by the tolerance, for encoder noise where
//! their stream ended. A stream of positions or velocities is recorded when it ends, with the greatest share of
//! a motor's speed that it requested.

use super::{FoundViolations, Invariant};
use crate::journal::{JournalLine, NOT_FINITE};
use mobee_contract::{Event, MotorUnits};
use std::collections::{BTreeMap, BTreeSet};

/// Tolerance for rounding, as a share, and in rad or rad/s.
const SLACK: f64 = 1e-9;
/// Tolerance for rounding in the ratio of a step to the greatest allowed step.
const STEP_SLACK: f64 = 1e-6;

#[derive(Default)]
pub(super) struct LimitsWatch {
    robots: BTreeMap<String, MotorLimits>,
}

#[derive(Default)]
struct MotorLimits {
    names: Vec<String>,
    units: MotorUnits,
    range: Vec<(f64, f64)>,
    max_speed: Vec<f64>,
    tolerance: f64,
    /// Motors that the last transaction has named.
    named: BTreeSet<usize>,
}

impl MotorLimits {
    fn position(&self, motor: usize, q: f64, slack: f64) -> Option<String> {
        let Some((min, max)) = self.range.get(motor) else { return Some(format!("there is no motor {motor}")) };
        let outside = !(min - slack..=max + slack).contains(&q);
        outside.then(|| {
            let name = self.names.get(motor).map_or("?", String::as_str);
            let unit = self.units.of(motor);
            format!("motor {name} was sent to {}, outside {}", unit.told(q, 4), unit.told_range([*min, *max], 4))
        })
    }

    fn speed(&self, motor: usize, speed: f64) -> Option<String> {
        let Some(max) = self.max_speed.get(motor) else { return Some(format!("there is no motor {motor}")) };
        let wrong = !(0.0..=max * (1.0 + SLACK) + SLACK).contains(&speed);
        wrong.then(|| {
            let name = self.names.get(motor).map_or("?", String::as_str);
            let [speed, max] = [speed, *max].map(|v| self.units.of(motor).told_speed(v, 4));
            format!("motor {name} was given {speed} of {max}")
        })
    }
}

impl Invariant for LimitsWatch {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        let robot = match &line.event {
            Event::Robot { robot, motors, sliding, min, max, max_speed, tolerance, .. } => {
                let range = min.iter().copied().zip(max.iter().copied()).collect();
                let units = MotorUnits::new(motors.len(), sliding);
                let motors = MotorLimits {
                    names: motors.clone(),
                    units,
                    range,
                    max_speed: max_speed.clone(),
                    tolerance: *tolerance,
                    named: BTreeSet::new(),
                };
                self.robots.insert(robot.clone(), motors);
                return;
            }
            Event::Warning { text } => {
                if text.starts_with(NOT_FINITE) {
                    found.report(text.clone());
                }
                return;
            }
            Event::Commit { robot, .. }
            | Event::Amended { robot, .. }
            | Event::Command { robot, .. }
            | Event::Streamed { robot, .. } => robot,
            _ => return,
        };
        let Some(motors) = self.robots.get_mut(robot) else {
            return found.report(format!("{robot}: moved before the journal named its limits"));
        };
        let mut wrong: Vec<String> = Vec::new();
        match &line.event {
            Event::Commit { target, motors: named, .. } | Event::Amended { target, motors: named, .. } => {
                if matches!(line.event, Event::Commit { .. }) {
                    motors.named.clear();
                }
                motors.named.extend(named.iter().map(|(m, _)| *m));
                if target.len() != motors.range.len() {
                    wrong.push(format!("a target of {} motors for {}", target.len(), motors.range.len()));
                }
                let slack = motors.tolerance.max(SLACK);
                let sent = |m: &usize| motors.position(*m, *target.get(*m)?, slack);
                wrong.extend(motors.named.iter().filter_map(sent));
            }
            Event::Command { q, speed, .. } => {
                wrong.extend(q.iter().filter_map(|(m, q)| motors.position(*m, *q, SLACK)));
                wrong.extend(speed.iter().filter_map(|(m, v)| motors.speed(*m, *v)));
            }
            Event::Streamed { within_limits, greatest_step, .. } => {
                if !within_limits {
                    wrong.push("a set-point was outside the limits".into());
                }
                if !(0.0..=1.0 + STEP_SLACK).contains(greatest_step) {
                    wrong.push(format!("a set-point was {greatest_step:.6} times the greatest step away"));
                }
            }
            _ => {}
        }
        wrong.into_iter().for_each(|what| found.report(format!("{robot}: {what}")));
    }
}
