//! A roadmap of configurations: vertices at which the robot may rest, and directed edges that it
//! may try.
//!
//! Edges are *optimistic*: they are not checked before they are driven. An edge that fails is
//! removed, that edge and no other (the paper's Algorithm 2), and recorded in a ledger with its
//! cause, from which it can be re-admitted.
//!
//! ```text
//!               driven to its end                      failed when driven
//!  Optimistic ───────────────────> Feasible ──┐   ┌──> Removed (ledger: cause) ──readmit──> Optimistic
//!      │                                      └───┤
//!      └── the opposite direction failed ──> Doubtful (used in a plan only if there is no other path)
//! ```
//!
//! An edge is a straight line in joint space, the short way round for continuous joints, and sweeps
//! the same configurations in both directions. Therefore an edge driven to its end also makes its
//! opposite feasible, if that was never driven. A failure says less about the opposite, because the
//! motion ended at its first contact.
//!
//! In addition, edges can be certified against the present world of the model (`validation.rs`). An
//! edge that it blocks is `Blocked`, is also recorded in the ledger, and returns to its former
//! state once the world has changed.

mod blocked;
mod file;
pub mod join;
pub mod neighbors;
mod replace;
mod search;
#[cfg(test)]
mod tests;
pub mod validation;
pub mod validity;
pub mod verdict;
pub mod walk;

use crate::map_file::TriedMotion;
use crate::roadmap::neighbors::{Neighbors, neighbors};
use crate::short_way::JointMetric;
use mobee_contract::{EdgeState, Note, Target};
use mobee_model::Robot;
use petgraph::algo::{Measure, dijkstra};
use petgraph::stable_graph::{NodeIndex, StableDiGraph};
use petgraph::visit::{EdgeRef, IntoEdgeReferences};
use search::{Buffers, Links};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Add;

/// Maximum number of motions of a run that are stored one by one; the states of the edges contain
/// the result of the others.
const MAX_TRIED: usize = 1000;

/// A vertex of the roadmap.
#[derive(Clone, Debug, PartialEq)]
pub struct Vertex {
    /// Name, if its author gave one.
    pub name: Option<String>,
    /// Configuration of the whole robot, rad.
    pub q: Vec<f64>,
    /// Position at which it is drawn: that of the hand, world frame, meters.
    pub at: [f64; 3],
}

/// A directed edge between two vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Edge {
    /// State of the edge.
    pub state: EdgeState,
    /// The edge itself was driven, to its end or to a failure.
    pub driven: bool,
    /// Obstacle, in words, if it failed.
    pub cause: Option<String>,
}

impl Edge {
    const NEW: Edge = Edge { state: EdgeState::Optimistic, driven: false, cause: None };
}

/// Cost of a path: the number of doubtful edges first, then the length in joint space.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Cost {
    /// Number of doubtful edges on the path.
    pub doubtful: u32,
    /// Length in joint space, rad.
    pub length: f64,
}

impl Add for Cost {
    type Output = Cost;
    fn add(self, other: Cost) -> Cost {
        Cost { doubtful: self.doubtful + other.doubtful, length: self.length + other.length }
    }
}

const _: fn() = || {
    fn is_measure<T: Measure>() {}
    is_measure::<Cost>();
};

/// Vertices and edges for one group of a robot's motors.
pub struct Roadmap {
    motors: Vec<usize>,
    metric: JointMetric,
    graph: StableDiGraph<Vertex, Edge, u32>,
    /// Copy of the graph's edges for searches: [`Roadmap::link`] and [`Roadmap::unlink`] update both.
    links: Links,
    search: RefCell<Buffers>,
    ledger: BTreeMap<(u32, u32), Edge>,
    near: Box<dyn Neighbors>,
    notes: Vec<Note>,
    /// Properties of its file: world and hand.
    about: file::About,
    /// Motions that were tried, in order: those of earlier runs, and the newest of this run.
    tried: Vec<TriedMotion>,
}

impl Roadmap {
    /// Creates an empty roadmap for these motors (indices into `Robot::motors`) of a robot.
    pub fn new(motors: Vec<usize>, robot: &Robot) -> Roadmap {
        let metric = JointMetric::of(&motors, robot);
        Self::empty(motors, metric)
    }

    fn empty(motors: Vec<usize>, metric: JointMetric) -> Roadmap {
        let near = neighbors(motors.len(), &metric);
        let links = Links::new(motors.len());
        let search = RefCell::default();
        let (graph, ledger, notes, about, tried) = Default::default();
        Roadmap { motors, metric, graph, links, search, ledger, near, notes, about, tried }
    }

    /// The motors in which its vertices differ.
    pub fn motors(&self) -> &[usize] {
        &self.motors
    }

    /// Returns the group's part of a whole configuration.
    pub fn group(&self, q: &[f64]) -> Vec<f64> {
        self.motors.iter().map(|m| q.get(*m).copied().unwrap_or(0.0)).collect()
    }

    /// Returns a whole configuration with the group at `q`.
    pub fn whole(&self, pose: &[f64], q: &[f64]) -> Vec<f64> {
        crate::group::whole(&self.motors, pose, q)
    }

    /// Adds a vertex and returns its number. Vertices are numbered from 0 and never removed; see
    /// [`Roadmap::replace`].
    pub fn add(&mut self, vertex: Vertex) -> u32 {
        let group = self.group(&vertex.q);
        let note = Note::Vertex { id: self.graph.node_count() as u32, q: vertex.q.clone(), at: vertex.at };
        let id = self.graph.add_node(vertex).index() as u32;
        self.near.add(id, &group);
        self.links.add_vertex(&group);
        self.notes.push(note);
        id
    }

    /// Restores a map from its notes: vertices with their numbers, and edges in their last state.
    /// Changes that these notes do not contain stay pending in [`Roadmap::notes`].
    pub fn recall(&mut self, notes: &[Note]) {
        for note in notes {
            match note {
                Note::Vertex { id, q, at } if *id as usize == self.len() => {
                    self.add(Vertex { name: None, q: q.clone(), at: *at });
                }
                // Blocked edges are determined again.
                Note::Edge { from, to, state: EdgeState::Blocked, .. } if self.edge(*from, *to).is_some() => {}
                Note::Edge { from, to, state, cause } => {
                    self.ledger.remove(&(*from, *to));
                    self.unlink(*from, *to);
                    let driven = matches!(state, EdgeState::Feasible | EdgeState::Removed);
                    self.restore(*from, *to, Edge { state: *state, driven, cause: cause.clone() });
                }
                Note::Tried { from, to, reached, cause } => self.store(*from, *to, *reached, cause.clone()),
                _ => {}
            }
        }
        let vertex = |n: &Note| if let Note::Vertex { id, .. } = n { Some(*id) } else { None };
        let edge = |n: &Note| if let Note::Edge { from, to, .. } = n { Some((*from, *to)) } else { None };
        let vertices: BTreeSet<u32> = notes.iter().filter_map(vertex).collect();
        let edges: BTreeSet<(u32, u32)> = notes.iter().filter_map(edge).collect();
        let is_noted = |n: &Note| {
            vertex(n).is_some_and(|id| vertices.contains(&id)) || edge(n).is_some_and(|edge| edges.contains(&edge))
        };
        self.notes.retain(|n| !is_noted(n));
    }

    /// Joins two vertices by an optimistic edge in each direction, unless that direction already
    /// exists or was removed.
    pub fn join(&mut self, a: u32, b: u32) {
        for (from, to) in [(a, b), (b, a)] {
            let known = self.edge(from, to).is_some();
            if from != to && !known && self.vertex(from).is_some() && self.vertex(to).is_some() {
                self.link(from, to, Edge::NEW);
                self.note(from, to, &Edge::NEW);
            }
        }
    }

    /// Adds an edge that does not exist yet.
    fn link(&mut self, from: u32, to: u32, edge: Edge) {
        self.links.add(from, to, edge.state == EdgeState::Doubtful, &self.metric);
        self.graph.add_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize), edge);
    }

    /// Removes an edge from the graph, if it exists.
    fn unlink(&mut self, from: u32, to: u32) -> Option<Edge> {
        self.links.remove(from, to);
        let known = self.graph.find_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize));
        known.and_then(|edge| self.graph.remove_edge(edge))
    }

    /// Joins every vertex to its `k` nearest ones, in both directions.
    pub fn join_nearest(&mut self, k: usize) {
        for (id, near) in self.near.knn_all(k) {
            for (_, other) in near {
                self.join(id, other);
            }
        }
    }

    /// Computes the position at which every vertex is drawn: `at` returns the hand's position in
    /// the world for a whole configuration.
    pub fn place(&mut self, at: impl Fn(&[f64]) -> [f64; 3]) {
        for i in 0..self.len() {
            if let Some(v) = self.graph.node_weight_mut(NodeIndex::new(i)) {
                v.at = at(&v.q);
            }
        }
        for note in &mut self.notes {
            if let Note::Vertex { q, at: shown, .. } = note {
                *shown = at(q);
            }
        }
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.graph.node_count()
    }

    /// Returns whether there are no vertices.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns a vertex by its number.
    pub fn vertex(&self, id: u32) -> Option<&Vertex> {
        self.graph.node_weight(NodeIndex::new(id as usize))
    }

    /// Returns all vertices, by number.
    pub fn vertices(&self) -> impl Iterator<Item = (u32, &Vertex)> {
        (0..self.len() as u32).filter_map(|id| Some((id, self.vertex(id)?)))
    }

    /// Returns the vertex of this name, or of this number if no vertex has such a name.
    pub fn find(&self, name: &str) -> Option<u32> {
        let named = self.vertices().find(|(_, v)| v.name.as_deref() == Some(name)).map(|(id, _)| id);
        named.or_else(|| name.parse().ok().filter(|id| self.vertex(*id).is_some()))
    }

    /// Returns an edge, removed ones included.
    pub fn edge(&self, from: u32, to: u32) -> Option<&Edge> {
        let present = self.graph.find_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize));
        present.and_then(|e| self.graph.edge_weight(e)).or_else(|| self.ledger.get(&(from, to)))
    }

    /// Returns all edges, removed ones included, ordered by (from, to).
    pub fn edges(&self) -> Vec<(u32, u32, &Edge)> {
        let present =
            self.graph.edge_references().map(|e| (e.source().index() as u32, e.target().index() as u32, e.weight()));
        let mut all: Vec<_> = present.chain(self.ledger.iter().map(|((a, b), e)| (*a, *b, e))).collect();
        all.sort_by_key(|(a, b, _)| (*a, *b));
        all
    }

    /// Returns the edges that leave a vertex, without removed ones, the shortest first.
    pub fn out(&self, from: u32) -> Vec<(u32, &Edge)> {
        let start = NodeIndex::new(from as usize);
        let all = self.graph.edges(start);
        let mut all: Vec<_> = all.map(|e| (self.cost(start, e.target(), e.weight()).length, e)).collect();
        all.sort_by(|(a, e), (b, f)| a.total_cmp(b).then(e.target().cmp(&f.target())));
        all.into_iter().map(|(_, e)| (e.target().index() as u32, e.weight())).collect()
    }

    /// Returns the robot's vertex: the nearest one, if every motor of the group is within
    /// `tolerance` (rad).
    pub fn at(&self, pose: &[f64], tolerance: f64) -> Option<u32> {
        let here = self.group(pose);
        let (_, id) = *self.near.knn(&here, 1).first()?;
        let there = self.group(&self.vertex(id)?.q);
        self.metric.is_within(&here, &there, tolerance).then_some(id)
    }

    /// Returns whether the robot is at a vertex: every motor of the group within `tolerance` (rad).
    pub fn is_at(&self, id: u32, pose: &[f64], tolerance: f64) -> bool {
        let there = self.vertex(id).map(|v| self.group(&v.q));
        there.is_some_and(|there| self.metric.is_within(&self.group(pose), &there, tolerance))
    }

    /// Returns all vertices by distance from a whole configuration.
    pub fn by_distance(&self, pose: &[f64]) -> Vec<u32> {
        self.near.knn(&self.group(pose), self.len()).into_iter().map(|(_, id)| id).collect()
    }

    /// Returns the shortest path from `from` to `to`, both included, over edges that are not
    /// removed: A*, fewest doubtful edges first.
    pub fn plan(&self, from: u32, to: u32) -> Option<Vec<u32>> {
        self.links.shortest(from, to, &self.metric, &mut self.search.borrow_mut())
    }

    /// Returns the cost of every vertex that can be reached from `from`, by number (Dijkstra).
    pub fn reach(&self, from: u32) -> BTreeMap<u32, Cost> {
        let start = NodeIndex::new(from as usize);
        if self.graph.node_weight(start).is_none() {
            return BTreeMap::new();
        }
        let costs = dijkstra(&self.graph, start, None, |e| self.cost(e.source(), e.target(), e.weight()));
        costs.into_iter().map(|(n, cost)| (n.index() as u32, cost)).collect()
    }

    fn cost(&self, from: NodeIndex, to: NodeIndex, edge: &Edge) -> Cost {
        let q = |n| self.graph.node_weight(n).map(|v| self.group(&v.q)).unwrap_or_default();
        Cost { doubtful: u32::from(edge.state == EdgeState::Doubtful), length: self.metric.distance(&q(from), &q(to)) }
    }

    /// Returns the target of a commit to a vertex, in the vertex's own turn: see
    /// [`nearest_target`](crate::short_way::nearest_target).
    pub fn target(&self, to: u32, speed: f64) -> Option<Target> {
        let q = self.group(&self.vertex(to)?.q);
        Some(Target { motors: self.motors.clone(), q, speed })
    }

    /// Records that an edge was driven to its end: it becomes feasible, and so does its opposite
    /// unless that one failed itself.
    pub fn succeeded(&mut self, from: u32, to: u32) {
        self.log(from, to, true, None);
        self.change(from, to, |e| *e = Edge { state: EdgeState::Feasible, driven: true, cause: None });
        self.change(to, from, |e| e.state = EdgeState::Feasible);
    }

    /// Records that an edge failed when driven: that edge moves from the graph to the ledger. Its
    /// opposite becomes doubtful unless it was driven to its end itself.
    pub fn failed(&mut self, from: u32, to: u32, cause: Option<String>) {
        self.unblock(from, to);
        if self.unlink(from, to).is_none() {
            return;
        }
        self.log(from, to, false, cause.clone());
        let removed = Edge { state: EdgeState::Removed, driven: true, cause };
        self.note(from, to, &removed);
        self.ledger.insert((from, to), removed);
        self.change(to, from, |e| {
            if !(e.driven && e.state == EdgeState::Feasible) {
                e.state = EdgeState::Doubtful;
            }
        });
    }

    /// Records a motion, and notes it for a successor of the agent.
    fn log(&mut self, from: u32, to: u32, reached: bool, cause: Option<String>) {
        self.notes.push(Note::Tried { from, to, reached, cause: cause.clone() });
        self.store(from, to, reached, cause);
    }

    /// Stores a motion of this run, up to [`MAX_TRIED`] of them: an endless tour must not fill the
    /// memory or the snapshots of its agent. Motions of earlier runs, from the map's file, are
    /// never dropped.
    fn store(&mut self, from: u32, to: u32, reached: bool, cause: Option<String>) {
        let own = self.tried.iter().position(|t| t.run.is_none()).unwrap_or(self.tried.len());
        if self.tried.len() - own >= MAX_TRIED {
            self.tried.remove(own);
        }
        self.tried.push(TriedMotion { run: None, from, to, reached, cause });
    }

    /// Re-admits a removed edge as an optimistic one, because the world has changed (I11). Returns
    /// whether there was one.
    pub fn readmit(&mut self, from: u32, to: u32) -> bool {
        let there = self.edge(from, to).is_some_and(|e| e.state == EdgeState::Removed);
        if there {
            self.ledger.remove(&(from, to));
            self.link(from, to, Edge::NEW);
            self.note(from, to, &Edge::NEW);
        }
        there
    }

    /// Returns the changes since the last call.
    pub fn notes(&mut self) -> Vec<Note> {
        std::mem::take(&mut self.notes)
    }

    fn change(&mut self, from: u32, to: u32, with: impl FnOnce(&mut Edge)) {
        let found = self.graph.find_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize));
        let Some(edge) = found.and_then(|e| self.graph.edge_weight_mut(e)) else { return };
        let before = edge.clone();
        with(edge);
        let after = edge.clone();
        if before.state != after.state {
            self.links.set(from, to, after.state == EdgeState::Doubtful);
            self.note(from, to, &after);
        }
    }

    fn note(&mut self, from: u32, to: u32, edge: &Edge) {
        self.notes.push(Note::Edge { from, to, state: edge.state, cause: edge.cause.clone() });
    }
}

impl Clone for Roadmap {
    fn clone(&self) -> Roadmap {
        let mut near = neighbors(self.motors.len(), &self.metric);
        self.vertices().for_each(|(id, v)| near.add(id, &self.group(&v.q)));
        Roadmap {
            motors: self.motors.clone(),
            metric: self.metric.clone(),
            graph: self.graph.clone(),
            links: self.links.clone(),
            search: RefCell::default(),
            ledger: self.ledger.clone(),
            near,
            notes: self.notes.clone(),
            about: self.about.clone(),
            tried: self.tried.clone(),
        }
    }
}
