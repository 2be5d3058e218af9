//! Promise: if a shape has a hull, the hull decides contacts, and the shape only rejects pairs early.

use mobee_model::{
    Collider, Engine, Hull, Near, Robot, ScalarEngine, Scene, Shape, Watch, distance, parse_robot, random_poses,
    write_robot,
};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// The corners of a box about the origin.
fn corners(size: &Vector3<f64>) -> Vec<Point3<f64>> {
    let sign = |i: usize, k: usize| if i >> k & 1 == 0 { -0.5 } else { 0.5 };
    (0..8).map(|i| Point3::from(Vector3::from_fn(|k, _| sign(i, k) * size[k]))).collect()
}

fn anywhere(rng: &mut ChaCha8Rng, within: f64) -> Isometry3<f64> {
    let mut at = || Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
    Isometry3::from_parts(Translation3::from(at() * within), UnitQuaternion::from_scaled_axis(at() * 3.0))
}

/// A box with a smaller hull somewhere inside.
fn boxed_box(rng: &mut ChaCha8Rng, frame: usize) -> (Collider, Shape, Isometry3<f64>, f64) {
    let size = Vector3::from_fn(|_, _| rng.random_range(0.02..0.2));
    let radius = rng.random_range(0.0..0.01);
    let pose = anywhere(rng, 0.02);
    let hull = Hull::new(corners(&size), radius).unwrap().moved(&pose);
    let around = Shape::Sphere { radius: size.norm() / 2.0 + radius };
    let collider = Collider::new(around, frame, pose).with_hull(Some(Arc::new(hull)));
    (collider, Shape::Box { size }, pose, radius)
}

#[test]
fn a_hull_of_a_box_is_as_far_as_the_box() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut apart, mut deep) = (0, 0);
    for i in 0..2000 {
        let (a, box_a, in_a, radius_a) = boxed_box(&mut rng, 0);
        let (b, box_b, in_b, radius_b) = boxed_box(&mut rng, 1);
        let frames = [anywhere(&mut rng, 0.1), anywhere(&mut rng, 0.1)];
        let engine = ScalarEngine::prepare(&[a, b]);
        let mut placement = Default::default();
        engine.place(&frames, &mut placement);
        let truth = distance(&box_a, &(frames[0] * in_a), &box_b, &(frames[1] * in_b)).distance - radius_a - radius_b;
        let Near::Within(near) = engine.near(&placement, (0, 1), 10.0) else { panic!("within ten meters") };
        let (least, most) = (truth - if truth > 0.0 { 1e-7 } else { 1e-5 }, truth + 1e-7);
        assert!((least..=most).contains(&near.distance), "{i}: {} and not {truth}", near.distance);
        assert_eq!(engine.touches(&placement, (0, 1), 0.0), near.distance <= 0.0, "{i}");
        if let Near::Beyond(bound) = engine.near(&placement, (0, 1), 0.005) {
            assert!(bound <= truth + 1e-7 && truth > 0.005 - 1e-7, "{i}: {bound} is above {truth}");
        }
        *(if truth > 0.0 { &mut apart } else { &mut deep }) += 1;
    }
    assert!(apart > 200 && deep > 200, "both kinds: {apart} {deep}");
}

/// Two arms that meet; only a wedge of each link's box is solid.
fn wedges() -> Robot {
    let arm = |name: &str, at: &str| {
        let hull = "hull=\"0 -0.02 -0.02 0.2 -0.02 -0.02 0.2 0.02 -0.02 0 0.02 -0.02 0.1 0 0.02\" hullRadius=\"0.001\"";
        let solid = format!("<box px=\"0.1\" width=\"0.21\" height=\"0.05\" depth=\"0.05\" {hull}/>");
        format!(
            "<bodypart name=\"{name}\"><link {at}><motor name=\"{name}1\"><joint z=\"1\" length=\"0.01\" minPos=\"-90\" \
             maxPos=\"90\"><link x=\"0.2\">{solid}<motor name=\"{name}2\"><joint y=\"1\" length=\"0.01\" minPos=\"-120\" \
             maxPos=\"120\"><link x=\"0.2\">{solid}</link></joint></motor></link></joint></motor></link></bodypart>"
        )
    };
    let (one, other) = (arm("a", "y=\"0.1\""), arm("b", "y=\"-0.1\""));
    let motors =
        |name: &str| [1, 2].map(|i| format!("<motor name=\"{name}{i}\" minPos=\"-110\" maxPos=\"110\"/>")).concat();
    let lists = ["a", "b"].map(|name| format!("<bodypart name=\"{name}\">{}</bodypart>", motors(name))).concat();
    let text =
        format!("<ZeroPositionKinematicTree robotName=\"wedges\">{lists}{one}{other}</ZeroPositionKinematicTree>");
    parse_robot("wedges.xml", &text).unwrap().value
}

#[test]
fn hulls_free_poses_and_every_query_says_so() {
    let robot = wedges();
    assert_eq!(robot.nodes.iter().map(|n| n.hulls.len()).sum::<usize>(), 4);
    let mut bare = robot.clone();
    bare.nodes.iter_mut().for_each(|n| n.hulls.clear());
    let scene = |robot: &Robot| Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new()).unwrap();
    let (with, without) = (scene(&robot), scene(&bare));
    let mut watch = Watch::new(Arc::new(with.clone()), 0.01);
    let (mut freed, mut free) = (0, 0);
    let mut last = robot.home();
    for q in random_poses(&robot, 3).take(300) {
        for part in 1..=10 {
            let q: Vec<f64> = last.iter().zip(&q).map(|(a, b)| a + (b - a) * f64::from(part) / 10.0).collect();
            let contacts = with.contacts(&[&q], 0.01);
            assert_eq!(watch.update(&[&q]), contacts, "a stream of poses is judged as each alone");
            assert!(!without.free(&[&q], 0.0) || with.free(&[&q], 0.0), "a hull never makes a contact");
            assert_eq!(with.free(&[&q], 0.0), with.contacts(&[&q], 0.0).is_empty());
            assert_eq!(with.free(&[&q], 0.0), with.report(&[&q]).is_empty());
            freed += usize::from(with.free(&[&q], 0.0) && !without.free(&[&q], 0.0));
            free += usize::from(without.free(&[&q], 0.0));
        }
        last = q;
    }
    assert!(freed > 20 && free > 200, "{freed} {free}");
}

#[test]
fn a_file_with_hulls_reads_back() {
    let robot = wedges();
    let again = parse_robot("again.xml", &write_robot(&robot)).unwrap();
    assert!(again.warnings.is_empty(), "{:?}", again.warnings);
    let hulls = |robot: &Robot| robot.nodes.iter().map(|n| n.hulls.clone()).collect::<Vec<_>>();
    assert_eq!(hulls(&again.value), hulls(&robot));
}
