//! The joints between the base and a frame: forward kinematics and Jacobian of that frame alone. No Python here.

use mobee_model::{Hinge, JointMotion, Skeleton};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// The joints that move a frame, from the base outward.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    hinges: Vec<Hinge>,
    /// The frame behind the last joint.
    end: Isometry3<f64>,
}

impl Chain {
    /// To the frame at the origin of a node, turned by `turn`.
    pub fn new(skeleton: &Skeleton, node: usize, turn: &UnitQuaternion<f64>) -> Option<Self> {
        let end = skeleton.in_frame.get(node)? * turn;
        let mut hinges = Vec::new();
        let mut frame = *skeleton.frame.get(node)?;
        while let Some(hinge) = frame.checked_sub(1).and_then(|joint| skeleton.joints.get(joint)) {
            hinges.push(hinge.clone());
            frame = hinge.parent;
        }
        hinges.reverse();
        Some(Self { hinges, end })
    }

    /// The motors that move it, from the base outward, each once.
    pub fn motors(&self) -> Vec<usize> {
        let mut motors = Vec::new();
        for hinge in &self.hinges {
            if !motors.contains(&hinge.motor) {
                motors.push(hinge.motor);
            }
        }
        motors
    }

    /// `base_from_frame` at a pose of the motors, rad of encoder.
    pub fn forward(&self, pose: &[f64]) -> Isometry3<f64> {
        self.hinges.iter().fold(Isometry3::identity(), |at, hinge| moved(&(at * hinge.at), hinge, pose)) * self.end
    }

    /// The frame's velocity in the base frame per velocity of each motor, rad of encoder: rows x, y, z, about x, about y, about z.
    ///
    /// # Arguments
    /// * `jacobian`: `6 * motors` numbers, row by row; set to zero first.
    pub fn jacobian(&self, pose: &[f64], motors: usize, jacobian: &mut [f64]) {
        jacobian.fill(0.0);
        let tip = self.forward(pose).translation.vector;
        let mut at = Isometry3::identity();
        for hinge in &self.hinges {
            let joint = at * hinge.at;
            let axis = joint.rotation * *hinge.axis * hinge.gain;
            let (linear, angular) = match hinge.motion {
                JointMotion::Turn => (axis.cross(&(tip - joint.translation.vector)), axis),
                JointMotion::Slide => (axis, Vector3::zeros()),
            };
            for (row, value) in linear.iter().chain(angular.iter()).enumerate() {
                // one motor may drive several joints
                if let Some(entry) = jacobian.get_mut(row * motors + hinge.motor) {
                    *entry += value;
                }
            }
            at = moved(&joint, hinge, pose);
        }
    }
}

/// The frame behind a joint, given the one before it.
fn moved(joint: &Isometry3<f64>, hinge: &Hinge, pose: &[f64]) -> Isometry3<f64> {
    joint * hinge.motion.by(&hinge.axis, hinge.position(pose))
}
