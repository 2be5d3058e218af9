//! Where the hand is: the kinematics of one chain, from the base to a marker.

use mobee_model::{Hinge, JointMotion, Scene};
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};

/// The joints between a robot's base and its hand, and nothing else of the robot.
#[derive(Clone, Debug)]
pub struct HandChain {
    base: Isometry3<f64>,
    /// From the base outward.
    hinges: Vec<Hinge>,
    /// `frame_from_marker` on the last of them.
    tip: Isometry3<f64>,
    palm: Unit<Vector3<f64>>,
}

/// The hand at a pose, in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandPose {
    /// The marker's position, meters.
    pub at: Point3<f64>,
    /// The unit vector out of the palm.
    pub palm: Vector3<f64>,
}

impl HandChain {
    /// The chain to a marker (an index into `Robot::markers`) of the scene's first robot; `palm` is given in the marker's
    /// frame.
    pub fn new(scene: &Scene, marker: usize, palm: Unit<Vector3<f64>>) -> HandChain {
        HandChain::of_robot(scene, 0, marker, palm)
    }

    /// The same of another robot, an index into the scene's robots. Whatever has a marker will do for a hand: of an eye, `palm` is where it looks.
    pub fn of_robot(scene: &Scene, robot: usize, marker: usize, palm: Unit<Vector3<f64>>) -> HandChain {
        let mut chain = HandChain { base: scene.base(robot), hinges: Vec::new(), tip: Isometry3::identity(), palm };
        let node = scene.robots().get(robot).and_then(|r| r.markers.get(marker)).map(|m| m.node);
        let (Some(skeleton), Some(node)) = (scene.skeletons().get(robot), node) else { return chain };
        chain.tip = skeleton.in_frame.get(node).copied().unwrap_or_default();
        let mut frame = skeleton.frame.get(node).copied().unwrap_or(0);
        // a frame has a higher number than the one that it hangs on, so this ends
        while let Some(hinge) = frame.checked_sub(1).and_then(|i| skeleton.joints.get(i)) {
            frame = hinge.parent;
            chain.hinges.push(hinge.clone());
        }
        chain.hinges.reverse();
        chain
    }

    /// Where the hand is at a pose of the whole robot, rad of encoder.
    pub fn at(&self, pose: &[f64]) -> HandPose {
        let frame = self.frame(pose);
        HandPose { at: Point3::from(frame.translation.vector), palm: frame.rotation * *self.palm }
    }

    /// `world_from_marker` at a pose of the whole robot, rad of encoder.
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
