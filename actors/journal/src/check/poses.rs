//! Merges the measured configurations beside a journal with its events, by the time of recording.
//!
//! Readings may be missing because a process died or a disk was full. The checker is notified that it is blind
//! to the robot, and finds no violation that only those readings could have excused.

use super::{Checker, wants_poses};
use crate::track::{Readings, TrackGap, file, read};
use mobee_contract::Time;
use std::path::Path;

/// Measured configurations that a journal was judged by.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JudgedPoses {
    /// Number of readings of all robots.
    pub readings: u64,
    /// Robots without readings.
    pub missing: Vec<String>,
    /// Damage of the existing readings, and the checks that it prevents, as sentences.
    pub wrong: Vec<String>,
    /// True if there is more damage than the unfinished end that a crash leaves.
    pub is_damaged: bool,
}

/// Describes an unreadable part of a robot's measured configurations and the checks that it prevents.
fn unjudged(robot: &str, file: &Path, gap: &TrackGap) -> String {
    let TrackGap { bytes: (from, to), after, until } = gap;
    let what = match (from == to, until) {
        (true, _) => format!("readings are missing at byte {from}"),
        (false, Some(_)) => format!("bytes {from} to {to} are damaged"),
        (false, None) => format!("nothing can be read from byte {from} on"),
    };
    let span = match (after, until) {
        (None, None) => "at all".to_owned(),
        (None, Some(until)) => format!("before {until}"),
        (Some(after), None) => format!("after {after}"),
        (Some(after), Some(until)) => format!("from {after} to {until}"),
    };
    format!("{}: {what}: {} of {robot} are not judged {span}", file.display(), wants_poses())
}

/// Readings of all robots that are still to be merged.
#[derive(Default)]
pub(super) struct Merge {
    robots: Vec<RobotPoses>,
    found: JudgedPoses,
}

struct RobotPoses {
    name: String,
    readings: Option<Readings>,
    /// True if the checker currently receives its readings.
    seen: bool,
}

impl RobotPoses {
    fn recorded_at(&mut self) -> Option<Time> {
        Some(self.readings.as_mut()?.peek()?.reported)
    }

    /// True if the next reading follows the last one without a gap.
    fn goes_on(&mut self) -> bool {
        self.readings.as_mut().and_then(Readings::peek).is_some_and(|reading| reading.follows)
    }
}

impl Merge {
    /// Adds a robot of the journal, whose readings are expected in the run's folder.
    pub fn robot(&mut self, dir: &Path, robot: &str) {
        if self.robots.iter().any(|known| known.name == robot) {
            return;
        }
        let readings = read(&file(dir, robot)).unwrap_or_else(|why| {
            self.found.wrong.push(why);
            self.found.is_damaged = true;
            None
        });
        if readings.is_none() {
            self.found.missing.push(robot.into());
        }
        self.robots.push(RobotPoses { name: robot.into(), readings, seen: false });
    }

    /// Passes the readings recorded up to this time to the checker.
    pub fn until(&mut self, time: Time, checker: &mut Checker) {
        loop {
            let next = self.robots.iter_mut().enumerate().filter_map(|(i, r)| Some((r.recorded_at()?, i))).min();
            let Some((_, i)) = next.filter(|(recorded_at, _)| *recorded_at <= time) else { break };
            let Some(robot) = self.robots.get_mut(i) else { break };
            if !robot.goes_on() {
                checker.blind(i);
            }
            let Some(reading) = robot.readings.as_mut().and_then(Iterator::next) else { break };
            robot.seen = true;
            self.found.readings += 1;
            checker.pose(i, reading.at, &reading.q);
        }
        for (i, robot) in self.robots.iter_mut().enumerate() {
            if robot.seen && !robot.goes_on() {
                robot.seen = false;
                checker.blind(i);
            }
        }
    }

    /// Returns the result after all readings were passed on.
    pub fn end(self) -> JudgedPoses {
        let Merge { robots, mut found } = self;
        for robot in robots {
            let Some(readings) = robot.readings else { continue };
            // A crash leaves an unreadable end with nothing behind it.
            found.is_damaged |= readings.gaps().iter().any(|gap| gap.until.is_some());
            found.is_damaged |= readings.failure().is_some();
            found.wrong.extend(readings.failure().map(str::to_owned));
            found.wrong.extend(readings.gaps().iter().map(|gap| unjudged(&robot.name, readings.path(), gap)));
        }
        found
    }
}
