//! `grab`: objects that follow a marker until they are released.
//!
//! An obstacle in the hand touches the hand: change it to a target or a ghost (`def`) before grabbing it, or
//! the reflex acts.

use super::{ObjectReply, WorldRefusal, WorldView};
use mobee_model::{Edit, Object};
use nalgebra::Isometry3;
use std::collections::BTreeMap;

/// Distance and angle (m, rad) below which an object is not moved, so that a robot at rest makes no edits.
const MOVE_THRESHOLD: (f64, f64) = (0.000_5, 0.005);

/// Grabbed objects, by name.
#[derive(Clone, Debug, Default)]
pub(super) struct Grabs(BTreeMap<String, Grab>);

#[derive(Clone, Debug)]
struct Grab {
    robot: usize,
    node: usize,
    node_from_object: Isometry3<f64>,
}

impl Grabs {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn release(&mut self, object: &str) {
        self.0.remove(object);
    }

    pub(super) fn grab(
        &mut self,
        object: &Object,
        robot: &str,
        marker: &str,
        view: &WorldView,
    ) -> Result<ObjectReply, WorldRefusal> {
        let robot = view.scene.robots().iter().position(|r| r.name == robot).ok_or(WorldRefusal::NoRobot)?;
        let node = view.scene.robots().get(robot).and_then(|r| r.marker(marker)).map(|m| m.node);
        let frame = node.and_then(|node| Some((node, world_from_node(robot, node, view)?)));
        match frame {
            Some((node, frame)) => {
                let grab = Grab { robot, node, node_from_object: frame.inverse() * object.pose };
                self.0.insert(object.name.clone(), grab);
                Ok(ObjectReply::Grabbed)
            }
            None => {
                self.0.remove(&object.name);
                Ok(ObjectReply::Released)
            }
        }
    }

    /// Updates grabs of objects that were moved: they follow from their new pose.
    pub(super) fn regrip(&mut self, edits: &[Edit], view: &WorldView) {
        for edit in edits {
            if let Edit::Move { name, pose } = edit
                && let Some(grab) = self.0.get_mut(name)
                && let Some(frame) = world_from_node(grab.robot, grab.node, view)
            {
                grab.node_from_object = frame.inverse() * pose;
            }
        }
    }

    pub(super) fn follow(&mut self, view: &WorldView) -> Vec<Edit> {
        self.0.retain(|name, _| view.scene.object(name).is_some());
        let edit = |(name, grab): (&String, &Grab)| {
            let (_, object) = view.scene.object(name)?;
            let pose = world_from_node(grab.robot, grab.node, view)? * grab.node_from_object;
            let off = (pose.translation.vector - object.pose.translation.vector).norm();
            let turned = pose.rotation.angle_to(&object.pose.rotation);
            // NaN moves nothing
            (off > MOVE_THRESHOLD.0 || turned > MOVE_THRESHOLD.1).then(|| Edit::Move { name: name.clone(), pose })
        };
        self.0.iter().filter_map(edit).collect()
    }
}

/// Frame of a robot's node in the world; `None` if there is no such robot or node.
fn world_from_node(robot: usize, node: usize, view: &WorldView) -> Option<Isometry3<f64>> {
    let model = view.scene.robots().get(robot)?;
    let mut frames = Vec::with_capacity(model.nodes.len());
    model.forward_from(&view.scene.base(robot), view.poses.get(robot).map_or(&[], |q| q), &mut frames);
    frames.get(node).copied()
}
