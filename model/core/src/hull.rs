//! Hulls: the solid part of a shape that was fitted around a part of a mesh.
//!
//! ```text
//! shape (ball, capsule, cylinder, box)   cheap to reject, larger than the part it encloses
//!   └── hull: some points and a radius     decides contacts
//! ```

use crate::{BoundingCapsule, InnerCapsule, Mesh, Shape};
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;
use std::sync::Arc;

/// Maximum number of points of a hull: all are visited several times in each measurement, and the length of a file's
/// attribute is limited.
pub const MAX_HULL_POINTS: usize = 112;
/// Tolerance by which a hull may extend beyond its shape, meters: rounding of a pose that was written as heading and
/// angle.
const ROUNDING_M: f64 = 1e-6;
/// Minimum dilation of a hull's mesh for display, meters: a flat hull has no volume.
const MIN_DISPLAY_RADIUS_M: f64 = 1e-3;

/// The convex hull of points, dilated by a radius: a solid within a shape, on the same node.
///
/// The shape is what viewers draw, and what is tested first; if it may touch, its hull decides. So a hull never causes
/// a contact that its shape would not cause.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// `node` frame, meters; at least one.
    points: Vec<Point3<f64>>,
    /// Dilation, meters.
    radius: f64,
}

/// The hulls of a node's shapes, by the shape's index among the node's solids.
pub type Hulls = std::collections::BTreeMap<usize, Arc<Hull>>;

impl Hull {
    /// Creates the hull of points, meters, dilated by a radius, meters.
    ///
    /// # Errors
    /// The end of a sentence that begins with the hull: no points or too many, numbers that are not finite, or a
    /// negative radius.
    pub fn new(points: Vec<Point3<f64>>, radius: f64) -> Result<Self, String> {
        if points.is_empty() || points.len() > MAX_HULL_POINTS {
            return Err(format!("has {} points; 1 to {MAX_HULL_POINTS} make one", points.len()));
        }
        if !(points.iter().all(|p| p.iter().all(|x| x.is_finite())) && radius.is_finite() && radius >= 0.0) {
            return Err("has numbers that are not finite, or a radius below zero".to_owned());
        }
        Ok(Self { points, radius })
    }

    /// Its points, meters.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Its dilation, meters.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The hull in another frame.
    pub fn moved(&self, to_from_here: &Isometry3<f64>) -> Self {
        Self { points: self.points.iter().map(|p| to_from_here * p).collect(), radius: self.radius }
    }

    /// Its surface for display: edges of the dilated hull are cut off by up to half of the radius.
    pub fn mesh(&self) -> Mesh {
        let by = self.radius.max(MIN_DISPLAY_RADIUS_M);
        let ball = [-1.0, 0.0, 1.0].map(|x| [-1.0, 0.0, 1.0].map(|y| [-1.0, 0.0, 1.0].map(|z| Vector3::new(x, y, z))));
        // The axes and corners of a cube: few directions, sufficiently even.
        let ball = ball.as_flattened().as_flattened().iter().filter(|d| matches!(d.norm_squared() as u8, 1 | 3));
        let ball: Vec<Vector3<f64>> = ball.map(|d| d.normalize() * by).collect();
        let around = self.points.iter().flat_map(|p| ball.iter().map(move |d| p.coords + d));
        let around: Vec<Vector> = around.map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let Ok((corners, triangles)) = try_convex_hull(&around) else { return Mesh::default() };
        Mesh { vertices: corners.iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect(), triangles }
    }

    /// The largest of a few capsules inside the hull, on the axis of a shape's outer capsule; [`InnerCapsule::NONE`] if
    /// the midpoint of that axis is outside, or the hull is flat.
    pub(crate) fn inner_capsule(&self, outer: &BoundingCapsule, shape_from_hull: &Isometry3<f64>) -> InnerCapsule {
        /// Number of steps in length that are tried.
        const STEPS: usize = 16;
        let points: Vec<Vector> = self.points.iter().map(|p| Vector::from((shape_from_hull * p).coords)).collect();
        let Ok((corners, triangles)) = try_convex_hull(&points) else { return InnerCapsule::NONE };
        let side = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|t| corners[t as usize]);
            let normal = (b - a).cross(c - a).try_normalize()?;
            Some((Vector3::new(normal.x, normal.y, normal.z), normal.dot(a)))
        };
        let Some(sides) = triangles.iter().map(side).collect::<Option<Vec<_>>>() else { return InnerCapsule::NONE };
        let capsule = |step: usize| {
            let share = step as f64 / STEPS as f64;
            // The distance of the nearer of both ends from the side.
            let margin = |(normal, far): &(Vector3<f64>, f64)| far - share * normal.dot(&outer.half_axis).abs();
            let radius = sides.iter().map(margin).fold(f64::INFINITY, f64::min) - ROUNDING_M;
            InnerCapsule { share, radius: radius + self.radius }
        };
        let volume = |c: &InnerCapsule| c.radius.powi(2) * (c.radius * 2.0 / 3.0 + c.share * outer.half_axis.norm());
        // The points alone may form a flat hull: then only the dilation has an interior.
        let held = (0..=STEPS).map(capsule).filter(|c| c.radius > self.radius);
        held.max_by(|a, b| volume(a).total_cmp(&volume(b))).unwrap_or(InnerCapsule::NONE)
    }

    /// True if the hull lies inside a shape, given the shape's pose in the hull's frame.
    pub fn is_within(&self, shape: &Shape, pose: &Isometry3<f64>) -> bool {
        let depth = |p: &Point3<f64>| shape.depth(&pose.inverse_transform_point(p).coords);
        self.points.iter().all(|p| depth(p) >= self.radius - ROUNDING_M)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::distances_from_hull;
    use proptest::array::uniform3;
    use proptest::collection::vec;
    use proptest::prelude::*;

    const OUTER: Shape = Shape::Box { size: Vector3::new(0.1, 0.3, 0.2) };

    fn inner(points: Vec<Point3<f64>>, shape_from_hull: &Isometry3<f64>) -> InnerCapsule {
        let hull = Hull::new(points, 0.001).unwrap().moved(&shape_from_hull.inverse());
        hull.inner_capsule(&OUTER.bounding_capsule(), shape_from_hull)
    }

    /// The hull of a box's corners contains about the same capsule as the box, in any orientation; a flat hull, or one
    /// beside the axis, contains none.
    #[test]
    fn a_hull_of_corners_contains_the_capsule_of_its_box() {
        let corner = |i: usize| Vector3::from_fn(|k, _| [0.04, 0.3, 0.06][k] * ((i >> k & 1) as f64 - 0.5));
        let corners: Vec<Point3<f64>> = (0..8).map(|i| corner(i).into()).collect();
        for turn in [Vector3::zeros(), Vector3::new(0.3, -0.2, 0.5)] {
            let turned = Isometry3::rotation(turn);
            let found = inner(corners.clone(), &turned);
            assert!(found.radius > 0.0209 && found.radius < 0.021 && found.share > 0.7, "{found:?}");
            let flat = corners.iter().map(|p| Point3::new(0.0, p.y, p.z)).collect();
            let beside = corners.iter().map(|p| p + Vector3::x()).collect();
            assert_eq!([inner(flat, &turned), inner(beside, &turned)], [InnerCapsule::NONE; 2]);
        }
    }

    proptest! {
        /// No point of the capsule is outside the hull.
        #[test]
        fn the_capsule_in_a_hull_is_within(
            points in vec(uniform3(-1.0..1.0), 4..60), directions in vec(uniform3(-1.0..1.0), 50)
        ) {
            let half = OUTER.bounding_capsule().half_axis;
            let points: Vec<Vector3<f64>> = points.iter().map(|p| Vector3::from(*p).component_mul(&Vector3::new(0.05, 0.15, 0.1))).collect();
            let found = inner(points.iter().map(|p| Point3::from(*p)).collect(), &Isometry3::identity());
            prop_assume!(found != InnerCapsule::NONE);
            let on_it = |d: &[f64; 3]| {
                let d = Vector3::from(*d).normalize();
                d * found.radius + half * (found.share * d.dot(&half).signum())
            };
            let outside = distances_from_hull(&points, &directions.iter().map(on_it).collect::<Vec<_>>()).fold(0.0, f64::max);
            prop_assert!(outside <= 0.001, "{found:?} {outside}");
        }
    }

    /// The mesh contains the points of the hull, and extends nowhere beyond the dilated hull.
    #[test]
    fn the_mesh_of_a_hull_matches_the_hull() {
        let flat =
            [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.2, 0.0], [0.0, 0.2, 0.0], [0.05, 0.1, 0.0]].map(Point3::from);
        for (points, radius) in [(flat.to_vec(), 0.002), (flat.to_vec(), 0.0), (flat[..1].to_vec(), 0.01)] {
            let mesh = Hull::new(points.clone(), radius).unwrap().mesh();
            assert!(mesh.triangles.len() >= 8, "{points:?}");
            let inside = |p: &Vector3<f64>| {
                let corner = |t: u32| mesh.vertices[t as usize];
                // A hundredth of a millimeter is negligible for display.
                let holds = |t: &[u32; 3]| {
                    let [a, b, c] = t.map(corner);
                    let normal = (b - a).cross(&(c - a)).try_normalize(1e-12);
                    normal.is_none_or(|normal| normal.dot(&(p - a)) <= 1e-5)
                };
                mesh.triangles.iter().all(holds)
            };
            assert!(points.iter().all(|p| inside(&p.coords)), "{points:?} {radius}");
            let by = radius.max(MIN_DISPLAY_RADIUS_M) + 1e-12;
            let low = Vector3::repeat(-by);
            let high = Vector3::new(0.1, 0.2, 0.0).add_scalar(by);
            assert!(mesh.vertices.iter().all(|p| *p >= low && *p <= high), "{points:?} {radius}");
        }
    }
}
