//! I2: every accepted commit has exactly one outcome, and a robot has one transaction at a time.
//!
//! A commit that is open at the end is a violation only if the run ended in order.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{CommitId, Event};
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct OneOutcome {
    /// The last commit of each robot, and whether it is open.
    robots: BTreeMap<String, (CommitId, bool)>,
}

impl Invariant for OneOutcome {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Commit { robot, id, .. } => {
                if let Some((last, open)) = self.robots.insert(robot.clone(), (*id, true)) {
                    if open {
                        found.report(format!("{robot}: commit {} was accepted while {} was open", id.0, last.0));
                    }
                    if *id <= last {
                        found.report(format!("{robot}: commit {} follows {}: numbers only grow", id.0, last.0));
                    }
                }
            }
            Event::Outcome { robot, id, outcome, .. } => match self.robots.get_mut(robot) {
                Some((last, open)) if last == id && *open => *open = false,
                Some((last, _)) if last == id => {
                    found.report(format!("{robot}: commit {} got a second outcome, {outcome:?}", id.0));
                }
                _ => found.report(format!("{robot}: outcome {outcome:?} of commit {}, which is not open", id.0)),
            },
            Event::Amended { robot, id, .. } | Event::SafePoseMoved { robot, id, .. }
                if self.robots.get(robot) != Some(&(*id, true)) =>
            {
                found.report(format!("{robot}: commit {} was changed, but is not open", id.0));
            }
            _ => {}
        }
    }

    fn end(&mut self, found: &mut FoundViolations<'_>) {
        for (robot, (id, open)) in &self.robots {
            if *open {
                found.report(format!("{robot}: commit {} has no outcome", id.0));
            }
        }
    }
}
