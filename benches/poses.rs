//! Configurations per second: kinematics only, with self-collision, and with 20 obstacles, compared with the lower
//! bound of measuring every pair without rejection.
//!
//! Uses the original `icub.xml` if the shared reference data exist (`MOBEE_SHARED`, or `../shared`), else the shipped
//! one. *first* stops at the first contact, *full* finds all of them; configurations are uniform within the limits. The
//! goal is 5,000 configurations/s with self-collision.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use mobee_model::{Robot, Scene, distance, load_robot, load_world};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn files() -> (PathBuf, Option<PathBuf>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let shared = std::env::var_os("MOBEE_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from);
    let original = shared.join("reference/mobee-original-data/icub.xml");
    if original.is_file() {
        (original, Some(shared.join("reference/mobee-oracle/icub/world20.xml")))
    } else {
        eprintln!("no shared reference data: measuring configs/robots/icub.xml, without the world of 20 obstacles");
        (root.join("configs/robots/icub.xml"), None)
    }
}

fn random_poses(robot: &Robot, count: usize) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut any = || robot.motors.iter().map(|m| m.min + (m.max - m.min) * rng.random::<f64>()).collect();
    (0..count).map(|_| any()).collect()
}

/// Measures every reflex pair, without rejection.
fn pair_by_pair(scene: &Scene, q: &[f64]) -> usize {
    let robot = &scene.robots()[0];
    let frames = scene.node_transforms(&[q]).swap_remove(0);
    let mut touching = 0;
    for &(a, b) in &robot.pairs.reflex {
        for p in &robot.nodes[a].solids {
            for s in &robot.nodes[b].solids {
                let near = distance(&p.shape, &(frames[a] * p.pose), &s.shape, &(frames[b] * s.pose));
                touching += usize::from(near.distance <= 0.0);
            }
        }
    }
    touching
}

fn poses_per_second(c: &mut Criterion) {
    let (robot, world) = files();
    let robot = Arc::new(load_robot(robot).expect("the robot loads").value);
    let alone = Scene::new(vec![(robot.clone(), Default::default())], Vec::new()).expect("a scene");
    let poses = random_poses(&robot, 256);
    let mut group = c.benchmark_group("poses");
    group.throughput(Throughput::Elements(1)).sample_size(50);
    let mut next = 0;
    let mut pose = move || {
        next = (next + 1) % 256;
        next
    };
    let mut frames = Vec::new();
    group.bench_function("kinematics", |b| {
        b.iter_batched(&mut pose, |i| robot.forward(black_box(&poses[i]), &mut frames), BatchSize::SmallInput);
    });
    let mut scenes = vec![("self", alone)];
    if let Some(world) = world {
        let objects = load_world(world).expect("the world loads").value;
        scenes.push(("20 obstacles", Scene::new(vec![(robot.clone(), Default::default())], objects).expect("a scene")));
    }
    for (name, scene) in &scenes {
        group.bench_function(format!("{name}, first"), |b| {
            b.iter_batched(&mut pose, |i| scene.free(&[&poses[i]], 0.0), BatchSize::SmallInput);
        });
        group.bench_function(format!("{name}, full"), |b| {
            b.iter_batched(&mut pose, |i| scene.contacts(&[&poses[i]], 0.0), BatchSize::SmallInput);
        });
    }
    group.sample_size(10);
    group.bench_function("self, pair by pair (the bound)", |b| {
        b.iter_batched(&mut pose, |i| pair_by_pair(&scenes[0].1, &poses[i]), BatchSize::SmallInput);
    });
    group.finish();
}

criterion_group!(benches, poses_per_second);
criterion_main!(benches);
