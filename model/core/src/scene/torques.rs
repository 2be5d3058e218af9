//! Mapping of forces on points of a robot to motor torques, by the transposed Jacobian.

use super::{Scene, ShapeId, Skeleton};
use crate::engine::Engine;
use crate::{Contact, JointMotion};
use nalgebra::{Isometry3, Point3, Vector3};

impl Skeleton {
    /// Adds the torques due to a force on a point of a node to all motors of the node's chain.
    ///
    /// # Arguments
    /// * `frames`: `world_from_frame` of this robot, from [`Skeleton::place`].
    /// * `point`: point of application, m, world frame.
    /// * `force`: N, world frame.
    /// * `torques`: per motor, N m per radian of encoder: force times displacement, for prismatic joints, too.
    pub fn add_torques(
        &self,
        frames: &[Isometry3<f64>],
        node: usize,
        point: &Point3<f64>,
        force: &Vector3<f64>,
        torques: &mut [f64],
    ) {
        let mut frame = self.frame.get(node).copied().unwrap_or(0);
        // Down the chain to the base: each revolute joint by its lever, each prismatic joint along its axis.
        while let Some(hinge) = frame.checked_sub(1).and_then(|f| self.joints.get(f)) {
            let Some(world) = frames.get(frame) else { return };
            let axis = world.rotation * *hinge.axis;
            let direction = match hinge.motion {
                JointMotion::Turn => axis.cross(&(point.coords - world.translation.vector)),
                JointMotion::Slide => axis,
            };
            if let Some(torque) = torques.get_mut(hinge.motor) {
                *torque += hinge.gain * direction.dot(force);
            }
            frame = hinge.parent;
        }
    }
}

impl<E: Engine> Scene<E> {
    /// Gradient of a contact's distance with respect to the motors of one robot: m per radian of encoder.
    ///
    /// # Arguments
    /// * `frames`: `world_from_frame` of that robot, from [`Skeleton::place`].
    ///
    /// # Returns
    /// One number per motor. Zeros if the two shapes just touch, since there is no direction, and for a contact of
    /// other robots.
    pub fn distance_gradient(&self, robot: usize, contact: &Contact, frames: &[Isometry3<f64>]) -> Vec<f64> {
        let motors = self.robots().get(robot).map_or(0, |r| r.motors.len());
        let mut gradient = vec![0.0; motors];
        let apart = contact.points[1] - contact.points[0];
        let (Some(skeleton), true) = (self.skeletons().get(robot), contact.distance.abs() > 1e-9) else {
            return gradient;
        };
        // From the first shape to the second if they are apart, reversed if they overlap.
        let normal = apart / contact.distance;
        for (shape, point, direction) in
            [(contact.pair.0, contact.points[0], -normal), (contact.pair.1, contact.points[1], normal)]
        {
            if let ShapeId::Robot { robot: owner, node, .. } = shape
                && usize::from(owner) == robot
            {
                skeleton.add_torques(frames, usize::from(node), &point, &direction, &mut gradient);
            }
        }
        gradient
    }
}

#[cfg(test)]
mod tests {
    use crate::{Scene, load_robot, load_world};
    use std::path::Path;
    use std::sync::Arc;

    /// The gradient equals the difference quotient of the distance, for every motor of an arm near an obstacle.
    #[test]
    fn the_gradient_is_the_slope_of_the_distance() {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let robot = Arc::new(load_robot(configs.join("robots/icub.xml")).unwrap().value);
        let world = load_world(configs.join("worlds/ball.xml")).unwrap().value;
        let scene: Scene = Scene::new(vec![(robot.clone(), nalgebra::Isometry3::identity())], world).unwrap();
        let q = robot.home();
        let contact = scene.contacts(&[&q], 1.0).into_iter().find(|c| c.pair.1.robot().is_none()).unwrap();
        let mut frames = Vec::new();
        scene.skeletons()[0].place(&q, &mut frames);
        let gradient = scene.distance_gradient(0, &contact, &frames);
        let distance =
            |q: &[f64]| scene.contacts(&[q], 1.0).into_iter().find(|c| c.pair == contact.pair).unwrap().distance;
        let step = 1e-5;
        let mut moved = 0;
        for motor in 0..q.len() {
            let at = |by: f64| {
                let mut q = q.clone();
                q[motor] += by;
                distance(&q)
            };
            let slope = (at(step) - at(-step)) / (2.0 * step);
            assert!((slope - gradient[motor]).abs() < 1e-4, "{motor}: {slope} and {}", gradient[motor]);
            moved += usize::from(slope.abs() > 1e-3);
        }
        assert!(moved > 0, "no motor moves that shape");
    }
}
