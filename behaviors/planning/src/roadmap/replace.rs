//! Reuse of vertex numbers, so that a map to which vertices are added indefinitely does not grow.

use super::{Roadmap, Vertex};
use mobee_contract::Note;
use petgraph::stable_graph::NodeIndex;

impl Roadmap {
    /// Assigns a vertex's number to another configuration. The edges of the old one, removed ones
    /// included, and the motions tried along them are dropped, and the vertex is noted again.
    /// Returns whether the number exists.
    pub fn replace(&mut self, id: u32, vertex: Vertex) -> bool {
        let node = NodeIndex::new(id as usize);
        let others: Vec<u32> = self.graph.neighbors_undirected(node).map(|n| n.index() as u32).collect();
        for other in others {
            self.unlink(id, other);
            self.unlink(other, id);
        }
        let group = self.group(&vertex.q);
        let note = Note::Vertex { id, q: vertex.q.clone(), at: vertex.at };
        let Some(slot) = self.graph.node_weight_mut(node) else { return false };
        *slot = vertex;
        self.ledger.retain(|(from, to), _| *from != id && *to != id);
        self.tried.retain(|t| t.from != id && t.to != id);
        self.near.add(id, &group);
        self.links.place(id, &group);
        self.notes.push(note);
        true
    }
}
