//! Whether the eyes have the object before them, where it is thought to be: what is not seen then is not there any more.

use super::look::Gaze;
use mobee_contract::View;
use mobee_model::{Edit, Object, ObjectClass, Primitive, Shape, ShapeId, distance};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// What is no farther than this from the middle of an eye's picture is well inside it, rad (18 degrees).
const INSIDE: f64 = std::f64::consts::PI / 10.0;
/// A line of sight: how wide it is, and how far from the eye and from the object's middle what is near does not hide anything, meters.
const RADIUS: f64 = 0.03;
const ENDS: [f64; 2] = [0.12, 0.06];
/// What it is called while it is looked at as an object.
const NAME: &str = "line of sight";

impl Gaze {
    /// Whether all eyes look at a place, and nothing that the model knows is between: no body of a robot, no other object.
    pub fn faces(&self, object: &str, place: Vector3<f64>, view: &View) -> bool {
        let is_open = |(eye, toward): (Point3<f64>, Vector3<f64>)| {
            let way = place - eye.coords;
            let is_inside = toward.angle(&way) <= INSIDE;
            is_inside && line(eye, way).is_some_and(|line| is_clear(&line, object, view))
        };
        let mut eyes = self.eyes(view.pose()).peekable();
        eyes.peek().is_some() && eyes.all(is_open)
    }
}

fn line(eye: Point3<f64>, way: Vector3<f64>) -> Option<Primitive> {
    let (far, toward) = (way.norm(), way.try_normalize(1e-9)?);
    let [from, to] = [ENDS[0], far - ENDS[1]];
    let height = to - from - 2.0 * RADIUS;
    // capsules lie along y
    let turned = UnitQuaternion::rotation_between(&Vector3::y(), &toward)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let middle = Translation3::from(eye.coords + toward * ((from + to) / 2.0));
    let shape = Shape::Capsule { radius: RADIUS, height };
    (height > 0.0).then(|| Primitive { shape, pose: Isometry3::from_parts(middle, turned) })
}

fn is_clear(line: &Primitive, object: &str, view: &View) -> bool {
    let hides = |o: &Object| {
        let near = |p: &Primitive| distance(&line.shape, &line.pose, &p.shape, &(o.pose * p.pose)).distance;
        o.name != object && o.shapes.iter().any(|p| near(p) < 0.0)
    };
    if view.scene.objects().any(|(_, o)| hides(o)) {
        return false;
    }
    let own = Object {
        name: NAME.to_owned(),
        class: ObjectClass::Obstacle,
        persistent: false,
        pose: line.pose,
        shapes: vec![Primitive { shape: line.shape, pose: Isometry3::identity() }],
        color: None,
    };
    let Ok(scene) = view.scene.edit(&Edit::Add(own)) else { return false };
    let Some((number, _)) = scene.object(NAME) else { return false };
    // an object is always the second of a pair
    let is_line = |shape: ShapeId| matches!(shape, ShapeId::Object { object, .. } if object == number);
    !scene.contacts(&view.poses, 0.0).iter().any(|c| is_line(c.pair.1))
}
