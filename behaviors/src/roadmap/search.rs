//! A* on the edges of a map, laid out for it: lengths are measured once, and buffers are used again.
//!
//! It visits vertices and edges in the very order of `petgraph::algo::astar` on the map's graph, so that of ways of equal cost the same
//! one is chosen; a property test holds the two together. Edges are kept per vertex, in the order in which they were added, and
//! looked at from the newest to the oldest.
//!
//! That there is no way is found out from both ends: while the search goes on, what leads to the goal is gathered backwards, a vertex
//! for each of the search. A goal on a small island is so given up long before everything else was looked at.

use super::Cost;
use crate::short_way::JointMetric;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// An edge that can be driven.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Link {
    to: u32,
    cost: Cost,
}

/// The edges that are not removed, by the vertex that they leave, and where the vertices are.
#[derive(Clone, Debug, Default)]
pub(super) struct Links {
    dimension: usize,
    /// The group's share of every vertex, one after the other.
    poses: Vec<f64>,
    out: Vec<Vec<Link>>,
    /// The vertices whose edges lead to each.
    into: Vec<Vec<u32>>,
}

impl Links {
    pub fn new(dimension: usize) -> Links {
        Links { dimension, ..Links::default() }
    }

    /// One more vertex, without edges.
    pub fn add_vertex(&mut self, group: &[f64]) {
        self.poses.extend(group);
        self.out.push(Vec::new());
        self.into.push(Vec::new());
    }

    /// A vertex without edges is somewhere else.
    pub fn place(&mut self, vertex: u32, group: &[f64]) {
        let from = vertex as usize * self.dimension;
        let there = self.poses.get_mut(from..from + self.dimension);
        there.into_iter().flatten().zip(group).for_each(|(slot, q)| *slot = *q);
    }

    fn pose(&self, vertex: u32) -> &[f64] {
        let from = vertex as usize * self.dimension;
        self.poses.get(from..from + self.dimension).unwrap_or(&[])
    }

    /// An edge that was not there.
    pub fn add(&mut self, from: u32, to: u32, doubtful: bool, metric: &JointMetric) {
        let cost = Cost { doubtful: u32::from(doubtful), length: metric.distance(self.pose(from), self.pose(to)) };
        if let (Some(out), Some(into)) = (self.out.get_mut(from as usize), self.into.get_mut(to as usize)) {
            out.push(Link { to, cost });
            into.push(from);
        }
    }

    /// An edge that can't be driven any more.
    pub fn remove(&mut self, from: u32, to: u32) {
        if let Some(out) = self.out.get_mut(from as usize) {
            out.retain(|link| link.to != to);
        }
        if let Some(into) = self.into.get_mut(to as usize) {
            into.retain(|other| *other != from);
        }
    }

    /// Whether an edge is doubtful now.
    pub fn set(&mut self, from: u32, to: u32, doubtful: bool) {
        let out = self.out.get_mut(from as usize).map(|out| out.iter_mut());
        if let Some(link) = out.into_iter().flatten().find(|link| link.to == to) {
            link.cost.doubtful = u32::from(doubtful);
        }
    }

    /// Where the edges of a vertex lead.
    pub fn out(&self, from: u32) -> impl Iterator<Item = u32> {
        self.out.get(from as usize).into_iter().flatten().map(|link| link.to)
    }

    /// The shortest way (A*), both ends included.
    pub fn shortest(&self, from: u32, to: u32, metric: &JointMetric, at_hand: &mut Buffers) -> Option<Vec<u32>> {
        if from.max(to) as usize >= self.out.len() {
            return None;
        }
        let aim = self.pose(to);
        let left = |vertex: u32| Cost { doubtful: 0, length: metric.distance(self.pose(vertex), aim) };
        at_hand.begin(self.out.len(), to);
        let Buffers { seen, open, back, leads, .. } = at_hand;
        let (first, now) = (from as usize, at_hand.now);
        let mut both_ends = true;
        let start = left(from);
        if let Some(seen) = seen.get_mut(first) {
            *seen = Seen { now, from, cost: Cost::default(), left: start };
        }
        open.push(Open { total: start, left: start, cost: Cost::default(), vertex: from });
        while let Some(Open { cost, vertex, .. }) = open.pop() {
            if vertex == to {
                return Some(way(seen, from, to));
            }
            let worse = seen.get(vertex as usize).is_none_or(|seen| seen.cost < cost);
            if worse {
                continue;
            }
            if both_ends {
                // nothing else leads to the goal, and the start does not
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
                *seen = Seen { now, from: vertex, cost: reached, left };
                open.push(Open { total: reached + left, left, cost: reached, vertex: link.to });
            }
        }
        None
    }
}

/// The way back from the end, turned round.
fn way(seen: &[Seen], from: u32, to: u32) -> Vec<u32> {
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

/// What is known of a vertex in a search.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    /// The search that it was seen in: others are as if it had not been.
    now: u32,
    from: u32,
    cost: Cost,
    left: Cost,
}

/// A vertex to go on from, the least total first.
#[derive(Clone, Copy, Debug)]
struct Open {
    total: Cost,
    left: Cost,
    cost: Cost,
    vertex: u32,
}

impl Ord for Open {
    fn cmp(&self, other: &Open) -> Ordering {
        let key = |o: &Open| (o.total, o.left, o.cost);
        // the heap gives the greatest first; lengths are numbers, as limits of motors are
        key(other).partial_cmp(&key(self)).unwrap_or(Ordering::Equal)
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Open) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Open {
    fn eq(&self, other: &Open) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Open {}

/// What a search needs, used again by the next.
#[derive(Clone, Debug, Default)]
pub(super) struct Buffers {
    seen: Vec<Seen>,
    open: BinaryHeap<Open>,
    /// Vertices that lead to the goal, and were not gone back from yet.
    back: Vec<u32>,
    /// The search in which each vertex was found to lead to the goal.
    leads: Vec<u32>,
    now: u32,
}

impl Buffers {
    fn begin(&mut self, vertices: usize, goal: u32) {
        self.open.clear();
        self.back.clear();
        self.back.push(goal);
        self.leads.resize(vertices, 0);
        self.seen.resize(vertices, Seen::default());
        self.now = self.now.wrapping_add(1);
        if self.now == 0 {
            // numbers begin anew: nothing may seem to be of this search
            self.seen.fill(Seen::default());
            self.leads.fill(0);
            self.now = 1;
        }
        if let Some(leads) = self.leads.get_mut(goal as usize) {
            *leads = self.now;
        }
    }
}
