//! Repulsive force fields around a robot's shapes, mapped to motor torques.
//!
//! If the robot's file defines field primitives, they are its fields. Otherwise every solid shape has a field of the
//! given width. Two shapes repel each other in proportion to the penetration depth of their fields, along the line
//! between their witness points (the nearest, or deepest, points of the two). The transposed Jacobian maps this force
//! to the motors:
//!
//! ```text
//! depth = width - signed distance          torque of motor m = depth * d(distance)/d(q_m)      (meters times meters)
//! ```
//! A prismatic joint receives the force along its axis, so its lever is its gain: meters of travel per radian of
//! encoder.
//!
//! The chain runs from the shape to the robot's root. (In the original it ended at the root motor of the shape's body
//! part, and the lever was taken from the node's origin instead of the witness point.)

use crate::engine::{DefaultEngine, Engine};
use crate::{Contact, Pair, Robot, Scene, ShapeId, Watch};
use nalgebra::Isometry3;
use std::sync::Arc;

/// The fields of one robot of a scene.
#[derive(Clone, Debug)]
pub struct Field<E: Engine = DefaultEngine> {
    /// Its index in the scene.
    robot: usize,
    /// Width of the fields beyond the shapes, meters; zero if the robot has field primitives.
    width: f64,
    /// Tracks the pairs whose fields overlap.
    watch: Watch<E>,
    /// Pairs whose fields overlap at the target, sorted by pair.
    reduced: Vec<ReducedField>,
    /// `world_from_frame` of the robot, computed only if a pair repels.
    frames: Vec<Isometry3<f64>>,
    /// Torque per motor, m^2 (depth times lever).
    torques: Vec<f64>,
}

/// A pair with a reduced field during a motion, since it is near at the target of the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ReducedField {
    /// The two shapes.
    pair: Pair,
    /// Their distance at the target, meters: the field's width for this pair.
    distance: f64,
}

impl<E: Engine> Field<E> {
    /// The fields of one robot.
    ///
    /// # Arguments
    /// * `robot`: its index in [`Scene::robots`].
    /// * `width`: width of the fields of its solid shapes, meters. Ignored if the robot has field primitives.
    pub fn new(scene: &Arc<Scene<E>>, robot: usize, width: f64) -> Field<E> {
        let width = if scene.robots().get(robot).is_some_and(|r| has_fields(r)) { 0.0 } else { width };
        let watch = Watch::new(fields_of(scene, robot), width);
        Field { robot, width, watch, reduced: Vec::new(), frames: Vec::new(), torques: Vec::new() }
    }

    /// Continues in another scene, such as one after an edit. Clears the target: call [`Field::aim`] again during a
    /// motion.
    pub fn set_scene(&mut self, scene: &Arc<Scene<E>>) {
        self.watch.set_scene(fields_of(scene, self.robot));
        self.reduced.clear();
    }

    /// Sets the target of a motion: the configurations of all robots at its end. Pairs whose fields overlap there repel
    /// only below their distance at the target. Otherwise the robot could not rest at the target, and nothing near an
    /// object would be reachable.
    pub fn aim<P: AsRef<[f64]>>(&mut self, target: &[P]) {
        let near = self.watch.scene().contacts(target, self.width);
        self.reduced = near.iter().map(|c| ReducedField { pair: c.pair, distance: c.distance }).collect();
    }

    /// The torques on the robot's motors: the negative gradient of half the sum of squared depths.
    ///
    /// # Arguments
    /// * `poses`: configurations of all robots, rad of encoder. Intended for a stream of configurations, as for a
    ///   [`Watch`].
    ///
    /// # Returns
    /// One torque per motor, m^2 (depth times lever); all zero if no pair repels. Empty if there is no such robot.
    pub fn torques<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> &[f64] {
        let scene = self.watch.scene().clone();
        let bodies = scene.bodies();
        let robot = self.robot;
        self.torques.clear();
        let Some(skeleton) = bodies.skeletons.get(robot) else { return &self.torques };
        self.torques.resize(bodies.robots.get(robot).map_or(0, |r| r.motors.len()), 0.0);
        self.frames.clear();
        for contact in self.watch.update(poses) {
            let depth = width_of(&self.reduced, contact, self.width) - contact.distance;
            let apart = contact.points[1] - contact.points[0];
            if depth <= 0.0 || contact.distance.abs() < 1e-9 {
                continue; // shapes that just touch have no direction
            }
            // Along the witness points: from the first shape to the second if they are apart, reversed if they overlap,
            // since the distance is negative then.
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

/// Width of the field between a contact's shapes, meters.
fn width_of(reduced: &[ReducedField], contact: &Contact, width: f64) -> f64 {
    reduced.binary_search_by_key(&contact.pair, |s| s.pair).map_or(width, |i| width.min(reduced[i].distance))
}

/// True if the robot's file defines field primitives.
fn has_fields(robot: &Robot) -> bool {
    robot.nodes.iter().any(|n| !n.fields.is_empty())
}

/// The scene with this robot's field primitives as its solids; the same scene if it has none.
fn fields_of<E: Engine>(scene: &Arc<Scene<E>>, robot: usize) -> Arc<Scene<E>> {
    if !scene.robots().get(robot).is_some_and(|r| has_fields(r)) {
        return scene.clone();
    }
    let with_fields = |(i, r): (usize, &Arc<Robot>)| {
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
    let robots = scene.robots().iter().enumerate().map(with_fields).collect();
    let objects = scene.objects().map(|(_, o)| (**o).clone()).collect();
    Scene::with_engine(robots, objects).map_or_else(|_| scene.clone(), Arc::new)
}
