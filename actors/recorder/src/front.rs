//! Where to look from: a robot's front, found from what its file says.

use mobee_model::{Object, Robot, Scene, Shape};
use nalgebra::{Isometry3, Point3, Vector3};

/// An object wider than this is ground or wall and does not move the camera, meters.
const WALL: f64 = 3.0;

/// A camera before the robots.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Front {
    /// Where the eye is, meters.
    pub(crate) eye: [f32; 3],
    /// What it looks at, meters.
    pub(crate) target: [f32; 3],
    /// The world's direction to the viewer's right.
    pub(crate) right: [f32; 3],
    /// Height of the lowest thing, meters.
    pub(crate) floor: f32,
}

impl Front {
    /// A camera before the scene's robots at home, a little to the side and above.
    ///
    /// A robot's markers (eyes, palms, tools) are on its front: the mean of their places, seen from its root, says where that
    /// is. A robot without markers is taken to look along x.
    pub(crate) fn of(scene: &Scene) -> Front {
        let (mut bounds, mut floor) = (Bounds::default(), Bounds::default());
        let mut ahead = Vector3::zeros();
        for (i, robot) in scene.robots().iter().enumerate() {
            ahead += look(robot, &scene.base(i), &mut bounds);
        }
        for (_, object) in scene.objects() {
            floor.object(object);
        }
        ahead.z = 0.0;
        let ahead = ahead.try_normalize(0.02).unwrap_or_else(Vector3::x);
        let right = (-ahead).cross(&Vector3::z());
        let (low, high) = bounds.ends();
        let floor = floor.0.map_or(low.z, |(lowest, _)| lowest.z.min(low.z));
        let (middle, size) = (nalgebra::center(&low, &high), (high - low).norm().max(0.3));
        let direction: Vector3<f64> = ahead + 0.55 * right + 0.42 * Vector3::z();
        let eye = middle + direction.normalize() * (1.05 * size);
        Front { eye: f32s(&eye.coords), target: f32s(&middle.coords), right: f32s(&right), floor: floor as f32 }
    }

    /// How far the eye is from what it looks at, meters.
    pub(crate) fn distance(&self) -> f64 {
        let squares = self.eye.iter().zip(self.target).map(|(a, b)| f64::from(a - b).powi(2));
        squares.sum::<f64>().sqrt()
    }
}

/// Where a robot looks, as far as its markers tell; widens the bounds by its shapes.
fn look(robot: &Robot, base: &Isometry3<f64>, bounds: &mut Bounds) -> Vector3<f64> {
    let mut frames = Vec::new();
    robot.forward_from(base, &robot.home(), &mut frames);
    for (node, frame) in robot.nodes.iter().zip(&frames) {
        for solid in &node.solids {
            bounds.ball(frame * solid.pose * Point3::origin(), solid.shape.bounding_radius());
        }
    }
    let places = robot.markers.iter().filter_map(|m| frames.get(m.node)).map(|f| f.translation.vector);
    let markers = robot.markers.len().max(1) as f64;
    places.map(|p| p - base.translation.vector).sum::<Vector3<f64>>() / markers
}

#[derive(Default)]
struct Bounds(Option<(Point3<f64>, Point3<f64>)>);

impl Bounds {
    fn ball(&mut self, at: Point3<f64>, radius: f64) {
        let r = Vector3::repeat(radius);
        let (low, high) = self.0.unwrap_or((at - r, at + r));
        self.0 = Some((low.inf(&(at - r)), high.sup(&(at + r))));
    }

    fn object(&mut self, object: &Object) {
        for shape in object.shapes.iter().filter(|s| s.shape.bounding_radius() < WALL) {
            let half = match shape.shape {
                Shape::Box { size } => 0.5 * size,
                other => Vector3::repeat(other.bounding_radius()),
            };
            let at = object.pose * shape.pose * Point3::origin();
            self.ball(at - half, 0.0);
            self.ball(at + half, 0.0);
        }
    }

    fn ends(&self) -> (Point3<f64>, Point3<f64>) {
        self.0.unwrap_or((Point3::new(-0.5, -0.5, 0.0), Point3::new(0.5, 0.5, 1.0)))
    }
}

fn f32s(v: &Vector3<f64>) -> [f32; 3] {
    v.cast::<f32>().into()
}
