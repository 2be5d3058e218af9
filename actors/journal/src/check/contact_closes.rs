//! I19: a contact that begins during a motion closes the filter within one control period (Algorithm 6). An
//! escape is excused: it starts in contact. A controller without a reflex does not promise this.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{Event, Status, Time};
use std::collections::BTreeMap;
use std::time::Duration;

#[derive(Default)]
pub(super) struct ContactCloses {
    robots: BTreeMap<String, ContactWatch>,
}

#[derive(Default)]
struct ContactWatch {
    period: Duration,
    open: bool,
    /// True if its controller has no reflex, and so does not promise this.
    no_reflex: bool,
    /// Start of a contact that has not closed the filter yet.
    met: Option<Time>,
}

impl ContactWatch {
    fn judge(&mut self, robot: &str, now: Time, found: &mut FoundViolations<'_>) {
        if let Some(at) = self.met.take_if(|at| now.since(*at) > self.period) {
            found.report(format!("{robot}: the contact that began at {at} in mid-motion did not close the filter"));
        }
    }
}

impl Invariant for ContactCloses {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, period, .. } => {
                let period = Duration::try_from_secs_f64(*period).unwrap_or_default();
                self.robots.insert(robot.clone(), ContactWatch { period, ..ContactWatch::default() });
            }
            Event::Controller { robot, reflex, .. } => {
                self.robots.entry(robot.clone()).or_default().no_reflex = !reflex;
            }
            Event::Enabled { robot, .. } => self.robots.entry(robot.clone()).or_default().open = true,
            Event::Disabled { robot, .. } => {
                let filter = self.robots.entry(robot.clone()).or_default();
                filter.judge(robot, line.at, found);
                (filter.open, filter.met) = (false, None);
            }
            Event::ContactBegan { robot, during: Status::Moving, .. } => {
                let filter = self.robots.entry(robot.clone()).or_default();
                if filter.open && !filter.no_reflex {
                    filter.met.get_or_insert(line.at);
                }
            }
            Event::Command { robot, .. } | Event::Outcome { robot, .. } | Event::State { robot, .. } => {
                self.robots.entry(robot.clone()).or_default().judge(robot, line.at, found);
            }
            _ => {}
        }
    }

    fn end(&mut self, found: &mut FoundViolations<'_>) {
        let now = found.at;
        self.robots.iter_mut().for_each(|(robot, filter)| filter.judge(robot, now, found));
    }
}
