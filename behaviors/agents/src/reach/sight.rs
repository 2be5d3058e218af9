//! Visibility of the object's position: an object that is not detected although the eyes face its
//! position is no longer there.

use super::look::Gaze;
use mobee_contract::View;
use mobee_model::{Edit, Object, ObjectClass, Primitive, Shape, ShapeId, distance};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// Maximum angle from the optical axis of an eye at which a point is well inside its image, rad (18
/// degrees).
const MAX_VIEW_ANGLE_RAD: f64 = std::f64::consts::PI / 10.0;
/// Radius of a line of sight, meters.
const SIGHT_RADIUS_M: f64 = 0.03;
/// Lengths at the eye's and at the object's end of a line of sight that are not checked for occlusion, meters.
const UNCHECKED_ENDS_M: [f64; 2] = [0.12, 0.06];
/// Name of the line of sight while it is checked as an object of a scene.
const SIGHT_NAME: &str = "line of sight";

impl Gaze {
    /// Returns whether all eyes face a position and the model has nothing in between: no body of a
    /// robot, and no other object.
    pub fn faces(&self, object: &str, place: Vector3<f64>, view: &View) -> bool {
        let is_open = |(eye, toward): (Point3<f64>, Vector3<f64>)| {
            let way = place - eye.coords;
            let is_inside = toward.angle(&way) <= MAX_VIEW_ANGLE_RAD;
            is_inside && line(eye, way).is_some_and(|line| is_clear(&line, object, view))
        };
        let mut eyes = self.eyes(view.pose()).peekable();
        eyes.peek().is_some() && eyes.all(is_open)
    }
}

fn line(eye: Point3<f64>, way: Vector3<f64>) -> Option<Primitive> {
    let far = way.norm();
    let toward = way.try_normalize(1e-9)?;
    let [from, to] = [UNCHECKED_ENDS_M[0], far - UNCHECKED_ENDS_M[1]];
    let height = to - from - 2.0 * SIGHT_RADIUS_M;
    // Capsules are aligned with the y axis.
    let turned = UnitQuaternion::rotation_between(&Vector3::y(), &toward)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let middle = Translation3::from(eye.coords + toward * ((from + to) / 2.0));
    let shape = Shape::Capsule { radius: SIGHT_RADIUS_M, height };
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
        name: SIGHT_NAME.to_owned(),
        class: ObjectClass::Obstacle,
        persistent: false,
        pose: line.pose,
        shapes: vec![Primitive { shape: line.shape, pose: Isometry3::identity() }],
        color: None,
    };
    let Ok(scene) = view.scene.edit(&Edit::Add(own)) else { return false };
    let Some((number, _)) = scene.object(SIGHT_NAME) else { return false };
    // An object is always the second element of a pair.
    let is_line = |shape: ShapeId| matches!(shape, ShapeId::Object { object, .. } if object == number);
    !scene.contacts(&view.poses, 0.0).iter().any(|c| is_line(c.pair.1))
}
