//! I35: a robot does not push a thing for long. The push ends within a second, plus the time that the robot
//! takes to brake and to return.
//!
//! Judged by the forces that a simulation computes (`pushed`). Excused are pushes after a disturbance, as for
//! hard contacts, and in an escape.

use super::disturbances::Disturbances;
use super::{FoundViolations, Invariant, PerRobot};
use crate::journal::JournalLine;
use mobee_contract::Event;
use std::collections::BTreeMap;

/// Longest duration of a push in addition to braking and returning, s.
const MAX_PUSH_S: f64 = 1.0;

/// Judges pushes as they end.
#[derive(Default)]
pub(super) struct Released {
    robots: BTreeMap<String, ReleaseWatch>,
    disturbances: Disturbances,
}

#[derive(Default)]
struct ReleaseWatch {
    /// Stopping time, s.
    stops: f64,
    /// True if its motion leads out of a contact, or began in one.
    escapes: bool,
    /// The push that was reported before its end: its start, s, and its greatest force so far, N.
    open: Option<(f64, f64)>,
}

impl ReleaseWatch {
    fn judge(&self, robot: &str, secs: f64, newtons: f64) -> Option<String> {
        let most = MAX_PUSH_S + 2.0 * self.stops;
        (secs > most && !self.escapes).then(|| {
            format!("{robot}: pushed something for {secs:.2} s, with at most {newtons:.1} N; {most:.2} s are allowed")
        })
    }
}

impl Invariant for Released {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        self.disturbances.note(line.at, &line.event);
        let now = line.at.secs();
        match &line.event {
            Event::Controller { robot, stops, .. } => {
                self.robots.entry(robot.clone()).or_default().stops = stops.unwrap_or_default();
            }
            Event::Commit { robot, escape, .. } => self.robots.of(robot, |r| r.escapes = *escape),
            Event::Pushed { robot, newtons, secs, lasting } => {
                let excused = self.disturbances.excuse(line.at);
                let Some(of) = self.robots.get_mut(robot) else { return };
                of.open = lasting.then_some((now - secs, *newtons));
                if !lasting && !excused {
                    found.report_all(of.judge(robot, *secs, *newtons));
                }
            }
            Event::Ended { .. } => {
                let judge = |(name, r): (&String, &ReleaseWatch)| {
                    r.open.and_then(|(since, most)| r.judge(name, now - since, most))
                };
                found.report_all(self.robots.iter().filter_map(judge));
            }
            _ => {}
        }
    }
}
