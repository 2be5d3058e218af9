//! An agent's roadmap from its notes: vertices, edges by state, the plan. Pure; `draw.rs` shows it.

use crate::layout;
use mobee_contract::{EdgeState, Note};
use std::collections::BTreeMap;

/// The present state of a roadmap.
#[derive(Default)]
pub(crate) struct DrawnRoadmap {
    pub(crate) vertices: BTreeMap<u32, DrawnVertex>,
    /// Directed edges.
    pub(crate) edges: BTreeMap<(u32, u32), EdgeState>,
    /// The plan, vertex by vertex.
    pub(crate) plan: Vec<u32>,
    /// Changes since the last drawing.
    pub(crate) changed: RoadmapChanges,
    /// Named poses of the robot.
    pub(crate) named: Vec<DrawnPose>,
    /// Names of the vertices at named poses.
    pub(crate) names: BTreeMap<u32, String>,
}

/// A named pose of a robot.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DrawnPose {
    pub(crate) name: String,
    /// Configuration of the whole robot, rad of encoder.
    pub(crate) q: Vec<f64>,
}

/// Greatest distance per motor at which a vertex has the name of a pose, rad.
const SAME: f64 = 1e-5;

/// Position of a vertex in the drawings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DrawnVertex {
    /// In the world: the position of the hand, meters.
    pub(crate) at: [f32; 3],
    /// In the flat drawing, x right and y down.
    pub(crate) flat: [f32; 2],
}

/// Parts of the drawing that are out of date.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct RoadmapChanges {
    pub(crate) vertices: bool,
    pub(crate) edges: bool,
    pub(crate) plan: bool,
}

impl DrawnRoadmap {
    /// Takes a note; `right` is the direction in the world that points right in the flat drawing.
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
                let before = self.vertices.insert(*id, DrawnVertex { at, flat });
                if before.is_some_and(|before| before.at != at) {
                    // It is another vertex now, whose edges are reported again.
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

    /// Bounds of the flat drawing, labels included: left, top, right, bottom.
    pub(crate) fn bounds(&self) -> Option<[f32; 4]> {
        let [mut left, mut top] = [f32::INFINITY; 2];
        let [mut right, mut bottom] = [f32::NEG_INFINITY; 2];
        for DrawnVertex { flat: [x, y], .. } in self.vertices.values() {
            left = left.min(x - 50.0);
            top = top.min(y - 30.0);
            right = right.max(x + 50.0);
            bottom = bottom.max(y + 60.0);
        }
        (left < right).then_some([left, top, right, bottom])
    }

    /// Lowest and highest corner of the box around it in the world, meters.
    pub(crate) fn extent(&self) -> Option<([f32; 3], [f32; 3])> {
        let grown = |(low, high): ([f32; 3], [f32; 3]), at: [f32; 3]| {
            let pick = |f: fn(f32, f32) -> f32, a: [f32; 3]| std::array::from_fn(|i| f(a[i], at[i]));
            (pick(f32::min, low), pick(f32::max, high))
        };
        let first = self.vertices.values().next()?.at;
        Some(self.vertices.values().map(|v| v.at).fold((first, first), grown))
    }

    /// Label of a vertex: the name of its pose, or its number.
    pub(crate) fn label(&self, id: u32) -> String {
        self.names.get(&id).cloned().unwrap_or_else(|| id.to_string())
    }

    /// True if a vertex has a name.
    pub(crate) fn has_names(&self) -> bool {
        !self.names.is_empty()
    }

    /// Undirected lines of the drawing, each with the higher-ranked state of its two directions.
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

    /// Number of directed edges in a state.
    pub(crate) fn count(&self, state: EdgeState) -> usize {
        self.edges.values().filter(|s| **s == state).count()
    }
}

impl DrawnPose {
    fn is_at(&self, q: &[f64]) -> bool {
        self.q.len() == q.len() && self.q.iter().zip(q).all(|(a, b)| (a - b).abs() <= SAME)
    }
}

/// Rank of a state among two opposite directions: evidence before assumptions, passable before impassable.
fn rank(state: EdgeState) -> u8 {
    match state {
        // An edge that the world blocks is impassable, whatever was found in an earlier world.
        EdgeState::Blocked => 4,
        EdgeState::Feasible => 3,
        // A direction that failed is evidence; the opposite one is doubtful because of it.
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
        let mut map = DrawnRoadmap::default();
        for (a, b) in [(EdgeState::Feasible, EdgeState::Removed), (EdgeState::Removed, EdgeState::Feasible)] {
            map.on(&edge(1, 2, a), [1.0, 0.0, 0.0]);
            map.on(&edge(2, 1, b), [1.0, 0.0, 0.0]);
            assert_eq!(map.lines(), BTreeMap::from([((1, 2), EdgeState::Feasible)]));
        }
    }

    #[test]
    fn a_line_that_failed_one_way_is_removed_though_the_other_way_is_untried() {
        let mut map = DrawnRoadmap::default();
        map.on(&edge(0, 1, EdgeState::Removed), [1.0, 0.0, 0.0]);
        map.on(&edge(1, 0, EdgeState::Doubtful), [1.0, 0.0, 0.0]);
        assert_eq!(map.lines(), BTreeMap::from([((0, 1), EdgeState::Removed)]));
    }

    #[test]
    fn a_vertex_that_moved_has_lost_its_edges() {
        let mut map = DrawnRoadmap::default();
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
        let named = vec![DrawnPose { name: "left".into(), q: vec![0.5, 1.0] }];
        let mut map = DrawnRoadmap { named, ..DrawnRoadmap::default() };
        let vertex = |id, q: &[f64]| Note::Vertex { id, q: q.to_vec(), at: [f64::from(id), -1.0, 0.0] };
        map.on(&vertex(0, &[0.0, 0.0]), [1.0, 0.0, 0.0]);
        map.on(&vertex(1, &[0.5, 1.0 + 1e-9]), [1.0, 0.0, 0.0]);
        assert_eq!([0, 1, 7].map(|id| map.label(id)), ["0", "left", "7"]);
        assert_eq!(map.extent(), Some(([0.0, -1.0, 0.0], [1.0, -1.0, 0.0])));
        map.on(&vertex(1, &[0.5]), [1.0, 0.0, 0.0]);
        assert_eq!(map.label(1), "1");
    }

    #[test]
    fn a_note_without_news_draws_nothing() {
        let mut map = DrawnRoadmap::default();
        map.on(&edge(1, 2, EdgeState::Optimistic), [1.0, 0.0, 0.0]);
        assert!(map.changed.edges);
        map.changed = RoadmapChanges::default();
        map.on(&edge(1, 2, EdgeState::Optimistic), [1.0, 0.0, 0.0]);
        map.on(&Note::Plan { path: vec![] }, [1.0, 0.0, 0.0]);
        assert_eq!(map.changed, RoadmapChanges::default());
    }
}
