//! A* on the edges of a map, in a layout for it: lengths are computed once, and buffers are reused.
//!
//! It visits vertices and edges in the same order as `petgraph::algo::astar` on the map's graph, so
//! that among paths of equal cost the same one is chosen; a property test compares the two. Edges
//! are stored per vertex in the order in which they were added, and visited from the newest to the
//! oldest.
//!
//! The absence of a path is detected from both ends: during the search, the vertices that lead to
//! the goal are collected backward, one for each step of the search. A goal on a small island is
//! then found unreachable long before all other vertices have been visited.

use super::Cost;
use crate::short_way::JointMetric;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// An edge that can be driven.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SearchLink {
    to: u32,
    cost: Cost,
}

/// Edges that are not removed, by their start vertex, and the positions of the vertices.
#[derive(Clone, Debug, Default)]
pub(super) struct Links {
    dimension: usize,
    /// The group's part of every vertex, one after the other.
    poses: Vec<f64>,
    out: Vec<Vec<SearchLink>>,
    /// Start vertices of the edges that lead to each vertex.
    into: Vec<Vec<u32>>,
}

impl Links {
    pub fn new(dimension: usize) -> Links {
        Links { dimension, ..Links::default() }
    }

    /// Adds a vertex without edges.
    pub fn add_vertex(&mut self, group: &[f64]) {
        self.poses.extend(group);
        self.out.push(Vec::new());
        self.into.push(Vec::new());
    }

    /// Moves a vertex without edges.
    pub fn place(&mut self, vertex: u32, group: &[f64]) {
        let from = vertex as usize * self.dimension;
        let there = self.poses.get_mut(from..from + self.dimension);
        there.into_iter().flatten().zip(group).for_each(|(slot, q)| *slot = *q);
    }

    fn pose(&self, vertex: u32) -> &[f64] {
        let from = vertex as usize * self.dimension;
        self.poses.get(from..from + self.dimension).unwrap_or(&[])
    }

    /// Adds an edge that did not exist.
    pub fn add(&mut self, from: u32, to: u32, doubtful: bool, metric: &JointMetric) {
        let cost = Cost { doubtful: u32::from(doubtful), length: metric.distance(self.pose(from), self.pose(to)) };
        if let (Some(out), Some(into)) = (self.out.get_mut(from as usize), self.into.get_mut(to as usize)) {
            out.push(SearchLink { to, cost });
            into.push(from);
        }
    }

    /// Removes an edge.
    pub fn remove(&mut self, from: u32, to: u32) {
        if let Some(out) = self.out.get_mut(from as usize) {
            out.retain(|link| link.to != to);
        }
        if let Some(into) = self.into.get_mut(to as usize) {
            into.retain(|other| *other != from);
        }
    }

    /// Sets whether an edge is doubtful.
    pub fn set(&mut self, from: u32, to: u32, doubtful: bool) {
        let out = self.out.get_mut(from as usize).map(|out| out.iter_mut());
        if let Some(link) = out.into_iter().flatten().find(|link| link.to == to) {
            link.cost.doubtful = u32::from(doubtful);
        }
    }

    /// Returns the end vertices of the edges that leave a vertex.
    pub fn out(&self, from: u32) -> impl Iterator<Item = u32> {
        self.out.get(from as usize).into_iter().flatten().map(|link| link.to)
    }

    /// Returns the shortest path (A*), both ends included.
    pub fn shortest(&self, from: u32, to: u32, metric: &JointMetric, buffers: &mut Buffers) -> Option<Vec<u32>> {
        if from.max(to) as usize >= self.out.len() {
            return None;
        }
        let aim = self.pose(to);
        let left = |vertex: u32| Cost { doubtful: 0, length: metric.distance(self.pose(vertex), aim) };
        buffers.begin(self.out.len(), to);
        let Buffers { seen, open, back, leads, .. } = buffers;
        let first = from as usize;
        let now = buffers.now;
        let mut both_ends = true;
        let start = left(from);
        if let Some(seen) = seen.get_mut(first) {
            *seen = VisitedVertex { now, from, cost: Cost::default(), left: start };
        }
        open.push(OpenVertex { total: start, left: start, cost: Cost::default(), vertex: from });
        while let Some(OpenVertex { cost, vertex, .. }) = open.pop() {
            if vertex == to {
                return Some(way(seen, from, to));
            }
            let worse = seen.get(vertex as usize).is_none_or(|seen| seen.cost < cost);
            if worse {
                continue;
            }
            if both_ends {
                // If the backward search is exhausted, the start does not lead to the goal.
                let vertex = back.pop()?;
                for other in self.into.get(vertex as usize).into_iter().flatten() {
                    let Some(leads) = leads.get_mut(*other as usize).filter(|leads| **leads != now) else { continue };
                    *leads = now;
                    back.push(*other);
                    both_ends &= *other != from;
                }
            }
            for link in self.out.get(vertex as usize).into_iter().flatten().rev() {
                let Some(seen) = seen.get_mut(link.to as usize) else { continue };
                let reached = cost + link.cost;
                if seen.now == now && reached >= seen.cost {
                    continue;
                }
                let left = if seen.now == now { seen.left } else { left(link.to) };
                *seen = VisitedVertex { now, from: vertex, cost: reached, left };
                open.push(OpenVertex { total: reached + left, left, cost: reached, vertex: link.to });
            }
        }
        None
    }
}

/// Returns the path, traced back from its end.
fn way(seen: &[VisitedVertex], from: u32, to: u32) -> Vec<u32> {
    let mut way = vec![to];
    let mut at = to;
    while at != from {
        let Some(seen) = seen.get(at as usize) else { break };
        at = seen.from;
        way.push(at);
    }
    way.reverse();
    way
}

/// State of a vertex in a search.
#[derive(Clone, Copy, Debug, Default)]
struct VisitedVertex {
    /// Number of the search in which it was visited; the state is void in any other search.
    now: u32,
    from: u32,
    cost: Cost,
    left: Cost,
}

/// A vertex to expand, ordered by the least total cost.
#[derive(Clone, Copy, Debug)]
struct OpenVertex {
    total: Cost,
    left: Cost,
    cost: Cost,
    vertex: u32,
}

impl Ord for OpenVertex {
    fn cmp(&self, other: &OpenVertex) -> Ordering {
        let key = |o: &OpenVertex| (o.total, o.left, o.cost);
        // The heap returns the greatest element first. Lengths are finite, because the limits of
        // motors are.
        key(other).partial_cmp(&key(self)).unwrap_or(Ordering::Equal)
    }
}

impl PartialOrd for OpenVertex {
    fn partial_cmp(&self, other: &OpenVertex) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for OpenVertex {
    fn eq(&self, other: &OpenVertex) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for OpenVertex {}

/// Buffers of a search, reused by the next one.
#[derive(Clone, Debug, Default)]
pub(super) struct Buffers {
    seen: Vec<VisitedVertex>,
    open: BinaryHeap<OpenVertex>,
    /// Vertices that lead to the goal and have not been expanded backward yet.
    back: Vec<u32>,
    /// Number of the search in which each vertex was found to lead to the goal.
    leads: Vec<u32>,
    now: u32,
}

impl Buffers {
    fn begin(&mut self, vertices: usize, goal: u32) {
        self.open.clear();
        self.back.clear();
        self.back.push(goal);
        self.leads.resize(vertices, 0);
        self.seen.resize(vertices, VisitedVertex::default());
        self.now = self.now.wrapping_add(1);
        if self.now == 0 {
            // The numbers wrapped around: clear the marks of old searches.
            self.seen.fill(VisitedVertex::default());
            self.leads.fill(0);
            self.now = 1;
        }
        if let Some(leads) = self.leads.get_mut(goal as usize) {
            *leads = self.now;
        }
    }
}
