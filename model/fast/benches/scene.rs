//! Time to construct and compile a scene of a Panda among 30 objects, from scratch and by reuse of a compiled robot, and
//! after one object has moved. Minimum of all rounds; us.
//!
//! `cargo bench -p mobee-fast --bench scene`
#![allow(clippy::disallowed_methods)] // a measurement of the processor

#[allow(dead_code)] // the rest is used by the tests
#[path = "../tests/it/scenes.rs"]
mod scenes;

use mobee_fast::FastScene;
use mobee_model::{Edit, Scene};
use nalgebra::Isometry3;
use scenes::{obstacles, shipped};
use std::time::Instant;

const OBJECTS: usize = 30;
const ROUNDS: usize = 301;

fn main() {
    let robot = shipped("panda");
    let mut objects = obstacles(3, OBJECTS);
    objects.truncate(OBJECTS);
    let robots = vec![(robot, Isometry3::identity())];
    let alone = Scene::new(robots.clone(), Vec::new()).expect("a scene");
    let compiled = FastScene::new(&alone, 0.0).expect("it compiles");
    let scene = Scene::new(robots.clone(), objects.clone()).expect("a scene");
    let among = compiled.among(&scene, |_, _| true).expect("it compiles");
    let name = objects[0].name.clone();
    let pose = objects[0].pose * Isometry3::translation(0.01, 0.0, 0.0);
    let moved = scene.edit(&Edit::Move { name: name.clone(), pose }).expect("an edit");
    report("Scene::new", ROUNDS, || drop(Scene::new(robots.clone(), objects.clone())));
    report("Scene::with_objects", ROUNDS, || drop(alone.with_objects(objects.clone())));
    report("FastScene::new", ROUNDS / 10, || drop(FastScene::new(&scene, 0.0)));
    report("FastScene::among", ROUNDS, || drop(compiled.among(&scene, |_, _| true)));
    report("Scene::edit, one object moved", ROUNDS, || drop(scene.edit(&Edit::Move { name: name.clone(), pose })));
    report("FastScene::among, one object moved", ROUNDS, || drop(among.among(&moved, |_, _| true)));
}

fn report(name: &str, rounds: usize, mut run: impl FnMut()) {
    let times = (0..rounds).map(|_| {
        let begin = Instant::now();
        run();
        begin.elapsed().as_secs_f64()
    });
    println!("{name:36} {:8.0}", 1e6 * times.fold(f64::INFINITY, f64::min));
}
