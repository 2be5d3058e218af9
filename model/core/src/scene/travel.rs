//! Lipschitz bounds of the motion of shapes with respect to the motors.
//!
//! A point at most `r` from a revolute joint's axis moves at most `r` times the angle; a prismatic joint moves all
//! points by its own displacement. `r` is bounded over all configurations of the joints between. So between any two
//! configurations no point of a shape moves farther, relative to another shape, than the sum over the motors between
//! the two of `coefficient * |change of motor|`. The signed distance of the two changes by no more than that.
//! over the motors between the two of `coefficient * |change of motor|`. The signed distance of the two changes no more than that.
//!
//! ```text
//! base --- hinge A --- hinge B --- shape        rho: farthest point of the shape from B's origin
//!            |<- offset ->|                     A's coefficient: |offset across A's axis| + rho
//!                         |<----- rho ---->|    B's: the farthest point from B's axis itself
//! ```
//! Only the last hinge's bound uses the position of the shape: as seen from A, B may have rotated it anywhere within a
//! ball of radius rho. The bound holds at every configuration (for a prismatic B at both ends of its range, and thus
//! between them), so it is computed once per robot. The more the arm is bent, the looser it is.

use super::skeleton::Hinge;
use super::{Scene, Skeleton};
use crate::engine::{Collider, Engine};
use crate::robot::JointMotion;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Contribution of one motor to a bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Term {
    /// Index among all motors of the scene.
    pub motor: u32,
    /// Meters per radian of encoder.
    pub reach: f64,
}

/// A bound: the sum over its terms of `reach * |change of motor|`, meters.
pub(crate) type Terms = Vec<Term>;

/// A hinge that moves a frame, with a motion bound: see [`Scene::levers`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lever {
    /// The frame that the hinge carries, within its robot.
    pub frame: usize,
    /// Maximum displacement of the moved frame's shapes, meters per radian of the hinge's motor.
    pub reach: f64,
}

/// Motion bounds per frame of one robot: displacement of its shapes relative to the base, hinge by hinge from the frame
/// to the base.
#[derive(Clone, Debug, Default)]
pub(crate) struct FrameReach {
    /// Per frame: the hinges between it and the base.
    pub levers: Vec<Vec<Lever>>,
    /// Maximum distance of any of its shapes from the base's origin, meters.
    pub radius: f64,
}

impl<E: Engine> Scene<E> {
    /// The hinges between a frame of a robot (numbered within it, as in its [`Skeleton`]) and the robot's base,
    /// starting at the frame, each with the maximum displacement of the frame's shapes at any configuration of the
    /// others. Empty for the base itself.
    pub fn levers(&self, robot: usize, frame: usize) -> &[Lever] {
        self.bodies().reach.get(robot).and_then(|reach| reach.levers.get(frame)).map_or(&[], Vec::as_slice)
    }

    /// Maximum distance of any shape of a robot from its base ([`Scene::base`]) at any configuration, meters. Zero for
    /// a robot that the scene does not have.
    pub fn reach(&self, robot: usize) -> f64 {
        self.bodies().reach.get(robot).map_or(0.0, |reach| reach.radius)
    }

    /// Upper bound of the displacement of a robot's shapes in the world, meters, while its motors go from one
    /// configuration to the other, both rad of encoder; the maximum over its frames. Zero for a robot that the scene
    /// does not have.
    pub fn travel(&self, robot: usize, from: &[f64], to: &[f64]) -> f64 {
        let reach = self.bodies().reach.get(robot);
        let (Some(reach), Some(skeleton)) = (reach, self.skeletons().get(robot)) else {
            return 0.0;
        };
        let turned = |lever: &Lever| {
            let motor = lever.frame.checked_sub(1).and_then(|h| skeleton.joints.get(h)).map(|joint| joint.motor);
            let change = motor.and_then(|m| Some((to.get(m)? - from.get(m)?).abs()));
            lever.reach * change.unwrap_or_default()
        };
        reach.levers.iter().map(|levers| levers.iter().map(turned).sum()).fold(0.0, f64::max)
    }
}

impl Hinge {
    /// Speed bound of a point at distance `off_axis` (meters) from its axis, meters per radian of its motor.
    fn lever(&self, off_axis: f64) -> f64 {
        let arm = match self.motion {
            JointMotion::Turn => off_axis,
            JointMotion::Slide => 1.0,
        };
        arm * self.gain.abs()
    }
}

impl FrameReach {
    /// Computes the bounds. `colliders` are those of this robot, whose frames are numbered from `first_frame`.
    pub fn new(skeleton: &Skeleton, first_frame: usize, colliders: &[Collider]) -> Self {
        let levers = (0..skeleton.frames())
            .map(|f| {
                let Some(own) = f.checked_sub(1).and_then(|h| skeleton.joints.get(h)) else { return Vec::new() };
                // Greatest distance of the frame's points from its hinge's axis, and from its origin, meters.
                let mut off_axis = 0.0_f64;
                let mut rho = 0.0_f64;
                let off = |v: &Vector3<f64>, axis: &Vector3<f64>| (v - axis * v.dot(axis)).norm();
                for collider in colliders.iter().filter(|c| c.frame == first_frame + f) {
                    let c = collider.pose.translation.vector;
                    let capsule = collider.shape.bounding_capsule();
                    let ball_radius = collider.shape.bounding_radius();
                    let axis = collider.pose.rotation * capsule.half_axis;
                    let ends = [c + axis, c - axis];
                    // Capsule and ball both contain the shape, so the smaller of the two bounds holds, too.
                    let far = |v: f64, w: f64, ball: f64| (v.max(w) + capsule.radius).min(ball + ball_radius);
                    off_axis =
                        off_axis.max(far(off(&ends[0], &own.axis), off(&ends[1], &own.axis), off(&c, &own.axis)));
                    rho = rho.max(far(ends[0].norm(), ends[1].norm(), c.norm()));
                }
                for (_, at) in skeleton.frame.iter().zip(&skeleton.in_frame).filter(|(frame, _)| **frame == f) {
                    off_axis = off_axis.max(off(&at.translation.vector, &own.axis));
                    rho = rho.max(at.translation.vector.norm());
                }
                let mut list = vec![Lever { frame: f, reach: own.lever(off_axis) }];
                let mut at = f;
                loop {
                    let below = &skeleton.joints[at - 1];
                    let parent = below.parent;
                    if parent == 0 {
                        break list;
                    }
                    let hinge = &skeleton.joints[parent - 1];
                    let offsets = below.origins();
                    // The positions of the hinges between are arbitrary: the rest of the chain is a ball about its
                    // origin.
                    let arm = offsets.iter().map(|at| off(at, &hinge.axis)).fold(0.0, f64::max) + rho;
                    list.push(Lever { frame: parent, reach: hinge.lever(arm) });
                    rho += offsets.iter().map(Vector3::norm).fold(0.0, f64::max);
                    at = parent;
                }
            })
            .collect();
        let from_origin = |f: usize| {
            let own = colliders.iter().filter(|c| c.frame == first_frame + f);
            own.map(|c| c.pose.translation.vector.norm() + c.shape.bounding_radius()).fold(0.0, f64::max)
        };
        // Stretched out: each joint at its maximum distance from the one below.
        let mut outward = vec![0.0];
        for joint in &skeleton.joints {
            let arm = joint.origins().iter().map(Vector3::norm).fold(0.0, f64::max);
            outward.push(outward.get(joint.parent).copied().unwrap_or_default() + arm);
        }
        let radius = outward.iter().enumerate().map(|(f, out)| out + from_origin(f)).fold(0.0, f64::max);
        FrameReach { levers, radius }
    }

    /// Upper bound of the relative motion between the shapes of frame `a` and those of frame `b` of the same robot; `b
    /// = 0` is the base.
    ///
    /// # Arguments
    /// * `first_motor`: index of the robot's first motor among all motors of the scene.
    ///
    /// # Returns
    /// One term per motor between the two frames, in order of motors; empty for equal frames.
    pub fn between(&self, skeleton: &Skeleton, first_motor: usize, a: usize, b: usize) -> Terms {
        let mut sums = BTreeMap::<u32, f64>::new();
        for (one, other) in [(a, b), (b, a)] {
            // A hinge below both frames moves both alike.
            let shared: Vec<usize> = self.levers[other].iter().map(|l| l.frame).collect();
            for lever in self.levers[one].iter().filter(|l| !shared.contains(&l.frame)) {
                let motor = first_motor + skeleton.joints[lever.frame - 1].motor;
                *sums.entry(motor as u32).or_default() += lever.reach;
            }
        }
        sums.into_iter().map(|(motor, reach)| Term { motor, reach }).collect()
    }
}
