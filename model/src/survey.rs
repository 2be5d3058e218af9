//! What random poses tell of a robot's shapes: which pairs of links need no test, how often the fitted shapes touch where the meshes do
//! not, and where the robot can begin.
//!
//! ```text
//! Robot + surfaces ──random poses──> Comparison ──> where to fit closer
//!                                └─> spared_pairs ──> Robot::leave_out
//! Robot ──find_home──> a pose that is free
//! ```

mod compare;
mod home;
mod spare;

pub use compare::{Comparison, ContactCounts, compare};
pub use home::{HomePose, find_home};
pub use spare::spared_pairs;

use crate::{Robot, Scene, SceneError, ShapeId, Surfaces};
use nalgebra::Isometry3;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The robot alone in the world, and which of its nodes has which surface.
struct Subject {
    scene: Scene,
    /// Per node: its link's index in the surfaces.
    surface_of: BTreeMap<usize, usize>,
}

impl Subject {
    fn new(robot: &Robot, surfaces: &Surfaces) -> Result<Self, SceneError> {
        let by_name: BTreeMap<&str, usize> = surfaces.links().enumerate().map(|(i, name)| (name, i)).collect();
        let of = |(i, node): (usize, &crate::Node)| Some((i, *by_name.get(node.name.as_deref()?)?));
        let surface_of = robot.nodes.iter().enumerate().filter_map(of).collect();
        let scene = Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new())?;
        Ok(Self { scene, surface_of })
    }

    /// The pairs of nodes whose shapes are nearer than a margin (meters), each with the smallest distance.
    fn near(&self, q: &[f64], margin: f64) -> BTreeMap<(usize, usize), f64> {
        let node = |shape: ShapeId| match shape {
            ShapeId::Robot { node, .. } => Some(usize::from(node)),
            ShapeId::Object { .. } => None,
        };
        let mut near = BTreeMap::new();
        for contact in self.scene.contacts(&[q], margin) {
            if let (Some(a), Some(b)) = (node(contact.pair.0), node(contact.pair.1)) {
                let least = near.entry((a.min(b), a.max(b))).or_insert(f64::INFINITY);
                *least = contact.distance.min(*least);
            }
        }
        near
    }

    /// Two nodes as links of the surfaces, if both have one.
    fn surfaces(&self, (a, b): (usize, usize)) -> Option<(usize, usize)> {
        Some((*self.surface_of.get(&a)?, *self.surface_of.get(&b)?))
    }

    /// The pairs of nodes that are tested.
    fn tested(&self) -> BTreeSet<(usize, usize)> {
        self.scene.robots().iter().flat_map(|r| r.pairs.reflex.iter().copied()).collect()
    }
}
