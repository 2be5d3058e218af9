//! What can only be seen from inside: that bounds bound.

use crate::chain::LaneFrame;
use crate::compile::compile;
use crate::isa::{InstructionSet, checked};
use crate::kernel::Block;
use crate::lanes::{Mask, WIDTH};
use crate::sweep::{Sphere, least_distance};
use mobee_model::{Robot, Scene, load_robot, random_poses};
use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use std::path::Path;
use std::sync::Arc;

fn scene(name: &str) -> (Arc<Robot>, Scene) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../configs/robots/{name}.xml"));
    let robot = Arc::new(load_robot(file).expect("the robot loads").value);
    // Not at the origin: distance from there costs digits, and the bound must know it.
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -1.0, 0.5));
    let base = Isometry3::from_parts(Translation3::new(1.3, -0.4, 0.2), turn);
    let scene = Scene::new(vec![(robot.clone(), base)], Vec::new()).expect("a scene");
    (robot, scene)
}

/// Calls with the poses that lanes were given, and the block that they were judged in, for each set of instructions.
fn judged(name: &str, mut look: impl FnMut(&Scene, &[LaneFrame], &[Vec<f64>], &Block, &[usize])) {
    let (robot, scene) = scene(name);
    let mut compiled = compile(&scene, scene.pairs(), 10.0);
    // Everything is near at ten meters, but nothing touches by then that would end the block: only frames are asked for
    // here.
    compiled.program.units.clear();
    compiled.program.regions.truncate(1);
    compiled.program.regions[0] = 0..compiled.program.joints.len();
    let frames: Vec<usize> = compiled.program.joints.iter().map(|j| j.frame).collect();
    for set in InstructionSet::available() {
        let runner = checked(set).expect("available");
        let mut block = Block::new(&compiled.program);
        let mut poses = random_poses(&robot, 5);
        for _ in 0..50 {
            let poses: Vec<Vec<f64>> = poses.by_ref().take(WIDTH).collect();
            for (lane, pose) in poses.iter().enumerate() {
                for (row, q) in block.motors.iter_mut().zip(pose) {
                    row.0[lane] = *q;
                }
            }
            runner.judge(&compiled.program, &mut block, Mask::MAX);
            look(&scene, &compiled.movers.frames, &poses, &block, &frames);
        }
    }
}

#[test]
fn frames_keep_to_their_bounds() {
    for name in ["icub", "katana"] {
        let (mut worst, mut largest) = (0.0f64, 0.0f64);
        judged(name, |scene, frames, poses, block, moving| {
            for (lane, pose) in poses.iter().enumerate() {
                let mut exact = Vec::new();
                scene.skeletons()[0].place(pose, &mut exact);
                for &f in moving {
                    let vector = |i: usize| Vector3::from_fn(|r, _| f64::from(block.frames[f][i][r].0[lane]));
                    let expected = exact[f] * frames[f].choice;
                    let bound = frames[f].bound;
                    let place = (vector(3) - expected.translation.vector).norm();
                    let turn = Matrix3::from_columns(&[vector(0), vector(1), vector(2)]);
                    let turn = (turn - expected.rotation.to_rotation_matrix().matrix()).norm() / 3f64.sqrt();
                    assert!(
                        place <= bound.place && turn <= bound.turn,
                        "{name}, frame {f}: {place}, {turn}, {bound:?}"
                    );
                    worst = worst.max(place / bound.place).max(turn / bound.turn);
                    largest = largest.max(bound.place);
                }
            }
        });
        eprintln!("{name}: at most {:.1} % of a bound; the largest bound is {largest:.2e} m", 100.0 * worst);
        assert!(worst > 0.01, "a bound a hundred times too wide would hold anything");
    }
}

#[test]
fn a_pair_keeps_the_distance_that_is_proved() {
    for name in ["icub", "katana"] {
        let (robot, scene) = scene(name);
        let frames = compile(&scene, scene.pairs(), 0.0).movers.frames;
        let balls: Vec<(usize, Sphere)> = scene
            .colliders()
            .map(|c| {
                let center = (frames[c.frame].choice.inverse() * c.pose).translation.vector;
                (c.frame, Sphere { center, radius: c.shape.bounding_radius() })
            })
            .collect();
        for pose in random_poses(&robot, 9).take(300) {
            let mut exact = Vec::new();
            scene.skeletons()[0].place(&pose, &mut exact);
            for &(i, j) in scene.pairs() {
                let (a, b) = (balls[i as usize], balls[j as usize]);
                let at = |(frame, ball): (usize, Sphere)| {
                    exact[frame] * frames[frame].choice * nalgebra::Point3::from(ball.center)
                };
                let distance = (at(a) - at(b)).norm() - a.1.radius - b.1.radius;
                assert!(distance >= least_distance(&frames, a, b) - 1e-9, "{name}: {i} and {j}");
            }
        }
    }
}

#[test]
fn a_ball_holds_the_balls_it_is_around() {
    let ball = |x: f64, y: f64, radius: f64| Sphere { center: Vector3::new(x, y, 0.1 * x), radius };
    let balls = [ball(0.0, 0.0, 0.1), ball(1.0, 0.2, 0.3), ball(-0.5, 1.0, 0.05)];
    for count in 1..=3 {
        let around = Sphere::around(&balls[..count]);
        for ball in &balls[..count] {
            assert!((ball.center - around.center).norm() + ball.radius <= around.radius + 1e-12);
        }
    }
    assert_eq!(Sphere::around(&balls[..1]), balls[0]);
}

#[test]
fn fingers_are_a_region_of_their_own() {
    let (_, scene) = scene("icub");
    let regions = compile(&scene, scene.pairs(), 0.0).program.regions;
    let fingers: Vec<usize> =
        regions.iter().skip(1).map(|joints| joints.len()).filter(|joints| *joints >= 15).collect();
    assert_eq!(fingers.len(), 2, "two hands: {regions:?}");
}
