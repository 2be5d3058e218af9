//! A robot as a tree of Rerun entities: one level per joint, so that a frame is one number per moving joint and the
//! viewer does the kinematics.
//!
//! ```text
//! world/icub                      shapes that no joint moves
//! world/icub/torso_yaw            static: origin of the joint
//! world/icub/torso_yaw/turned     one rotation per frame, and the shapes that turn with it
//! world/icub/torso_yaw/turned/torso_roll/turned/...
//! world/tiago/lift/slid           one translation per frame, for a prismatic joint
//! ```

use crate::palette::{self, Rgba};
use crate::shapes::{DrawnSolid, Shapes, quaternion, vec3};
use crate::stream::{EntityStream, Written};
use mobee_contract::Time;
use mobee_model::{JointMotion, NodeKind, Robot, ShapeId};
use nalgebra::{Isometry3, Vector3};
use rerun::external::arrow::array::{Array as _, ArrayRef, FixedSizeListArray, Float32Array, StructArray};
use rerun::external::arrow::datatypes::{DataType, Field};
use rerun::{FillMode, SerializedComponentBatch, Transform3D};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::sync::Arc;

/// Change of a revolute joint's angle after which it is written again, rad (0.05 degrees).
const STEP: f64 = 0.05 * std::f64::consts::PI / 180.0;
/// The same for the position of a prismatic joint, meters.
const SLIDE_STEP: f64 = 5e-5;

/// Appearance of a robot.
pub(crate) struct Appearance<'a> {
    /// Fill mode of its shapes: opaque or transparent.
    pub(crate) fill: FillMode,
    /// Color of a node's shapes.
    pub(crate) color: &'a dyn Fn(&Robot, usize) -> Rgba,
    /// True if hulls are drawn, with only the outlines of the shapes that have one.
    pub(crate) hulls: bool,
    /// Nodes that carry more than their shapes, which must move with them.
    pub(crate) carrying: &'a BTreeSet<usize>,
}

impl Appearance<'_> {
    /// Appearance in the recording of a run: solid, with a color for each part.
    pub(crate) const RUN: Appearance<'static> = Appearance {
        fill: FillMode::Solid,
        color: &|robot, node| palette::part(robot.nodes.get(node).map_or(0, |n| n.part)),
        hulls: false,
        carrying: &BTreeSet::new(),
    };
}

/// Entities of a robot, and the joint positions that are still to be sent.
pub(crate) struct RobotEntities {
    joints: Vec<MovingJoint>,
    /// Frame of each node.
    pub(crate) seats: Vec<Seat>,
    /// Its shapes, to be colored.
    pub(crate) shapes: Shapes,
}

/// A joint that moves shapes.
struct MovingJoint {
    path: String,
    motion: JointMotion,
    /// Index into the robot's nodes.
    node: usize,
    axis: [f32; 3],
    /// The position that was written last, rad or meters.
    written: f64,
    times: Vec<i64>,
    positions: Vec<f32>,
}

/// Frame of a node: its entity, and its offset from the entity's origin.
#[derive(Clone)]
pub(crate) struct Seat {
    pub(crate) entity: String,
    /// `entity_from_node`: both have the root's orientation at the zero pose.
    pub(crate) offset: Vector3<f64>,
}

impl RobotEntities {
    /// Writes a robot's shapes and joints under `world/NAME`; `base` is `world_from_robot`.
    ///
    /// # Errors
    /// If Rerun refuses the data, as a message.
    pub(crate) fn new(
        stream: &EntityStream,
        robot: &Robot,
        base: &Isometry3<f64>,
        index: u16,
        look: &Appearance<'_>,
    ) -> Result<RobotEntities, String> {
        let root = format!("world/{}", entity_beside(&robot.name, &WORLD));
        let place = Transform3D::from_translation_rotation(vec3(&base.translation.vector), quaternion(&base.rotation));
        stream.log_static(&root, &place)?;
        let moved = moves_something(robot, look.carrying);
        let mut body = RobotEntities { joints: Vec::new(), seats: Vec::new(), shapes: Shapes::default() };
        // Frames for the children of each node, and the solids of each entity.
        let mut seats: Vec<Seat> = Vec::with_capacity(robot.nodes.len());
        let mut solids: Vec<(String, Vec<DrawnSolid<'_>>)> = Vec::new();
        let base = Seat { entity: root, offset: Vector3::zeros() };
        for (n, node) in robot.nodes.iter().enumerate() {
            let seat = node.parent.and_then(|p| seats.get(p)).unwrap_or(&base).clone();
            body.seats.push(seat.clone());
            for (s, primitive) in node.solids.iter().enumerate() {
                let solid = DrawnSolid {
                    id: ShapeId::Robot { robot: index, node: n as u16, shape: s as u16 },
                    primitive,
                    hull: node.hulls.get(&s).filter(|_| look.hulls).map(Arc::as_ref),
                    frame_from_node: Isometry3::translation(seat.offset.x, seat.offset.y, seat.offset.z),
                    color: (look.color)(robot, n),
                };
                match solids.iter_mut().find(|(entity, _)| *entity == seat.entity) {
                    Some((_, list)) => list.push(solid),
                    None => solids.push((seat.entity.clone(), vec![solid])),
                }
            }
            let next = match &node.kind {
                NodeKind::Link { offset } => Seat { offset: seat.offset + offset, ..seat },
                NodeKind::Joint { .. } if !moved.get(n).copied().unwrap_or(false) => seat,
                NodeKind::Joint { motion, axis, motor, .. } => {
                    let path = joint_path(&seat.entity, robot, *motor, n);
                    stream.log_static(&path, &Transform3D::from_translation(vec3(&seat.offset)))?;
                    let moved = match motion {
                        JointMotion::Turn => "turned",
                        JointMotion::Slide => "slid",
                    };
                    let path = format!("{path}/{moved}");
                    body.joints.push(MovingJoint {
                        path: path.clone(),
                        motion: *motion,
                        node: n,
                        axis: vec3(axis),
                        written: f64::NAN,
                        times: Vec::new(),
                        positions: Vec::new(),
                    });
                    Seat { entity: path, offset: Vector3::zeros() }
                }
            };
            seats.push(next);
        }
        for (entity, solids) in &solids {
            body.shapes.add(stream, entity, solids, look.fill)?;
        }
        Ok(body)
    }

    /// Takes a configuration: stores the positions that changed.
    pub(crate) fn pose(&mut self, at: Time, robot: &Robot, q: &[f64]) {
        for joint in &mut self.joints {
            let position = robot.joint_position(joint.node, q);
            let step = match joint.motion {
                JointMotion::Turn => STEP,
                JointMotion::Slide => SLIDE_STEP,
            };
            // NaN (nothing written yet) does not count as a small change.
            let small = (position - joint.written).abs() <= step;
            if !small && position.is_finite() {
                joint.written = position;
                joint.times.push(at.0 as i64);
                joint.positions.push(position as f32);
            }
        }
    }

    /// Sends the stored positions.
    pub(crate) fn flush(&mut self, stream: &EntityStream) -> Written {
        for joint in &mut self.joints {
            if joint.times.is_empty() {
                continue;
            }
            let positions = std::mem::take(&mut joint.positions);
            let column = match joint.motion {
                JointMotion::Turn => rotations(joint.axis, positions),
                JointMotion::Slide => translations(joint.axis, &positions),
            };
            let column = column.ok_or_else(|| crate::stream::in_words(&joint.path, &"its motions do not fit"))?;
            stream.columns(&joint.path, &std::mem::take(&mut joint.times), [column])?;
        }
        Ok(())
    }
}

/// Rotations about one axis as a column, built from flat buffers: the typed builders cost ten times as much.
fn rotations(axis: [f32; 3], angles: Vec<f32>) -> Option<rerun::SerializedComponentColumn> {
    let n = angles.len();
    let axes = Float32Array::from_iter_values(axis.iter().copied().cycle().take(3 * n));
    let item = Arc::new(Field::new("item", DataType::Float32, false));
    let axes = FixedSizeListArray::try_new(item, 3, Arc::new(axes), None).ok()?;
    let fields =
        vec![Field::new("axis", axes.data_type().clone(), false), Field::new("angle", DataType::Float32, false)];
    let columns: Vec<ArrayRef> = vec![Arc::new(axes), Arc::new(Float32Array::from(angles))];
    let array = StructArray::try_new(fields.into(), columns, None).ok()?;
    let batch = SerializedComponentBatch::new(Arc::new(array), Transform3D::descriptor_rotation_axis_angle());
    batch.partitioned(std::iter::repeat_n(1, n)).ok()
}

/// Translations along one axis as a column, like [`rotations`].
fn translations(axis: [f32; 3], ways: &[f32]) -> Option<rerun::SerializedComponentColumn> {
    let along = Float32Array::from_iter_values(ways.iter().flat_map(|way| axis.map(|a| a * way)));
    let item = Arc::new(Field::new("item", DataType::Float32, false));
    let along = FixedSizeListArray::try_new(item, 3, Arc::new(along), None).ok()?;
    let batch = SerializedComponentBatch::new(Arc::new(along), Transform3D::descriptor_translation());
    batch.partitioned(std::iter::repeat_n(1, ways.len())).ok()
}

/// True for each node whose subtree, without the node itself, has shapes or carries something.
fn moves_something(robot: &Robot, carrying: &BTreeSet<usize>) -> Vec<bool> {
    let mut moves = vec![false; robot.nodes.len()];
    for (n, node) in robot.nodes.iter().enumerate().rev() {
        let below = moves.get(n).copied().unwrap_or(false);
        if let Some(parent) = node.parent.and_then(|p| moves.get_mut(p)) {
            *parent |= below || !node.solids.is_empty() || carrying.contains(&n);
        }
    }
    moves
}

/// Names of the recorder's entities beside robots.
const WORLD: [&str; 8] = ["axis", "contacts", "eyes", "map", "near", "objects", "roadmap", "trails"];
/// Names of the recorder's entities beside joints.
const FRAME: [&str; 9] = [
    "boxes",
    "boxes_around_hulls",
    "capsules",
    "capsules_around_hulls",
    "cylinders",
    "cylinders_around_hulls",
    "hulls",
    "spheres",
    "spheres_around_hulls",
];

/// Entity of a joint: named after its motor, with a number if the motor drives several.
fn joint_path(parent: &str, robot: &Robot, motor: usize, node: usize) -> String {
    let Some(m) = robot.motors.get(motor) else { return format!("{parent}/..joint{node}") };
    let name = entity_beside(&m.name, &FRAME);
    match m.joints.iter().position(|j| *j == node) {
        Some(i) if m.joints.len() > 1 => format!("{parent}/{name}..{}", i + 1),
        _ => format!("{parent}/{name}"),
    }
}

/// A name as a part of an entity path that differs from the recorder's own names.
fn entity_beside(name: &str, words: &[&str]) -> String {
    if words.contains(&name) { format!("..{name}") } else { entity(name) }
}

/// A name as a part of an entity path. Different names give different entities: a character that Rerun would
/// read as syntax becomes its code between dots (a blank `..20.`), and so do all but the last of several dots
/// in a row.
pub(crate) fn entity(name: &str) -> String {
    if name.is_empty() {
        return "..unnamed".to_owned();
    }
    let mut out = String::with_capacity(name.len());
    let mut rest = name.chars().peekable();
    while let Some(c) = rest.next() {
        let fits = c.is_alphanumeric() || matches!(c, '_' | '-') || (c == '.' && rest.peek() != Some(&'.'));
        if fits {
            out.push(c);
        } else {
            let _ = write!(out, "..{:X}.", u32::from(c));
        }
    }
    out
}

/// A name with slashes as a path of entities.
pub(crate) fn entities(name: &str) -> String {
    name.split('/').map(entity).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::parse_robot;
    use proptest::prelude::*;

    proptest! {
        /// The name can be reconstructed from the entity, so no two names share one.
        #[test]
        fn names_that_differ_are_entities_that_differ(name in "[ab._/ :é-]{1,9}") {
            let encoded = entity(&name);
            let strict = rerun::EntityPath::parse_strict(&encoded).unwrap();
            prop_assert!(strict.len() == 1 && strict.to_string() == format!("/{encoded}"), "{strict}");
            let mut decoded = String::new();
            let mut rest = encoded.as_str();
            while let Some(c) = rest.chars().next() {
                let escape = rest.strip_prefix("..").and_then(|r| r.split_once('.'));
                let code = escape.and_then(|(hex, after)| Some((u32::from_str_radix(hex, 16).ok()?, after)));
                let (c, after) = match code.and_then(|(code, after)| Some((char::from_u32(code)?, after))) {
                    Some(escaped) => escaped,
                    None => (c, &rest[c.len_utf8()..]),
                };
                decoded.push(c);
                rest = after;
            }
            prop_assert_eq!(decoded, name);
        }
    }

    #[test]
    fn links_whose_joints_have_similar_names_are_all_drawn() {
        let joint = |name: &str| {
            format!("<motor name=\"{name}\"><joint z=\"1\"><link x=\"0.1\" radius=\"0.02\"/></joint></motor>")
        };
        let twice = "<motor name=\"two\"><joint z=\"1\"><link x=\"0.1\" radius=\"0.02\"/></joint>\
                     <joint z=\"1\"><link x=\"0.1\" radius=\"0.02\"/></joint></motor>";
        let names = ["a/b", "a_b", "a b", "a.b", "a..b", "two_1", "two.1", "cylinders", "hulls", "turned"];
        let joints: String = names.map(joint).concat() + twice;
        let text = format!(
            "<ZeroPositionKinematicTree robotName=\"objects\"><bodypart name=\"all\"><link z=\"0.1\" radius=\"0.01\">\
             {joints}</link></bodypart></ZeroPositionKinematicTree>"
        );
        let robot = parse_robot("r.xml", &text).unwrap().value;
        let rec = rerun::RecordingStreamBuilder::new("test").memory().unwrap().0;
        let stream = EntityStream { rec, root: String::new() };
        let body = RobotEntities::new(&stream, &robot, &Isometry3::identity(), 0, &Appearance::RUN).unwrap();
        let mut seats: Vec<_> =
            body.seats.iter().map(|s| s.entity.as_str()).filter(|e| e.ends_with("turned")).collect();
        assert!(seats.iter().all(|e| !e.starts_with("world/objects/") && !e.contains("/cylinders/")), "{seats:?}");
        seats.sort_unstable();
        seats.dedup();
        assert_eq!(seats.len(), names.len() + 2, "{seats:?}");
    }

    #[test]
    fn a_node_sits_where_its_shapes_are_and_not_where_its_children_begin() {
        let text = r#"<ZeroPositionKinematicTree version="1.0" robotName="r"><bodypart name="all">
            <link z="0.4" radius="0.03"><motor name="turn"><joint z="1">
            <link x="0.1" radius="0.02"><link x="0.3" radius="0.02"/></link></joint></motor></link>
            </bodypart></ZeroPositionKinematicTree>"#;
        let robot = parse_robot("r.xml", text).unwrap().value;
        let rec = rerun::RecordingStreamBuilder::new("test").memory().unwrap().0;
        let stream = EntityStream { rec, root: String::new() };
        let body = RobotEntities::new(&stream, &robot, &Isometry3::identity(), 0, &Appearance::RUN).unwrap();
        let seats: Vec<_> = body.seats.iter().map(|s| (s.entity.as_str(), s.offset)).collect();
        let turned = "world/r/turn/turned";
        let column = ("world/r", Vector3::zeros());
        let joint = ("world/r", Vector3::z() * 0.4);
        assert_eq!(seats, [column, joint, (turned, Vector3::zeros()), (turned, Vector3::x() * 0.1)]);
    }
}
