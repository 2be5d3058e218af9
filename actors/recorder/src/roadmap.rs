//! An agent's roadmap as its notes tell it: vertices, edges by state, the plan. Pure; `draw.rs` shows it.

use crate::layout;
use mobee_contract::{EdgeState, Note};
use std::collections::BTreeMap;

/// A roadmap as it is known now.
#[derive(Default)]
pub(crate) struct Roadmap {
    pub(crate) vertices: BTreeMap<u32, Vertex>,
    /// Directed edges.
    pub(crate) edges: BTreeMap<(u32, u32), EdgeState>,
    /// The plan, vertex by vertex.
    pub(crate) plan: Vec<u32>,
    /// What changed since it was last drawn.
    pub(crate) changed: Changed,
}

/// Where a vertex is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Vertex {
    /// In the world: the hand's position there, meters.
    pub(crate) at: [f32; 3],
    /// In the flat drawing, x right and y down.
    pub(crate) flat: [f32; 2],
}

/// Parts of the picture that are out of date.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Changed {
    pub(crate) vertices: bool,
    pub(crate) edges: bool,
    pub(crate) plan: bool,
}

impl Roadmap {
    /// Takes over a note; `right` is the direction in the world that the flat drawing has on its right.
    pub(crate) fn on(&mut self, note: &Note, right: [f32; 3]) {
        match note {
            Note::Vertex { id, at, .. } => {
                let at = at.map(|v| v as f32);
                let taken: Vec<_> = self.vertices.values().map(|v| v.flat).collect();
                let flat = layout::place(layout::project(at, right), &taken);
                let before = self.vertices.insert(*id, Vertex { at, flat });
                if before.is_some_and(|before| before.at != at) {
                    // another vertex, whose edges are told anew
                    self.edges.retain(|(from, to), _| from != id && to != id);
                    self.changed.edges = true;
                }
                self.changed.vertices = true;
            }
            Note::Edge { from, to, state, .. } => {
                if self.edges.insert((*from, *to), *state) != Some(*state) {
                    self.changed.edges = true;
                }
            }
            Note::Plan { path } => {
                if self.plan != *path {
                    self.plan.clone_from(path);
                    self.changed.plan = true;
                }
            }
            Note::Tried { .. } | Note::Log { .. } => {}
        }
    }

    /// What the flat drawing covers, labels included: left, top, right, bottom.
    pub(crate) fn bounds(&self) -> Option<[f32; 4]> {
        let [mut left, mut top] = [f32::INFINITY; 2];
        let [mut right, mut bottom] = [f32::NEG_INFINITY; 2];
        for Vertex { flat: [x, y], .. } in self.vertices.values() {
            (left, top) = (left.min(x - 50.0), top.min(y - 30.0));
            (right, bottom) = (right.max(x + 50.0), bottom.max(y + 60.0));
        }
        (left < right).then_some([left, top, right, bottom])
    }

    /// The undirected lines of the picture, each with the better of its two directions' states.
    pub(crate) fn lines(&self) -> BTreeMap<(u32, u32), EdgeState> {
        let mut lines = BTreeMap::new();
        for ((from, to), state) in &self.edges {
            let line = lines.entry((*from.min(to), *from.max(to))).or_insert(*state);
            if rank(*state) > rank(*line) {
                *line = *state;
            }
        }
        lines
    }

    /// Directed edges in a state.
    pub(crate) fn count(&self, state: EdgeState) -> usize {
        self.edges.values().filter(|s| **s == state).count()
    }
}

/// Which of two opposite directions is shown: what was found out before what is only believed, passable before not.
fn rank(state: EdgeState) -> u8 {
    match state {
        // what the world blocks can't be passed, whatever was found out when it was another one
        EdgeState::Blocked => 4,
        EdgeState::Feasible => 3,
        // a direction that failed is evidence; that the opposite one is doubtful follows from it
        EdgeState::Removed => 2,
        EdgeState::Doubtful => 1,
        EdgeState::Optimistic => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edge(from: u32, to: u32, state: EdgeState) -> Note {
        Note::Edge { from, to, state, cause: None }
    }

    #[test]
    fn a_line_that_was_driven_one_way_is_feasible_whatever_the_other_way_did() {
        let mut map = Roadmap::default();
        for (a, b) in [(EdgeState::Feasible, EdgeState::Removed), (EdgeState::Removed, EdgeState::Feasible)] {
            map.on(&edge(1, 2, a), [1.0, 0.0, 0.0]);
            map.on(&edge(2, 1, b), [1.0, 0.0, 0.0]);
            assert_eq!(map.lines(), BTreeMap::from([((1, 2), EdgeState::Feasible)]));
        }
    }

    #[test]
    fn a_line_that_failed_one_way_is_removed_though_the_other_way_is_untried() {
        let mut map = Roadmap::default();
        map.on(&edge(0, 1, EdgeState::Removed), [1.0, 0.0, 0.0]);
        map.on(&edge(1, 0, EdgeState::Doubtful), [1.0, 0.0, 0.0]);
        assert_eq!(map.lines(), BTreeMap::from([((0, 1), EdgeState::Removed)]));
    }

    #[test]
    fn a_vertex_that_moved_has_lost_its_edges() {
        let mut map = Roadmap::default();
        let vertex = |id, x| Note::Vertex { id, q: vec![x], at: [x, 0.0, 0.0] };
        (0..3).for_each(|id| map.on(&vertex(id, f64::from(id)), [1.0, 0.0, 0.0]));
        for (a, b) in [(0, 1), (1, 0), (0, 2)] {
            map.on(&edge(a, b, EdgeState::Feasible), [1.0, 0.0, 0.0]);
        }
        map.on(&vertex(1, 1.0), [1.0, 0.0, 0.0]);
        assert_eq!(map.edges.len(), 3, "told again, and the same");
        map.on(&vertex(1, 5.0), [1.0, 0.0, 0.0]);
        assert_eq!(map.edges.keys().collect::<Vec<_>>(), [&(0, 2)]);
    }

    #[test]
    fn a_note_that_says_nothing_new_draws_nothing() {
        let mut map = Roadmap::default();
        map.on(&edge(1, 2, EdgeState::Optimistic), [1.0, 0.0, 0.0]);
        assert!(map.changed.edges);
        map.changed = Changed::default();
        map.on(&edge(1, 2, EdgeState::Optimistic), [1.0, 0.0, 0.0]);
        map.on(&Note::Plan { path: vec![] }, [1.0, 0.0, 0.0]);
        assert_eq!(map.changed, Changed::default());
    }
}
