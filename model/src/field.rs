//! The force fields about a robot's shapes: what pushes its motors where something is near.
//!
//! A robot's own field primitives are its fields, if its file has any; else every solid shape has a field as wide as it is
//! told. Two shapes repel by how deep they are in each other's field, along the line between their witness points (the
//! nearest, or deepest, points on the two), and the motors feel that by the transposed Jacobian:
//!
//! ```text
//! depth = width - signed distance          torque of motor m = depth * d(distance)/d(q_m)      (meters times meters)
//! ```
//! A slide feels the push along its axis, so that its lever is its gain: meters of way per radian of encoder.
//!
//! The chain runs from the shape to the robot's root. (The original's ended at the root motor of the shape's body part, and
//! took its lever from the node's origin instead of the witness point.)

use crate::engine::{DefaultEngine, Engine};
use crate::{Contact, Pair, Robot, Scene, ShapeId, Watch};
use nalgebra::Isometry3;
use std::sync::Arc;

/// The fields of one robot of a scene.
#[derive(Clone, Debug)]
pub struct Field<E: Engine = DefaultEngine> {
    /// Its index in the scene.
    robot: usize,
    /// How far the fields reach beyond the shapes, meters; zero if the robot has field primitives.
    width: f64,
    /// Follows what is in the fields.
    watch: Watch<E>,
    /// What is in each other's field at the target, sorted by pair.
    spared: Vec<Spared>,
    /// `world_from_frame` of the robot, filled only if something pushes.
    frames: Vec<Isometry3<f64>>,
    /// Per motor: meters times meters.
    torques: Vec<f64>,
}

/// A pair that pushes less during a motion, since it is near at the motion's target.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Spared {
    /// Which two.
    pair: Pair,
    /// Their distance at the target, meters: nearer than this they push.
    distance: f64,
}

impl<E: Engine> Field<E> {
    /// The fields of one robot.
    ///
    /// # Arguments
    /// * `robot`: its index in [`Scene::robots`].
    /// * `width`: how far the fields of its solid shapes reach, meters. Not read if it has field primitives.
    pub fn new(scene: &Arc<Scene<E>>, robot: usize, width: f64) -> Field<E> {
        let width = if scene.robots().get(robot).is_some_and(|r| has_fields(r)) { 0.0 } else { width };
        let watch = Watch::new(fields_of(scene, robot), width);
        Field { robot, width, watch, spared: Vec::new(), frames: Vec::new(), torques: Vec::new() }
    }

    /// Goes on in another scene, such as one after an edit. Whoever moves must [`Field::aim`] again.
    pub fn set_scene(&mut self, scene: &Arc<Scene<E>>) {
        self.watch.set_scene(fields_of(scene, self.robot));
        self.spared.clear();
    }

    /// A motion begins to where these poses have the robot. Pairs that are in each other's field there push only where they are
    /// nearer than that: else the target would be no place to rest at, and nothing near anything could be reached.
    pub fn aim<P: AsRef<[f64]>>(&mut self, target: &[P]) {
        let near = self.watch.scene().contacts(target, self.width);
        self.spared = near.iter().map(|c| Spared { pair: c.pair, distance: c.distance }).collect();
    }

    /// The torques on the robot's motors: the downward slope of half the sum of squared depths.
    ///
    /// # Arguments
    /// * `poses`: of all robots, rad of encoder. Meant for a stream of poses, as those of a [`Watch`].
    ///
    /// # Returns
    /// One number per motor, meters of depth times meters of lever; nothing pushes where it is zero. Empty if there is no such
    /// robot.
    pub fn torques<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> &[f64] {
        let scene = self.watch.scene().clone();
        let (bodies, robot) = (scene.bodies(), self.robot);
        self.torques.clear();
        let Some(skeleton) = bodies.skeletons.get(robot) else { return &self.torques };
        self.torques.resize(bodies.robots.get(robot).map_or(0, |r| r.motors.len()), 0.0);
        self.frames.clear();
        for contact in self.watch.update(poses) {
            let depth = width_of(&self.spared, contact, self.width) - contact.distance;
            let apart = contact.points[1] - contact.points[0];
            if depth <= 0.0 || contact.distance.abs() < 1e-9 {
                continue; // shapes that just touch give no direction
            }
            // Along the witness points: from the first shape to the second where they are apart, turned about where they
            // overlap, as the distance is negative then.
            let push = apart * (depth / contact.distance);
            for (shape, point, push) in
                [(contact.pair.0, contact.points[0], -push), (contact.pair.1, contact.points[1], push)]
            {
                let ShapeId::Robot { robot: owner, node, .. } = shape else { continue };
                if usize::from(owner) != robot {
                    continue;
                }
                if self.frames.is_empty() {
                    skeleton.place(poses.get(robot).map_or(&[], AsRef::as_ref), &mut self.frames);
                }
                skeleton.add_torques(&self.frames, usize::from(node), &point, &push, &mut self.torques);
            }
        }
        &self.torques
    }
}

/// How wide the field between a contact's shapes is, meters.
fn width_of(spared: &[Spared], contact: &Contact, width: f64) -> f64 {
    spared.binary_search_by_key(&contact.pair, |s| s.pair).map_or(width, |i| width.min(spared[i].distance))
}

/// Whether the file gives the robot field primitives of its own.
fn has_fields(robot: &Robot) -> bool {
    robot.nodes.iter().any(|n| !n.fields.is_empty())
}

/// A scene in which this robot's solids are its field primitives, if it has any.
fn fields_of<E: Engine>(scene: &Arc<Scene<E>>, robot: usize) -> Arc<Scene<E>> {
    if !scene.robots().get(robot).is_some_and(|r| has_fields(r)) {
        return scene.clone();
    }
    let of = |(i, r): (usize, &Arc<Robot>)| {
        let mut r = r.clone();
        if i == robot {
            let fields = Arc::make_mut(&mut r);
            for node in &mut fields.nodes {
                node.solids = std::mem::take(&mut node.fields);
                node.hulls.clear();
            }
            fields.pairs.reflex = std::mem::take(&mut fields.pairs.field);
            fields.pairs.visual_only.clear();
        }
        (r, scene.base(i))
    };
    let robots = scene.robots().iter().enumerate().map(of).collect();
    let objects = scene.objects().map(|(_, o)| (**o).clone()).collect();
    Scene::with_engine(robots, objects).map_or_else(|_| scene.clone(), Arc::new)
}
