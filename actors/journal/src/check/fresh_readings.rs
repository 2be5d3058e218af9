//! I8: a commit is accepted, and an outcome given, only while the newest reading is fresh.
//!
//! Needs the measured configurations. The end of a run may be hurried: outcomes given after a supervision group
//! gave up, or while the run is being shut down, use the newest available reading.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{Event, Hold, Pose, Status, Time};
use std::collections::BTreeMap;
use std::time::Duration;

#[derive(Default)]
pub(super) struct FreshReadings {
    robots: BTreeMap<String, FreshnessWatch>,
    gave_up: bool,
}

#[derive(Default)]
struct FreshnessWatch {
    fresh: Duration,
    newest: Option<Time>,
    ending: bool,
}

impl Invariant for FreshReadings {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        let (robot, what) = match &line.event {
            Event::Robot { robot, fresh, .. } => {
                let fresh = Duration::try_from_secs_f64(*fresh).unwrap_or_default();
                self.robots.insert(robot.clone(), FreshnessWatch { fresh, ..FreshnessWatch::default() });
                return;
            }
            Event::State { robot, status } => {
                let reading = self.robots.entry(robot.clone()).or_default();
                reading.ending |= *status == Status::Holding(Hold::ShuttingDown);
                return;
            }
            Event::GaveUp { .. } => {
                self.gave_up = true;
                return;
            }
            Event::Commit { robot, id, .. } => (robot, format!("commit {} was accepted", id.0)),
            Event::Outcome { robot, id, .. } => (robot, format!("the outcome of commit {} was given", id.0)),
            _ => return,
        };
        let Some(reading) = self.robots.get(robot).filter(|r| !r.ending && !self.gave_up) else { return };
        // Without measured configurations the age is unknown.
        let Some(newest) = reading.newest else { return };
        let age = line.at.since(newest);
        if age > reading.fresh {
            found.report(format!("{robot}: {what} by a reading {:.3} s old", age.as_secs_f64()));
        }
    }

    fn pose(&mut self, robot: &str, at: Time, _q: &Pose, _found: &mut FoundViolations<'_>) {
        if let Some(reading) = self.robots.get_mut(robot) {
            reading.newest = reading.newest.max(Some(at));
        }
    }

    fn blind(&mut self, robot: &str) {
        if let Some(reading) = self.robots.get_mut(robot) {
            reading.newest = None;
        }
    }
}
