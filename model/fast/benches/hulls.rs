//! Edges of a robot with hulls inside its shapes, as `mobee model convert` creates them if shapes around meshes have
//! false contacts: the shipped Panda with a hull in each shape, among 20 obstacles, compared with the same without
//! hulls.
//!
//! ```text
//! cargo bench -p mobee-fast --bench hulls
//! ```
#![allow(clippy::disallowed_methods)] // a measurement of the processor

use mobee_fast::FastScene;
use mobee_model::{Hull, Object, ObjectClass, Primitive, Robot, Scene, Shape, load_robot, random_poses};
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Length of an edge, rad (Euclidean norm), and number of edges.
const STEP: f64 = 1.0;
const EDGES: usize = 224;
/// Number of corners of a hull, and its radius, meters.
const CORNERS: usize = 60;
const RADIUS: f64 = 0.002;
const ROUNDS: usize = 3;

fn main() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/panda.xml");
    let bare = load_robot(file).expect("the robot loads").value;
    let hulled = hulled(&bare);
    println!("{EDGES} edges of {STEP} rad, one at a time, us, least of {ROUNDS}: median, mean; intervals; questions");
    for (name, robot) in [("shapes", bare), ("hulls", hulled)] {
        measure(name, Arc::new(robot));
    }
}

/// The same robot with a hull inside each shape that nearly fills it.
fn hulled(robot: &Robot) -> Robot {
    let mut robot = robot.clone();
    for node in &mut robot.nodes {
        for (i, solid) in node.solids.iter().enumerate() {
            let far = solid.shape.bounding_radius();
            // Points on a spiral about the ball, each moved inward until it is inside the shape.
            let corner = |k: usize| {
                let z = 1.0 - 2.0 * (k as f64 + 0.5) / CORNERS as f64;
                let (sine, cosine) = (2.399_963 * k as f64).sin_cos();
                let out = (1.0 - z * z).sqrt();
                let toward = Vector3::new(out * cosine, z, out * sine);
                (0..100).map(|s| toward * far * (1.0 - f64::from(s) / 100.0)).find(|p| solid.shape.depth(p) >= RADIUS)
            };
            let corners: Vec<Point3<f64>> =
                (0..CORNERS).filter_map(corner).map(|p| solid.pose * Point3::from(p)).collect();
            if let Ok(hull) = Hull::new(corners, RADIUS) {
                node.hulls.insert(i, Arc::new(hull));
            }
        }
    }
    robot
}

fn obstacles() -> Vec<Object> {
    let ball = |i: usize| {
        let angle = 2.399_963 * i as f64;
        let far = 0.35 + 0.02 * i as f64;
        let shape = if i.is_multiple_of(2) {
            Shape::Sphere { radius: 0.06 }
        } else {
            Shape::Box { size: Vector3::new(0.3, 0.3, 0.03) }
        };
        Object {
            name: format!("o{i}"),
            class: ObjectClass::Obstacle,
            persistent: false,
            pose: Isometry3::translation(far * angle.cos(), far * angle.sin(), 0.1 + 0.04 * i as f64),
            shapes: vec![Primitive { shape, pose: Isometry3::identity() }],
            color: None,
        }
    };
    (0..20).map(ball).collect()
}

fn measure(name: &str, robot: Arc<Robot>) {
    let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], obstacles()).expect("a scene");
    let mut fast = FastScene::new(&scene, 0.0).expect("it compiles");
    let mut poses = random_poses(&robot, 46);
    let mut free = Vec::new();
    let mut edges = Vec::new();
    while edges.len() < EDGES {
        let (Some(from), Some(to)) = (poses.next(), poses.next()) else { break };
        if !scene.free(&[&from], 0.0) {
            continue;
        }
        let far = from.iter().zip(&to).map(|(a, b)| (b - a).powi(2)).sum::<f64>().sqrt();
        let share = (STEP / far).min(1.0);
        let end: Vec<f64> = from.iter().zip(&to).map(|(a, b)| a + (b - a) * share).collect();
        edges.push([from, end].concat());
    }
    // Blocked, free: times, intervals and calls of the scalar engine.
    let mut all = [const { (Vec::new(), 0, 0) }; 2];
    for edge in &edges {
        let before = fast.figures();
        let times = (0..ROUNDS).map(|_| {
            let start = Instant::now();
            fast.edges_free(edge, &mut free).expect("a whole edge");
            start.elapsed().as_secs_f64()
        });
        let least = times.fold(f64::INFINITY, f64::min);
        let (times, intervals, stuck) = &mut all[usize::from(free == [true])];
        times.push(least * 1e6);
        *intervals += (fast.figures().intervals - before.intervals) / ROUNDS as u64;
        *stuck += (fast.figures().stuck - before.stuck) / ROUNDS as u64;
    }
    for (kind, (mut times, intervals, stuck)) in ["blocked", "free"].into_iter().zip(all) {
        let count = times.len().max(1);
        times.sort_by(f64::total_cmp);
        let mean = times.iter().sum::<f64>() / count as f64;
        let median = times.get(count / 2).copied().unwrap_or(f64::NAN);
        let each = |sum: u64| sum as f64 / count as f64;
        println!("{name}, {count} {kind}: {median:.1}, {mean:.1}; {:.1}; {:.1}", each(intervals), each(stuck));
    }
}
