//! I18: when the agent that owns a motion dies, the motion is cancelled. More than two control periods after
//! the death it is neither amended nor ends as committed, unless the filter has closed in between or was closed
//! before.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{CommitId, Event, Outcome, Time};
use std::collections::BTreeMap;
use std::time::Duration;

/// Longest time for which a motion may continue, in control periods.
const PERIODS: u32 = 2;

#[derive(Default)]
pub(super) struct Orphans {
    robots: BTreeMap<String, OrphanWatch>,
}

#[derive(Default)]
struct OrphanWatch {
    period: Duration,
    open: Option<(CommitId, String)>,
    /// True if the filter is closed, so that the motion has been stopped.
    closed: bool,
    /// Time of its agent's death, until the motion is stopped.
    orphan: Option<Time>,
}

impl Invariant for Orphans {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        let (robot, id, what) = match &line.event {
            Event::Robot { robot, period, .. } => {
                let period = Duration::try_from_secs_f64(*period).unwrap_or_default();
                self.robots.insert(robot.clone(), OrphanWatch { period, ..OrphanWatch::default() });
                return;
            }
            Event::Commit { robot, id, agent, .. } => {
                let motion = self.robots.entry(robot.clone()).or_default();
                (motion.open, motion.orphan, motion.closed) = (Some((*id, agent.clone())), None, false);
                return;
            }
            Event::Died { actor, .. } => {
                let owned =
                    |m: &&mut OrphanWatch| !m.closed && m.open.as_ref().is_some_and(|(_, agent)| agent == actor);
                self.robots.values_mut().filter(owned).for_each(|m| m.orphan = m.orphan.or(Some(line.at)));
                return;
            }
            Event::Disabled { robot, .. } => {
                let motion = self.robots.entry(robot.clone()).or_default();
                (motion.orphan, motion.closed) = (None, true);
                return;
            }
            Event::Amended { robot, id, .. } => (robot, id, "was amended"),
            Event::Outcome { robot, id, outcome, .. } => {
                let what = if *outcome == Outcome::Committed { "went on to its target" } else { "" };
                (robot, id, what)
            }
            _ => return,
        };
        let motion = self.robots.entry(robot.clone()).or_default();
        let late = motion.orphan.filter(|died| line.at.since(*died) > motion.period * PERIODS);
        if let (Some(died), false) = (late, what.is_empty()) {
            found.report(format!("{robot}: commit {} {what}, although its agent died at {died}", id.0));
        }
        if matches!(line.event, Event::Outcome { .. }) {
            (motion.open, motion.orphan) = (None, None);
        }
    }
}
