//! Promises: the fields' torques are the gradient of the depths of overlapping fields, on both robots of a pair; a
//! robot's own field shapes replace its solids; nothing pushes at the target of a motion.

use crate::engines::for_every_engine;
use crate::oracle;
use mobee_model::{Engine, Field, Object, ObjectClass, Primitive, Robot, Scene, Shape, load_robot, parse_robot};
use nalgebra::Isometry3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

for_every_engine!(
    torques_are_the_slope_of_the_depth,
    at_the_target_nothing_pushes,
    a_robots_own_field_shapes_are_its_fields,
);

fn ball(name: &str, at: [f64; 3], radius: f64) -> Object {
    let shapes = vec![Primitive { shape: Shape::Sphere { radius }, pose: Isometry3::identity() }];
    let pose = Isometry3::translation(at[0], at[1], at[2]);
    Object { name: name.into(), class: ObjectClass::Obstacle, persistent: false, pose, shapes, color: None }
}

fn scenes<E: Engine>() -> Vec<Arc<Scene<E>>> {
    let mut edge = load_robot(oracle::own_data("edge").join("edge_a.xml")).expect("the robot loads").value;
    edge.nodes.iter_mut().for_each(|n| n.fields.clear());
    let other = Arc::new(Robot { name: "other".into(), ..edge.clone() });
    let two = vec![(Arc::new(edge), Isometry3::identity()), (other, Isometry3::translation(0.25, 0.0, 0.0))];
    let balls = vec![ball("one", [0.15, 0.1, 0.2], 0.06), ball("two", [-0.1, 0.25, 0.1], 0.08)];
    let own = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/icub.xml");
    let icub = Arc::new(load_robot(own).expect("the robot loads").value);
    let near = vec![ball("ball", [-0.3, 0.2, 0.1], 0.05)];
    let scene = |robots, objects| Arc::new(Scene::<E>::with_engine(robots, objects).expect("a scene"));
    vec![scene(two, balls), scene(vec![(icub, Isometry3::identity())], near)]
}

fn random_poses(scene: &Scene<impl Engine>, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let any = |r: &Arc<Robot>, rng: &mut ChaCha8Rng| -> Vec<f64> {
        r.motors.iter().map(|m| m.min + (m.max - m.min) * rng.random_range(0.01..0.99)).collect()
    };
    scene.robots().iter().map(|r| any(r, rng)).collect()
}

/// Half the sum of the squared depths: the torques are its negative gradient.
fn potential(scene: &Scene<impl Engine>, poses: &[Vec<f64>], width: f64) -> f64 {
    scene.contacts(poses, width).iter().map(|c| 0.5 * (width - c.distance).powi(2)).sum()
}

fn torques_are_the_slope_of_the_depth<E: Engine>() {
    let (width, step) = (0.05, 1e-4);
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for scene in scenes::<E>() {
        let mut fields: Vec<Field<E>> = (0..scene.robots().len()).map(|r| Field::new(&scene, r, width)).collect();
        let (mut judged, mut pushed) = (0, 0);
        for _ in 0..40 {
            let poses = random_poses(&scene, &mut rng);
            for (r, field) in fields.iter_mut().enumerate() {
                let torques = field.torques(&poses).to_vec();
                let here = potential(&scene, &poses, width);
                for (m, torque) in torques.iter().enumerate() {
                    let at = |by: f64| {
                        let mut moved = poses.clone();
                        moved[r][m] += by;
                        (potential(&scene, &moved, width) - here) / by
                    };
                    let (up, down) = (at(step), at(-step));
                    // The depth is not differentiable at the edges of shapes.
                    if (up - down).abs() > 1e-3 {
                        continue;
                    }
                    judged += 1;
                    pushed += usize::from(torque.abs() > 0.002);
                    let slope = 0.5 * (up + down);
                    assert!((slope + torque).abs() < 5e-4, "robot {r} motor {m}: torque {torque}, slope {slope}");
                }
            }
        }
        assert!(judged > 200 && pushed > 40, "{judged} judged, {pushed} of them pushed");
    }
}

fn at_the_target_nothing_pushes<E: Engine>() {
    let width = 0.05;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for scene in scenes::<E>() {
        let mut field = Field::new(&scene, 0, width);
        for _ in 0..20 {
            let poses = random_poses(&scene, &mut rng);
            field.aim(&poses);
            assert!(field.torques(&poses).iter().all(|t| t.abs() < 1e-9), "at the target");
            let elsewhere = random_poses(&scene, &mut rng);
            let aimed: f64 = field.torques(&elsewhere).iter().map(|t| t.abs()).sum();
            let unaimed: f64 = Field::new(&scene, 0, width).torques(&elsewhere).iter().map(|t| t.abs()).sum();
            assert!(aimed <= 0.0 || unaimed > 0.0, "what pushes on the way pushes without a target, too");
        }
    }
}

/// A bar with a wide field about its end, and a ball beside it.
fn a_robots_own_field_shapes_are_its_fields<E: Engine>() {
    let text = r#"<ZeroPositionKinematicTree robotName="bar"><bodypart name="p"><link z="0.1">
<motor name="base" minPos="-1" maxPos="1"><joint z="1" minPos="-1" maxPos="1"><link x="0.1"><motor name="m" minPos="-90" maxPos="90"><joint z="1" minPos="-90" maxPos="90">
<link x="0.3" radius="0.02"><link x="0.001"><sphere radius="0.15" field="true"/></link></link>
</joint></motor></link></joint></motor></link></bodypart></ZeroPositionKinematicTree>"#;
    let robot = Arc::new(parse_robot("bar.xml", text).expect("the robot loads").value);
    let scene = |at| {
        let robots = vec![(robot.clone(), Isometry3::identity())];
        Arc::new(Scene::<E>::with_engine(robots, vec![ball("ball", at, 0.05)]).expect("a scene"))
    };
    // Left of its end (y > 0): it is pushed to the right.
    let mut field = Field::new(&scene([0.4, 0.12, 0.1]), 0, 0.5);
    let torques = field.torques(&[[0.0, 0.0]]);
    assert!((torques[1] + (0.2 - 0.12) * 0.3).abs() < 1e-9, "depth times lever: {torques:?}");
    // Beside the bar's middle there is a solid but no field, at any width.
    let mut field = Field::new(&scene([0.15, 0.09, 0.1]), 0, 0.5);
    assert_eq!(field.torques(&[[0.0, 0.0]]), [0.0, 0.0]);
}
