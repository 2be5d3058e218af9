//! The objects of a scene, prepared, with the tested pairs: rebuilt by each edit.

use super::bodies::{Bodies, Solid};
use super::pair_rules::{PairPolicy, ResolvedRule, rule_of};
use super::travel::Terms;
use super::{Contact, Object, ObjectClass, ShapeId};
use crate::engine::{Collider, Engine, IndexPair, Near, PairProximity};
use std::collections::BTreeMap;
use std::sync::Arc;

/// All solids of a scene, and the pairs that the reflex monitors.
#[derive(Debug)]
pub(crate) struct SolidWorld<E> {
    /// Those of the robots, then those of the obstacles, in order of their ids.
    pub solids: Vec<Solid>,
    /// The solids, prepared.
    pub engine: E,
    /// Reflex pairs that can move relative to each other: indices, smaller first, sorted.
    pub pairs: Vec<IndexPair>,
    /// The same pairs, grouped by their two frames.
    pub groups: Vec<PairGroup>,
    /// Pairs with a clearance of their own, meters; sorted.
    pub near: Vec<(IndexPair, f64)>,
    /// Touching pairs that can't move relative to each other.
    pub fixed_contacts: Vec<Contact>,
}

/// Pairs of solids with the same relative motion: those of the same two frames.
#[derive(Clone, Debug)]
pub(crate) struct PairGroup {
    /// Bound of their relative motion.
    pub travel: Terms,
    /// The pairs.
    pub pairs: Vec<IndexPair>,
}

impl<E: Engine> SolidWorld<E> {
    /// Prepares the robots together with the obstacles among the objects: targets and ghosts never collide.
    pub fn new(bodies: &Bodies, objects: &[(u32, Arc<Object>)], rules: &[ResolvedRule]) -> Self {
        let mut solids = bodies.solids.clone();
        let mut sorted: Vec<_> = objects.iter().filter(|(_, o)| o.class == ObjectClass::Obstacle).collect();
        // In order of ids, so that pairs of indices sort as pairs of ids do, and contacts come out sorted.
        sorted.sort_unstable_by_key(|(id, _)| *id);
        for (id, object) in sorted {
            for (s, primitive) in object.shapes.iter().enumerate() {
                let pose = object.pose * primitive.pose;
                solids.push(Solid {
                    id: ShapeId::Object { object: *id, shape: s as u16 },
                    collider: Collider::new(primitive.shape, bodies.frames, pose),
                    fixed: true,
                    near_root: false,
                });
            }
        }
        let own = bodies.solids.len();
        let mut pairs = bodies.moving.clone();
        let mut fixed = bodies.fixed.clone();
        // A base is not tested against the world that it stands on.
        for (i, solid) in bodies.solids.iter().enumerate().filter(|(_, s)| !s.near_root) {
            let list = if solid.fixed { &mut fixed } else { &mut pairs };
            list.extend((own..solids.len()).map(|j| (i as u32, j as u32)));
        }
        pairs.sort_unstable();
        let mut near = Vec::new();
        if !rules.is_empty() || bodies.robots.iter().any(|robot| !robot.near.is_empty()) {
            pairs.retain(|&(i, j)| {
                let ids = (solids[i as usize].id, solids[j as usize].id);
                match rule_of(&bodies.robots, rules, ids) {
                    PairPolicy::General => true,
                    PairPolicy::Near(clearance) => {
                        near.push(((i, j), clearance));
                        true
                    }
                    PairPolicy::MayTouch => false,
                }
            });
        }
        // One motion bound serves all pairs of two frames, and a group that is not due is skipped as a whole.
        let mut by_frames = BTreeMap::<(usize, usize), Vec<IndexPair>>::new();
        for &(i, j) in &pairs {
            let f = solids[i as usize].collider.frame;
            let g = solids[j as usize].collider.frame;
            by_frames.entry((f.min(g), f.max(g))).or_default().push((i, j));
        }
        let groups =
            by_frames.into_iter().map(|((f, g), pairs)| PairGroup { travel: bodies.travel(f, g), pairs }).collect();
        let engine = E::prepare(&solids.iter().map(|s| s.collider.clone()).collect::<Vec<_>>());
        let mut world = SolidWorld { solids, engine, pairs, groups, near, fixed_contacts: Vec::new() };
        // These contacts are the same at every configuration; home is used here.
        let mut frames = Vec::new();
        let mut placement = E::Placement::default();
        bodies.place::<&[f64]>(&[], &mut frames);
        world.engine.place(&frames, &mut placement);
        let touching = world.engine.contacts(&placement, &fixed, 0.0);
        world.fixed_contacts = touching.into_iter().map(|near| world.contact(near)).collect();
        world
    }

    /// The clearance of a pair: its own, if that is lower than the given one.
    pub fn clearance_of(&self, pair: IndexPair, clearance: f64) -> f64 {
        self.own_clearance(pair).map_or(clearance, |own| own.min(clearance))
    }

    /// The pair's own clearance, if it has one.
    pub fn own_clearance(&self, pair: IndexPair) -> Option<f64> {
        let at = self.near.binary_search_by_key(&pair, |(pair, _)| *pair).ok()?;
        self.near.get(at).map(|(_, own)| *own)
    }

    /// True if a measured pair counts as near: it is closer than the clearance that applies to it, or touches.
    pub fn is_near(&self, pair: IndexPair, distance: f64, clearance: f64) -> bool {
        distance < self.clearance_of(pair, clearance) || distance <= 0.0
    }

    /// True if all of these pairs are farther apart than the clearance that applies to each.
    pub fn free(&self, placement: &E::Placement, pairs: impl Iterator<Item = IndexPair>, clearance: f64) -> bool {
        if self.near.is_empty() {
            return self.engine.free(placement, pairs, clearance);
        }
        let mut own = Vec::new();
        let general = pairs.filter(|pair| {
            let at = self.own_clearance(*pair);
            own.extend(at.map(|at| (*pair, at.min(clearance))));
            at.is_none()
        });
        self.engine.free(placement, general, clearance)
            && !own.iter().any(|(pair, clearance)| self.engine.touches(placement, *pair, *clearance))
    }

    /// The nearest pair within `cap` meters. A pair with a clearance of its own counts only if it is closer than that.
    pub fn nearest(&self, placement: &E::Placement, cap: f64) -> Option<PairProximity> {
        if self.near.is_empty() {
            return self.engine.clearance(placement, &self.pairs, cap);
        }
        let general: Vec<IndexPair> =
            self.pairs.iter().copied().filter(|pair| self.own_clearance(*pair).is_none()).collect();
        let nearest = self.engine.clearance(placement, &general, cap);
        let own = self.near.iter().filter_map(|(pair, own)| match self.engine.near(placement, *pair, own.min(cap)) {
            Near::Within(proximity) => Some(PairProximity { pair: *pair, proximity }),
            Near::Beyond(_) => None,
        });
        nearest.into_iter().chain(own).min_by(|a, b| a.proximity.distance.total_cmp(&b.proximity.distance))
    }

    /// Converts an engine's pair of indices to a contact with shape ids.
    pub fn contact(&self, near: PairProximity) -> Contact {
        let (i, j) = near.pair;
        let pair = (self.solids[i as usize].id, self.solids[j as usize].id);
        Contact { pair, distance: near.proximity.distance, points: near.proximity.points }
    }
}
