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
    /// Poses that have names.
    pub(crate) named: Vec<NamedPose>,
    /// Names of vertices that are at one of them.
    pub(crate) names: BTreeMap<u32, String>,
}

/// A pose of a robot that has a name.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NamedPose {
    pub(crate) name: String,
    /// The whole robot's pose, rad of encoder.
    pub(crate) q: Vec<f64>,
}

/// A vertex has the name of a pose if no motor of it is farther away, rad.
const SAME: f64 = 1e-5;

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
            Note::Vertex { id, at, q } => {
                match self.named.iter().find(|pose| pose.is_at(q)) {
                    Some(pose) => drop(self.names.insert(*id, pose.name.clone())),
                    None => drop(self.names.remove(id)),
                }
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

    /// The lowest and the highest corner of the box around it in the world, meters.
    pub(crate) fn extent(&self) -> Option<([f32; 3], [f32; 3])> {
        let grown = |(low, high): ([f32; 3], [f32; 3]), at: [f32; 3]| {
            let pick = |f: fn(f32, f32) -> f32, a: [f32; 3]| std::array::from_fn(|i| f(a[i], at[i]));
            (pick(f32::min, low), pick(f32::max, high))
        };
        let first = self.vertices.values().next()?.at;
        Some(self.vertices.values().map(|v| v.at).fold((first, first), grown))
    }

    /// A vertex's label: its pose's name, else its number.
    pub(crate) fn label(&self, id: u32) -> String {
        self.names.get(&id).cloned().unwrap_or_else(|| id.to_string())
    }

    /// Whether a vertex has a name.
    pub(crate) fn has_names(&self) -> bool {
        !self.names.is_empty()
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

impl NamedPose {
    fn is_at(&self, q: &[f64]) -> bool {
        self.q.len() == q.len() && self.q.iter().zip(q).all(|(a, b)| (a - b).abs() <= SAME)
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
    fn a_vertex_at_a_pose_with_a_name_is_called_by_it_until_it_is_elsewhere() {
        let named = vec![NamedPose { name: "left".into(), q: vec![0.5, 1.0] }];
        let mut map = Roadmap { named, ..Roadmap::default() };
        let vertex = |id, q: &[f64]| Note::Vertex { id, q: q.to_vec(), at: [f64::from(id), -1.0, 0.0] };
        map.on(&vertex(0, &[0.0, 0.0]), [1.0, 0.0, 0.0]);
        map.on(&vertex(1, &[0.5, 1.0 + 1e-9]), [1.0, 0.0, 0.0]);
        assert_eq!([0, 1, 7].map(|id| map.label(id)), ["0", "left", "7"]);
        assert_eq!(map.extent(), Some(([0.0, -1.0, 0.0], [1.0, -1.0, 0.0])));
        map.on(&vertex(1, &[0.5]), [1.0, 0.0, 0.0]);
        assert_eq!(map.label(1), "1");
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
