//! Texts beside the views, in Markdown.

use super::sweep::in_units;
use super::{NearLinks, SeenModel};
use mobee_model::{Contact, Robot, ShapeId};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Legend of the views.
pub(super) const LEGEND: &str = "\
# What you see

The robot at home, then each motor in turn through its range while the others stay at home.

- colored, see-through: the **shapes** that the program tests, a color for each link; where only the outlines of a shape are drawn,
  the **hull** within it is what touches, and the shape is what is looked at first
- gray: the **meshes** of the URDF, if it was given; no mesh may stick out of the shapes, and no shape far out of its mesh
- yellow arrow: the **axis** of the motor that moves; it turns about it, or slides along it
- **red**: two shapes that are nearer to each other than the reflex's margin, with a line between the nearest points;
  **magenta**: they touch

A robot is right if it moves as it should, if red comes up only where links could really hit each other, and if every pair that is
left out may be.
";

/// Name of a link, or its place in the robot if it has none.
pub(super) fn link(robot: &Robot, node: usize) -> String {
    let Some(of) = robot.nodes.get(node) else { return format!("node {node}") };
    let part = || robot.parts.get(of.part).map_or("?", |p| p.name.as_str());
    of.name.as_deref().map_or_else(|| format!("{}/{node}", part()), str::to_owned)
}

/// Nodes of a robot's contact with itself.
pub(super) fn nodes(contact: &Contact) -> Option<(usize, usize)> {
    let node = |id| match id {
        ShapeId::Robot { node, .. } => Some(usize::from(node)),
        ShapeId::Object { .. } => None,
    };
    Some((node(contact.pair.0)?, node(contact.pair.1)?))
}

/// Formats a distance, such as `3.2 mm` or `1.4 mm deep`.
pub(super) fn distance(meters: f64) -> String {
    let mm = meters * 1e3;
    if mm < 0.0 { format!("{:.1} mm deep", -mm) } else { format!("{mm:.1} mm") }
}

/// The moving motor with its position, and the pairs that are near now.
pub(super) fn now(robot: &Robot, moving: Option<(usize, f64)>, contacts: &[Contact]) -> String {
    let mut out = String::new();
    match moving.and_then(|(m, q)| Some((robot.motors.get(m)?, m, q))) {
        None => out += "# home\n\nall motors at home\n\n",
        Some((motor, m, q)) => {
            let (min, max) = motor.range();
            let [min, max, home] = [min, max, motor.home].map(|v| in_units(motor, v));
            let _ = writeln!(out, "# {}\n\n# {}\n", escaped(&motor.name), in_units(motor, q));
            let _ = writeln!(out, "motor {} of {}, from {min} to {max}, home {home}\n", m + 1, robot.motors.len());
        }
    }
    let mut nearest: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    for contact in contacts {
        let Some(pair) = nodes(contact) else { continue };
        let least = nearest.entry(pair).or_insert(contact.distance);
        *least = least.min(contact.distance);
    }
    if nearest.is_empty() {
        return out + "nothing is near\n";
    }
    for ((a, b), d) in nearest {
        let [a, b] = [a, b].map(|n| escaped(&link(robot, n)));
        let _ = writeln!(out, "- **{a}** and **{b}**: {}", distance(d));
    }
    out
}

/// Pairs that got near in the whole sweep, the deepest first.
pub(super) fn near(robot: &Robot, seen: &SeenModel, margin: f64) -> String {
    let mm = margin * 1e3;
    let mut out = format!("# What comes near\n\nPairs of links nearer than the margin of {mm} mm.\n\n");
    if seen.near.is_empty() {
        return out + "None, at home or while one motor moves.\n";
    }
    out += "| links | how near | while |\n|---|---|---|\n";
    for NearLinks { links: (a, b), distance: d, motor } in &seen.near {
        let when = match motor.and_then(|(m, q)| Some((robot.motors.get(m)?, q))) {
            None => "at home".to_owned(),
            Some((motor, q)) => format!("{} {}", escaped(&motor.name), in_units(motor, q)),
        };
        let _ = writeln!(out, "| {} - {} | {} | {when} |", escaped(a), escaped(b), distance(*d));
    }
    out
}

/// Disabled pairs and those with a clearance of their own, with their reasons.
pub(super) fn left_out(robot: &Robot) -> String {
    let tested = robot.pairs.reflex.len();
    let mut out = format!("# Pairs left out\n\n{tested} pairs of links are tested. ");
    let Some(list) = &robot.left_out else {
        return out + "The file lists none that are not: neighbors are left out by the filter of the format.\n";
    };
    let _ = writeln!(out, "These {} are not; remove a `leaveOut` from the file to have its pair tested.\n", list.len());
    out += "| links | reason |\n|---|---|\n";
    let mut list: Vec<_> = list.iter().collect();
    // Neighbors are many, and the least surprising.
    list.sort_by_key(|l| (l.reason.starts_with("neighbors"), l.nodes));
    for l in list {
        let [a, b] = [l.nodes.0, l.nodes.1].map(|n| escaped(&link(robot, n)));
        let _ = writeln!(out, "| {a} - {b} | {} |", escaped(&l.reason));
    }
    if !robot.near.is_empty() {
        out += "\n# Pairs with a clearance of their own\n\n| links | mm | reason |\n|---|---|---|\n";
    }
    for near in &robot.near {
        let [a, b] = [near.nodes.0, near.nodes.1].map(|n| escaped(&link(robot, n)));
        let _ = writeln!(out, "| {a} - {b} | {:.1} | {} |", near.clearance * 1e3, escaped(&near.reason));
    }
    out
}

/// Escapes all Markdown syntax in a text.
fn escaped(text: &str) -> String {
    let special = |c: char| c.is_ascii_punctuation() && !matches!(c, '-' | ',' | '.' | ':' | '(' | ')' | '/');
    text.chars().flat_map(|c| special(c).then_some('\\').into_iter().chain([c])).collect()
}
