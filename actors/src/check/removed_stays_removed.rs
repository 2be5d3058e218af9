//! I11: an edge that was removed is in no later plan, until a note states it as optimistic or feasible again.

use super::{Found, Invariant};
use crate::record::journal::JournalLine;
use mobee_contract::{EdgeState, Event, Note};
use std::collections::{BTreeMap, BTreeSet};

#[derive(Default)]
pub(super) struct RemovedStaysRemoved {
    robots: BTreeMap<String, BTreeSet<(u32, u32)>>,
}

impl Invariant for RemovedStaysRemoved {
    fn on(&mut self, line: &JournalLine, found: &mut Found<'_>) {
        let Event::Note { robot, note } = &line.event else { return };
        let removed = self.robots.entry(robot.clone()).or_default();
        match note {
            Note::Edge { from, to, state: EdgeState::Removed, .. } => drop(removed.insert((*from, *to))),
            Note::Edge { from, to, state: EdgeState::Optimistic | EdgeState::Feasible, .. } => {
                removed.remove(&(*from, *to));
            }
            Note::Plan { path } => {
                for (from, to) in path.iter().zip(path.iter().skip(1)) {
                    if removed.contains(&(*from, *to)) {
                        found.say(format!("{robot}: plans over the edge {from} -> {to}, which was removed"));
                    }
                }
            }
            _ => {}
        }
    }
}
