//! The smallest of a few simple shapes around a cloud of points.
//!
//! Always around and never within: a shape that is too large costs free space, one that is too small costs a robot.

use crate::{Primitive, Shape};
use nalgebra::{Isometry3, Matrix3, Rotation3, SymmetricEigen, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// A round shape may be this much larger than a box and is still taken: it is much faster to test.
const ROUND_BONUS: f64 = 1.15;
/// Flat meshes get this thickness at least, meters.
const THIN: f64 = 1e-3;

/// A box, capsule or sphere that contains all points. The box and the capsule lie along the principal axes or the mesh's own.
pub(super) fn fit(points: impl Iterator<Item = Vector3<f64>>) -> Result<Primitive, String> {
    let points: Vec<Vector3<f64>> = points.collect();
    if points.iter().flatten().any(|c| !c.is_finite() || c.abs() > 1e4) {
        return Err("has coordinates that are not finite or beyond 10 km".to_owned());
    }
    let count = points.len().max(1) as f64;
    // The principal axes of the vertices find long and flat parts however the mesh lies in its file. Vertices are dense
    // where a mesh is detailed and not where it is large, so its own axes are tried as well, and the smaller shape wins.
    let mean = points.iter().sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix3<f64>>() / count;
    let mut principal = SymmetricEigen::new(spread).eigenvectors;
    // Eigenvectors come with any sign; a reflection is no rotation.
    if principal.determinant() < 0.0 {
        principal.column_mut(0).neg_mut();
    }
    let turns = [Matrix3::identity(), principal]
        .map(|m| UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(m)));
    let best = turns.iter().flat_map(|turn| candidates(&points, turn)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, primitive)| primitive).ok_or_else(|| "has no vertices".to_owned())
}

/// Shapes around the points in a turned frame, each with its (weighted) volume.
fn candidates(points: &[Vector3<f64>], turn: &UnitQuaternion<f64>) -> Vec<(f64, Primitive)> {
    let local: Vec<Vector3<f64>> = points.iter().map(|p| turn.inverse() * p).collect();
    let low = local.iter().fold(Vector3::repeat(f64::INFINITY), |a, p| a.inf(p));
    let high = local.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |a, p| a.sup(p));
    let center = (low + high) / 2.0;
    let size = (high - low).map(|s| s.max(THIN));
    let place = |spin: UnitQuaternion<f64>| Isometry3::from_parts(Translation3::from(turn * center), turn * spin);
    let identity = UnitQuaternion::identity();
    let mut out = vec![(size.product() * ROUND_BONUS, Primitive { shape: Shape::Box { size }, pose: place(identity) })];
    let radius = local.iter().map(|p| (p - center).norm()).fold(THIN / 2.0, f64::max);
    let ball = 4.0 / 3.0 * PI * radius.powi(3);
    out.push((ball, Primitive { shape: Shape::Sphere { radius }, pose: place(identity) }));
    for axis in 0..3 {
        let across = |p: &Vector3<f64>| {
            let mut d = p - center;
            d[axis] = 0.0;
            d.norm()
        };
        let radius = local.iter().map(across).fold(THIN / 2.0, f64::max);
        // How far the axis must reach so that the end balls still hold each point: less far for points off the axis.
        let half =
            local.iter().map(|p| (p[axis] - center[axis]).abs() - (radius.powi(2) - across(p).powi(2)).max(0.0).sqrt());
        let height = 2.0 * half.fold(THIN / 2.0, f64::max);
        // Capsules lie along local y.
        let spin = match axis {
            0 => UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -PI / 2.0),
            1 => identity,
            _ => UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI / 2.0),
        };
        let volume = PI * radius.powi(2) * height + 4.0 / 3.0 * PI * radius.powi(3);
        out.push((volume, Primitive { shape: Shape::Capsule { radius, height }, pose: place(spin) }));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// How far outside the shape a point is.
    fn outside(primitive: &Primitive, point: &Vector3<f64>) -> f64 {
        let p = primitive.pose.inverse_transform_point(&(*point).into()).coords;
        match primitive.shape {
            Shape::Sphere { radius } => p.norm() - radius,
            Shape::Box { size } => (p.abs() - size / 2.0).max(),
            Shape::Cylinder { radius, height } => (p.xz().norm() - radius).max(p.y.abs() - height / 2.0),
            Shape::Capsule { radius, height } => {
                let nearest = Vector3::new(0.0, p.y.clamp(-height / 2.0, height / 2.0), 0.0);
                (p - nearest).norm() - radius
            }
        }
    }

    proptest! {
        #[test]
        fn every_point_is_inside(points in prop::collection::vec(prop::array::uniform3(-1.0..1.0), 1..60)) {
            let points: Vec<Vector3<f64>> = points.into_iter().map(Vector3::from).collect();
            let fitted = fit(points.iter().copied()).unwrap();
            for p in &points {
                prop_assert!(outside(&fitted, p) < 1e-9, "{fitted:?} leaves out {p}");
            }
        }
    }

    #[test]
    fn a_long_rod_becomes_a_capsule() {
        let ring = |y: f64| {
            (0..8).map(move |i| {
                let (sin, cos) = (f64::from(i) * PI / 4.0).sin_cos();
                Vector3::new(0.03 * cos, y, 0.03 * sin)
            })
        };
        let fitted = fit((0..10).flat_map(|i| ring(f64::from(i) * 0.05))).unwrap();
        assert!(matches!(fitted.shape, Shape::Capsule { radius, .. } if radius < 0.031), "{fitted:?}");
    }
}
