//! External torques on an arm: weight and contacts.

use mobee_model::{Contact, NodePairs, Object, ObjectClass, Robot, Scene, SceneError, ShapeId, Watch};
use nalgebra::{Isometry3, Vector3};
use std::sync::Arc;

/// Gravity, m/s^2.
const GRAVITY: f64 = 9.81;
/// Distance below which a link and an object are tracked between two evaluations, m.
const TRACKING_DISTANCE_M: f64 = 0.03;
/// The same for two links, m: they count only from the evaluation on that finds them in contact.
const SELF_TRACKING_DISTANCE_M: f64 = 0.001;

/// Surroundings of an arm, and its physical parameters.
#[derive(Clone, Debug)]
pub struct ArmPhysics {
    /// The arm and the objects around it, including objects known to the physics only.
    pub scene: Arc<Scene>,
    /// Mass of the arm, kg, distributed over its shapes by volume.
    pub mass: f64,
    /// Share of its weight that no controller of its own compensates, 0 to 1.
    pub felt: f64,
    /// Stiffness of a contact, N/m.
    pub stiffness: f64,
    /// Damping of a contact, N s/m.
    pub damping: f64,
}

impl ArmPhysics {
    /// Scene with this robot alone and these objects. Targets and ghosts are omitted, because nothing can
    /// touch them.
    ///
    /// # Errors
    /// Two objects of one name.
    pub fn scene_of(scene: &Scene, robot: usize, more: &[Object]) -> Result<Option<Arc<Scene>>, SceneError> {
        let Some(model) = scene.robots().get(robot) else { return Ok(None) };
        let there = scene.objects().map(|(_, object)| object.as_ref().clone()).chain(more.iter().cloned());
        let solid = there.filter(|object| object.class == ObjectClass::Obstacle).collect();
        Scene::new(vec![(model.clone(), scene.base(robot))], solid).map(|scene| Some(Arc::new(scene)))
    }
}

/// A part of the arm's mass.
#[derive(Clone, Copy, Debug)]
struct PartWeight {
    node: usize,
    /// Its center in the node's frame, m.
    at: Vector3<f64>,
    /// N.
    newtons: f64,
}

/// A pair that may touch before the next evaluation: its distance as a linear function of the joints.
#[derive(Clone, Debug)]
struct Gap {
    distance: f64,
    gradient: Vec<f64>,
}

/// Weight and contacts of an arm.
#[derive(Clone, Debug)]
pub struct ExternalTorques {
    physics: ArmPhysics,
    /// Pairs of a link and an object, and pairs of links.
    watches: [Watch; 2],
    weights: Vec<PartWeight>,
    /// Last evaluation: joint positions, their torques by weight, and the close pairs.
    seen: Vec<f64>,
    weight: Vec<f64>,
    gaps: Vec<Gap>,
}

impl ExternalTorques {
    /// Creates the torques; `None` if the scene has no robot.
    pub fn new(physics: ArmPhysics) -> Option<ExternalTorques> {
        let robot = physics.scene.robots().first()?;
        let moved = robot.nodes.iter().enumerate().filter(|(n, _)| robot.body(*n).is_some());
        let shapes: Vec<(usize, Vector3<f64>, f64)> = moved
            .flat_map(|(n, node)| node.solids.iter().map(move |s| (n, s.pose.translation.vector, s.shape.volume())))
            .collect();
        let all: f64 = shapes.iter().map(|(_, _, volume)| volume).sum();
        let per_volume = if all > 0.0 { physics.mass * physics.felt * GRAVITY / all } else { 0.0 };
        let weight = |(node, at, volume)| PartWeight { node, at, newtons: volume * per_volume };
        let motors = robot.motors.len();
        let alone = |robot: Robot, objects: Vec<Object>| {
            let scene = Scene::new(vec![(Arc::new(robot), physics.scene.base(0))], objects);
            scene.map_or_else(|_| physics.scene.clone(), Arc::new)
        };
        // most links are always near each other, and far from all objects
        let objects = physics.scene.objects().map(|(_, object)| object.as_ref().clone()).collect();
        let outside = alone(Robot { pairs: NodePairs::default(), ..Robot::clone(robot) }, objects);
        let inside = alone(Robot::clone(robot), Vec::new());
        Some(ExternalTorques {
            watches: [Watch::new(outside, TRACKING_DISTANCE_M), Watch::new(inside, SELF_TRACKING_DISTANCE_M)],
            weights: shapes.into_iter().map(weight).filter(|w| w.newtons > 0.0).collect(),
            seen: vec![0.0; motors],
            weight: vec![0.0; motors],
            gaps: Vec::new(),
            physics,
        })
    }

    /// Evaluates weight and contacts at these joint positions, rad.
    pub fn look(&mut self, q: &[f64]) {
        let scene = self.physics.scene.clone();
        let Some(skeleton) = scene.skeletons().first() else { return };
        let mut frames: Vec<Isometry3<f64>> = Vec::new();
        skeleton.place(q, &mut frames);
        self.seen = q.to_vec();
        self.weight.fill(0.0);
        for w in &self.weights {
            let frame = skeleton.frame.get(w.node).and_then(|f| frames.get(*f));
            let (Some(frame), Some(inside)) = (frame, skeleton.in_frame.get(w.node)) else { continue };
            let point = frame * inside * nalgebra::Point3::from(w.at);
            skeleton.add_torques(&frames, w.node, &point, &(-Vector3::z() * w.newtons), &mut self.weight);
        }
        let object = |id: ShapeId| matches!(id, ShapeId::Object { .. });
        self.gaps.clear();
        for watch in &mut self.watches {
            let touches = watch.update(&[q]).iter().filter(|c| object(c.pair.1) || c.distance < 0.0);
            let gap = |c: &Contact| Gap { distance: c.distance, gradient: scene.distance_gradient(0, c, &frames) };
            self.gaps.extend(touches.map(gap));
        }
    }

    /// Adds the torques of weight and contacts, N m per joint. Returns the greatest contact force, N.
    pub fn torques(&self, q: &[f64], v: &[f64], out: &mut [f64]) -> f64 {
        for (out, weight) in out.iter_mut().zip(&self.weight) {
            *out += weight;
        }
        let mut greatest = 0.0_f64;
        for gap in &self.gaps {
            let moved: f64 =
                gap.gradient.iter().zip(q.iter().zip(&self.seen)).map(|(g, (q, seen))| g * (q - seen)).sum();
            let depth = -(gap.distance + moved);
            if depth <= 0.0 {
                continue;
            }
            let closing: f64 = -gap.gradient.iter().zip(v).map(|(g, v)| g * v).sum::<f64>();
            let force = (self.physics.stiffness * depth + self.physics.damping * closing).max(0.0);
            greatest = greatest.max(force);
            for (out, g) in out.iter_mut().zip(&gap.gradient) {
                *out += force * g;
            }
        }
        greatest
    }
}
