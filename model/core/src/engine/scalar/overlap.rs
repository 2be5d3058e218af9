//! Penetration depth of two boxes, or of a segment and a box, by separating axes.
//!
//! Their Minkowski difference is a zonotope. The normals of its faces are the boxes' axes and the cross products of one
//! edge of each, so trying these is exact: 3 + 3 + 9 directions for two boxes, 3 + 3 for a box and a segment. The
//! result is the direction with the shortest separating translation.

use super::closed::{self, Segment};
use super::exact::Separation;
use super::form::Core;
use super::support::{Placed, support_point};
use nalgebra::{Point3, Vector3};

/// The signed separation along the best separating axis: exact if the cores overlap, else a lower bound.
pub(super) fn by_axes(a: &Placed, b: &Placed) -> Separation {
    let edges_a = edges(a);
    let edges_b = edges(b);
    let between = b.center() - a.center();
    let mut best: Option<(f64, Vector3<f64>, AxisSource)> = None;
    let mut consider = |axis: Vector3<f64>, kind: AxisSource| {
        let Some(n) = axis.try_normalize(1e-300) else { return };
        let n = if n.dot(&between) < 0.0 { -n } else { n };
        let apart = n.dot(&between) - reach(&edges_a, &n) - reach(&edges_b, &n);
        // Edge pairs must be better by a small tolerance, so that faces win ties: their witness points are more stable.
        let tie_margin = if matches!(kind, AxisSource::Edges(..)) { 1e-12 } else { 0.0 };
        if best.is_none_or(|(d, ..)| apart > d + tie_margin) {
            best = Some((apart, n, kind));
        }
    };
    if matches!(a.core, Core::Box { .. }) {
        edges_a.iter().for_each(|e| consider(*e, AxisSource::FaceOfA));
    }
    if matches!(b.core, Core::Box { .. }) {
        edges_b.iter().for_each(|e| consider(*e, AxisSource::FaceOfB));
    }
    for ea in edges_a {
        for eb in edges_b {
            // Normalized first: a thin plate's short edge is as good a direction as its long one.
            let (Some(ua), Some(ub)) = (ea.try_normalize(1e-300), eb.try_normalize(1e-300)) else { continue };
            let axis = ua.cross(&ub);
            consider(axis, AxisSource::Edges(ea, eb));
        }
    }
    let (distance, normal, kind) = best.unwrap_or((0.0, Vector3::x(), AxisSource::FaceOfA));
    let points = match kind {
        AxisSource::FaceOfA => {
            let p = support_point(b, &-normal);
            [p - normal * distance, p]
        }
        AxisSource::FaceOfB => {
            let p = support_point(a, &normal);
            [p, p + normal * distance]
        }
        AxisSource::Edges(ea, eb) => {
            let edge = |placed: &Placed, edge: Vector3<f64>, n: Vector3<f64>| {
                let middle = edges(placed)
                    .iter()
                    .filter(|e| (**e - edge).norm_squared() > 0.0)
                    .fold(placed.center(), |p, e| if e.dot(&n) < 0.0 { p - e } else { p + e });
                Segment { middle, half_axis: edge }
            };
            let a = edge(a, ea, normal);
            let b = edge(b, eb, -normal);
            let (s, t) = closed::nearest_parameters(&a, &b);
            let p: Point3<f64> = nalgebra::center(&a.at(s), &b.at(t));
            [p - normal * (distance / 2.0), p + normal * (distance / 2.0)]
        }
    };
    Separation { distance, normal, points }
}

/// The features that an axis comes from; they determine the witness points.
#[derive(Clone, Copy)]
enum AxisSource {
    FaceOfA,
    FaceOfB,
    Edges(Vector3<f64>, Vector3<f64>),
}

/// Half edges in the world frame: three of a box, one of a segment; unused entries are zero.
fn edges(placed: &Placed) -> [Vector3<f64>; 3] {
    let rotation = placed.pose.rotation.to_rotation_matrix();
    let m = rotation.matrix();
    let column = |i: usize| Vector3::from(m.column(i));
    match *placed.core {
        Core::Box { half } => [column(0) * half.x, column(1) * half.y, column(2) * half.z],
        Core::Segment { half } | Core::Cylinder { half, .. } => [Vector3::zeros(), column(1) * half, Vector3::zeros()],
        Core::Point | Core::Hull { .. } => [Vector3::zeros(); 3],
    }
}

/// Extent of a core with these half edges from its center along unit `n`, meters.
fn reach(edges: &[Vector3<f64>; 3], n: &Vector3<f64>) -> f64 {
    edges.iter().map(|e| e.dot(n).abs()).sum()
}
