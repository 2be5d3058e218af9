//! What the world does to a roadmap's edges: a layer beside what the robot learned by driving them.
//!
//! Every edge that was ever asked about is *known*: whether the robot itself is in its own way, and each object that blocks it. When
//! the world changes, only the objects that changed are looked at. An object that went away takes its blocks along, without a search;
//! where one came, boxes that hold each edge's whole sweep name the few edges that it can touch, and these are certified against
//! that object alone.
//!
//! ```text
//! edge ──certify──> own pairs: free? ──> objects whose region meets its boxes ──certify each──> blocks
//! object moved ───> its blocks are dropped ──> known edges whose boxes meet its new region ──certify──> blocks
//! ```
//!
//! So a verdict is a function of edge and world, not of what happened in between: after any edits it is what a layer that never saw
//! another world says. Other robots are no part of it: they move, and the reflex minds them.

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

/// The edge between two vertices.
pub fn edge_between(a: u32, b: u32) -> EdgeEnds {
    (a.min(b), a.max(b))
}

/// What is known of a roadmap's edges in the world as it was last seen.
#[derive(Default)]
pub struct Validity {
    motors: Vec<usize>,
    world: Option<SeenWorld>,
    /// Where each known edge is in the following lists.
    slots: BTreeMap<EdgeEnds, usize>,
    edges: Vec<KnownEdge>,
    /// Per edge the map's motors at its start, then at its end, rad.
    ways: Vec<f64>,
    /// Per edge what each limb sweeps.
    boxes: Vec<WorldBox>,
    /// The edges that each object blocks.
    blocks: BTreeMap<u32, Vec<usize>>,
    /// How often an edge was certified against an object.
    asked: u64,
}

struct KnownEdge {
    ends: EdgeEnds,
    own: EdgeVerdict,
    /// The objects that block it, and where. None if the robot is itself in the way: they are not asked then.
    blocked_by: Vec<(u32, EdgeVerdict)>,
}

/// What a look at the world brought.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorldNews {
    /// Another robot, clearance or resting pose: nothing is known any more.
    pub forgotten: bool,
    /// Objects that were added, moved, changed or removed.
    pub objects: BTreeSet<u32>,
    /// Known edges that these objects blocked, or block now.
    pub edges: BTreeSet<EdgeEnds>,
}

/// How large the layer is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ValidityFigures {
    /// Known edges.
    pub edges: usize,
    /// Boxes of each.
    pub limbs: usize,
    /// Memory of their boxes, bytes.
    pub index_bytes: usize,
    /// Memory of their poses and verdicts, bytes.
    pub edge_bytes: usize,
    /// How often an edge was certified against an object so far.
    pub asked: u64,
}

impl Validity {
    /// A layer for the map of these motors (indices into the robot's), which knows nothing yet.
    pub fn new(motors: &[usize]) -> Validity {
        Validity { motors: motors.to_vec(), ..Validity::default() }
    }

    /// Looks at the world: known edges are up to date with it afterwards, by a look at the objects that changed alone.
    ///
    /// # Performance
    /// Nothing to speak of while the view's scene is the one seen last.
    pub fn look(&mut self, view: &View) -> WorldNews {
        let Some(world) = self.world.as_mut().filter(|world| world.is_of(view, &self.motors)) else {
            // whoever waits for an object to change hears of it all the same
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
            edges.extend(self.ask_about(*id, 0..self.edges.len()));
        }
        WorldNews { forgotten: false, objects, edges }
    }

    /// Certifies the edges between these vertices that are not known yet, in the world of the last [`Validity::look`].
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
            self.ask_about(id, first..self.edges.len());
        }
    }

    /// Certifies those of a range of known edges that an object can touch against it; answers which of them it blocks.
    fn ask_about(&mut self, object: u32, range: Range<usize>) -> Vec<EdgeEnds> {
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

    /// What is known of an edge: that it is free, or where it is first blocked. `None`: it was not asked about.
    pub fn verdict(&self, edge: EdgeEnds) -> Option<&EdgeVerdict> {
        let known = self.edges.get(*self.slots.get(&edge)?)?;
        let first = known.blocked_by.iter().min_by(|(i, a), (j, b)| at(a).total_cmp(&at(b)).then(i.cmp(j)));
        Some(first.map_or(&known.own, |(_, verdict)| verdict))
    }

    /// The objects that block an edge.
    pub fn blocked_by(&self, edge: EdgeEnds) -> impl Iterator<Item = u32> {
        let known = self.slots.get(&edge).and_then(|slot| self.edges.get(*slot));
        known.into_iter().flat_map(|edge| edge.blocked_by.iter().map(|(object, _)| *object))
    }

    /// Forgets all edges, but not the world: a vertex is another one now.
    pub fn forget_edges(&mut self) {
        let (motors, world) = (std::mem::take(&mut self.motors), self.world.take());
        *self = Validity { motors, world, asked: self.asked, ..Validity::default() };
    }

    /// How large it is.
    pub fn figures(&self) -> ValidityFigures {
        let limbs = self.world.as_ref().map_or(0, |world| world.limbs.len());
        let blocks: usize = self.edges.iter().map(|e| e.blocked_by.capacity() * size_of::<(u32, EdgeVerdict)>()).sum();
        let edge = size_of::<KnownEdge>() + size_of::<(EdgeEnds, usize)>();
        let edge_bytes = self.edges.len() * edge + blocks + size_of_val(&self.ways[..]);
        let index_bytes = size_of_val(&self.boxes[..]);
        ValidityFigures { edges: self.edges.len(), limbs, index_bytes, edge_bytes, asked: self.asked }
    }
}

/// Where along the way an edge is first not free.
fn at(verdict: &EdgeVerdict) -> f64 {
    match verdict {
        EdgeVerdict::Free => f64::INFINITY,
        EdgeVerdict::Blocked(obstruction) => obstruction.at,
        EdgeVerdict::Uncertified { at } => *at,
    }
}

/// The map's motors at the first vertex of an edge, then at the second, the short way from there.
fn way(map: &Roadmap, scene: &Scene, robot: usize, (a, b): EdgeEnds) -> Option<Vec<f64>> {
    let (from, to) = (map.vertex(a)?, map.vertex(b).filter(|_| a != b)?);
    let robot = scene.robots().get(robot)?;
    // rounding may have put a pose a hair beyond a limit
    let group = |q: &[f64]| {
        let q = q.iter().zip(&robot.motors).map(|(q, m)| q.max(m.min).min(m.max)).collect::<Vec<_>>();
        map.group(&q)
    };
    Some([group(&from.q), group(&robot.nearest_equivalent(&from.q, &to.q))].concat())
}

/// The edges of a range whose boxes (so many each) meet a region.
fn touched(boxes: &[WorldBox], limbs: usize, region: &[WorldBox], range: Range<usize>) -> impl Iterator<Item = usize> {
    let meet = |a: &WorldBox, b: &WorldBox| (0..3).all(|i| a[i] <= b[i + 3] && b[i] <= a[i + 3]);
    let own = boxes.get(range.start * limbs..range.end * limbs).unwrap_or(&[]);
    let meets = move |boxes: &[WorldBox]| boxes.iter().any(|a| region.iter().any(|b| meet(a, b)));
    own.chunks_exact(limbs.max(1)).zip(range).filter(move |(boxes, _)| meets(boxes)).map(|(_, slot)| slot)
}
