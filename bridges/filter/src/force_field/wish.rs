//! Requests to a force field, and the conversion of forces at a marker to joint forces.

use mobee_model::{JointMotion, NodeKind, Robot};
use nalgebra::Vector3;

/// A request to a part's force field.
#[derive(Clone, Debug, PartialEq)]
pub enum Wish {
    /// Attractor, as shares of each joint's range, 0 to 1. Missing values are unchanged.
    Attractor(Vec<f64>),
    /// Force per joint, until it is replaced.
    Force(Vec<f64>),
    /// Force and torque at a marker, world frame.
    Wrench {
        /// Name of the marker.
        marker: String,
        /// The force.
        force: [f64; 3],
        /// The torque.
        torque: [f64; 3],
    },
}

/// Multiplies the transposed Jacobian at a marker by a force and a torque, which gives a force for each motor
/// of the part (`q`: configuration of the robot, rad). The chain ends at the part's root motor; a motor of
/// several joints gets each joint's share. (The original used the k-th joint of the chain for the k-th motor,
/// which is wrong for the torso.)
pub(super) fn joint_forces(
    robot: &Robot,
    part: usize,
    q: &[f64],
    marker: &str,
    force: &Vector3<f64>,
    torque: &Vector3<f64>,
) -> Result<Vec<f64>, String> {
    let motors = robot.parts.get(part).map(|p| p.motors.clone()).unwrap_or_default();
    let node = robot.marker(marker).map(|m| m.node).ok_or_else(|| format!("there is no marker {marker}"))?;
    let mut frames = Vec::with_capacity(robot.nodes.len());
    robot.forward(q, &mut frames);
    let here = frames.get(node).map(|f| f.translation.vector).unwrap_or_default();
    let mut forces = vec![0.0; motors.len()];
    let mut walk = Some(node);
    while let Some(at) = walk {
        let Some((node, frame)) = robot.nodes.get(at).zip(frames.get(at)) else { break };
        walk = node.parent;
        let NodeKind::Joint { motion, axis, motor, min, max, .. } = &node.kind else { continue };
        let Some(m) = robot.motors.get(*motor) else { continue };
        let axis = frame.rotation * **axis;
        let felt = match motion {
            JointMotion::Turn => axis.cross(&(here - frame.translation.vector)).dot(force) + axis.dot(torque),
            JointMotion::Slide => axis.dot(force),
        };
        let share = if m.max > m.min { (max - min) / (m.max - m.min) } else { 0.0 };
        if let Some(slot) = motor.checked_sub(motors.start).and_then(|i| forces.get_mut(i)) {
            *slot += share * felt;
        }
        if m.is_part_root {
            break;
        }
    }
    Ok(forces)
}
