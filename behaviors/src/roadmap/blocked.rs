//! Edges that the world blocks: out of the graph for as long as it does.

use super::{Edge, Roadmap};
use mobee_contract::EdgeState;
use petgraph::stable_graph::NodeIndex;

impl Roadmap {
    /// Takes an edge out of the graph, because it is not free in the present world. One that was removed stays removed, and one that
    /// is blocked already learns its cause. Answers whether it was planned over until now.
    pub fn block(&mut self, from: u32, to: u32, cause: Option<String>) -> bool {
        let was = self.graph.contains_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize));
        let is_blocked = |e: &Edge| e.state == EdgeState::Blocked && e.cause != cause;
        let Some(edge) = self.edge(from, to).filter(|e| was || is_blocked(e)).cloned() else { return false };
        self.unlink(from, to);
        let blocked = Edge { state: EdgeState::Blocked, cause, ..edge };
        self.note(from, to, &blocked);
        self.ledger.insert((from, to), blocked);
        was
    }

    /// Puts a blocked edge back into the graph, as what it was believed to be. Answers whether it was blocked.
    pub fn unblock(&mut self, from: u32, to: u32) -> bool {
        let Some(edge) = self.believed(from, to) else { return false };
        self.ledger.remove(&(from, to));
        self.note(from, to, &edge);
        self.link(from, to, edge);
        true
    }

    /// What a blocked edge would be if nothing blocked it: known from having been driven, or from its opposite.
    pub(super) fn believed(&self, from: u32, to: u32) -> Option<Edge> {
        let Edge { driven, .. } = *self.ledger.get(&(from, to)).filter(|e| e.state == EdgeState::Blocked)?;
        let state = match self.edge(to, from).map(|e| (e.state, e.driven)) {
            _ if driven => EdgeState::Feasible,
            Some((EdgeState::Removed, _)) => EdgeState::Doubtful,
            Some((EdgeState::Feasible | EdgeState::Blocked, true)) => EdgeState::Feasible,
            _ => EdgeState::Optimistic,
        };
        Some(Edge { state, driven, cause: None })
    }

    /// How many directed edges there are, removed and blocked ones included.
    pub fn edge_count(&self) -> usize {
        self.graph.edge_count() + self.ledger.len()
    }

    /// The blocked edges that leave a vertex, as what they are believed to be, by number.
    pub(super) fn blocked_out(&self, from: u32) -> impl Iterator<Item = (u32, Edge)> {
        let all = self.ledger.range((from, 0)..=(from, u32::MAX));
        all.filter_map(move |((_, to), _)| Some((*to, self.believed(from, *to)?)))
    }
}
