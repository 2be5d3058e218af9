//! Writes the objects of a world as XML that reads back to the same objects: the present state of a running world, as a
//! file to start from.

use super::{color, degrees, escape, heading, primitive, vector};
use crate::{Object, ObjectClass, Primitive};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::fmt::Write;

/// Writes the objects of a world as an XML file that [`crate::parse_world`] reads back to the same objects (poses
/// within rounding).
pub fn write_world<'a>(objects: impl IntoIterator<Item = &'a Object>) -> String {
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<WorldList version=\"1.0\">\n");
    for object in objects {
        let (pose, turned) = upright(object);
        let class = match object.class {
            ObjectClass::Obstacle => "obstacle",
            ObjectClass::Target => "target",
            ObjectClass::Ghost => "ghost",
        };
        let _ = write!(out, "  <object name=\"{}\" type=\"{class}\"", escape(&object.name));
        if object.persistent {
            out.push_str(" persistent=\"1\"");
        }
        out += &color(object.color);
        out.push_str(&vector(&pose.translation.vector, ["px", "py", "pz"]));
        let (h, angle) = heading(&pose.rotation);
        if h != Vector3::y() {
            out.push_str(&vector(&h, ["hx", "hy", "hz"]));
        }
        if angle != 0.0 {
            let _ = write!(out, " angle=\"{}\"", degrees(angle));
        }
        out.push_str(">\n");
        for shape in &object.shapes {
            let shape = Primitive { pose: turned * shape.pose, ..shape.clone() };
            let _ = writeln!(out, "    <{}/>", primitive(&shape, false));
        }
        out.push_str("  </object>\n");
    }
    out.push_str("</WorldList>\n");
    out
}

/// The object's pose in a form that the format can represent, and the transform of its shapes that compensates the
/// change: the format has no heading along -y, so the half turn is moved to the shapes.
fn upright(object: &Object) -> (Isometry3<f64>, Isometry3<f64>) {
    let h = object.pose.rotation * Vector3::y();
    if h.y < 0.0 && h.x.hypot(h.z) <= super::geometry::ZERO {
        let half = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let half = Isometry3::from_parts(Vector3::zeros().into(), half);
        (object.pose * half, half.inverse())
    } else {
        (object.pose, Isometry3::identity())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Shape, parse_world};

    fn object(name: &str, rotation: UnitQuaternion<f64>) -> Object {
        let at = Isometry3::from_parts(Vector3::new(0.1, -0.2, 0.3).into(), rotation);
        let part = |shape, x| Primitive { shape, pose: Isometry3::translation(x, 0.01, 0.02) };
        let shapes = vec![
            part(Shape::Sphere { radius: 0.05 }, 0.0),
            part(Shape::Cylinder { radius: 0.02, height: 0.3 }, 0.1),
            part(Shape::Box { size: Vector3::new(0.1, 0.2, 0.3) }, 0.2),
            part(Shape::Capsule { radius: 0.02, height: 0.1 }, -0.1),
        ];
        Object {
            name: name.into(),
            class: ObjectClass::Target,
            persistent: name == "a<b",
            pose: at,
            shapes,
            color: Some([1, 2, 3]),
        }
    }

    #[test]
    fn a_world_reads_back_as_it_was_written() {
        let turns =
            [[0.0, 0.0, 0.0], [0.4, -1.2, 2.9], [std::f64::consts::PI, 0.0, 0.0], [0.0, 0.0, -1.5], [0.0, 3.1, 0.0]];
        for turn in turns {
            let rotation = UnitQuaternion::from_euler_angles(turn[0], turn[1], turn[2]);
            let objects = [object("a<b", rotation), object("cup \"1\"", rotation.inverse())];
            let read = parse_world("written", &write_world(&objects)).unwrap();
            assert!(read.warnings.is_empty(), "{:?}", read.warnings);
            for (a, b) in objects.iter().zip(&read.value) {
                assert_eq!((&a.name, a.class, a.persistent, a.color), (&b.name, b.class, b.persistent, b.color));
                assert_eq!(a.shapes.len(), b.shapes.len());
                for (s, t) in a.shapes.iter().zip(&b.shapes) {
                    assert_eq!(s.shape, t.shape);
                    let s = a.pose * s.pose;
                    let t = b.pose * t.pose;
                    assert!((s.translation.vector - t.translation.vector).norm() < 1e-9, "{turn:?}");
                    // The direction of a shape's own axis may be reversed, which changes none of these shapes.
                    let u = s.rotation * Vector3::y();
                    let v = t.rotation * Vector3::y();
                    assert!(u.dot(&v).abs() > 1.0 - 1e-9, "{turn:?}");
                }
            }
        }
    }
}
