//! Shapes and their orientations in the notation of the format.
//!
//! A pose is a position, a *heading* (the direction of the shape's own y axis) and a rotation about that heading. A
//! heading determines two angles and leaves the roll open; the original's choice of the roll is part of the format,
//! since it matters for boxes.

use super::element::Element;
use crate::{Hull, Primitive, Shape};
use mobee_text::FileError;
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

/// Length of a direction below which it counts as zero.
pub(super) const ZERO: f64 = 1e-12;

/// The attributes of a pose: position in meters, heading without unit, angle in degrees.
pub(super) const POSE: &[&str] = &["px", "py", "pz", "hx", "hy", "hz", "angle"];

/// The rotation that maps local y to heading `h`, with the roll of the original format, followed by `angle` (rad) about
/// `h`.
///
/// For `h` along -y the original uses a point reflection; this function uses the identity, which is equivalent for
/// these shapes.
pub(super) fn orientation(h: &Vector3<f64>, angle: f64) -> UnitQuaternion<f64> {
    let Some(h) = Unit::try_new(*h, ZERO) else {
        return UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
    };
    let side = h.x.hypot(h.z);
    let heading = if side > ZERO {
        // The rotation about y is never negative, regardless of the sign of h.z: a quirk of the format.
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), h.z.abs().atan2(h.x));
        let axis = Unit::new_normalize(Vector3::new(h.z, 0.0, -h.x));
        UnitQuaternion::from_axis_angle(&axis, side.atan2(h.y)) * turn
    } else {
        UnitQuaternion::identity()
    };
    UnitQuaternion::from_axis_angle(&h, angle) * heading
}

/// `parent_from_here` from the attributes `px py pz hx hy hz angle`.
pub(super) fn pose(e: &Element) -> Result<Isometry3<f64>, FileError> {
    let at = e.vector(["px", "py", "pz"])?;
    let h = e.vector(["hx", "hy", "hz"])?;
    let angle = e.number_or_zero("angle")?.to_radians();
    Ok(Isometry3::from_parts(Translation3::from(at), orientation(&h, angle)))
}

/// The attributes of a shape's element, besides the pose; `None` if the element is not a shape.
pub(super) fn shape_attributes(name: &str) -> Option<&'static [&'static str]> {
    match name {
        "sphere" => Some(&["radius"]),
        "cylinder" | "capsule" => Some(&["radius", "height"]),
        "box" => Some(&["width", "height", "depth"]),
        _ => None,
    }
}

/// Reads a `sphere`, `cylinder`, `box` or `capsule` element.
pub(super) fn primitive(e: &Element) -> Result<Primitive, FileError> {
    let shape = match e.name.as_str() {
        "sphere" => Shape::Sphere { radius: e.size("radius")? },
        "cylinder" => Shape::Cylinder { radius: e.size("radius")?, height: e.size("height")? },
        "capsule" => Shape::Capsule { radius: e.size("radius")?, height: e.size("height")? },
        _ => Shape::Box { size: Vector3::new(e.size("width")?, e.size("height")?, e.size("depth")?) },
    };
    Ok(Primitive { shape, pose: pose(e)? })
}

/// The hull attributes of a collision shape.
pub(super) const HULL: &[&str] = &["hull", "hullRadius"];

/// The hull of a shape, if its element defines one: points in the node's frame and a radius, meters.
pub(super) fn hull(e: &Element, around: &Primitive) -> Result<Option<Hull>, FileError> {
    if e.get("hull").is_none() {
        return Ok(None);
    }
    let numbers = e.numbers("hull")?;
    if !numbers.len().is_multiple_of(3) {
        let message = format!("`hull` holds {} numbers, which is no multiple of three", numbers.len());
        return Err(e.error_at("hull", message, "write x, y and z of each point, in meters, in the node's frame"));
    }
    let points = numbers.as_chunks().0.iter().map(|[x, y, z]| Point3::new(*x, *y, *z)).collect();
    let radius = e.optional_size("hullRadius")?.unwrap_or(0.0);
    let help = "leave out `hull` and `hullRadius`: then all of the shape is solid";
    let hull = Hull::new(points, radius).map_err(|why| e.error_at("hull", format!("the hull {why}"), help))?;
    if !hull.is_within(&around.shape, &around.pose) {
        let message = format!("the hull sticks out of its <{}>, and what sticks out would not be seen", e.written);
        return Err(e.error_at("hull", message, format!("make the shape larger, or {help}")));
    }
    Ok(Some(hull))
}

/// The cylinder (or capsule) of length `height` that `radius` and `field` add to a link or joint: along `axis`,
/// centered at `center`.
pub(super) fn automatic(
    radius: f64,
    height: f64,
    axis: &Vector3<f64>,
    center: Vector3<f64>,
    capsule: bool,
) -> Primitive {
    let shape = if capsule { Shape::Capsule { radius, height } } else { Shape::Cylinder { radius, height } };
    Primitive { shape, pose: Isometry3::from_parts(Translation3::from(center), orientation(axis, 0.0)) }
}
