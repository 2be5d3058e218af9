//! Labels of shapes for display, without node numbers, which nobody could locate on a robot.
//!
//! The name of a shape in journals, map files and tables ([`Scene::shape_name`]) is stable and exact. A label is its
//! readable form:
//!
//! | the shape belongs to | label |
//! |---|---|
//! | a node with a name (all links of a converted robot) | `ur5e forearm_link` |
//! | a rigid body with such a node or a marker above it | `icub right_arm: r_hand` |
//! | a rigid body behind a joint | `icub right_arm: behind r_elbow` |
//! | a part that no joint moves | `icub torso: base` |
//! | an object | `ball` |

use super::{Scene, ShapeId};
use crate::robot::{NodeKind, Robot};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Maximum length of a stable name in a text, bytes.
const MAX_NAME_BYTES: usize = 512;

impl Scene {
    /// A shape's label for display, such as `icub right_arm: behind r_elbow`; all shapes of one rigid body have the
    /// same label.
    ///
    /// # Examples
    /// ```
    /// # use mobee_model::*;
    /// let xml = r#"<ZeroPositionKinematicTree robotName="arm"><bodypart name="arm"><link z="0.2">
    ///   <motor name="elbow"><joint z="1"><link x="0.3" radius="0.03"/></joint></motor>
    /// </link></bodypart></ZeroPositionKinematicTree>"#;
    /// let robot = parse_robot("arm.xml", xml).unwrap().value;
    /// let scene = Scene::new(vec![(robot.into(), nalgebra::Isometry3::identity())], Vec::new()).unwrap();
    /// let shape = ShapeId::Robot { robot: 0, node: 2, shape: 0 };
    /// assert_eq!(scene.shape_name(shape), "arm:arm/2#0");
    /// assert_eq!(scene.label(shape), "arm arm: behind elbow");
    /// ```
    pub fn label(&self, id: ShapeId) -> String {
        let robot = |robot: u16| self.robots().get(usize::from(robot));
        match id {
            ShapeId::Robot { robot: index, node, .. } => {
                robot(index).map_or_else(|| self.shape_name(id), |owner| owner.label(usize::from(node)))
            }
            ShapeId::Object { object, .. } => {
                let found = self.objects().find(|(o, _)| *o == object);
                found.map_or_else(|| self.shape_name(id), |(_, o)| o.name.clone())
            }
        }
    }
}

impl Robot {
    /// The label of a node's shapes: see [`Scene::label`].
    pub fn label(&self, node: usize) -> String {
        label(self, node)
    }
}

fn label(robot: &Robot, node: usize) -> String {
    let name = &robot.name;
    let Some(own) = robot.nodes.get(node) else { return format!("{name}: node {node}") };
    if let Some(link) = &own.name {
        return format!("{name} {link}");
    }
    let part = robot.parts.get(own.part).map_or("?", |part| part.name.as_str());
    // A joint's own shapes don't move with it: they belong to the body before it.
    let mut at = Some(node);
    while let Some(node) = at {
        let Some(here) = robot.nodes.get(node) else { break };
        if let Some(marker) = robot.markers.iter().find(|marker| marker.node == node) {
            return format!("{name} {part}: {}", marker.name);
        }
        if let Some(link) = &here.name {
            return format!("{name} {part}: {link}");
        }
        at = here.parent;
        let joint = at.and_then(|parent| robot.nodes.get(parent)).map(|parent| &parent.kind);
        if let Some(NodeKind::Joint { motor, .. }) = joint {
            let motor = robot.motors.get(*motor).map_or("?", |motor| motor.name.as_str());
            return format!("{name} {part}: behind {motor}");
        }
    }
    format!("{name} {part}: base")
}

/// Replaces stable names of shapes in a text by their labels, for the display of journals.
#[derive(Clone, Debug, Default)]
pub struct Labels(BTreeMap<String, String>);

impl Labels {
    /// Labels of all shapes of these robots.
    pub fn new(robots: &[Arc<Robot>]) -> Labels {
        let mut labels = BTreeMap::new();
        for robot in robots {
            for (i, node) in robot.nodes.iter().enumerate() {
                let part = robot.parts.get(node.part).map_or("?", |part| part.name.as_str());
                let stable = match &node.name {
                    Some(link) => format!("{}:{link}", robot.name),
                    None => format!("{}:{part}/{i}", robot.name),
                };
                labels.insert(stable, label(robot, i));
            }
        }
        Labels(labels)
    }

    /// The text with each `NAME#NUMBER` replaced: a robot's shape by its label, an object's by the object's name.
    pub fn read<'a>(&self, text: &'a str) -> Cow<'a, str> {
        if !text.contains('#') {
            return Cow::Borrowed(text);
        }
        let mut out = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(at) = rest.find('#') {
            let before = &rest[..at];
            let after = &rest[at + 1..];
            let digits = after.len() - after.trim_start_matches(|c: char| c.is_ascii_digit()).len();
            let ends = !after[digits..].starts_with(|c: char| c.is_alphanumeric() || c == '_');
            match self.known(before).filter(|_| digits > 0 && ends) {
                Some((start, label)) => {
                    out.push_str(&before[..start]);
                    out.push_str(label);
                }
                None if digits > 0 && ends && before.ends_with(|c: char| c.is_alphanumeric() || c == '_') => {
                    out.push_str(before);
                }
                None => {
                    out.push_str(&rest[..=at + digits]);
                }
            }
            rest = &after[digits..];
        }
        out.push_str(rest);
        Cow::Owned(out)
    }

    /// The start of the longest stable name at the end of this text, and its label.
    fn known(&self, before: &str) -> Option<(usize, &str)> {
        let from = before.len().saturating_sub(MAX_NAME_BYTES);
        let starts = before.char_indices().map(|(i, _)| i).filter(|i| *i >= from);
        starts.filter_map(|i| Some((i, self.0.get(&before[i..])?.as_str()))).next()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse_robot;

    const ARM: &str = r#"<ZeroPositionKinematicTree robotName="r 2"><bodypart name="arm"><link z="0.2" radius="0.03">
      <motor name="pan"><joint z="1" length="0.1" radius="0.02"><link x="0.3" radius="0.03"><link x="0.1" radius="0.02">
      <motor name="wrist"><joint z="1"><link x="0.1"><marker name="hand"/><sphere radius="0.1"/>
        <link x="0.1" radius="0.01"/></link><link name="tool" x="0.1" radius="0.02"/></joint></motor>
      </link></link></joint></motor></link></bodypart></ZeroPositionKinematicTree>"#;

    #[test]
    fn every_shape_has_a_label_without_numbers() {
        let robot = Arc::new(parse_robot("r.xml", ARM).unwrap().value);
        let labels: Vec<String> = (0..robot.nodes.len()).map(|node| label(&robot, node)).collect();
        let expected = [
            "r 2 arm: base",
            "r 2 arm: base",
            "r 2 arm: behind pan",
            "r 2 arm: behind pan",
            "r 2 arm: behind pan",
            "r 2 arm: hand",
            "r 2 arm: hand",
            "r 2 tool",
        ];
        assert_eq!(labels, expected);
    }

    #[test]
    fn stable_names_in_a_text_become_labels_and_nothing_else_is_touched() {
        let robot = Arc::new(parse_robot("r.xml", ARM).unwrap().value);
        let labels = Labels::new(&[robot]);
        for (text, read) in [
            ("r 2:arm/3#0 and ball#12 at 3.1 mm", "r 2 arm: behind pan and ball at 3.1 mm"),
            ("(r 2:tool#1, r 2:arm/5#0)", "(r 2 tool, r 2 arm: hand)"),
            ("#12 rolled back; commit #3: x", "#12 rolled back; commit #3: x"),
            ("r 2:arm/30#0x, a#b, #, c#", "r 2:arm/30#0x, a#b, #, c#"),
            ("no names: é", "no names: é"),
            ("é#1 üb#", "é üb#"),
        ] {
            assert_eq!(labels.read(text), read);
        }
    }
}
