//! Support points of cores: the only access that GJK, EPA and the checks of both have to a core.
//!
//! The support point in a direction is the point of a convex set that lies farthest along it. Two support points bound
//! the distance of two sets from below in that direction ([`along`]), whatever method proposed the direction. The
//! results of GJK and EPA are checked this way.

use super::form::Core;
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;

/// A core and its pose: `world_from_core`, or from another frame common to both cores of a pair.
#[derive(Clone, Copy)]
pub(super) struct Placed<'a> {
    /// The core.
    pub core: &'a Core,
    /// Its pose.
    pub pose: Isometry3<f64>,
}

impl Placed<'_> {
    /// Its origin, world frame.
    pub fn center(&self) -> Point3<f64> {
        self.pose.translation.vector.into()
    }
}

impl SupportMap for Core {
    /// The farthest point along `dir`, in the core's frame. `copysign` instead of a comparison, because zero has a
    /// sign, too: equal directions always give the same corner.
    fn local_support_point(&self, dir: Vector) -> Vector {
        match *self {
            Core::Point => Vector::ZERO,
            Core::Segment { half } => Vector::new(0.0, half.copysign(dir.y), 0.0),
            Core::Box { half } => Vector::new(half.x.copysign(dir.x), half.y.copysign(dir.y), half.z.copysign(dir.z)),
            Core::Cylinder { half, radius } => {
                let rho = (dir.x * dir.x + dir.z * dir.z).sqrt();
                let k = if rho > 0.0 { radius / rho } else { 0.0 };
                Vector::new(dir.x * k, half.copysign(dir.y), dir.z * k)
            }
            Core::Hull { ref points } => {
                let farther = |best: (f64, Vector), p: &Vector| match p.dot(dir) {
                    along if along > best.0 => (along, *p),
                    _ => best,
                };
                points.iter().fold((f64::NEG_INFINITY, Vector::ZERO), farther).1
            }
        }
    }
}

/// The point of a placed core that lies farthest along `direction`, world frame.
pub(super) fn support_point(placed: &Placed, direction: &Vector3<f64>) -> Point3<f64> {
    let local = placed.pose.rotation.inverse_transform_vector(direction);
    let p = placed.core.local_support_point(Vector::new(local.x, local.y, local.z));
    placed.pose * Point3::new(p.x, p.y, p.z)
}

/// Separation of the cores along unit `n`, meters: a lower bound of their signed distance.
pub(super) fn along(a: &Placed, b: &Placed, n: &Vector3<f64>) -> f64 {
    (support_point(b, &-n) - support_point(a, n)).dot(n)
}

/// The point of a placed core nearest to a point.
pub(super) fn project(placed: &Placed, point: &Point3<f64>) -> Point3<f64> {
    let p = placed.pose.inverse_transform_point(point);
    placed.pose
        * match *placed.core {
            Core::Point => Point3::origin(),
            Core::Segment { half } => Point3::new(0.0, p.y.clamp(-half, half), 0.0),
            Core::Box { half } => {
                Point3::new(p.x.clamp(-half.x, half.x), p.y.clamp(-half.y, half.y), p.z.clamp(-half.z, half.z))
            }
            Core::Cylinder { half, radius } => {
                let k = (radius / p.x.hypot(p.z)).min(1.0);
                Point3::new(p.x * k, p.y.clamp(-half, half), p.z * k)
            }
            Core::Hull { .. } => nearest_of_hull(placed.core, &p),
        }
}

/// Distances of points from the hull of `points`, meters; zero inside.
pub fn distances_from_hull(points: &[Vector3<f64>], queries: &[Vector3<f64>]) -> impl Iterator<Item = f64> {
    let core = Core::Hull { points: points.iter().map(|p| Vector::from(*p)).collect() };
    queries.iter().map(move |query| (nearest_of_hull(&core, &Point3::from(*query)).coords - query).norm())
}

/// The point of a hull nearest to a point, both in the hull's frame.
fn nearest_of_hull(hull: &Core, p: &Point3<f64>) -> Point3<f64> {
    let there = Pose::from_translation(Vector::new(p.x, p.y, p.z));
    let mut simplex = VoronoiSimplex::new();
    let start = Vector::new(-p.x, -p.y, -p.z).try_normalize().unwrap_or(Vector::X);
    simplex.reset(CsoPoint::from_shapes(&there, hull, &Core::Point, start));
    match gjk::closest_points(&there, hull, &Core::Point, f64::MAX, true, &mut simplex) {
        GJKResult::ClosestPoints(on_hull, _, _) => Point3::new(on_hull.x, on_hull.y, on_hull.z),
        // Inside the hull.
        _ => *p,
    }
}

/// Of the points of a placed core that lie farthest along unit `n`, the one nearest to `point`.
pub(super) fn farthest_near(placed: &Placed, n: &Vector3<f64>, point: &Point3<f64>) -> Point3<f64> {
    /// Deviation of a side from perpendicular to `n`, rad, up to which all of the side counts as farthest.
    const PERPENDICULAR_RAD: f64 = 1e-6;
    let n = placed.pose.rotation.inverse_transform_vector(n);
    let p = placed.pose.inverse_transform_point(point);
    let end =
        |n: f64, half: f64, p: f64| if n.abs() > PERPENDICULAR_RAD { half.copysign(n) } else { p.clamp(-half, half) };
    placed.pose
        * match *placed.core {
            Core::Point => Point3::origin(),
            Core::Segment { half } => Point3::new(0.0, end(n.y, half, p.y), 0.0),
            Core::Box { half } => Point3::new(end(n.x, half.x, p.x), end(n.y, half.y, p.y), end(n.z, half.z, p.z)),
            Core::Cylinder { half, radius } => {
                let slant = n.x.hypot(n.z);
                let (x, z) = if slant > PERPENDICULAR_RAD {
                    (n.x * radius / slant, n.z * radius / slant)
                } else {
                    let k = (radius / p.x.hypot(p.z)).min(1.0);
                    (p.x * k, p.z * k)
                };
                Point3::new(x, end(n.y, half, p.y), z)
            }
            // Any of the farthest points will do: the faces of a hull are small.
            Core::Hull { .. } => {
                let p = placed.core.local_support_point(Vector::new(n.x, n.y, n.z));
                Point3::new(p.x, p.y, p.z)
            }
        }
}
