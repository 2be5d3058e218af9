//! What the engine itself does with the poses of `queries.py`, without Python: poses per second of processor time.
//!
//! `cargo bench -p mobee-python --bench engine`
#![allow(clippy::disallowed_methods)] // a measurement

#[path = "../../model/fast/benches/measure/mod.rs"]
#[allow(dead_code)] // other benchmarks use the rest
mod measure;

use measure::processor_time;
use mobee_fast::FastScene;
use mobee_model::{Scene, load_robot, random_poses};
use nalgebra::Isometry3;
use std::sync::Arc;
use std::time::Instant;

/// How long each number of poses is measured, processor seconds.
const MEASURE_S: f64 = 0.5;

fn main() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/robots/ur5.xml");
    let robot = Arc::new(load_robot(path).expect("the shipped robot").value);
    let scene = Scene::new(vec![(Arc::clone(&robot), Isometry3::identity())], Vec::new()).expect("a scene");
    let mut fast = FastScene::new(&scene, 0.0).expect("a compiled scene");
    for count in [1, 100, 10_000, 1_000_000] {
        let poses: Vec<f64> = random_poses(&robot, 7).take(count).flatten().collect();
        let mut free = Vec::new();
        let vector = rate(count, || fast.free(&poses, &mut free).expect("whole poses"));
        println!("{count:>8}  free {vector:>10.0}/s");
    }
}

fn rate(count: usize, mut call: impl FnMut()) -> f64 {
    call();
    let (start, mut calls) = (Instant::now(), 0);
    let (begin, mut taken) = (processor_time(start), 0.0);
    while taken < MEASURE_S {
        // of short calls many: to read the clock takes longer than one
        (0..10_000_usize.div_ceil(count)).for_each(|_| call());
        calls += 10_000_usize.div_ceil(count);
        taken = processor_time(start) - begin;
    }
    (calls * count) as f64 / taken
}
