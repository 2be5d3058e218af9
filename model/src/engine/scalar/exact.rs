//! Exact: the signed distance of two convex shapes, with witness points.
//!
//! Every shape is a *core* blown up by a radius: a ball is a point, a capsule a segment, boxes and cylinders are their
//! own cores. The distance of two shapes is that of their cores less both radii, and so is the penetration depth, down
//! to where the cores meet. Distances of points and segments have closed forms; so has the depth of overlapping boxes
//! and segments (separating axes). The rest, pairs with a cylinder and boxes apart, goes through parry's GJK and EPA in
//! f64; both answers are checked by the identity
//!
//! ```text
//! signed distance = max over unit n of ( min over B of n.x  -  max over A of n.x )
//! ```
//!
//! which turns any direction into a lower bound of the distance (an upper bound of the depth) at the cost of two
//! support points, and GJK's own points into an upper bound.

use super::super::Proximity;
use super::closed;
use super::form::{Core, Form};
use super::gjk;
use nalgebra::{Isometry3, Point3, Vector3};

/// Separation of two cores: `points[1] - points[0] = distance * normal`, the normal pointing out of the first one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Separation {
    /// Signed, meters.
    pub distance: f64,
    /// Unit: the direction in which the second core is parted from the first by the shortest way.
    pub normal: Vector3<f64>,
    /// On the first and on the second core.
    pub points: [Point3<f64>; 2],
}

impl Separation {
    /// The same with the cores exchanged.
    fn flipped(self) -> Self {
        Separation { distance: self.distance, normal: -self.normal, points: [self.points[1], self.points[0]] }
    }
}

/// The signed distance of two shapes, or `None` once it is sure that they are farther apart than `cap` meters. Poses are
/// `world_from_shape`, witness points are in the world.
pub(super) fn distance_within(
    a: &Form,
    world_from_a: &Isometry3<f64>,
    b: &Form,
    world_from_b: &Isometry3<f64>,
    cap: f64,
) -> Option<Proximity> {
    let radii = a.radius + b.radius;
    // Less the radii the cap holds for the shapes, with them for their cores.
    let core = core_separation(&a.core, world_from_a, &b.core, world_from_b, cap + radii)?;
    let distance = core.distance - radii;
    (distance <= cap).then(|| Proximity {
        distance,
        points: [core.points[0] + core.normal * a.radius, core.points[1] - core.normal * b.radius],
    })
}

/// The separation of two cores, or `None` once they are surely farther apart than `cap`: closed forms where there are any, else
/// by support points. Poses are `world_from_core`.
fn core_separation(a: &Core, pa: &Isometry3<f64>, b: &Core, pb: &Isometry3<f64>, cap: f64) -> Option<Separation> {
    use Core::{Box, Cylinder, Point, Segment};
    let segment = |p: &Isometry3<f64>, half: f64| closed::Segment {
        middle: p.translation.vector.into(),
        half_axis: p.rotation * Vector3::y() * half,
    };
    match (a, b) {
        (Point, Point) => Some(closed::segments(segment(pa, 0.0), segment(pb, 0.0))),
        (Point, Segment { half }) => Some(closed::segments(segment(pa, 0.0), segment(pb, *half))),
        (Segment { half }, Point) => Some(closed::segments(segment(pa, *half), segment(pb, 0.0))),
        (Segment { half: ha }, Segment { half: hb }) => Some(closed::segments(segment(pa, *ha), segment(pb, *hb))),
        (Point, Box { half }) => Some(closed::point_box(pa.translation.vector.into(), half, pb)),
        (Point, Cylinder { half, radius }) => {
            Some(closed::point_cylinder(pa.translation.vector.into(), *half, *radius, pb))
        }
        // One order has the closed form; the other is the same seen from the other side.
        (Box { .. } | Cylinder { .. }, Point) => core_separation(b, pb, a, pa, cap).map(Separation::flipped),
        _ => gjk::separation(a, pa, b, pb, cap),
    }
}
