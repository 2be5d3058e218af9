//! I11: a removed edge is in no later plan until a note states it as optimistic or feasible again. The same
//! holds for an edge that the world blocks, until a note states any other state.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{EdgeState, Event, Note};
use std::collections::{BTreeMap, BTreeSet};

#[derive(Default)]
pub(super) struct RemovedStaysRemoved {
    robots: BTreeMap<String, ClosedEdges>,
}

#[derive(Default)]
struct ClosedEdges {
    removed: BTreeSet<(u32, u32)>,
    blocked: BTreeSet<(u32, u32)>,
}

impl Invariant for RemovedStaysRemoved {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        let Event::Note { robot, note } = &line.event else { return };
        let ClosedEdges { removed, blocked } = self.robots.entry(robot.clone()).or_default();
        match note {
            Note::Edge { from, to, state, .. } => {
                let edge = (*from, *to);
                blocked.remove(&edge);
                match state {
                    EdgeState::Removed => {
                        removed.insert(edge);
                    }
                    EdgeState::Blocked => {
                        blocked.insert(edge);
                    }
                    EdgeState::Optimistic | EdgeState::Feasible => {
                        removed.remove(&edge);
                    }
                    EdgeState::Doubtful => {}
                }
            }
            Note::Plan { path } => {
                for (from, to) in path.iter().zip(path.iter().skip(1)) {
                    if removed.contains(&(*from, *to)) {
                        found.report(format!("{robot}: plans over the edge {from} -> {to}, which was removed"));
                    }
                    if blocked.contains(&(*from, *to)) {
                        found.report(format!("{robot}: plans over the edge {from} -> {to}, which the world blocks"));
                    }
                }
            }
            _ => {}
        }
    }
}
