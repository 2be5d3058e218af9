//! The objects of a scene, prepared, with the tested pairs: rebuilt by each edit.

use super::bodies::{Bodies, Solid};
use super::travel::Terms;
use super::{Contact, Object, ObjectClass, ShapeId};
use crate::engine::{Collider, Engine, IndexPair, PairProximity};
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
    pub fn new(bodies: &Bodies, objects: &[(u32, Arc<Object>)]) -> Self {
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
        let mut world = SolidWorld { solids, engine, pairs, groups, fixed_contacts: Vec::new() };
        // These contacts are the same at every configuration; home is used here.
        let mut frames = Vec::new();
        let mut placement = E::Placement::default();
        bodies.place::<&[f64]>(&[], &mut frames);
        world.engine.place(&frames, &mut placement);
        let touching = world.engine.contacts(&placement, &fixed, 0.0);
        world.fixed_contacts = touching.into_iter().map(|near| world.contact(near)).collect();
        world
    }

    /// Converts an engine's pair of indices to a contact with shape ids.
    pub fn contact(&self, near: PairProximity) -> Contact {
        let (i, j) = near.pair;
        let pair = (self.solids[i as usize].id, self.solids[j as usize].id);
        Contact { pair, distance: near.proximity.distance, points: near.proximity.points }
    }
}
