//! The solids of a scene, prepared, with the tested pairs: each edit derives a new one.

use super::bodies::{Bodies, Solid};
use super::pair_lists::PairLists;
use super::pair_rules::{ResolvedRule, RuleChange};
use super::{Contact, Object, ObjectClass, ShapeId};
use crate::engine::{Collider, Engine, IndexPair, Near, PairProximity};
use crate::shared_list::SharedList;
use std::sync::Arc;

/// All solids of a scene, and the pairs that the reflex monitors.
#[derive(Debug)]
pub(crate) struct SolidWorld<E> {
    /// Those of the robots, then those of the obstacles, in order of their ids.
    pub solids: SharedList<Solid>,
    /// The solids, prepared.
    pub engine: E,
    /// Tested pairs of the robots alone.
    robots: Arc<PairLists>,
    /// Tested pairs.
    pub lists: Arc<PairLists>,
    /// Touching pairs that can't move relative to each other.
    pub fixed_contacts: Vec<Contact>,
}

impl<E: Engine> SolidWorld<E> {
    /// Prepares robots without objects.
    pub fn alone(bodies: &Bodies) -> Self {
        let solids = SharedList::new(bodies.solids.iter().cloned());
        let robots = Arc::new(PairLists::of_robots(bodies, &[]));
        let engine = E::prepare(&solids.iter().map(|s| s.collider.clone()).collect::<Vec<_>>());
        let lists = robots.clone();
        let mut world = SolidWorld { solids, engine, robots, lists, fixed_contacts: Vec::new() };
        world.fixed_contacts = world.contacts_at_home(bodies, &bodies.fixed);
        world
    }

    /// The same robots with the obstacles among other objects: targets and ghosts never collide. What is independent
    /// of the changed objects is shared with this world.
    ///
    /// # Arguments
    /// * `objects`: in order of their ids, so that pairs of indices sort as pairs of ids do, and contacts come out
    ///   sorted.
    /// * `rules`: with their difference from the present ones.
    /// * `is_changed`: true for the id of an object that is new or changed.
    pub fn among(
        &self,
        bodies: &Bodies,
        objects: &[(u32, Arc<Object>)],
        (rules, change): (&[ResolvedRule], RuleChange),
        is_changed: impl Fn(u32) -> bool,
    ) -> Self {
        debug_assert!(objects.is_sorted_by_key(|(id, _)| *id), "ids grow with every object");
        let obstacles = objects.iter().filter(|(_, o)| o.class == ObjectClass::Obstacle);
        let shapes = obstacles.flat_map(|(id, object)| (0..).zip(&object.shapes).map(move |s| (*id, object, s)));
        let solids = self.solids.followed_by(shapes.map(|(id, object, (s, primitive))| Solid {
            id: ShapeId::Object { object: id, shape: s },
            collider: Collider::new(primitive.shape, bodies.frames, object.pose * primitive.pose),
            fixed: true,
            near_root: false,
        }));
        let is_same = |(a, b): (&Solid, &Solid)| a.id == b.id;
        let are_same = solids.len() == self.solids.len() && solids.own().iter().zip(self.solids.own()).all(is_same);
        let robots = match change {
            RuleChange::Robots => Arc::new(PairLists::of_robots(bodies, rules)),
            RuleChange::None | RuleChange::Objects => self.robots.clone(),
        };
        let lists = if are_same && change == RuleChange::None {
            self.lists.clone()
        } else if solids.own().is_empty() {
            robots.clone()
        } else {
            Arc::new(robots.among(bodies, solids.own(), rules))
        };
        let engine = self.engine.prepare_after(self.solids.shared_len(), solids.iter().map(|s| &s.collider));
        let mut world = SolidWorld { solids, engine, robots, lists, fixed_contacts: Vec::new() };
        world.fixed_contacts = self.fixed_contacts_among(bodies, &world, is_changed);
        world
    }

    /// The fixed contacts of this world that remain in the next, and those with changed objects.
    fn fixed_contacts_among(&self, bodies: &Bodies, next: &Self, is_changed: impl Fn(u32) -> bool) -> Vec<Contact> {
        let remains = |contact: &&Contact| match contact.pair.1 {
            ShapeId::Robot { .. } => true,
            ShapeId::Object { object, .. } => {
                !is_changed(object) && next.solids.own().iter().any(|solid| solid.id == contact.pair.1)
            }
        };
        let mut all: Vec<Contact> = self.fixed_contacts.iter().filter(remains).copied().collect();
        if bodies.tested_fixed.is_empty() {
            return all;
        }
        let is_new = |solid: &Solid| matches!(solid.id, ShapeId::Object { object, .. } if is_changed(object));
        let changed = (bodies.solids.len() as u32..).zip(next.solids.own()).filter(|(_, solid)| is_new(solid));
        let pairs: Vec<IndexPair> =
            changed.flat_map(|(j, _)| bodies.tested_fixed.iter().map(move |i| (*i, j))).collect();
        all.extend(next.contacts_at_home(bodies, &pairs));
        all.sort_by_key(|contact| (matches!(contact.pair.1, ShapeId::Object { .. }), contact.pair));
        all
    }

    /// Contacts of pairs that can't move relative to each other: the same at every configuration; home is used here.
    fn contacts_at_home(&self, bodies: &Bodies, pairs: &[IndexPair]) -> Vec<Contact> {
        if pairs.is_empty() {
            return Vec::new();
        }
        let mut frames = Vec::new();
        let mut placement = E::Placement::default();
        bodies.place::<&[f64]>(&[], &mut frames);
        self.engine.place(&frames, &mut placement);
        let touching = self.engine.contacts(&placement, pairs, 0.0);
        touching.into_iter().map(|near| self.contact(near)).collect()
    }

    /// The clearance of a pair: its own, if that is lower than the given one.
    pub fn clearance_of(&self, pair: IndexPair, clearance: f64) -> f64 {
        self.own_clearance(pair).map_or(clearance, |own| own.min(clearance))
    }

    /// The pair's own clearance, if it has one.
    pub fn own_clearance(&self, pair: IndexPair) -> Option<f64> {
        let at = self.lists.near.binary_search_by_key(&pair, |(pair, _)| *pair).ok()?;
        self.lists.near.get(at).map(|(_, own)| *own)
    }

    /// True if a measured pair counts as near: it is closer than the clearance that applies to it, or touches.
    pub fn is_near(&self, pair: IndexPair, distance: f64, clearance: f64) -> bool {
        distance < self.clearance_of(pair, clearance) || distance <= 0.0
    }

    /// True if all of these pairs are farther apart than the clearance that applies to each.
    pub fn free(&self, placement: &E::Placement, pairs: impl Iterator<Item = IndexPair>, clearance: f64) -> bool {
        if self.lists.near.is_empty() {
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
        if self.lists.near.is_empty() {
            return self.engine.clearance(placement, &self.lists.pairs, cap);
        }
        let general: Vec<IndexPair> =
            self.lists.pairs.iter().copied().filter(|pair| self.own_clearance(*pair).is_none()).collect();
        let nearest = self.engine.clearance(placement, &general, cap);
        let own =
            self.lists.near.iter().filter_map(|(pair, own)| match self.engine.near(placement, *pair, own.min(cap)) {
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
