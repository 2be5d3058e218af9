//! Closed forms: two segments, and a point against a box or a cylinder.

use super::exact::Separation;
use nalgebra::{Isometry3, Point3, Unit, Vector3};

/// A segment given by its midpoint and half axis. A zero half axis makes it a point, and a capsule's axis needs no
/// ends.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Segment {
    /// Midpoint, in the caller's frame: the world, or the other shape.
    pub middle: Point3<f64>,
    /// From the middle to one end, meters.
    pub half_axis: Vector3<f64>,
}

impl Segment {
    /// The point at a parameter in [-1, 1].
    pub fn at(&self, parameter: f64) -> Point3<f64> {
        self.middle + self.half_axis * parameter
    }
}

/// Parameters in [-1, 1] of the nearest points of two segments.
///
/// After Ericson, *Real-Time Collision Detection*, 5.1.9, with centered parameters.
pub(super) fn nearest_parameters(a: &Segment, b: &Segment) -> (f64, f64) {
    let r = a.middle - b.middle;
    let aa = a.half_axis.norm_squared();
    let bb = b.half_axis.norm_squared();
    let ar = a.half_axis.dot(&r);
    let br = b.half_axis.dot(&r);
    /// Squared length, m^2, below which a half axis counts as zero: (1 pm)^2.
    const TINY: f64 = 1e-24;
    if aa <= TINY && bb <= TINY {
        return (0.0, 0.0);
    }
    if aa <= TINY {
        return (0.0, (br / bb).clamp(-1.0, 1.0));
    }
    if bb <= TINY {
        return ((-ar / aa).clamp(-1.0, 1.0), 0.0);
    }
    let ab = a.half_axis.dot(&b.half_axis);
    let det = aa * bb - ab * ab;
    // If the segments are nearly parallel, any starting point on the first will do; its midpoint is the most stable.
    let s = if det > 1e-12 * aa * bb { ((ab * br - bb * ar) / det).clamp(-1.0, 1.0) } else { 0.0 };
    let t = (ab * s + br) / bb;
    if t < -1.0 {
        (((-ab - ar) / aa).clamp(-1.0, 1.0), -1.0)
    } else if t > 1.0 {
        (((ab - ar) / aa).clamp(-1.0, 1.0), 1.0)
    } else {
        (s, t)
    }
}

/// Squared distance of two segments.
pub(super) fn segments_squared(a: &Segment, b: &Segment) -> f64 {
    let (s, t) = nearest_parameters(a, b);
    (a.at(s) - b.at(t)).norm_squared()
}

/// Separation of two segments, or of points if a half axis is zero. If they cross, the normal is perpendicular to both.
pub(super) fn segments(a: Segment, b: Segment) -> Separation {
    let (s, t) = nearest_parameters(&a, &b);
    let points = [a.at(s), b.at(t)];
    let apart = points[1] - points[0];
    let distance = apart.norm();
    // Below this distance, meters, the direction between the points is rounding noise.
    if distance > 1e-12 {
        return Separation { distance, normal: apart / distance, points };
    }
    let both = a.half_axis.cross(&b.half_axis);
    let long = if a.half_axis.norm_squared() > b.half_axis.norm_squared() { a.half_axis } else { b.half_axis };
    let normal = match both.try_normalize(1e-12 * long.norm_squared().max(1e-300)) {
        Some(n) => n,
        None => across(&long),
    };
    Separation { distance: 0.0, normal, points: [points[0], points[0]] }
}

/// Separation of a point and a box with half edge lengths `half`; for a point inside, from the nearest face.
pub(super) fn point_box(point: Point3<f64>, half: &Vector3<f64>, world_from_box: &Isometry3<f64>) -> Separation {
    let p = world_from_box.inverse_transform_point(&point).coords;
    let nearest = Vector3::new(p.x.clamp(-half.x, half.x), p.y.clamp(-half.y, half.y), p.z.clamp(-half.z, half.z));
    let apart = nearest - p;
    let distance = apart.norm();
    if distance > 0.0 {
        return place(point, apart / distance, distance, world_from_box);
    }
    let room = half - p.abs();
    let face = room.imin();
    let mut outward = Vector3::zeros();
    outward[face] = if p[face] < 0.0 { -1.0 } else { 1.0 };
    place(point, -outward, -room[face], world_from_box)
}

/// Separation of a point and a cylinder along y; for a point inside, from the nearer of mantle and end.
pub(super) fn point_cylinder(
    point: Point3<f64>,
    half: f64,
    radius: f64,
    world_from_cylinder: &Isometry3<f64>,
) -> Separation {
    let p = world_from_cylinder.inverse_transform_point(&point).coords;
    let rho = p.x.hypot(p.z);
    let radial = if rho > 0.0 { Vector3::new(p.x / rho, 0.0, p.z / rho) } else { Vector3::x() };
    let end = Vector3::y() * if p.y < 0.0 { -1.0 } else { 1.0 };
    let out_radial = rho - radius;
    let out_axial = p.y.abs() - half;
    let (outward, distance) = if out_radial > 0.0 && out_axial > 0.0 {
        let distance = out_radial.hypot(out_axial);
        ((radial * out_radial + end * out_axial) / distance, distance)
    } else if out_radial > out_axial {
        (radial, out_radial)
    } else {
        (end, out_axial)
    };
    place(point, -outward, distance, world_from_cylinder)
}

/// Transforms a separation from the frame of the second core to the world.
fn place(point: Point3<f64>, local_normal: Vector3<f64>, distance: f64, world: &Isometry3<f64>) -> Separation {
    let normal = world.rotation * local_normal;
    Separation { distance, normal, points: [point, point + normal * distance] }
}

/// An arbitrary unit vector perpendicular to `axis`.
fn across(axis: &Vector3<f64>) -> Vector3<f64> {
    let least = axis.iamin();
    let mut e = Vector3::zeros();
    e[least] = 1.0;
    Unit::try_new(axis.cross(&e), 1e-300).map_or(Vector3::x(), Unit::into_inner)
}
