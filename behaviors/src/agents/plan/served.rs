//! Which of the map's vertices served least: the place of a new one, once there is no more room.

use crate::roadmap::Roadmap;
use mobee_contract::EdgeState;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
use std::collections::BTreeSet;

/// When each vertex was last on the way; part of an agent's state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Served {
    /// Ways driven or planned so far.
    now: u64,
    /// By vertex, the last of them that it was on; 0, or no entry: none.
    last: Vec<u64>,
}

impl Served {
    /// These vertices are on the way now.
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

    /// The vertex that was not on the way for the longest time, of those that may go. One where an edge failed goes after all others:
    /// with it goes what its failure taught.
    pub fn least(&self, map: &Roadmap, may_go: impl Fn(u32) -> bool) -> Option<u32> {
        let removed = map.edges().into_iter().filter(|(.., e)| e.state == EdgeState::Removed);
        let taught: BTreeSet<u32> = removed.flat_map(|(from, to, _)| [from, to]).collect();
        let last = |id: u32| self.last.get(id as usize).copied().unwrap_or(0);
        let all = map.vertices().map(|(id, _)| id).filter(|id| may_go(*id));
        all.max_by_key(|id| (!taught.contains(id), Reverse(last(*id)), Reverse(*id)))
    }
}
