//! Forward kinematics of one chain, from the base to a marker.

use mobee_model::{Hinge, JointMotion, Scene};
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};

/// The joints between a robot's base and its hand.
#[derive(Clone, Debug)]
pub struct HandChain {
    base: Isometry3<f64>,
    /// Joints from the base outward.
    hinges: Vec<Hinge>,
    /// `frame_from_marker` of the last one.
    tip: Isometry3<f64>,
    palm: Unit<Vector3<f64>>,
}

/// Position and palm direction of a hand, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandPose {
    /// Position of the marker, meters.
    pub at: Point3<f64>,
    /// Unit vector out of the palm.
    pub palm: Vector3<f64>,
}

impl HandChain {
    /// Creates the chain to a marker (an index into `Robot::markers`) of the scene's first robot;
    /// `palm` is given in the marker's frame.
    pub fn new(scene: &Scene, marker: usize, palm: Unit<Vector3<f64>>) -> HandChain {
        HandChain::of_robot(scene, 0, marker, palm)
    }

    /// Creates the chain to a marker of another robot, an index into the scene's robots. The marker
    /// need not be a hand: for an eye, `palm` is the viewing direction.
    pub fn of_robot(scene: &Scene, robot: usize, marker: usize, palm: Unit<Vector3<f64>>) -> HandChain {
        let mut chain = HandChain { base: scene.base(robot), hinges: Vec::new(), tip: Isometry3::identity(), palm };
        let node = scene.robots().get(robot).and_then(|r| r.markers.get(marker)).map(|m| m.node);
        let (Some(skeleton), Some(node)) = (scene.skeletons().get(robot), node) else { return chain };
        chain.tip = skeleton.in_frame.get(node).copied().unwrap_or_default();
        let mut frame = skeleton.frame.get(node).copied().unwrap_or(0);
        // A frame has a higher number than its parent, so the loop terminates.
        while let Some(hinge) = frame.checked_sub(1).and_then(|i| skeleton.joints.get(i)) {
            frame = hinge.parent;
            chain.hinges.push(hinge.clone());
        }
        chain.hinges.reverse();
        chain
    }

    /// Computes position and palm direction of the hand at a configuration of the whole robot, rad
    /// at the encoder.
    pub fn at(&self, pose: &[f64]) -> HandPose {
        let frame = self.frame(pose);
        HandPose { at: Point3::from(frame.translation.vector), palm: frame.rotation * *self.palm }
    }

    /// Computes `world_from_marker` at a configuration of the whole robot, rad at the encoder.
    pub fn frame(&self, pose: &[f64]) -> Isometry3<f64> {
        let mut frame = self.base;
        for hinge in &self.hinges {
            frame *= hinge.at;
            let position = hinge.position(pose);
            match hinge.motion {
                JointMotion::Turn => frame.rotation *= UnitQuaternion::from_axis_angle(&hinge.axis, position),
                JointMotion::Slide => frame.translation.vector += frame.rotation * (*hinge.axis * position),
            }
        }
        frame * self.tip
    }
}
