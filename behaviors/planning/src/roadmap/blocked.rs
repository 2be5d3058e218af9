//! Edges that the world blocks: they are removed from the graph until it no longer does.

use super::{Edge, Roadmap};
use mobee_contract::EdgeState;

impl Roadmap {
    /// Removes an edge from the graph because it is not free in the present world. An edge that
    /// failed stays removed; for an edge that is already blocked, the cause is updated. Returns
    /// whether the edge was in the graph.
    pub fn block(&mut self, from: u32, to: u32, cause: Option<String>) -> bool {
        let present = self.unlink(from, to);
        let is_blocked = |e: &&Edge| e.state == EdgeState::Blocked && e.cause != cause;
        let was = present.is_some();
        let Some(edge) = present.or_else(|| self.ledger.get(&(from, to)).filter(is_blocked).cloned()) else {
            return false;
        };
        let blocked = Edge { state: EdgeState::Blocked, cause, ..edge };
        self.note(from, to, &blocked);
        self.ledger.insert((from, to), blocked);
        was
    }

    /// Returns a blocked edge to the graph, in its unblocked state. Returns whether it was blocked.
    pub fn unblock(&mut self, from: u32, to: u32) -> bool {
        let Some(edge) = self.unblocked(from, to) else { return false };
        self.ledger.remove(&(from, to));
        self.note(from, to, &edge);
        self.link(from, to, edge);
        true
    }

    /// Returns the state that a blocked edge has without the obstacle: from its own motions, or
    /// from its opposite.
    pub(super) fn unblocked(&self, from: u32, to: u32) -> Option<Edge> {
        let Edge { driven, .. } = *self.ledger.get(&(from, to)).filter(|e| e.state == EdgeState::Blocked)?;
        let state = match self.edge(to, from).map(|e| (e.state, e.driven)) {
            _ if driven => EdgeState::Feasible,
            Some((EdgeState::Removed, _)) => EdgeState::Doubtful,
            Some((EdgeState::Feasible | EdgeState::Blocked, true)) => EdgeState::Feasible,
            _ => EdgeState::Optimistic,
        };
        Some(Edge { state, driven, cause: None })
    }

    /// Number of directed edges, including removed and blocked ones.
    pub fn edge_count(&self) -> usize {
        self.graph.edge_count() + self.ledger.len()
    }

    /// Returns the blocked edges that leave a vertex, in their unblocked state, by number.
    pub(super) fn blocked_out(&self, from: u32) -> impl Iterator<Item = (u32, Edge)> {
        let all = self.ledger.range((from, 0)..=(from, u32::MAX));
        all.filter_map(move |((_, to), _)| Some((*to, self.unblocked(from, *to)?)))
    }
}
