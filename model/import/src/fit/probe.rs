//! Sample points on the surface of a primitive.

use super::enclose::Cover;
use mobee_model::Shape;
use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;

/// Rows of points along an edge or a quarter circle while searching.
pub(super) const COARSE: usize = 4;
/// Rows of points for the result of a search.
pub(super) const MEDIUM: usize = 8;
/// Rows of points for the final measurement.
pub(super) const FINE: usize = 13;

/// Points distributed over the surface, corners and rims included, in the parent frame of the primitive's pose.
pub(super) fn points(cover: &Cover, rows: usize) -> Vec<Vector3<f64>> {
    let mut out = Vec::with_capacity(8 * rows * rows);
    let part = |i: usize| i as f64 / (rows - 1) as f64;
    let around = 4 * (rows - 1);
    let circle: Vec<(f64, f64)> = (0..around).map(|i| (i as f64 / around as f64 * 2.0 * PI).sin_cos()).collect();
    match cover.shape {
        Shape::Box { size } => {
            for axis in 0..3 {
                let a = (axis + 1) % 3;
                let b = (axis + 2) % 3;
                for i in 0..rows * rows {
                    let mut p = Vector3::zeros();
                    p[a] = (part(i % rows) - 0.5) * size[a];
                    p[b] = (part(i / rows) - 0.5) * size[b];
                    p[axis] = size[axis] / 2.0;
                    out.push(p);
                    p[axis] = -p[axis];
                    out.push(p);
                }
            }
        }
        Shape::Sphere { radius } => half_balls(&mut out, radius, 0.0, rows, &circle),
        Shape::Capsule { radius, height } => {
            half_balls(&mut out, radius, height / 2.0, rows, &circle);
            wall(&mut out, radius, height, rows, &circle);
        }
        Shape::Cylinder { radius, height } => {
            wall(&mut out, radius, height, rows, &circle);
            for (sin, cos) in &circle {
                for k in 0..rows - 1 {
                    let r = part(k) * radius;
                    out.extend([0.5, -0.5].map(|y| Vector3::new(r * cos, y * height, r * sin)));
                }
            }
        }
    }
    out.iter_mut().for_each(|p| *p = (cover.pose * Point3::from(*p)).coords);
    out
}

/// Adds points on the end hemispheres, whose centers are `half` from the middle.
fn half_balls(out: &mut Vec<Vector3<f64>>, radius: f64, half: f64, rows: usize, circle: &[(f64, f64)]) {
    for k in 0..rows {
        let (up, r) = (k as f64 / (rows - 1) as f64 * PI / 2.0).sin_cos();
        // Near the pole the rings are shorter and need fewer points.
        let step = if 2 * k > rows { 2 } else { 1 };
        for (sin, cos) in circle.iter().step_by(if k + 1 == rows { usize::MAX } else { step }) {
            let p = Vector3::new(r * cos * radius, up * radius + half, r * sin * radius);
            out.extend([p, Vector3::new(p.x, -p.y, p.z)]);
        }
    }
}

/// Adds rings of points along the wall, rims included.
fn wall(out: &mut Vec<Vector3<f64>>, radius: f64, height: f64, rows: usize, circle: &[(f64, f64)]) {
    for (sin, cos) in circle {
        for k in 0..rows {
            let y = (k as f64 / (rows - 1) as f64 - 0.5) * height;
            out.push(Vector3::new(radius * cos, y, radius * sin));
        }
    }
}
