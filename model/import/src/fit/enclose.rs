//! Enclosing primitives of each kind around a set of points.

use super::soup::bounds;
use mobee_model::Shape;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, SymmetricEigen, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Minimum thickness of a shape around a flat mesh, meters.
const MIN_THICKNESS_M: f64 = 1e-3;
/// Factors by which capsules are tried thicker than needed: a thicker one has flatter ends, which suits a part with
/// flat ends.
pub(super) const THICKENING: [f64; 2] = [1.08, 1.2];

/// The principal axes of a set of points, as a rotation.
pub(super) fn principal_axes(points: &[Vector3<f64>]) -> UnitQuaternion<f64> {
    let count = points.len().max(1) as f64;
    let mean = points.iter().sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix3<f64>>() / count;
    // Without any spread the axes are arbitrary. The iteration bound guards against cases that no test has found yet.
    let Some(eigen) = SymmetricEigen::try_new(spread, f64::EPSILON, 1000) else { return UnitQuaternion::identity() };
    let mut axes = eigen.eigenvectors;
    // Eigenvectors have arbitrary signs; a reflection is not a rotation.
    if axes.determinant() < 0.0 {
        axes.column_mut(0).neg_mut();
    }
    if axes.iter().any(|a| !a.is_finite()) {
        return UnitQuaternion::identity();
    }
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

/// Rotations that map the local y axis, the axis of round shapes, to x, y and z.
fn spins() -> [UnitQuaternion<f64>; 3] {
    [
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -FRAC_PI_2),
        UnitQuaternion::identity(),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2),
    ]
}

/// A convex shape and its pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cover {
    /// The shape.
    pub shape: Shape,
    /// `link_from_shape`.
    pub pose: Isometry3<f64>,
}

impl Cover {
    /// Enlarges the shape by a margin on all sides, meters.
    pub fn grown(&self, by: f64) -> Self {
        let shape = match self.shape {
            Shape::Sphere { radius } => Shape::Sphere { radius: radius + by },
            Shape::Capsule { radius, height } => Shape::Capsule { radius: radius + by, height },
            Shape::Cylinder { radius, height } => Shape::Cylinder { radius: radius + by, height: height + 2.0 * by },
            Shape::Box { size } => Shape::Box { size: size.add_scalar(2.0 * by) },
        };
        Self { shape, pose: self.pose }
    }

    /// True if a point is inside.
    pub fn contains(&self, point: &Vector3<f64>) -> bool {
        self.shape.depth(&self.pose.inverse_transform_point(&Point3::from(*point)).coords) >= 0.0
    }
}

/// Shapes of all kinds around the points, along the axes of a rotated frame.
pub(super) fn all_kinds(points: &[Vector3<f64>], turn: &UnitQuaternion<f64>) -> Vec<Cover> {
    let (low, high) = bounds(&points.iter().map(|p| turn.inverse_transform_vector(p)).collect::<Vec<_>>());
    let center = Translation3::from(turn * ((low + high) / 2.0));
    let mut out = Vec::with_capacity(14);
    let mut add = |shape, turn| {
        let found = around(points, &Cover { shape, pose: Isometry3::from_parts(center, turn) });
        out.push(found);
        found
    };
    add(Shape::Box { size: Vector3::zeros() }, *turn);
    add(Shape::Sphere { radius: 0.0 }, *turn);
    for spin in spins() {
        add(Shape::Cylinder { radius: 0.0, height: 0.0 }, turn * spin);
        if let Shape::Capsule { radius, .. } = add(Shape::Capsule { radius: 0.0, height: 0.0 }, turn * spin).shape {
            for by in THICKENING {
                add(Shape::Capsule { radius: radius * by, height: 0.0 }, turn * spin);
            }
        }
    }
    out
}

/// The shape with the axes of `like` and at least its radius, around all points. Its center may move along the axes, to
/// make it shorter.
pub(super) fn around(points: &[Vector3<f64>], like: &Cover) -> Cover {
    let local = || points.iter().map(|p| like.pose.inverse_transform_point(&Point3::from(*p)).coords);
    let placed = |shape, middle: Vector3<f64>| Cover { shape, pose: like.pose * Translation3::from(middle) };
    let across = |p: &Vector3<f64>| p.x.hypot(p.z);
    let span = |ends: &dyn Fn(&Vector3<f64>) -> f64| {
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        let (low, high) = local().fold(start, |(low, high), p| {
            let reach = ends(&p);
            (low.min(p.y + reach), high.max(p.y - reach))
        });
        // If the end balls already contain everything, the ends would cross.
        (Vector3::y() * ((low + high) / 2.0), (high - low).max(MIN_THICKNESS_M))
    };
    match like.shape {
        Shape::Box { .. } => {
            let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
            let (low, high) = local().fold(start, |(low, high), p| (low.inf(&p), high.sup(&p)));
            placed(Shape::Box { size: (high - low).map(|s| s.max(MIN_THICKNESS_M)) }, (low + high) / 2.0)
        }
        Shape::Sphere { radius } => {
            let radius = local().map(|p| p.norm()).fold(radius.max(MIN_THICKNESS_M / 2.0), f64::max);
            placed(Shape::Sphere { radius }, Vector3::zeros())
        }
        Shape::Cylinder { radius, .. } => {
            let radius = local().map(|p| across(&p)).fold(radius.max(MIN_THICKNESS_M / 2.0), f64::max);
            let (middle, height) = span(&|_| 0.0);
            placed(Shape::Cylinder { radius, height }, middle)
        }
        Shape::Capsule { radius, .. } => {
            let radius = local().map(|p| across(&p)).fold(radius.max(MIN_THICKNESS_M / 2.0), f64::max);
            // Extent of an end ball beyond its center; smaller for points off the axis.
            let (middle, height) = span(&|p| (radius.powi(2) - p.x.powi(2) - p.z.powi(2)).max(0.0).sqrt());
            placed(Shape::Capsule { radius, height }, middle)
        }
    }
}

/// Moves the axis of a round primitive (or the center of a ball) closer to the points that are farthest from it.
///
/// After Badoiu and Clarkson, *Smaller core-sets for balls* (2003): step toward the farthest point with decreasing step
/// sizes.
pub(super) fn centered(points: &[Vector3<f64>], like: &Cover) -> Cover {
    let flat = match like.shape {
        Shape::Box { .. } => return *like,
        Shape::Sphere { .. } => Vector3::repeat(1.0),
        Shape::Cylinder { .. } | Shape::Capsule { .. } => Vector3::new(1.0, 0.0, 1.0),
    };
    let local: Vec<Vector3<f64>> = points
        .iter()
        .map(|p| like.pose.inverse_transform_point(&Point3::from(*p)).coords.component_mul(&flat))
        .collect();
    let farthest = |from: &Vector3<f64>| {
        let all = local.iter().map(|p| ((p - from).norm_squared(), *p));
        all.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, *from))
    };
    let mut center = Vector3::zeros();
    let mut best = (farthest(&center).0, center);
    for step in 1..=40 {
        let (_, far) = farthest(&center);
        center += (far - center) / f64::from(step + 1);
        let square = farthest(&center).0;
        if square < best.0 {
            best = (square, center);
        }
    }
    let shape = match like.shape {
        // The radius around the new center may be smaller, so the old one must not be a lower bound.
        Shape::Sphere { .. } | Shape::Box { .. } => Shape::Sphere { radius: 0.0 },
        Shape::Cylinder { .. } => Shape::Cylinder { radius: 0.0, height: 0.0 },
        Shape::Capsule { .. } => Shape::Capsule { radius: 0.0, height: 0.0 },
    };
    around(points, &Cover { shape, pose: like.pose * Translation3::from(best.1) })
}
