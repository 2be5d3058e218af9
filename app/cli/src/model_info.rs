//! `mobee model info`: an overview of a robot file.

use miette::Report;
use mobee_model::{Shape, load_robot};
use std::fmt::Write;
use std::path::Path;

/// Parts, motors, markers and shapes of a robot file.
///
/// # Errors
/// If the file can't be read, with its place and remedy.
pub fn text(path: &Path) -> Result<String, Report> {
    let loaded = load_robot(path)?;
    let robot = &loaded.value;
    let solids = || robot.nodes.iter().flat_map(|n| &n.solids);
    let count = |of: fn(&Shape) -> bool| solids().filter(|p| of(&p.shape)).count();
    let mut out = String::new();
    let _ = writeln!(
        out,
        "{}: {} parts, {} motors, {} nodes, {} markers\nsolid shapes: {} ({} spheres, {} capsules, {} cylinders, {} boxes), field shapes: {}",
        robot.name,
        robot.parts.len(),
        robot.motors.len(),
        robot.nodes.len(),
        robot.markers.len(),
        solids().count(),
        count(|s| matches!(s, Shape::Sphere { .. })),
        count(|s| matches!(s, Shape::Capsule { .. })),
        count(|s| matches!(s, Shape::Cylinder { .. })),
        count(|s| matches!(s, Shape::Box { .. })),
        robot.nodes.iter().map(|n| n.fields.len()).sum::<usize>(),
    );
    let hulls: Vec<usize> = robot.nodes.iter().flat_map(|n| n.hulls.values().map(|hull| hull.points().len())).collect();
    if !hulls.is_empty() {
        let _ = writeln!(
            out,
            "of these with hulls, which are what touches: {} ({} points)",
            hulls.len(),
            hulls.iter().sum::<usize>()
        );
    }
    let _ = writeln!(
        out,
        "node pairs: {} reflex, {} shown only, {} field",
        robot.pairs.reflex.len(),
        robot.pairs.visual_only.len(),
        robot.pairs.field.len()
    );
    if let Some(left_out) = &robot.left_out {
        let name = |n: usize| robot.nodes.get(n).and_then(|n| n.name.as_deref()).unwrap_or("?");
        let _ = writeln!(out, "pairs left out: {}", left_out.len());
        for pair in left_out {
            let _ = writeln!(out, "  {} and {}: {}", name(pair.nodes.0), name(pair.nodes.1), pair.reason);
        }
    }
    if !robot.near.is_empty() {
        let name = |n: usize| robot.nodes.get(n).and_then(|n| n.name.as_deref()).unwrap_or("?");
        let _ = writeln!(out, "pairs with a clearance of their own: {}", robot.near.len());
        for pair in &robot.near {
            let mm = pair.clearance * 1e3;
            let _ = writeln!(out, "  {} and {}: {mm:.1} mm, {}", name(pair.nodes.0), name(pair.nodes.1), pair.reason);
        }
    }
    for (i, part) in robot.parts.iter().enumerate() {
        let _ = writeln!(out, "\n{} ({} constraint clauses)", part.name, part.clauses.len());
        for m in robot.motors.get(part.motors.clone()).unwrap_or_default() {
            let _ = writeln!(
                out,
                "  {:20} {:8.2} to {:8.2} {}, home {:7.2}, joints {}{}{}",
                m.name,
                m.min.to_degrees(),
                m.max.to_degrees(),
                m.motion.unit(),
                m.home.to_degrees(),
                m.joints.len(),
                if m.continuous { ", without end" } else { "" },
                m.max_speed
                    .map(|v| format!(", at most {:.2} {}/s", v.to_degrees(), m.motion.unit()))
                    .unwrap_or_default()
            );
        }
        let markers: Vec<&str> = robot.markers.iter().filter(|m| m.part == i).map(|m| m.name.as_str()).collect();
        if !markers.is_empty() {
            let _ = writeln!(out, "  markers: {}", markers.join(", "));
        }
    }
    for w in &loaded.warnings {
        let _ = writeln!(out, "\nwarning: {w}");
    }
    Ok(out)
}
