//! The measured poses beside a journal, in the order in which they were told.
//!
//! Where readings are missing, since a process died or a disk was full, nothing is held against the robot that only they could
//! have excused: the checker is told that it sees it no more.

use super::{Checker, wants_poses};
use crate::record::track::{Readings, TrackGap, file, read};
use mobee_contract::Time;
use std::path::Path;

/// What measured poses a journal was judged by.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JudgedPoses {
    /// Readings, of all robots.
    pub readings: u64,
    /// Robots without any.
    pub missing: Vec<String>,
    /// What is wrong with those that there are, and what is not judged for it, in words.
    pub wrong: Vec<String>,
    /// Whether more is wrong than the end that a crash leaves.
    pub is_damaged: bool,
}

/// What is not judged of a robot for a part of its measured poses that can't be read.
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

/// The robots' readings that are still to come.
#[derive(Default)]
pub(super) struct Merge {
    robots: Vec<OfRobot>,
    found: JudgedPoses,
}

struct OfRobot {
    name: String,
    readings: Option<Readings>,
    /// Whether the checker sees it.
    seen: bool,
}

impl OfRobot {
    fn told(&mut self) -> Option<Time> {
        Some(self.readings.as_mut()?.peek()?.told)
    }

    /// Whether the next reading is the next there was.
    fn goes_on(&mut self) -> bool {
        self.readings.as_mut().and_then(Readings::peek).is_some_and(|reading| reading.follows)
    }
}

impl Merge {
    /// A robot of the journal, whose readings are in the run's folder, if anywhere.
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
        self.robots.push(OfRobot { name: robot.into(), readings, seen: false });
    }

    /// Hands the checker what was told up to this time.
    pub fn until(&mut self, time: Time, checker: &mut Checker) {
        loop {
            let next = self.robots.iter_mut().enumerate().filter_map(|(i, r)| Some((r.told()?, i))).min();
            let Some((_, i)) = next.filter(|(told, _)| *told <= time) else { break };
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

    /// What there was, once all was told.
    pub fn end(self) -> JudgedPoses {
        let Merge { robots, mut found } = self;
        for robot in robots {
            let Some(readings) = robot.readings else { continue };
            // a crash leaves an end that can't be read, and nothing behind it
            found.is_damaged |= readings.gaps().iter().any(|gap| gap.until.is_some());
            found.wrong.extend(readings.gaps().iter().map(|gap| unjudged(&robot.name, readings.path(), gap)));
        }
        found
    }
}
