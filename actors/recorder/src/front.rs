//! Viewpoint of the 3D view: in front of the robots, far enough away that robots, near objects and the map are
//! visible.

use crate::traces::trail_markers;
use mobee_model::{Object, Primitive, Robot, Scene, Shape};
use nalgebra::{Isometry3, Point3, Vector3};

/// Size from which an object is ground or wall and does not move the viewpoint, meters.
const WALL_M: f64 = 3.0;
/// Distance from the robots and their reach beyond which an object does not move the viewpoint, meters.
const NEAR_M: f64 = 0.3;
/// Diagonal below which an object is framed as a whole, meters.
const SMALL_M: f64 = 1.0;
/// Tangent of half the viewer's vertical field of view, which is 55 degrees in Rerun.
const HALF_FIELD: f64 = 0.5206;
/// Width by height of the view: less than in the layout, so that a narrower window still shows everything.
const ASPECT: f64 = 1.2;
/// Share of the view that is used; the rest is margin.
const USED: f64 = 0.92;
/// Number of configurations from which the reach of the hands is determined.
const SAMPLES: usize = 400;

/// A viewpoint in front of the robots.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Front {
    /// Position of the viewpoint, meters.
    pub(crate) eye: [f32; 3],
    /// Point that it looks at, meters.
    pub(crate) target: [f32; 3],
    /// The world's direction to the viewer's right.
    pub(crate) right: [f32; 3],
    /// Height of the lowest shape, meters.
    pub(crate) floor: f32,
    frame: ViewExtent,
}

/// Extent of the content, as seen in one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ViewExtent {
    /// Right, up, and toward the viewer; of unit length.
    axes: [Vector3<f64>; 3],
    /// Extent toward the right, left, upper and lower plane of the view, meters.
    sides: [f64; 4],
    /// Start and end along the view, meters.
    depth: [f64; 2],
}

impl Front {
    /// Creates a viewpoint for the scene's robots at home, the reach of their hands, and the objects near them:
    /// a little to the side and above.
    ///
    /// A robot's markers (eyes, palms, tools) are on its front, so the mean of their positions relative to its
    /// root gives the direction. A robot without markers is assumed to face along x.
    pub(crate) fn of(scene: &Scene) -> Front {
        let reach = |(i, robot): (usize, &std::sync::Arc<Robot>)| hands(robot, &scene.base(i));
        let hands: Vec<Point3<f64>> = scene.robots().iter().enumerate().flat_map(reach).collect();
        Front::framing(scene, scene.home().iter().enumerate().map(|(i, q)| (i, q.to_vec())), &hands)
    }

    /// Creates a viewpoint for the first robot of the scene, moving through these configurations.
    pub(crate) fn of_motion(scene: &Scene, poses: impl Iterator<Item = Vec<f64>>) -> Front {
        Front::framing(scene, poses.map(|q| (0, q)), &[])
    }

    fn framing(scene: &Scene, poses: impl Iterator<Item = (usize, Vec<f64>)>, hands: &[Point3<f64>]) -> Front {
        let ahead: Vector3<f64> = scene.robots().iter().enumerate().map(|(i, r)| ahead(r, &scene.base(i))).sum();
        let ahead = Vector3::new(ahead.x, ahead.y, 0.0).try_normalize(0.02).unwrap_or_else(Vector3::x);
        let right = (-ahead).cross(&Vector3::z());
        let up: Vector3<f64> = 0.42 * Vector3::z();
        let toward = (ahead + 0.55 * right + up).normalize();
        let across = Vector3::z().cross(&toward).normalize();
        let mut frame = ViewExtent::empty([across, toward.cross(&across), toward]);
        let mut near = ContentBounds::default();
        let mut frames = Vec::new();
        for (i, q) in poses {
            let Some(robot) = scene.robots().get(i) else { continue };
            robot.forward_from(&scene.base(i), &q, &mut frames);
            for (node, at) in robot.nodes.iter().zip(&frames) {
                for Primitive { shape, pose } in &node.solids {
                    frame.shape(shape, &(at * pose));
                    near.shape(shape, &(at * pose));
                }
            }
        }
        for hand in hands {
            frame.point(hand);
            near.point(hand);
        }
        let floor = floor(scene);
        if let Some((low, high)) = near.0 {
            let edge = Vector3::repeat(NEAR_M);
            let around = (low - edge, high + edge);
            let parts = scene.objects().filter_map(|(_, object)| within(object, &around));
            parts.for_each(|(low, high)| corners(low, high).iter().for_each(|corner| frame.point(corner)));
        } else {
            corners(Point3::new(-0.5, -0.5, 0.0), Point3::new(0.5, 0.5, 1.0)).iter().for_each(|c| frame.point(c));
        }
        let (eye, target) = frame.eye();
        Front { eye: f32s(&eye), target: f32s(&target), right: f32s(&right), floor: floor as f32, frame }
    }

    /// Moves the viewpoint so that a box is visible, too, with room around it. Returns true if it had to move.
    pub(crate) fn include(&mut self, low: [f32; 3], high: [f32; 3]) -> bool {
        let [low, high] = [low, high].map(|p| Point3::from(p.map(f64::from)));
        if corners(low, high).iter().all(|corner| self.frame.sees(corner)) {
            return false;
        }
        // Room for later additions, so that a growing map moves the viewpoint only a few times.
        let room = 0.1 * (high - low);
        corners(low - room, high + room).iter().for_each(|corner| self.frame.point(corner));
        let (eye, target) = self.frame.eye();
        (self.eye, self.target) = (f32s(&eye), f32s(&target));
        true
    }

    /// Distance of the viewpoint from the point that it looks at, meters.
    pub(crate) fn distance(&self) -> f64 {
        let squares = self.eye.iter().zip(self.target).map(|(a, b)| f64::from(a - b).powi(2));
        squares.sum::<f64>().sqrt()
    }
}

impl ViewExtent {
    fn empty(axes: [Vector3<f64>; 3]) -> ViewExtent {
        ViewExtent { axes, sides: [f64::NEG_INFINITY; 4], depth: [f64::INFINITY, f64::NEG_INFINITY] }
    }

    /// Tangents of the view's half opening angles: to the sides, and up and down.
    fn opening() -> [f64; 2] {
        [USED * HALF_FIELD * ASPECT, USED * HALF_FIELD]
    }

    /// Normals of the right, left, upper and lower plane.
    fn normals(&self) -> [Vector3<f64>; 4] {
        let [right, up, back] = self.axes;
        let [wide, high] = ViewExtent::opening();
        [right + wide * back, wide * back - right, up + high * back, high * back - up]
    }

    fn point(&mut self, at: &Point3<f64>) {
        self.add(&|direction: &Vector3<f64>| at.coords.dot(direction));
    }

    fn shape(&mut self, shape: &Shape, at: &Isometry3<f64>) {
        self.add(&|direction: &Vector3<f64>| support(shape, at, direction));
    }

    /// Adds a shape, given by its extent in any direction.
    fn add(&mut self, extent: &dyn Fn(&Vector3<f64>) -> f64) {
        let normals = self.normals();
        for (side, normal) in self.sides.iter_mut().zip(normals) {
            *side = side.max(extent(&normal));
        }
        let [begin, end] = &mut self.depth;
        let [_, _, back] = self.axes;
        *begin = begin.min(-extent(&-back));
        *end = end.max(extent(&back));
    }

    /// The nearest viewpoint with all content within the view's planes, and the point in the middle that it
    /// looks at.
    fn eye(&self) -> (Vector3<f64>, Vector3<f64>) {
        let [wide, high] = ViewExtent::opening();
        let [a, b, c, d] = self.sides;
        let distance = ((a + b) / (2.0 * wide)).max((c + d) / (2.0 * high));
        let [right, up, back] = self.axes;
        let line = right * (0.5 * (a - b)) + up * (0.5 * (c - d));
        let [begin, end] = self.depth;
        let middle = (0.5 * (begin + end)).min(distance - 0.1);
        (line + back * distance, line + back * middle)
    }

    /// True if a point is within the view.
    fn sees(&self, at: &Point3<f64>) -> bool {
        let (eye, _) = self.eye();
        self.normals().iter().all(|normal| normal.dot(&(at.coords - eye)) <= 1e-9)
    }
}

/// Mean position of a robot's markers at home, relative to its root, meters.
fn ahead(robot: &Robot, base: &Isometry3<f64>) -> Vector3<f64> {
    let mut frames = Vec::new();
    robot.forward_from(base, &robot.home(), &mut frames);
    let places = robot.markers.iter().filter_map(|m| frames.get(m.node)).map(|f| f.translation.vector);
    places.map(|p| p - base.translation.vector).sum::<Vector3<f64>>() / robot.markers.len().max(1) as f64
}

/// Positions of a robot's hands: at home, and in random configurations within the limits.
fn hands(robot: &Robot, base: &Isometry3<f64>) -> Vec<Point3<f64>> {
    let markers = trail_markers(robot);
    let mut random = 1_u64;
    // A linear congruential generator: equal robots have equal viewpoints.
    let mut share = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as f64 / (1_u64 << 31) as f64
    };
    let mut places = Vec::new();
    let mut frames = Vec::new();
    for _ in 0..SAMPLES {
        let draw = |(min, max): (f64, f64)| min + share() * (max - min);
        let q: Vec<f64> = robot.motors.iter().map(mobee_model::Motor::range).map(draw).collect();
        robot.forward_from(base, &q, &mut frames);
        let at = markers.iter().filter_map(|m| frames.get(m.node)).map(|f| Point3::from(f.translation.vector));
        places.extend(at.filter(|p| p.coords.iter().all(|x| x.is_finite())));
    }
    places
}

/// Height of the lowest shape, except walls.
fn floor(scene: &Scene) -> f64 {
    let mut all = ContentBounds::default();
    for (i, (robot, q)) in scene.robots().iter().zip(scene.home()).enumerate() {
        let mut frames = Vec::new();
        robot.forward_from(&scene.base(i), &q, &mut frames);
        for (node, at) in robot.nodes.iter().zip(&frames) {
            node.solids.iter().for_each(|solid| all.shape(&solid.shape, &(at * solid.pose)));
        }
    }
    let objects = scene.objects().flat_map(|(_, o)| o.shapes.iter().map(move |s| (s.shape, o.pose * s.pose)));
    for (shape, at) in objects.filter(|(shape, _)| shape.bounding_radius() < WALL_M) {
        all.shape(&shape, &at);
    }
    all.0.map_or(0.0, |(low, _)| low.z)
}

/// Part of an object that is to be framed: a small one completely, if it meets the box, and of a large one the
/// part within the box. `None` if there is no such part, or the object is a wall.
fn within(object: &Object, around: &(Point3<f64>, Point3<f64>)) -> Option<(Point3<f64>, Point3<f64>)> {
    let mut bounds = ContentBounds::default();
    for Primitive { shape, pose } in object.shapes.iter().filter(|s| s.shape.bounding_radius() < WALL_M) {
        bounds.shape(shape, &(object.pose * pose));
    }
    let (low, high) = bounds.0?;
    let inner_low = low.sup(&around.0);
    let inner_high = high.inf(&around.1);
    let meets = inner_low.x <= inner_high.x && inner_low.y <= inner_high.y && inner_low.z <= inner_high.z;
    let framed = if (high - low).norm() < SMALL_M { (low, high) } else { (inner_low, inner_high) };
    meets.then_some(framed)
}

/// Extent of a shape in a direction of any length, meters times that length.
fn support(shape: &Shape, at: &Isometry3<f64>, direction: &Vector3<f64>) -> f64 {
    let length = direction.norm();
    let own = at.rotation.inverse() * direction / length.max(f64::MIN_POSITIVE);
    at.translation.vector.dot(direction) + length * shape.extent(&own)
}

fn corners(low: Point3<f64>, high: Point3<f64>) -> [Point3<f64>; 8] {
    let pick = |bit: usize, n: usize, a: f64, b: f64| if n & bit == 0 { a } else { b };
    std::array::from_fn(|n| {
        Point3::new(pick(1, n, low.x, high.x), pick(2, n, low.y, high.y), pick(4, n, low.z, high.z))
    })
}

#[derive(Default)]
struct ContentBounds(Option<(Point3<f64>, Point3<f64>)>);

impl ContentBounds {
    fn point(&mut self, at: &Point3<f64>) {
        let (low, high) = self.0.unwrap_or((*at, *at));
        self.0 = Some((low.inf(at), high.sup(at)));
    }

    fn shape(&mut self, shape: &Shape, at: &Isometry3<f64>) {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| {
            let middle = at.translation.vector.dot(&axis);
            support(shape, at, &axis) - middle
        });
        let middle = Point3::from(at.translation.vector);
        let half = Vector3::new(x, y, z);
        self.point(&(middle - half));
        self.point(&(middle + half));
    }
}

fn f32s(v: &Vector3<f64>) -> [f32; 3] {
    v.cast::<f32>().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::{ObjectClass, load_robot};
    use std::path::Path;
    use std::sync::Arc;

    /// Position of a point on the screen: 1 is the edge of a view that is no wider than [`ASPECT`].
    fn on_screen(front: &Front, at: &Point3<f64>) -> [f64; 2] {
        let [eye, target] = [front.eye, front.target].map(|p| Vector3::from(p.map(f64::from)));
        let forward = (target - eye).normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let to = at.coords - eye;
        let depth = to.dot(&forward);
        assert!(depth > 0.0, "behind the eye");
        [to.dot(&right) / (depth * HALF_FIELD * ASPECT), to.dot(&right.cross(&forward)) / (depth * HALF_FIELD)]
    }

    fn robot(name: &str) -> Arc<Robot> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots").join(name);
        Arc::new(load_robot(path).unwrap().value)
    }

    fn block(name: &str, at: [f64; 3], size: f64) -> Object {
        let shape = Shape::Box { size: Vector3::repeat(size) };
        Object {
            name: name.to_owned(),
            class: ObjectClass::Obstacle,
            persistent: false,
            pose: Isometry3::translation(at[0], at[1], at[2]),
            shapes: vec![Primitive { shape, pose: Isometry3::identity() }],
            color: None,
        }
    }

    fn front_of(robot: &Arc<Robot>, objects: Vec<Object>) -> Front {
        Front::of(&Scene::new(vec![(Arc::clone(robot), Isometry3::identity())], objects).unwrap())
    }

    #[test]
    fn robots_and_the_reach_of_their_hands_are_in_the_picture_and_fill_it() {
        for name in ["icub.xml", "ur5.xml", "panda.xml", "so101.xml", "katana.xml"] {
            let robot = robot(name);
            let front = front_of(&robot, Vec::new());
            let mut frames = Vec::new();
            robot.forward(&robot.home(), &mut frames);
            let mut points = hands(&robot, &Isometry3::identity());
            for (node, at) in robot.nodes.iter().zip(&frames) {
                for Primitive { shape, pose } in &node.solids {
                    let mut bounds = ContentBounds::default();
                    // Only the ends of the shape: everything between them is between them on the screen, too.
                    bounds.shape(&Shape::Sphere { radius: 0.0 }, &(at * pose));
                    assert!(shape.bounding_radius() > 0.0);
                    points.extend(bounds.0.map(|(low, _)| low));
                }
            }
            let all: Vec<[f64; 2]> = points.iter().map(|p| on_screen(&front, p)).collect();
            assert!(all.iter().flatten().all(|x| x.abs() <= 0.93), "{name}: {all:?}");
            let most = all.iter().flatten().fold(0.0_f64, |a, x| a.max(x.abs()));
            assert!(most > 0.75, "{name} is small: {most}");
        }
    }

    #[test]
    fn near_objects_are_in_the_picture_and_far_ones_and_walls_do_not_move_the_eye() {
        let robot = robot("katana.xml");
        let alone = front_of(&robot, Vec::new());
        let far = vec![block("far", [30.0, 0.0, 0.0], 0.5), block("ground", [0.0, 0.0, -5.0], 10.0)];
        let beside = front_of(&robot, far);
        assert_eq!((alone.eye, alone.target), (beside.eye, beside.target));
        let mut reach = ContentBounds::default();
        hands(&robot, &Isometry3::identity()).iter().for_each(|p| reach.point(p));
        let lowest = reach.0.map_or(0.0, |(low, _)| low.z);
        let block = block("near", [0.0, 0.0, lowest - 0.3], 0.2);
        let corner = block.pose * Point3::new(0.1, 0.1, -0.1);
        assert!(on_screen(&alone, &corner).iter().any(|x| x.abs() > 1.0), "else it proves nothing");
        let near = front_of(&robot, vec![block]);
        assert!(on_screen(&near, &corner).iter().all(|x| x.abs() <= 0.93));
    }

    #[test]
    fn a_map_that_grows_out_of_the_picture_moves_the_eye_and_one_within_does_not() {
        let mut front = front_of(&robot("katana.xml"), Vec::new());
        let before = front;
        assert!(!front.include([0.0; 3], [0.1; 3]));
        assert_eq!(front, before);
        let (low, high) = ([-0.1_f32, -0.1, 0.0], [1.5_f32, 1.0, 2.0]);
        assert!(front.include(low, high));
        let [low, high] = [low, high].map(|p| Point3::from(p.map(f64::from)));
        for corner in corners(low, high) {
            assert!(on_screen(&front, &corner).iter().all(|x| x.abs() <= 0.93), "{corner}");
        }
        let again = front;
        assert!(!front.include([-0.1, -0.1, 0.0], [1.52, 1.0, 2.0]), "there is room for a little more");
        assert_eq!(front, again);
    }
}
