//! Promises: prismatic joints move as an independent composition of translations and rotations; all motion bounds
//! include their travel; files preserve them; invalid input is rejected.

use crate::engines::for_every_engine;
use mobee_model::{
    Engine, Field, JointMotion, NodeKind, Object, ObjectClass, Primitive, Robot, Scene, Shape, Watch, parse_robot,
    write_robot,
};
use nalgebra::{Isometry3, Matrix4, Rotation3, Vector3};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

for_every_engine!(
    a_watch_of_slides_returns_what_a_full_check_would,
    the_torque_on_a_slide_is_the_slope_of_the_depth,
    no_point_of_a_sliding_robot_goes_farther_in_a_step_than_asked,
);

/// A chain of revolute and prismatic joints with random axes, links and ranges, and its motors' ranges in encoder
/// units.
pub fn chain(rng: &mut ChaCha8Rng, joints: usize) -> Robot {
    let mut text = String::from("<ZeroPositionKinematicTree robotName=\"chain\"><bodypart name=\"p\">");
    let vector = |rng: &mut ChaCha8Rng| [0; 3].map(|_| rng.random_range(-1.0..1.0_f64));
    for i in 0..joints {
        let ([x, y, z], [u, v, w]) = (vector(rng), vector(rng));
        let slides = rng.random::<bool>();
        let (lo, hi) = (rng.random_range(-0.4..0.0), rng.random_range(0.1..0.4));
        let (kind, scale) = if slides { ("prismatic", 1.0) } else { ("revolute", 200.0) };
        // The range of an encoder may differ from that of its joint, as for any motor.
        let counts = if slides { 1000.0 * rng.random_range(0.5..2.0) } else { 1.0 };
        text += &format!(
            "<motor name=\"m{i}\" minPos=\"{}\" maxPos=\"{}\"><joint type=\"{kind}\" x=\"{x}\" y=\"{y}\" z=\"{z}\" \
             minPos=\"{}\" maxPos=\"{}\" radius=\"0.02\" length=\"0.05\"><link x=\"{}\" y=\"{}\" z=\"{}\" radius=\"0.03\">",
            lo * scale * counts,
            hi * scale * counts,
            lo * scale,
            hi * scale,
            u * 0.3,
            v * 0.3,
            w * 0.3
        );
    }
    text += &"</link></joint></motor>".repeat(joints);
    text += "</bodypart></ZeroPositionKinematicTree>";
    parse_robot("chain.xml", &text).expect("the chain loads").value
}

fn draw(robot: &Robot, rng: &mut ChaCha8Rng) -> Vec<f64> {
    robot.motors.iter().map(|m| rng.random_range(m.min..=m.max)).collect()
}

/// Node frames by products of homogeneous matrices.
fn composed(robot: &Robot, q: &[f64]) -> Vec<Matrix4<f64>> {
    let mut below: Vec<Matrix4<f64>> = Vec::new();
    let mut frames = Vec::new();
    for node in &robot.nodes {
        let here = node.parent.map_or(Matrix4::identity(), |p| below[p]);
        frames.push(here);
        below.push(match &node.kind {
            NodeKind::Link { offset } => here * Matrix4::new_translation(offset),
            NodeKind::Joint { motion, axis, motor, min, max, .. } => {
                let m = &robot.motors[*motor];
                let at = min + (q[*motor] - m.min) / (m.max - m.min) * (max - min);
                match motion {
                    JointMotion::Turn => here * Rotation3::new(axis.into_inner() * at).to_homogeneous(),
                    JointMotion::Slide => here * Matrix4::new_translation(&(axis.into_inner() * at)),
                }
            }
        });
    }
    frames
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn chains_with_slides_move_as_composed(seed: u64, joints in 1..8usize) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let robot = chain(&mut rng, joints);
        let scene = Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], vec![]).unwrap();
        let mut frames = Vec::new();
        for _ in 0..20 {
            let q = draw(&robot, &mut rng);
            robot.forward(&q, &mut frames);
            let prepared = scene.node_transforms(&[&q]).swap_remove(0);
            for ((a, b), c) in frames.iter().zip(composed(&robot, &q)).zip(&prepared) {
                prop_assert!((a.to_homogeneous() - b).amax() < 1e-12);
                prop_assert!((c.to_homogeneous() - b).amax() < 1e-12);
            }
        }
    }

    #[test]
    fn no_point_of_a_chain_with_slides_outruns_its_reach(seed: u64, joints in 1..8usize) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let robot = chain(&mut rng, joints);
        let reach = robot.reach();
        for _ in 0..40 {
            let (q, to) = (draw(&robot, &mut rng), draw(&robot, &mut rng));
            let size = rng.random_range(0.001..1.0);
            let to: Vec<f64> = q.iter().zip(&to).map(|(a, b)| a + (b - a) * size).collect();
            let bound: f64 = reach.iter().zip(q.iter().zip(&to)).map(|(r, (a, b))| r * (a - b).abs()).sum();
            for (n, (a, b)) in composed(&robot, &q).iter().zip(composed(&robot, &to)).enumerate() {
                for solid in &robot.nodes[n].solids {
                    let at = (solid.pose.translation.vector).push(1.0);
                    let moved = (a * at - b * at).norm();
                    prop_assert!(moved <= bound + 1e-12, "node {n} moved {moved}, the bound is {bound}");
                }
            }
        }
    }

    #[test]
    fn chains_with_slides_survive_a_file(seed: u64, joints in 1..8usize) {
        let robot = chain(&mut ChaCha8Rng::seed_from_u64(seed), joints);
        let again = parse_robot("again.xml", &write_robot(&robot)).unwrap();
        prop_assert!(again.warnings.is_empty(), "{:?}", again.warnings);
        for (a, b) in robot.nodes.iter().zip(&again.value.nodes) {
            let (NodeKind::Joint { motion: a, min, max, .. }, NodeKind::Joint { motion: b, min: low, max: high, .. }) =
                (&a.kind, &b.kind)
            else {
                continue;
            };
            prop_assert_eq!((a, min, max), (b, low, high));
        }
        prop_assert_eq!(robot.motors, again.value.motors);
    }
}

fn ball(at: [f64; 3], radius: f64) -> Object {
    let shapes = vec![Primitive { shape: Shape::Sphere { radius }, pose: Isometry3::identity() }];
    let (class, pose) = (ObjectClass::Obstacle, Isometry3::translation(at[0], at[1], at[2]));
    Object { name: "ball".into(), class, persistent: false, pose, shapes, color: None }
}

/// Scenes with prismatic chains around a ball.
fn scenes<E: Engine>(rng: &mut ChaCha8Rng) -> Vec<Scene<E>> {
    let scene = |rng: &mut ChaCha8Rng| {
        let robot = Arc::new(chain(rng, 6));
        Scene::<E>::with_engine(vec![(robot, Isometry3::identity())], vec![ball([0.3, 0.1, 0.1], 0.15)]).unwrap()
    };
    (0..4).map(|_| scene(rng)).collect()
}

fn a_watch_of_slides_returns_what_a_full_check_would<E: Engine>() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut contacts = 0;
    for scene in scenes::<E>(&mut rng) {
        let mut watch = Watch::new(Arc::new(scene.clone()), 0.012);
        let robot = scene.robots()[0].clone();
        let (mut at, mut goal) = (draw(&robot, &mut rng), draw(&robot, &mut rng));
        for tick in 0..300 {
            if tick % 60 == 0 {
                goal = draw(&robot, &mut rng);
            }
            at.iter_mut().zip(&goal).for_each(|(q, g)| *q += (g - *q) * 0.05);
            let full = scene.contacts(&[&at], 0.012);
            contacts += full.len();
            let pairs = |list: &[mobee_model::Contact]| list.iter().map(|c| c.pair).collect::<Vec<_>>();
            assert_eq!(pairs(watch.update(&[&at])), pairs(&full));
        }
    }
    assert!(contacts > 100, "{contacts}");
}

fn the_torque_on_a_slide_is_the_slope_of_the_depth<E: Engine>() {
    let (width, step) = (0.05, 1e-5);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut judged, mut pushed) = (0, 0);
    for scene in scenes::<E>(&mut rng).into_iter().map(Arc::new) {
        let robot = scene.robots()[0].clone();
        let mut field = Field::new(&scene, 0, width);
        let depth =
            |q: &[f64]| scene.contacts(&[q], width).iter().map(|c| 0.5 * (width - c.distance).powi(2)).sum::<f64>();
        for _ in 0..40 {
            let q: Vec<f64> =
                robot.motors.iter().map(|m| m.min + (m.max - m.min) * rng.random_range(0.01..0.99)).collect();
            let torques = field.torques(&[&q]).to_vec();
            for (m, torque) in torques.iter().enumerate() {
                let at = |by: f64| {
                    let mut moved = q.clone();
                    moved[m] += by;
                    (depth(&moved) - depth(&q)) / by
                };
                let (up, down) = (at(step), at(-step));
                // The depth is not differentiable at the edges of shapes.
                if (up - down).abs() < 1e-3 * (1.0 + up.abs()) {
                    let slides = robot.motors[m].motion == JointMotion::Slide;
                    judged += usize::from(slides);
                    pushed += usize::from(slides && torque.abs() > 1e-4);
                    let slope = 0.5 * (up + down);
                    assert!((slope + torque).abs() < 2e-3 * (1.0 + slope.abs()), "motor {m}: {torque}, slope {slope}");
                }
            }
        }
    }
    assert!(judged > 50 && pushed > 10, "{judged} judged, {pushed} pushed");
}

fn no_point_of_a_sliding_robot_goes_farther_in_a_step_than_asked<E: Engine>() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for scene in scenes::<E>(&mut rng) {
        let robot = scene.robots()[0].clone();
        let (from, to) = (draw(&robot, &mut rng), draw(&robot, &mut rng));
        let steps = scene.line(0, &[&from], &from, &to, 0.01, 0.0).steps;
        let place = |k: u32| {
            let t = f64::from(k) / f64::from(steps);
            let q: Vec<f64> = from.iter().zip(&to).map(|(a, b)| a + (b - a) * t).collect();
            scene.node_transforms(&[&q]).swap_remove(0)
        };
        for k in 0..steps {
            for (a, b) in place(k).iter().zip(place(k + 1)) {
                assert!((a.translation.vector - b.translation.vector).norm() <= 0.01 + 1e-12);
            }
        }
    }
}

fn lift(motor: &str, joint: &str) -> String {
    format!(
        "<ZeroPositionKinematicTree robotName=\"lift\"><bodypart name=\"p\">\n<motor name=\"lift\" {motor}>\n\
         <joint z=\"1\" {joint}>\n<link x=\"0.3\" radius=\"0.02\"/></joint></motor></bodypart></ZeroPositionKinematicTree>"
    )
}

#[test]
fn a_lift_counts_millimeters_and_moves_in_meters() {
    let text = lift("minPos=\"0\" maxPos=\"350\"", "type=\"prismatic\" minPos=\"0\" maxPos=\"0.35\"");
    let robot = parse_robot("lift.xml", &text).unwrap().value;
    assert_eq!(robot.motors[0].motion, JointMotion::Slide);
    let mut frames = Vec::new();
    robot.forward(&[100_f64.to_radians()], &mut frames);
    assert!((frames[1].translation.vector - Vector3::new(0.0, 0.0, 0.1)).norm() < 1e-12, "{frames:?}");
    assert!(frames[0].translation.vector.norm() < 1e-12, "a joint's own frame stays");
}

/// Millimeters instead of meters cause a located warning, but are accepted: long rails exist.
#[test]
fn a_slide_of_sixty_meters_is_doubted_at_its_place() {
    let read = |joint: &str| parse_robot("lift.xml", &lift("minPos=\"-60\" maxPos=\"60\"", joint)).unwrap();
    let far = read("type=\"prismatic\" minPos=\"-60\" maxPos=\"60\"").warnings;
    assert!(far.len() == 1 && far[0].line() == 3 && far[0].to_string().contains("slides to -60 m"), "{far:?}");
    assert!(far[0].remedy().contains("meters"));
    assert_eq!(read("type=\"prismatic\" minPos=\"-0.06\" maxPos=\"10\"").warnings.len(), 0);
    assert_eq!(read("minPos=\"-60\" maxPos=\"60\"").warnings.len(), 0, "degrees");
}

#[test]
fn what_makes_no_sense_of_a_slide_is_refused_at_its_place() {
    let cases = [
        (lift("", "type=\"screw\""), 3, "screw"),
        (lift("", "type=\"prismatic\" maxPos=\"1\""), 3, "no `minPos`"),
        (lift("continuous=\"true\"", "type=\"prismatic\" minPos=\"0\" maxPos=\"1\""), 3, "does not bring"),
        (lift("continuous=\"true\" type=\"prismatic\"", ""), 2, "has an end"),
        (lift("continuous=\"true\" minPos=\"-720\" maxPos=\"720\"", "minPos=\"-180\" maxPos=\"180\""), 3, "full turn"),
        (
            lift("", "type=\"prismatic\" minPos=\"0\" maxPos=\"1\"/><joint z=\"1\""),
            3,
            "joints that turn and joints that slide",
        ),
    ];
    for (text, line, expected) in cases {
        let error = parse_robot("lift.xml", &text).expect_err(&text);
        assert!(error.to_string().contains(expected) && error.line() == line, "{text}\n{error}");
        assert!(!error.remedy().is_empty());
    }
}
