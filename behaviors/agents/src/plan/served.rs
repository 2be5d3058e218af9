//! Least recently used vertices of the map, which new ones replace once the map is full.

use mobee_contract::EdgeState;
use mobee_planning::roadmap::Roadmap;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
use std::collections::BTreeSet;

/// Times at which each vertex was last on a path, counted in paths; part of an agent's state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Served {
    /// Number of paths driven or planned so far.
    now: u64,
    /// By vertex: number of the last path through it; 0 or no entry: none.
    last: Vec<u64>,
}

impl Served {
    /// Marks these vertices as used now.
    pub fn on_the_way(&mut self, ids: &[u32]) {
        self.now += 1;
        for id in ids {
            let slot = *id as usize;
            self.last.resize(self.last.len().max(slot + 1), 0);
            if let Some(last) = self.last.get_mut(slot) {
                *last = self.now;
            }
        }
    }

    /// Returns the least recently used of the vertices that may be replaced. A vertex with a failed
    /// edge is chosen only if there is no other: replacing it would forget the failure.
    pub fn least(&self, map: &Roadmap, may_go: impl Fn(u32) -> bool) -> Option<u32> {
        let removed = map.edges().into_iter().filter(|(.., e)| e.state == EdgeState::Removed);
        let failed: BTreeSet<u32> = removed.flat_map(|(from, to, _)| [from, to]).collect();
        let last = |id: u32| self.last.get(id as usize).copied().unwrap_or(0);
        let all = map.vertices().map(|(id, _)| id).filter(|id| may_go(*id));
        all.max_by_key(|id| (!failed.contains(id), Reverse(last(*id)), Reverse(*id)))
    }
}
