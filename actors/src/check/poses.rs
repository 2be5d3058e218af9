//! The measured poses beside a journal, in the order in which they were told.
//!
//! Where readings are missing, since a process died or a disk was full, nothing is held against the robot that only they could
//! have excused: the checker is told that it sees it no more.

use super::Checker;
use crate::record::track::{Readings, file, read};
use mobee_contract::Time;
use std::path::Path;

/// What measured poses a journal was judged by.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JudgedPoses {
    /// Readings, of all robots.
    pub readings: u64,
    /// Robots without any.
    pub missing: Vec<String>,
    /// What is wrong with those that there are, in words.
    pub wrong: Vec<String>,
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
        let readings = robots.into_iter().filter_map(|robot| robot.readings);
        found.wrong.extend(readings.filter_map(|readings| readings.cut()));
        found
    }
}
