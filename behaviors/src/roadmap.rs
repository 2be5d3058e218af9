//! A roadmap of poses: vertices where the robot may rest, directed edges that it may try.
//!
//! Edges are *optimistic*: nobody checks them before they are driven. One that fails is removed, the driven one and no
//! other (the paper's Algorithm 2), and remembered in a ledger with its cause, from where it can be re-admitted.
//!
//! ```text
//!               driven to its end                      failed when driven
//!  Optimistic ───────────────────> Feasible ──┐   ┌──> Removed (ledger: cause) ──readmit──> Optimistic
//!      │                                      └───┤
//!      └── the opposite direction failed ──> Doubtful (planned over only if there is no other way)
//! ```
//!
//! An edge is a straight line in joint space, the short way round for motors without end, and sweeps the same poses in both
//! directions, so an edge driven to its end tells the same of its opposite, if that was never driven. A failure tells less, as the
//! motion broke off at its first contact.
//!
//! Beside that, what blocks an edge in the model's present world can be certified (`validation.rs`): such an edge is `Blocked`, in the
//! ledger too, and comes back as what it was believed to be once the world has changed.

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

/// The most motions of a run that are remembered one by one; the edges know what came of the others.
const MOST_TRIED: usize = 1000;

/// A pose of the roadmap.
#[derive(Clone, Debug, PartialEq)]
pub struct Vertex {
    /// Its name, if its author gave one.
    pub name: Option<String>,
    /// The whole robot's pose, rad.
    pub q: Vec<f64>,
    /// Where it is shown: the hand's position in the world, meters.
    pub at: [f64; 3],
}

/// A directed edge between two poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Edge {
    /// What is believed of it.
    pub state: EdgeState,
    /// Whether it was itself driven, to its end or to a failure.
    pub driven: bool,
    /// What stood in the way, in words, if it failed.
    pub cause: Option<String>,
}

impl Edge {
    const NEW: Edge = Edge { state: EdgeState::Optimistic, driven: false, cause: None };
}

/// The length of a way: few doubtful edges first, then a short distance in joint space (rad).
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Cost {
    /// Doubtful edges on the way.
    pub doubtful: u32,
    /// Joint-space length, rad.
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

/// Poses and edges for one group of a robot's motors.
pub struct Roadmap {
    motors: Vec<usize>,
    metric: JointMetric,
    graph: StableDiGraph<Vertex, Edge, u32>,
    /// The graph's edges once more, for searches: [`Roadmap::link`] and [`Roadmap::unlink`] keep both.
    links: Links,
    search: RefCell<Buffers>,
    ledger: BTreeMap<(u32, u32), Edge>,
    near: Box<dyn Neighbors>,
    notes: Vec<Note>,
    /// What its file says of the world and the hand.
    about: file::About,
    /// Motions that were tried, in order: those of earlier runs, and this run's newest.
    tried: Vec<TriedMotion>,
}

impl Roadmap {
    /// An empty roadmap for these motors (indices into `Robot::motors`) of a robot.
    pub fn new(motors: Vec<usize>, robot: &Robot) -> Roadmap {
        let metric = JointMetric::of(&motors, robot);
        Self::empty(motors, metric)
    }

    fn empty(motors: Vec<usize>, metric: JointMetric) -> Roadmap {
        let near = neighbors(motors.len(), &metric);
        let (links, search) = (Links::new(motors.len()), RefCell::default());
        let (graph, ledger, notes, about, tried) = Default::default();
        Roadmap { motors, metric, graph, links, search, ledger, near, notes, about, tried }
    }

    /// The motors that its poses tell apart.
    pub fn motors(&self) -> &[usize] {
        &self.motors
    }

    /// The group's share of a whole pose.
    pub fn group(&self, q: &[f64]) -> Vec<f64> {
        self.motors.iter().map(|m| q.get(*m).copied().unwrap_or(0.0)).collect()
    }

    /// A whole pose with the group at `q`.
    pub fn whole(&self, pose: &[f64], q: &[f64]) -> Vec<f64> {
        crate::group::whole(&self.motors, pose, q)
    }

    /// Adds a pose; answers its number. Vertices are numbered from 0 and never taken out; see [`Roadmap::replace`].
    pub fn add(&mut self, vertex: Vertex) -> u32 {
        let group = self.group(&vertex.q);
        let note = Note::Vertex { id: self.graph.node_count() as u32, q: vertex.q.clone(), at: vertex.at };
        let id = self.graph.add_node(vertex).index() as u32;
        self.near.add(id, &group);
        self.links.add_vertex(&group);
        self.notes.push(note);
        id
    }

    /// Takes up what was noted of a map: vertices as they were numbered, and edges as they were last. What nobody noted yet is still
    /// to be told.
    pub fn recall(&mut self, notes: &[Note]) {
        for note in notes {
            match note {
                Note::Vertex { id, q, at } if *id as usize == self.len() => {
                    self.add(Vertex { name: None, q: q.clone(), at: *at });
                }
                // what blocks an edge is found out anew
                Note::Edge { from, to, state: EdgeState::Blocked, .. } if self.edge(*from, *to).is_some() => {}
                Note::Edge { from, to, state, cause } => {
                    self.ledger.remove(&(*from, *to));
                    self.unlink(*from, *to);
                    let driven = matches!(state, EdgeState::Feasible | EdgeState::Removed);
                    self.restore(*from, *to, Edge { state: *state, driven, cause: cause.clone() });
                }
                Note::Tried { from, to, reached, cause } => self.keep(*from, *to, *reached, cause.clone()),
                _ => {}
            }
        }
        let vertex = |n: &Note| if let Note::Vertex { id, .. } = n { Some(*id) } else { None };
        let edge = |n: &Note| if let Note::Edge { from, to, .. } = n { Some((*from, *to)) } else { None };
        let vertices: BTreeSet<u32> = notes.iter().filter_map(vertex).collect();
        let edges: BTreeSet<(u32, u32)> = notes.iter().filter_map(edge).collect();
        let is_told = |n: &Note| {
            vertex(n).is_some_and(|id| vertices.contains(&id)) || edge(n).is_some_and(|edge| edges.contains(&edge))
        };
        self.notes.retain(|n| !is_told(n));
    }

    /// Joins two poses by an optimistic edge in each direction, unless that direction is known already (or was removed).
    pub fn join(&mut self, a: u32, b: u32) {
        for (from, to) in [(a, b), (b, a)] {
            let known = self.edge(from, to).is_some();
            if from != to && !known && self.vertex(from).is_some() && self.vertex(to).is_some() {
                self.link(from, to, Edge::NEW);
                self.note(from, to, &Edge::NEW);
            }
        }
    }

    /// Adds an edge that is not there.
    fn link(&mut self, from: u32, to: u32, edge: Edge) {
        self.links.add(from, to, edge.state == EdgeState::Doubtful, &self.metric);
        self.graph.add_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize), edge);
    }

    /// Takes an edge out, if it is there.
    fn unlink(&mut self, from: u32, to: u32) -> Option<Edge> {
        self.links.remove(from, to);
        let known = self.graph.find_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize));
        known.and_then(|edge| self.graph.remove_edge(edge))
    }

    /// Joins every pose to its `k` nearest ones, in both directions.
    pub fn join_nearest(&mut self, k: usize) {
        for (id, near) in self.near.knn_all(k) {
            for (_, other) in near {
                self.join(id, other);
            }
        }
    }

    /// Finds out for every vertex where it is shown: `at` gives the hand's position in the world at a whole pose.
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

    /// How many vertices there are.
    pub fn len(&self) -> usize {
        self.graph.node_count()
    }

    /// Whether there are no vertices.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A vertex by its number.
    pub fn vertex(&self, id: u32) -> Option<&Vertex> {
        self.graph.node_weight(NodeIndex::new(id as usize))
    }

    /// All vertices, by number.
    pub fn vertices(&self) -> impl Iterator<Item = (u32, &Vertex)> {
        (0..self.len() as u32).filter_map(|id| Some((id, self.vertex(id)?)))
    }

    /// The vertex of this name, or of this number if no vertex has such a name.
    pub fn find(&self, name: &str) -> Option<u32> {
        let named = self.vertices().find(|(_, v)| v.name.as_deref() == Some(name)).map(|(id, _)| id);
        named.or_else(|| name.parse().ok().filter(|id| self.vertex(*id).is_some()))
    }

    /// An edge, removed ones included.
    pub fn edge(&self, from: u32, to: u32) -> Option<&Edge> {
        let present = self.graph.find_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize));
        present.and_then(|e| self.graph.edge_weight(e)).or_else(|| self.ledger.get(&(from, to)))
    }

    /// All edges, removed ones included, by (from, to).
    pub fn edges(&self) -> Vec<(u32, u32, &Edge)> {
        let present =
            self.graph.edge_references().map(|e| (e.source().index() as u32, e.target().index() as u32, e.weight()));
        let mut all: Vec<_> = present.chain(self.ledger.iter().map(|((a, b), e)| (*a, *b, e))).collect();
        all.sort_by_key(|(a, b, _)| (*a, *b));
        all
    }

    /// The edges that leave a vertex, removed ones left out, the shortest first.
    pub fn out(&self, from: u32) -> Vec<(u32, &Edge)> {
        let start = NodeIndex::new(from as usize);
        let all = self.graph.edges(start);
        let mut all: Vec<_> = all.map(|e| (self.cost(start, e.target(), e.weight()).length, e)).collect();
        all.sort_by(|(a, e), (b, f)| a.total_cmp(b).then(e.target().cmp(&f.target())));
        all.into_iter().map(|(_, e)| (e.target().index() as u32, e.weight())).collect()
    }

    /// The vertex at whose pose the robot is: the nearest one, if every motor of the group is within `tolerance` (rad).
    pub fn at(&self, pose: &[f64], tolerance: f64) -> Option<u32> {
        let here = self.group(pose);
        let (_, id) = *self.near.knn(&here, 1).first()?;
        let there = self.group(&self.vertex(id)?.q);
        self.metric.is_within(&here, &there, tolerance).then_some(id)
    }

    /// Whether the robot is at a vertex: every motor of the group within `tolerance` (rad).
    pub fn is_at(&self, id: u32, pose: &[f64], tolerance: f64) -> bool {
        let there = self.vertex(id).map(|v| self.group(&v.q));
        there.is_some_and(|there| self.metric.is_within(&self.group(pose), &there, tolerance))
    }

    /// All vertices from near to far of a whole pose.
    pub fn by_distance(&self, pose: &[f64]) -> Vec<u32> {
        self.near.knn(&self.group(pose), self.len()).into_iter().map(|(_, id)| id).collect()
    }

    /// The shortest way over edges that are not removed: A*, fewest doubtful edges first. From `from` to `to`, both included.
    pub fn plan(&self, from: u32, to: u32) -> Option<Vec<u32>> {
        self.links.shortest(from, to, &self.metric, &mut self.search.borrow_mut())
    }

    /// What every vertex that can be reached from there costs to reach, by number (Dijkstra).
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

    /// The commit that drives to a vertex, in the vertex's own turn: see [`nearest_target`](crate::short_way::nearest_target).
    pub fn target(&self, to: u32, speed: f64) -> Option<Target> {
        let q = self.group(&self.vertex(to)?.q);
        Some(Target { motors: self.motors.clone(), q, speed })
    }

    /// An edge was driven to its end: it is feasible, and so is its opposite unless that one failed itself.
    pub fn succeeded(&mut self, from: u32, to: u32) {
        self.log(from, to, true, None);
        self.change(from, to, |e| *e = Edge { state: EdgeState::Feasible, driven: true, cause: None });
        self.change(to, from, |e| e.state = EdgeState::Feasible);
    }

    /// An edge failed when driven: that very edge leaves the graph for the ledger; its opposite becomes doubtful unless
    /// it was driven to its end itself.
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

    /// A motion was tried: whoever goes on with the run is told, too.
    fn log(&mut self, from: u32, to: u32, reached: bool, cause: Option<String>) {
        self.notes.push(Note::Tried { from, to, reached, cause: cause.clone() });
        self.keep(from, to, reached, cause);
    }

    /// Keeps a motion of this run. A tour without end must not fill the memory, nor each snapshot of its agent; what earlier runs tried,
    /// and the map's file tells, stays.
    fn keep(&mut self, from: u32, to: u32, reached: bool, cause: Option<String>) {
        let own = self.tried.iter().position(|t| t.run.is_none()).unwrap_or(self.tried.len());
        if self.tried.len() - own >= MOST_TRIED {
            self.tried.remove(own);
        }
        self.tried.push(TriedMotion { run: None, from, to, reached, cause });
    }

    /// Takes a removed edge back as an optimistic one, because the world changed (I11). Answers whether there was one.
    pub fn readmit(&mut self, from: u32, to: u32) -> bool {
        let there = self.edge(from, to).is_some_and(|e| e.state == EdgeState::Removed);
        if there {
            self.ledger.remove(&(from, to));
            self.link(from, to, Edge::NEW);
            self.note(from, to, &Edge::NEW);
        }
        there
    }

    /// What changed since the last call.
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
