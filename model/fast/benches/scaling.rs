//! Poses per second and core as a function of the number of obstacles: the shipped iCub among seeded shapes of all
//! kinds, up to two meters away, at random poses; the scalar engine in the same rounds.
//!
//! `cargo bench -p mobee-fast --bench scaling`
#![allow(clippy::disallowed_methods)] // a measurement of the processor

mod measure;
#[path = "measure/rate.rs"]
mod rate;
#[allow(dead_code)] // the rest is used by the tests
#[path = "../tests/it/scenes.rs"]
mod scenes;

use measure::{processor_time, sorted};
use mobee_fast::{FastScene, InstructionSet};
use mobee_model::{Scene, random_poses};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rate::rate;
use scenes::{Dice, obstacles, shipped};
use std::time::Instant;

/// Numbers of obstacles.
const COUNTS: [usize; 7] = [0, 10, 30, 100, 300, 1000, 3000];
/// Number of poses, and of those that the slower engine checks.
const POSES: usize = 10_000;
const SCALAR: usize = 1_000;
/// Number of rounds; the median is reported.
const ROUNDS: usize = 5;

fn main() {
    let robot = shipped("icub");
    let motors = robot.motors.len();
    let poses: Vec<f64> = random_poses(&robot, 7).take(POSES).flatten().collect();
    println!("obstacles   free  compiled  scalar, poses/s  fast, poses/s by instructions, and the ratio");
    for count in COUNTS {
        let mut dice = Dice(5);
        // Equal density at any number: additional obstacles surround the others.
        let mut objects = obstacles(3, count);
        objects.truncate(count);
        for object in &mut objects {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), dice.roll() * std::f64::consts::TAU);
            let away = turn * Vector3::x() * (0.4 + 1.6 * dice.roll());
            object.pose.translation.vector = away + Vector3::z() * (2.0 * dice.roll() - 1.0);
        }
        let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], objects).expect("a scene");
        let start = Instant::now();
        let begin = processor_time(start);
        drop(FastScene::new(&scene, 0.0));
        let compiled = processor_time(start) - begin;
        let mut scalar = Vec::new();
        let mut expected = Vec::new();
        for _ in 0..ROUNDS {
            scalar.push(rate(SCALAR, || {
                expected = poses.chunks_exact(motors).take(SCALAR).map(|pose| scene.free(&[pose], 0.0)).collect();
            }));
        }
        let scalar = sorted(scalar)[ROUNDS / 2];
        let mut free = Vec::new();
        let mut line = String::new();
        for set in InstructionSet::available() {
            let mut fast = FastScene::with_instructions(&scene, 0.0, set).expect("it compiles");
            let rates =
                (0..ROUNDS).map(|_| rate(POSES, || fast.free(&poses, &mut free).expect("whole poses"))).collect();
            assert!(free[..SCALAR] == expected, "{count} obstacles: verdicts differ");
            let rate = sorted(rates)[ROUNDS / 2];
            line += &format!("  {set:?} {rate:.0} ({:.1}x)", rate / scalar);
        }
        let share = free.iter().filter(|free| **free).count() as f64 / POSES as f64;
        println!("{count:9} {:5.1}% {:6.0} ms {scalar:16.0}{line}", 100.0 * share, 1e3 * compiled);
    }
}
