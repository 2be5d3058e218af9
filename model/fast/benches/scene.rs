//! Time to construct and compile a scene of a robot among 30 objects, from scratch and by reuse of a compiled robot, and
//! after one object has moved, appeared and vanished. Minimum and median of all rounds; us.
//!
//! `cargo bench -p mobee-fast --bench scene [-- ROBOT.xml...]`
#![allow(clippy::disallowed_methods)] // a measurement of the processor

#[allow(dead_code)] // the rest is used by the tests
#[path = "../tests/it/scenes.rs"]
mod scenes;

use mobee_fast::FastScene;
use mobee_model::{Edit, Object, Robot, Scene, load_robot};
use nalgebra::Isometry3;
use scenes::{Dice, obstacles, shipped};
use std::sync::Arc;
use std::time::Instant;

const OBJECTS: usize = 30;
const ROUNDS: usize = 301;

fn main() {
    let files: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with("--")).collect();
    if files.is_empty() {
        ["panda", "ur5"].iter().for_each(|name| measure(name, shipped(name)));
    }
    for file in files {
        measure(&file, Arc::new(load_robot(&file).expect("the robot loads").value));
    }
}

fn measure(name: &str, robot: Arc<Robot>) {
    let mut objects = obstacles(3, OBJECTS);
    objects.truncate(OBJECTS);
    let robots = vec![(robot, Isometry3::identity())];
    let alone = Scene::new(robots.clone(), Vec::new()).expect("a scene");
    let compiled = FastScene::new(&alone, 0.0).expect("it compiles");
    let scene = Scene::new(robots.clone(), objects.clone()).expect("a scene");
    let mut kept = compiled.among(&scene, |_, _| true).expect("it compiles");
    println!("{name}: {} shapes, {:?}", scene.robot_colliders(), kept.figures());
    report("Scene::new", ROUNDS, || drop(Scene::new(robots.clone(), objects.clone())));
    report("Scene::with_objects", ROUNDS, || drop(alone.with_objects(objects.clone())));
    report("FastScene::new", ROUNDS / 10, || drop(FastScene::new(&scene, 0.0)));
    report("FastScene::among", ROUNDS, || drop(compiled.among(&scene, |_, _| true)));
    report("both", ROUNDS, || {
        let scene = alone.with_objects(objects.clone()).expect("a scene");
        drop(compiled.among(&scene, |_, _| true));
    });
    let mut dice = Dice(7);
    let mut present = scene.clone();
    let mut change = |edits: &mut dyn FnMut() -> Vec<Edit>| {
        for edit in edits() {
            present = present.edit(&edit).expect("an edit");
            kept.set_scene(&present, |_, _| true).expect("it compiles");
        }
    };
    let mut round = 0;
    report("an object moved: edit, set_scene", ROUNDS, || {
        round += 1;
        let name = objects[round % OBJECTS].name.clone();
        change(&mut || vec![Edit::Move { name: name.clone(), pose: dice.pose(1.0) }]);
    });
    let added = Object { name: "added".into(), ..objects[3].clone() };
    report("an object added and removed", ROUNDS, || {
        change(&mut || vec![Edit::Add(added.clone()), Edit::Remove { name: "added".into() }]);
    });
}

fn report(name: &str, rounds: usize, mut run: impl FnMut()) {
    let mut times: Vec<f64> = (0..rounds)
        .map(|_| {
            let begin = Instant::now();
            run();
            1e6 * begin.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{name:36} {:8.1} {:8.1}", times[0], times[rounds / 2]);
}
