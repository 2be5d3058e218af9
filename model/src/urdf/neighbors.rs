//! Balls on joints, so that the format tells neighbors from others.
//!
//! The adjacency filter of ZRP leaves out a whole chain of one part, unless a *solid joint* lies between. So each moving joint gets a
//! tiny ball inside the body before it, at a place that none of that body's own neighbors (which must not be tested against it)
//! comes near. Where there is no such place there is no ball, and the filter spares one body more.

use crate::{NodeKind, Primitive, Robot, Shape, distance};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Radius of the ball, meters.
const RADIUS: f64 = 1e-4;
/// A neighbor that comes nearer would keep the reflex busy, meters.
const CLEAR: f64 = 0.015;
/// Positions at which a joint is looked at.
const SAMPLES: u32 = 13;

/// A body as written: its node, where that starts at zero (root frame), and the joint it hangs on.
pub(super) struct Written {
    /// Its first node, which carries its shapes.
    pub node: usize,
    /// Where that node starts, root frame, meters.
    pub start: Vector3<f64>,
    /// The node of the joint that it hangs on; `None` for the root body.
    pub joint: Option<usize>,
    /// Index of the body before it.
    pub before: Option<usize>,
}

/// Puts the balls onto the joints.
pub(super) fn mark_joints(robot: &mut Robot, bodies: &[Written]) {
    for (this, body) in bodies.iter().enumerate() {
        let next: Vec<&Written> = bodies.iter().filter(|b| b.before == Some(this)).collect();
        let places: Vec<Vector3<f64>> = robot.nodes[body.node].solids.iter().flat_map(inner_points).collect();
        for child in &next {
            let Some(joint) = child.joint else { continue };
            // Neighbors of this body in its own frame, at many positions of the joint between.
            let mut near: Vec<Primitive> = Vec::new();
            if let Some(before) = body.before.and_then(|b| bodies.get(b)) {
                let here = Translation3::from(before.start - body.start);
                let turns = body.joint.map_or(Vec::new(), |j| turns(robot, j));
                near.extend(swept(robot, before.node, turns.iter().map(|t| t.inverse() * here)));
            }
            for other in next.iter().filter(|o| o.node != child.node) {
                let there = Translation3::from(other.start - body.start);
                let turns = other.joint.map_or(Vec::new(), |j| turns(robot, j));
                near.extend(swept(robot, other.node, turns.iter().map(|t| there * t)));
            }
            // So small that nothing but the filter ever notices it.
            let ball = Shape::Sphere { radius: RADIUS };
            let clear = |place: &Vector3<f64>| {
                let at = Isometry3::from_parts((*place).into(), UnitQuaternion::identity());
                near.iter().map(|p| distance(&ball, &at, &p.shape, &p.pose).distance).fold(f64::INFINITY, f64::min)
            };
            // The place that is farthest from all neighbors at any turn.
            let best = places.iter().map(|p| (clear(p), p)).max_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, place)) = best.filter(|(clear, _)| *clear > CLEAR) {
                let pose = Isometry3::from(Translation3::from(place + body.start - child.start));
                robot.nodes[joint].solids.push(Primitive { shape: ball, pose });
            }
        }
    }
}

/// The turns of a joint over its range.
fn turns(robot: &Robot, joint: usize) -> Vec<UnitQuaternion<f64>> {
    match &robot.nodes[joint].kind {
        NodeKind::Link { .. } => Vec::new(),
        NodeKind::Joint { axis, min, max, .. } => (0..SAMPLES)
            .map(|i| UnitQuaternion::from_axis_angle(axis, min + (max - min) * f64::from(i) / f64::from(SAMPLES - 1)))
            .collect(),
    }
}

/// The solids of a node at several places.
fn swept(robot: &Robot, node: usize, places: impl Iterator<Item = Isometry3<f64>>) -> Vec<Primitive> {
    let solids = &robot.nodes[node].solids;
    places.flat_map(|at| solids.iter().map(move |s| Primitive { shape: s.shape, pose: at * s.pose })).collect()
}

/// Points within a shape, in its node's frame: the middle, and near the ends of its axes.
fn inner_points(solid: &Primitive) -> Vec<Vector3<f64>> {
    let reach = match solid.shape {
        Shape::Sphere { radius } => Vector3::repeat(radius),
        Shape::Cylinder { radius, height } => Vector3::new(radius, height / 2.0, radius),
        Shape::Capsule { radius, height } => Vector3::new(radius, height / 2.0 + radius, radius),
        Shape::Box { size } => size / 2.0,
        // Just within the surface: on it, rounding would decide whether the ball sticks out.
    } * 0.98;
    let ends = (0..3).flat_map(|i| [1.0, -1.0].map(|sign| Vector3::ith(i, sign * reach[i])));
    std::iter::once(Vector3::zeros()).chain(ends).map(|p| (solid.pose * nalgebra::Point3::from(p)).coords).collect()
}
