//! The objects of a scene, prepared, with the pairs that count: what an edit makes anew.

use super::bodies::{Bodies, Solid};
use super::travel::Terms;
use super::{Contact, Object, ObjectClass, ShapeId};
use crate::collision::{Placement, exact};
use crate::distance::Form;
use std::collections::BTreeMap;
use std::sync::Arc;

/// All solids of a scene and the pairs of them that the reflex watches.
#[derive(Debug)]
pub(crate) struct World {
    /// Those of the robots, then those of the obstacles, in order of their ids.
    pub solids: Vec<Solid>,
    /// Reflex pairs that can move against each other: indices, smaller first, sorted.
    pub pairs: Vec<(u32, u32)>,
    /// The same pairs by the frames they join.
    pub groups: Vec<Group>,
    /// Of those that can't, the ones that touch.
    pub fixed_contacts: Vec<Contact>,
}

/// Pairs of solids that move against each other alike: those of the same two frames.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// How far they move against each other.
    pub travel: Terms,
    /// The pairs.
    pub pairs: Vec<(u32, u32)>,
}

impl World {
    pub fn new(bodies: &Bodies, objects: &[(u32, Arc<Object>)]) -> Self {
        let mut solids = bodies.solids.clone();
        let mut sorted: Vec<_> = objects.iter().filter(|(_, o)| o.class == ObjectClass::Obstacle).collect();
        sorted.sort_unstable_by_key(|(id, _)| *id);
        for (id, object) in sorted {
            for (s, primitive) in object.shapes.iter().enumerate() {
                let form = Form::new(&primitive.shape);
                let pose = object.pose * primitive.pose;
                solids.push(Solid {
                    id: ShapeId::Object { object: *id, shape: s as u16 },
                    form,
                    frame: bodies.frames,
                    pose,
                    axis: pose.rotation * form.outer.0,
                    fixed: true,
                    near_root: false,
                });
            }
        }
        let own = bodies.solids.len();
        let mut pairs = bodies.moving.clone();
        let mut fixed = bodies.fixed.clone();
        for (i, solid) in bodies.solids.iter().enumerate().filter(|(_, s)| !s.near_root) {
            let list = if solid.fixed { &mut fixed } else { &mut pairs };
            list.extend((own..solids.len()).map(|j| (i as u32, j as u32)));
        }
        pairs.sort_unstable();
        let mut by_frames = BTreeMap::<(usize, usize), Vec<(u32, u32)>>::new();
        for &(i, j) in &pairs {
            let (f, g) = (solids[i as usize].frame, solids[j as usize].frame);
            by_frames.entry((f.min(g), f.max(g))).or_default().push((i, j));
        }
        let groups =
            by_frames.into_iter().map(|((f, g), pairs)| Group { travel: bodies.travel(f, g), pairs }).collect();
        let mut world = World { solids, pairs, groups, fixed_contacts: Vec::new() };
        let mut placement = Placement::default();
        bodies.place::<&[f64]>(&[], &mut placement.frames);
        placement.solids(&world.solids);
        world.fixed_contacts = fixed.iter().filter_map(|&(i, j)| exact(&world.solids, &placement, i, j, 0.0)).collect();
        world
    }
}
