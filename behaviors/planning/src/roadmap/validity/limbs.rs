//! Simplified geometry of the robot for a roadmap: a few limbs on the frames that the map's motors
//! move, and the boxes that they sweep along an edge.
//!
//! Motors that the map does not move are at rest, so everything between two of its motors is one
//! rigid body. The shapes of a body are grouped into *limbs* of about a hand's size, each with one
//! box in the body's frame.
//!
//! # Boxes that contain the whole motion
//! Along an edge all positions are linear in `s`, 0 to 1. On a piece of length `h`, a point `x(s)`
//! stays near its chord: in each coordinate within `A h^2 / 8`, where `A` bounds `|x''|`. A
//! rotation `i` by `angle_i` moves the point with a speed of at most `v_i = angle_i * reach_i`, and
//! a joint that it carries also changes its direction at that rate, so
//!
//! ```text
//! A = sum over rotations i of angle_i * (v_i + 2 * sum over joints j farther out of v_j)
//! ```
//!
//! (Differentiate `x' = sum of angle_i * axis_i x (x - p_i)` again.) Therefore the box around a
//! limb at the ends of all pieces, enlarged by that, contains all of its points at every
//! configuration in between. `reach` is [`Scene::levers`], which holds for every configuration.

#[cfg(test)]
mod tests;

use mobee_model::{Collider, Engine, Hinge, JointMotion, Scene, Shape, Skeleton};
use nalgebra::{Isometry3, Vector3};

/// Maximum edge of a limb's box, unless a single shape is longer, meters.
const MAX_LIMB_M: f64 = 0.2;
/// Maximum enlargement of a box; beyond it the edge is cut into more pieces, meters.
const MAX_ENLARGEMENT_M: f64 = 0.004;
/// Maximum number of pieces of an edge; beyond it the boxes are enlarged further.
const MAX_PIECES: f64 = 64.0;
/// Enlargement of a box for rounding, and for configurations up to 1e-6 rad beyond a limit, meters.
const ROUNDING_M: f64 = 1e-5;

/// An axis-aligned box in the world, meters: three lower, then three upper bounds, rounded outward.
pub(super) type WorldBox = [f32; 6];

/// A robot of which only the map's motors move.
#[derive(Clone, Debug)]
pub(super) struct Limbs {
    base: Isometry3<f64>,
    /// Joints that the map moves; joint `i` carries body `i + 1`, and body 0 is fixed.
    hinges: Vec<LimbCarrier>,
    limbs: Vec<Limb>,
    /// Body of each frame of the robot.
    body: Vec<usize>,
    /// Index of the robot's first frame in the scene.
    first_frame: usize,
}

#[derive(Clone, Debug)]
struct LimbCarrier {
    parent: usize,
    /// `parent_from_hinge` at position zero.
    at: Isometry3<f64>,
    /// The joint, with its motor numbered among those of the map.
    hinge: Hinge,
}

#[derive(Clone, Debug)]
struct Limb {
    body: usize,
    /// Lower corner of its box, in the body's frame.
    low: Vector3<f64>,
    /// Upper corner of its box, in the body's frame.
    high: Vector3<f64>,
    /// Joints between it and the base, from the outermost in: (joint, meters per radian of its
    /// motor).
    reach: Vec<(usize, f64)>,
}

impl Limbs {
    /// Creates the geometry of a robot with these moving motors (indices into its motors), and all
    /// others at `rest`.
    pub fn new<E: Engine>(scene: &Scene<E>, robot: usize, motors: &[usize], rest: &[f64]) -> Limbs {
        let first_frame = scene.skeletons().iter().take(robot).map(Skeleton::frames).sum();
        let Some(skeleton) = scene.skeletons().get(robot) else {
            let base = Isometry3::identity();
            let body = Vec::new();
            return Limbs { base, hinges: Vec::new(), limbs: Vec::new(), body, first_frame };
        };
        let mut hinges: Vec<LimbCarrier> = Vec::new();
        // For each frame: its body, `body_from_frame`, and the joint that carries it if the map
        // moves that.
        let mut bodies = vec![(0, Isometry3::identity())];
        let mut carriers = vec![None];
        for hinge in &skeleton.joints {
            let (body, above) = bodies.get(hinge.parent).copied().unwrap_or((0, Isometry3::identity()));
            let at = above * hinge.at;
            if let Some(rank) = motors.iter().position(|m| *m == hinge.motor) {
                let hinge = Hinge { motor: rank, ..hinge.clone() };
                hinges.push(LimbCarrier { parent: body, at, hinge });
                carriers.push(Some(hinges.len() - 1));
                bodies.push((hinges.len(), Isometry3::identity()));
            } else {
                carriers.push(None);
                bodies.push((body, at * hinge.motion.by(&hinge.axis, hinge.position(rest))));
            }
        }
        let mut limbs: Vec<Limb> = Vec::new();
        for collider in scene.colliders() {
            let Some(frame) = collider.frame.checked_sub(first_frame) else { continue };
            let Some((body, in_body)) = bodies.get(frame).copied().filter(|(body, _)| *body > 0) else { continue };
            let (low, high) = bounds(collider.shape, &(in_body * collider.pose));
            let levers = scene.levers(robot, frame).iter();
            let reach = levers.filter_map(|l| Some((carriers.get(l.frame).copied().flatten()?, l.reach)));
            let limb = Limb { body, low, high, reach: reach.collect() };
            match limbs.iter_mut().find(|other| other.takes(&limb)) {
                Some(other) => other.take(&limb),
                None => limbs.push(limb),
            }
        }
        let body = bodies.into_iter().map(|(body, _)| body).collect();
        Limbs { base: skeleton.base, hinges, limbs, body, first_frame }
    }

    /// Number of boxes of an edge.
    pub fn len(&self) -> usize {
        self.limbs.len()
    }

    /// Returns the body of each collider of the scene, 0 if the map's motors do not move it. Two
    /// shapes of one body can't block an edge.
    pub fn carried<E: Engine>(&self, scene: &Scene<E>) -> Vec<usize> {
        let local = |c: &Collider| c.frame.checked_sub(self.first_frame).and_then(|f| self.body.get(f));
        scene.colliders().map(|c| local(c).copied().unwrap_or(0)).collect()
    }

    /// Appends the box that each limb sweeps on the straight line between two configurations of the
    /// map's motors (rad at the encoder).
    pub fn sweep(&self, from: &[f64], to: &[f64], boxes: &mut Vec<WorldBox>) {
        let way =
            |c: &LimbCarrier| (to.get(c.hinge.motor).unwrap_or(&0.0) - from.get(c.hinge.motor).unwrap_or(&0.0)).abs();
        let ways: Vec<f64> = self.hinges.iter().map(way).collect();
        let bends: Vec<f64> = self.limbs.iter().map(|limb| self.bend(limb, &ways)).collect();
        let most = bends.iter().copied().fold(0.0, f64::max);
        let pieces = (most / (8.0 * MAX_ENLARGEMENT_M)).sqrt().ceil().clamp(1.0, MAX_PIECES);
        let first = boxes.len();
        boxes.extend(self.limbs.iter().map(|_| {
            [f32::INFINITY, f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY]
        }));
        let mut bodies = Vec::with_capacity(self.hinges.len() + 1);
        let mut q = from.to_vec();
        for piece in 0..=pieces as u32 {
            let s = f64::from(piece) / pieces;
            q.iter_mut().zip(from.iter().zip(to)).for_each(|(q, (a, b))| *q = a + (b - a) * s);
            self.place(&q, &mut bodies);
            for ((limb, bend), swept) in self.limbs.iter().zip(&bends).zip(boxes.iter_mut().skip(first)) {
                let Some(body) = bodies.get(limb.body) else { continue };
                let around = bend / (8.0 * pieces * pieces) + ROUNDING_M;
                let (low, high) = moved(limb.low, limb.high, body);
                for (axis, (low, high)) in low.iter().zip(high.iter()).enumerate() {
                    swept[axis] = swept[axis].min(((low - around) as f32).next_down());
                    swept[axis + 3] = swept[axis + 3].max(((high + around) as f32).next_up());
                }
            }
        }
    }

    /// Returns the bound `A` of the module documentation for the points of a limb, meters.
    fn bend(&self, limb: &Limb, ways: &[f64]) -> f64 {
        let mut sum = 0.0;
        let mut outer = 0.0;
        for (hinge, reach) in &limb.reach {
            let (Some(carrier), Some(way)) = (self.hinges.get(*hinge), ways.get(*hinge)) else { continue };
            let speed = way * reach;
            if carrier.hinge.motion == JointMotion::Turn {
                sum += way * carrier.hinge.gain.abs() * (speed + 2.0 * outer);
            }
            outer += speed;
        }
        sum
    }

    /// Computes `world_from_body` of all bodies at a configuration.
    fn place(&self, q: &[f64], bodies: &mut Vec<Isometry3<f64>>) {
        bodies.clear();
        bodies.push(self.base);
        for LimbCarrier { parent, at, hinge } in &self.hinges {
            let parent = bodies.get(*parent).copied().unwrap_or(self.base);
            bodies.push(parent * at * hinge.motion.by(&hinge.axis, hinge.position(q)));
        }
    }
}

impl Limb {
    /// Returns whether another limb of the same body is close enough for a common box.
    fn takes(&self, other: &Limb) -> bool {
        self.body == other.body && (self.high.sup(&other.high) - self.low.inf(&other.low)).max() <= MAX_LIMB_M
    }

    fn take(&mut self, other: &Limb) {
        self.low = self.low.inf(&other.low);
        self.high = self.high.sup(&other.high);
        for (hinge, reach) in &mut self.reach {
            let theirs = other.reach.iter().find(|(h, _)| h == hinge).map_or(0.0, |(_, r)| *r);
            *reach = reach.max(theirs);
        }
    }
}

/// Returns the box around a shape at a pose.
pub(super) fn bounds(shape: Shape, pose: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let axes = pose.rotation.to_rotation_matrix().into_inner();
    let y = axes.column(1);
    let half = match shape {
        Shape::Sphere { radius } => Vector3::repeat(radius),
        Shape::Capsule { radius, height } => y.abs() * (height / 2.0) + Vector3::repeat(radius),
        Shape::Cylinder { radius, height } => {
            y.abs() * (height / 2.0) + y.map(|c| radius * (1.0 - c * c).max(0.0).sqrt())
        }
        Shape::Box { size } => axes.abs() * size / 2.0,
    };
    (pose.translation.vector - half, pose.translation.vector + half)
}

/// Returns the box around a transformed box.
fn moved(low: Vector3<f64>, high: Vector3<f64>, by: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let axes = by.rotation.to_rotation_matrix().into_inner();
    let middle = by.translation.vector + axes * (low + high) / 2.0;
    let half = axes.abs() * (high - low) / 2.0;
    (middle - half, middle + half)
}
