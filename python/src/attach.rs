//! Objects that a robot carries, such as a cup in its gripper: as nodes of its model. No Python here.

use mobee_model::{LeftOut, Node, NodeKind, Primitive, Robot};
use nalgebra::Vector3;
use std::sync::Arc;

/// Reason of the disabled pairs of an attached object and what may touch it.
const REASON: &str = "attached";

/// Attaches an object to the rigid body of a node, as a node of its own behind all others.
///
/// From then on it moves with that node, and is tested against the world, other robots, and all shapes of the robot that can move relative
/// to it.
///
/// # Arguments
/// * `name`: a name that no node has.
/// * `node`: an index into `Robot::nodes`.
/// * `solids`: its shapes, in the frame of that node.
/// * `touch`: nodes of the robot that it may touch.
pub(crate) fn attach(robot: &mut Robot, name: &str, node: usize, solids: Vec<Primitive>, touch: &[usize]) {
    let new = robot.nodes.len();
    let Some(carrier) = robot.nodes.get(node) else { return };
    // a sibling: the frame of a node is the one before its own motion
    let attached = Node {
        name: Some(Arc::from(name)),
        parent: carrier.parent,
        part: carrier.part,
        kind: NodeKind::Link { offset: Vector3::zeros() },
        solids,
        hulls: Default::default(),
        fields: Vec::new(),
        color: None,
        no_self_collision: false,
        near_root: carrier.near_root,
    };
    robot.nodes.push(attached);
    if robot.left_out.is_some() {
        let pair = |other: &usize| LeftOut { nodes: (*other, new), reason: REASON.to_owned() };
        robot.leave_out(touch.iter().map(pair));
        // pairs with nodes that have no name can't be listed
        robot.pairs.reflex.retain(|(a, b)| *b != new || !touch.contains(a));
        return;
    }
    // the filter of the format is for links, which overlap their neighbors by construction; an object does not
    let quiet = quiet_root(robot, new);
    for other in 0..new {
        let has_shape = robot.nodes.get(other).is_some_and(|of| !of.solids.is_empty());
        if has_shape && !touch.contains(&other) && robot.moves(other, new) {
            let is_quiet = quiet.is_some() && quiet == quiet_root(robot, other);
            let list = if is_quiet { &mut robot.pairs.visual_only } else { &mut robot.pairs.reflex };
            list.push((other, new));
        }
    }
    robot.pairs.reflex.sort_unstable();
    robot.pairs.visual_only.sort_unstable();
}

/// The outermost node at or above this one whose subtree is not tested against itself.
fn quiet_root(robot: &Robot, node: usize) -> Option<usize> {
    let above = |n: &usize| robot.nodes.get(*n)?.parent;
    let quiet = |n: &usize| robot.nodes.get(*n).is_some_and(|of| of.no_self_collision);
    std::iter::successors(Some(node), above).filter(quiet).last()
}
