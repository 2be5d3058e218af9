//! Skeleton: a robot reduced to frames that are connected by moving joints.
//!
//! Nodes without a moving joint between them share a frame, so a configuration costs one motion per moving joint
//! instead of one product per node. Two nodes are rigidly connected if and only if their frames are equal.

use crate::robot::{JointMotion, NodeKind, Robot};
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};

/// The moving frames of one robot. Frame 0 is the base; the order of frames is that of their joints in the tree.
///
/// Transforms that are constant between two moving joints are multiplied once, here, instead of at every configuration.
#[derive(Clone, Debug)]
pub struct Skeleton {
    /// `world_from_robot`: frame 0.
    pub base: Isometry3<f64>,
    /// The joint that carries frame `i + 1`; a joint's parent frame has a lower number than its own.
    pub joints: Vec<Hinge>,
    /// Per node: its frame.
    pub frame: Vec<usize>,
    /// Per node: `frame_from_node`.
    pub in_frame: Vec<Isometry3<f64>>,
}

/// A joint that moves, revolute or prismatic.
#[derive(Clone, Debug)]
pub struct Hinge {
    /// The frame it is fixed to.
    pub parent: usize,
    /// Revolute or prismatic.
    pub motion: JointMotion,
    /// `parent_from_joint` at position zero.
    pub at: Isometry3<f64>,
    /// Its axis in its own frame.
    pub axis: Unit<Vector3<f64>>,
    /// Its motor.
    pub motor: usize,
    /// Motor limits, rad of encoder.
    pub limits: (f64, f64),
    /// The motor's home, for configurations without an entry for it.
    pub home: f64,
    /// Position at the motor's lower limit, rad or meters.
    pub min: f64,
    /// Position at the motor's upper limit, rad or meters.
    pub max: f64,
    /// Radians or meters of joint per radian of encoder.
    pub gain: f64,
}

impl Hinge {
    /// Position at a configuration of the robot, rad or meters; motor positions beyond the limits count as the limit.
    pub fn position(&self, pose: &[f64]) -> f64 {
        let q = pose.get(self.motor).copied().unwrap_or(self.home);
        self.min + (q.max(self.limits.0).min(self.limits.1) - self.limits.0) * self.gain
    }

    /// Origin of its frame in the parent frame at the two ends of its range; equal for a revolute joint.
    pub fn origins(&self) -> [Vector3<f64>; 2] {
        let at = self.at.translation.vector;
        match self.motion {
            JointMotion::Turn => [at; 2],
            JointMotion::Slide => [self.min, self.max].map(|position| at + self.at.rotation * (*self.axis * position)),
        }
    }
}

impl Skeleton {
    /// Traverses the tree once and folds everything that does not move into the pose of the next joint or shape.
    pub fn new(robot: &Robot, base: Isometry3<f64>) -> Self {
        let mut skeleton = Skeleton { base, joints: Vec::new(), frame: Vec::new(), in_frame: Vec::new() };
        // The frame of the children of each node, and their pose in it.
        let mut below: Vec<(usize, Isometry3<f64>)> = Vec::new();
        for (n, node) in robot.nodes.iter().enumerate() {
            let (frame, here) = node.parent.and_then(|p| below.get(p)).copied().unwrap_or((0, Isometry3::identity()));
            skeleton.frame.push(frame);
            skeleton.in_frame.push(here);
            below.push(match &node.kind {
                NodeKind::Link { offset } => (frame, here * Translation3::from(*offset)),
                NodeKind::Joint { motion, axis, motor, min, max, .. } => match robot.motors.get(*motor) {
                    Some(m) if robot.can_move(n) => {
                        skeleton.joints.push(Hinge {
                            parent: frame,
                            motion: *motion,
                            at: here,
                            axis: *axis,
                            motor: *motor,
                            limits: (m.min, m.max),
                            home: m.home,
                            min: *min,
                            max: *max,
                            gain: (max - min) / (m.max - m.min),
                        });
                        (skeleton.joints.len(), Isometry3::identity())
                    }
                    // A joint that can't move stays at its lower limit.
                    _ => (frame, here * motion.by(axis, *min)),
                },
            });
        }
        skeleton
    }

    /// Number of frames, the base included.
    pub fn frames(&self) -> usize {
        self.joints.len() + 1
    }

    /// Appends `world_from_frame` of every frame to `frames`.
    pub fn place(&self, pose: &[f64], frames: &mut Vec<Isometry3<f64>>) {
        let first = frames.len();
        frames.push(self.base);
        for joint in &self.joints {
            let parent = frames[first + joint.parent];
            let position = joint.position(pose);
            let mut frame = parent * joint.at;
            match joint.motion {
                // A revolute joint has no translation, so only the rotation is multiplied.
                JointMotion::Turn => frame.rotation *= UnitQuaternion::from_axis_angle(&joint.axis, position),
                JointMotion::Slide => frame.translation.vector += frame.rotation * (*joint.axis * position),
            }
            frames.push(frame);
        }
    }
}
