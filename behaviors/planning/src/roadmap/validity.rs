//! Verdicts of the world on a roadmap's edges, stored separately from the outcomes of driving them.
//!
//! For every *known* edge it stores whether the robot collides with itself, and each object that
//! blocks it. After a change of the world, only the objects that changed are checked. The blocks of
//! an object that was removed are dropped without a search. For an object that was added, boxes
//! that contain each edge's whole sweep select the few edges that it can touch, and these are
//! certified against that object alone.
//!
//! ```text
//! edge ──certify──> own pairs: free? ──> objects with a region that meets its boxes ──certify each──> blocks
//! object moved ───> its blocks are dropped ──> known edges with boxes that meet its new region ──certify──> blocks
//! ```
//!
//! A verdict is therefore a function of edge and world, independent of the history: after any edits
//! it equals the verdict of a layer that has seen only the last world. Other robots are not
//! included: they move, and the reflex monitors them.

mod limbs;
mod seen;

use self::limbs::WorldBox;
use self::seen::SeenWorld;
use crate::roadmap::Roadmap;
use mobee_contract::View;
use mobee_fast::EdgeVerdict;
use mobee_model::Scene;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

/// Two vertices, the smaller number first: certified edges have no direction.
pub type EdgeEnds = (u32, u32);

/// Returns the edge between two vertices.
pub fn edge_between(a: u32, b: u32) -> EdgeEnds {
    (a.min(b), a.max(b))
}

/// Verdicts on a roadmap's edges in the world of the last update.
#[derive(Default)]
pub struct Validity {
    motors: Vec<usize>,
    world: Option<SeenWorld>,
    /// Index of each known edge in the following lists.
    slots: BTreeMap<EdgeEnds, usize>,
    edges: Vec<KnownEdge>,
    /// Positions of the map's motors at the start, then at the end of each edge, rad.
    ways: Vec<f64>,
    /// Box swept by each limb, for each edge.
    boxes: Vec<WorldBox>,
    /// Edges blocked by each object.
    blocks: BTreeMap<u32, Vec<usize>>,
    /// Number of certifications of an edge against an object.
    asked: u64,
}

struct KnownEdge {
    ends: EdgeEnds,
    own: EdgeVerdict,
    /// Objects that block it, each with its verdict; empty if the robot collides with itself,
    /// because objects are not checked then.
    blocked_by: Vec<(u32, EdgeVerdict)>,
}

/// Changes found by an update.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorldNews {
    /// Robot, clearance or rest configuration changed: all verdicts were discarded.
    pub forgotten: bool,
    /// Objects that were added, moved, changed or removed.
    pub objects: BTreeSet<u32>,
    /// Known edges that these objects blocked, or block now.
    pub edges: BTreeSet<EdgeEnds>,
}

/// Size of the layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ValidityFigures {
    /// Number of known edges.
    pub edges: usize,
    /// Number of boxes of each edge.
    pub limbs: usize,
    /// Memory of the boxes, bytes.
    pub index_bytes: usize,
    /// Memory of the edges' configurations and verdicts, bytes.
    pub edge_bytes: usize,
    /// Number of certifications of an edge against an object so far.
    pub asked: u64,
}

impl Validity {
    /// Creates an empty layer for a map of these motors (indices into the robot's).
    pub fn new(motors: &[usize]) -> Validity {
        Validity { motors: motors.to_vec(), ..Validity::default() }
    }

    /// Updates the verdicts of known edges to the world of a view, by checking only the objects
    /// that changed.
    ///
    /// # Performance
    /// Negligible while the view's scene is that of the last update.
    pub fn look(&mut self, view: &View) -> WorldNews {
        let Some(world) = self.world.as_mut().filter(|world| world.is_of(view, &self.motors)) else {
            // The changed objects are reported even if all verdicts are discarded.
            let objects = self.world.as_mut().map(|world| world.update(&view.scene)).unwrap_or_default();
            let motors = std::mem::take(&mut self.motors);
            let world = Some(SeenWorld::new(view, &motors));
            *self = Validity { motors, world, ..Validity::default() };
            return WorldNews { forgotten: true, objects, ..WorldNews::default() };
        };
        if Arc::ptr_eq(&world.scene, &view.scene) {
            return WorldNews::default();
        }
        let objects = world.update(&view.scene);
        let mut edges = BTreeSet::new();
        for id in &objects {
            for slot in self.blocks.remove(id).unwrap_or_default() {
                let Some(edge) = self.edges.get_mut(slot) else { continue };
                edge.blocked_by.retain(|(object, _)| object != id);
                edges.insert(edge.ends);
            }
            edges.extend(self.certify_against(*id, 0..self.edges.len()));
        }
        WorldNews { forgotten: false, objects, edges }
    }

    /// Certifies the edges between these vertices that are not known yet, in the world of the last
    /// [`Validity::look`].
    pub fn certify(&mut self, map: &Roadmap, edges: impl IntoIterator<Item = EdgeEnds>) {
        let Some(world) = &mut self.world else { return };
        let first = self.edges.len();
        for (a, b) in edges {
            let edge = edge_between(a, b);
            let Some(way) = way(map, &world.scene, world.robot, edge).filter(|_| !self.slots.contains_key(&edge))
            else {
                continue;
            };
            let (from, to) = way.split_at(way.len() / 2);
            world.limbs.sweep(from, to, &mut self.boxes);
            self.ways.extend(way);
            self.slots.insert(edge, self.edges.len());
            let own = EdgeVerdict::Uncertified { at: 0.0 };
            self.edges.push(KnownEdge { ends: edge, own, blocked_by: Vec::new() });
        }
        let size = 2 * self.motors.len();
        let verdicts = world.certify_own(self.ways.chunks_exact(size).skip(first));
        for (edge, verdict) in self.edges.iter_mut().skip(first).zip(verdicts) {
            edge.own = verdict;
        }
        for id in world.objects() {
            self.certify_against(id, first..self.edges.len());
        }
    }

    /// Certifies those known edges of a range that an object can touch against it; returns those
    /// that it blocks.
    fn certify_against(&mut self, object: u32, range: Range<usize>) -> Vec<EdgeEnds> {
        let Some(world) = &mut self.world else { return Vec::new() };
        let region = world.region(object);
        if region.is_empty() || range.is_empty() {
            return Vec::new();
        }
        let free = |slot: &usize| self.edges.get(*slot).is_some_and(|edge| edge.own == EdgeVerdict::Free);
        let touched: Vec<usize> = touched(&self.boxes, world.limbs.len(), &region, range).filter(free).collect();
        let size = 2 * self.motors.len();
        self.asked += touched.len() as u64;
        let ways = touched.iter().filter_map(|slot| self.ways.get(slot * size..(slot + 1) * size));
        let verdicts = world.certify_object(object, ways);
        let mut blocked = Vec::new();
        for (slot, verdict) in touched.into_iter().zip(verdicts).filter(|(_, verdict)| *verdict != EdgeVerdict::Free) {
            let Some(edge) = self.edges.get_mut(slot) else { continue };
            edge.blocked_by.push((object, verdict));
            blocked.push(edge.ends);
            self.blocks.entry(object).or_default().push(slot);
        }
        blocked
    }

    /// Returns the verdict of an edge: free, or the first obstacle. `None`: the edge is not known.
    pub fn verdict(&self, edge: EdgeEnds) -> Option<&EdgeVerdict> {
        let known = self.edges.get(*self.slots.get(&edge)?)?;
        let first = known.blocked_by.iter().min_by(|(i, a), (j, b)| at(a).total_cmp(&at(b)).then(i.cmp(j)));
        Some(first.map_or(&known.own, |(_, verdict)| verdict))
    }

    /// Returns the objects that block an edge.
    pub fn blocked_by(&self, edge: EdgeEnds) -> impl Iterator<Item = u32> {
        let known = self.slots.get(&edge).and_then(|slot| self.edges.get(*slot));
        known.into_iter().flat_map(|edge| edge.blocked_by.iter().map(|(object, _)| *object))
    }

    /// Discards all edges, but not the world, because a vertex was replaced.
    pub fn forget_edges(&mut self) {
        let motors = std::mem::take(&mut self.motors);
        let world = self.world.take();
        *self = Validity { motors, world, asked: self.asked, ..Validity::default() };
    }

    /// Returns its size.
    pub fn figures(&self) -> ValidityFigures {
        let limbs = self.world.as_ref().map_or(0, |world| world.limbs.len());
        let blocks: usize = self.edges.iter().map(|e| e.blocked_by.capacity() * size_of::<(u32, EdgeVerdict)>()).sum();
        let edge = size_of::<KnownEdge>() + size_of::<(EdgeEnds, usize)>();
        let edge_bytes = self.edges.len() * edge + blocks + size_of_val(&self.ways[..]);
        let index_bytes = size_of_val(&self.boxes[..]);
        ValidityFigures { edges: self.edges.len(), limbs, index_bytes, edge_bytes, asked: self.asked }
    }
}

/// Returns the position of the first obstacle, as a share of the edge.
fn at(verdict: &EdgeVerdict) -> f64 {
    match verdict {
        EdgeVerdict::Free => f64::INFINITY,
        EdgeVerdict::Blocked(obstruction) => obstruction.at,
        EdgeVerdict::Uncertified { at } => *at,
    }
}

/// Returns the positions of the map's motors at the first vertex of an edge, then at the second, by
/// the short way.
fn way(map: &Roadmap, scene: &Scene, robot: usize, (a, b): EdgeEnds) -> Option<Vec<f64>> {
    let from = map.vertex(a)?;
    let to = map.vertex(b).filter(|_| a != b)?;
    let robot = scene.robots().get(robot)?;
    // Rounding may have put a position slightly beyond a limit.
    let group = |q: &[f64]| {
        let q = q.iter().zip(&robot.motors).map(|(q, m)| q.max(m.min).min(m.max)).collect::<Vec<_>>();
        map.group(&q)
    };
    Some([group(&from.q), group(&robot.nearest_equivalent(&from.q, &to.q))].concat())
}

/// Returns the edges of a range with boxes (`limbs` each) that intersect a region.
fn touched(boxes: &[WorldBox], limbs: usize, region: &[WorldBox], range: Range<usize>) -> impl Iterator<Item = usize> {
    let meet = |a: &WorldBox, b: &WorldBox| (0..3).all(|i| a[i] <= b[i + 3] && b[i] <= a[i + 3]);
    let own = boxes.get(range.start * limbs..range.end * limbs).unwrap_or(&[]);
    let meets = move |boxes: &[WorldBox]| boxes.iter().any(|a| region.iter().any(|b| meet(a, b)));
    own.chunks_exact(limbs.max(1)).zip(range).filter(move |(boxes, _)| meets(boxes)).map(|(_, slot)| slot)
}
