//! Scenes for tests: the shipped robots, and generated robots with everything that a file can contain.

use mobee_model::{Hull, Object, ObjectClass, Primitive, Robot, Scene, Shape, load_robot, parse_robot};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::path::Path;
use std::sync::Arc;

/// Random numbers from 0 to 1; equal seeds give equal sequences.
pub struct Dice(pub u64);

impl Dice {
    pub fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.roll()
    }

    fn direction(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.between(-1.0, 1.0)).normalize()
    }

    pub fn pose(&mut self, within: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(self.direction() * self.between(0.0, 3.0));
        Isometry3::from_parts(Translation3::from(self.direction() * self.between(0.0, within)), turn)
    }

    pub fn shape(&mut self, kind: usize) -> Shape {
        let mut size = || self.between(0.02, 0.2);
        match kind % 4 {
            0 => Shape::Sphere { radius: size() / 2.0 },
            1 => Shape::Capsule { radius: size() / 2.0, height: size() },
            2 => Shape::Cylinder { radius: size() / 2.0, height: size() },
            _ => Shape::Box { size: Vector3::from_fn(|_, _| size()) },
        }
    }
}

pub fn shipped(name: &str) -> Arc<Robot> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../configs/robots/{name}.xml"));
    Arc::new(load_robot(path).expect("the robot loads").value)
}

pub fn alone(robot: Arc<Robot>) -> Scene {
    Scene::new(vec![(robot, Isometry3::identity())], Vec::new()).expect("a scene")
}

/// A robot of three arms on a base: revolute joints about any axis, prismatic joints, motors with several joints, and
/// on each link shapes of all kinds.
pub fn made_up(name: &str, seed: u64) -> Arc<Robot> {
    let mut dice = Dice(seed);
    let mut text = format!("<ZeroPositionKinematicTree robotName=\"{name}\">");
    for arm in 0..3 {
        text += &format!("<bodypart name=\"arm{arm}\">");
        let mut end = String::from("</bodypart>");
        for joint in 0..5 {
            let offset = dice.direction() * dice.between(0.05, 0.3);
            let axis = dice.direction();
            // Right angles, as in most robots, and arbitrary ones.
            let axis = if dice.roll() < 0.5 { Vector3::ith(joint % 3, 1.0) } else { axis };
            // The last joint of an arm follows the motor of the one before.
            let motor = if joint == 4 { 3 } else { joint };
            let slides = joint == 2 && arm == 1;
            let limits = if slides { "minPos=\"-100\" maxPos=\"150\"" } else { "minPos=\"-110\" maxPos=\"170\"" };
            let (own, kind) = match (slides, joint) {
                (true, _) => ("minPos=\"-0.1\" maxPos=\"0.15\"", "type=\"prismatic\""),
                (false, 4) => ("minPos=\"-20\" maxPos=\"60\"", ""),
                _ => ("minPos=\"-110\" maxPos=\"170\"", ""),
            };
            let shape = |dice: &mut Dice, kind: usize| {
                let p = dice.direction() * 0.05;
                let h = dice.direction();
                let place = format!(
                    "px=\"{}\" py=\"{}\" pz=\"{}\" hx=\"{}\" hy=\"{}\" hz=\"{}\"",
                    p.x, p.y, p.z, h.x, h.y, h.z
                );
                written(&dice.shape(kind), &place)
            };
            let shapes: String = (0..1 + joint % 3).map(|i| shape(&mut dice, arm + joint + i)).collect();
            text += &format!(
                "<link x=\"{}\" y=\"{}\" z=\"{}\"><motor name=\"m{arm}{motor}\" {limits} {kind}>\
                 <joint x=\"{}\" y=\"{}\" z=\"{}\" {own} {kind}>\
                 <link x=\"{}\" y=\"{}\" z=\"{}\" radius=\"0.02\">{shapes}",
                offset.x, offset.y, offset.z, axis.x, axis.y, axis.z, offset.y, offset.z, offset.x
            );
            end = format!("</link></joint></motor></link>{end}");
        }
        text += &end;
    }
    text += "</ZeroPositionKinematicTree>";
    Arc::new(parse_robot("made_up.xml", &text).expect("a robot").value)
}

/// The same robot with hulls inside most of its shapes, which are then the only solid parts.
pub fn hulled(robot: &Robot, seed: u64) -> Arc<Robot> {
    const RADIUS: f64 = 0.002;
    let mut dice = Dice(seed);
    let mut robot = robot.clone();
    for node in &mut robot.nodes {
        for (i, solid) in node.solids.iter().enumerate().filter(|(i, _)| i % 3 < 2) {
            let far = solid.shape.bounding_radius();
            let within = |p: &Vector3<f64>| solid.shape.depth(p) >= RADIUS;
            let points = std::iter::repeat_with(|| dice.direction() * dice.roll() * far).filter(within).take(12);
            let hull = Hull::new(points.map(|p| solid.pose * Point3::from(p)).collect(), RADIUS).expect("a hull");
            node.hulls.insert(i, Arc::new(hull));
        }
    }
    Arc::new(robot)
}

/// A free body of one shape, moved by three prismatic and three revolute joints, beside an obstacle of another shape.
pub fn two_shapes(dice: &mut Dice, kinds: (usize, usize)) -> Scene {
    let slide = "minPos=\"-2000\" maxPos=\"2000\" type=\"prismatic\"";
    let turn = "minPos=\"-180\" maxPos=\"180\"";
    let mut text = String::from("<ZeroPositionKinematicTree robotName=\"body\"><bodypart name=\"p\">");
    let mut end = String::from("</bodypart><pairs></pairs></ZeroPositionKinematicTree>");
    for (i, axis) in ["x", "y", "z", "x", "y", "z"].iter().enumerate() {
        let (motor, joint) =
            if i < 3 { (slide, "minPos=\"-2\" maxPos=\"2\" type=\"prismatic\"") } else { (turn, turn) };
        text += &format!("<motor name=\"m{i}\" {motor}><joint {axis}=\"1\" {joint}>");
        end = format!("</joint></motor>{end}");
    }
    text += &format!("<link x=\"0.001\">{}</link>{end}", written(&dice.shape(kinds.0), ""));
    let robot = Arc::new(parse_robot("body.xml", &text).expect("a robot").value);
    let shapes = vec![Primitive { shape: dice.shape(kinds.1), pose: dice.pose(0.05) }];
    let other = object("other".into(), dice.pose(0.3), shapes);
    Scene::new(vec![(robot, Isometry3::identity())], vec![other]).expect("a scene")
}

/// The element of a shape in a robot file, with the attributes of its pose.
fn written(shape: &Shape, place: &str) -> String {
    match *shape {
        Shape::Sphere { radius } => format!("<sphere radius=\"{radius}\" {place}/>"),
        Shape::Capsule { radius, height } => format!("<capsule radius=\"{radius}\" height=\"{height}\" {place}/>"),
        Shape::Cylinder { radius, height } => format!("<cylinder radius=\"{radius}\" height=\"{height}\" {place}/>"),
        Shape::Box { size } => {
            format!("<box width=\"{}\" height=\"{}\" depth=\"{}\" {place}/>", size.x, size.y, size.z)
        }
    }
}

/// Obstacles of all kinds about the origin, and a table.
pub fn obstacles(seed: u64, count: usize) -> Vec<Object> {
    let mut dice = Dice(seed);
    let mut objects: Vec<Object> = (0..count)
        .map(|i| {
            let shapes = vec![Primitive { shape: dice.shape(i), pose: dice.pose(0.1) }];
            object(format!("o{i}"), dice.pose(1.0), shapes)
        })
        .collect();
    let top = Primitive { shape: Shape::Box { size: Vector3::new(1.0, 1.5, 0.04) }, pose: Isometry3::identity() };
    objects.push(object("table".into(), Isometry3::translation(0.7, 0.0, -0.2), vec![top]));
    objects
}

fn object(name: String, pose: Isometry3<f64>, shapes: Vec<Primitive>) -> Object {
    Object { name, class: ObjectClass::Obstacle, persistent: false, pose, shapes, color: None }
}
