//! Comparison of [`FastScene`] with other collision checkers, on the same robots, shapes, pairs and poses, in
//! alternating rounds; each peer is a separate process, and both sides measure processor time.
//!
//! For the installation of the peers, and the compared quantities, see `benches/peers/README.md`.
//! ```text
//! cargo bench -p mobee-fast --bench peers -- edges panda.xml vamp_peer panda
//! cargo bench -p mobee-fast --bench peers -- poses icub.xml python benches/peers/coal_peer.py
//! ```
#![allow(clippy::disallowed_methods)] // a measurement of the processor

mod measure;
#[path = "../../../benches/peers/peer.rs"]
mod peer;
#[path = "measure/rate.rs"]
mod rate;

use measure::sorted;
use mobee_fast::{FastScene, InstructionSet};
use mobee_model::{Object, Robot, Scene, Shape, load_robot, load_world, random_poses};
use nalgebra::Isometry3;
use peer::{Folder, Peer, described};
use rate::rate;
use std::path::PathBuf;
use std::sync::Arc;

/// Number of rounds; the median and the extremes are reported.
const ROUNDS: usize = 7;
/// Number of edges before those that are not free are removed, and their length, rad.
const EDGES: usize = 2_000;
const LENGTH: f64 = 0.5;
/// Number of poses before those of one verdict are selected.
const POSES: usize = 3_000;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let [kind, robot, peer @ ..] = words.as_slice() else {
        println!("skipped: name a peer, as benches/peers/README.md says");
        return;
    };
    let robot = Arc::new(load_robot(robot).expect("a robot").value);
    let world = std::env::var_os("MOBEE_WORLD").map(PathBuf::from);
    let objects = world.map(|w| load_world(w).expect("a world").value).unwrap_or_default();
    let folder = Folder::new();
    match kind.as_str() {
        "edges" => edges(&robot, objects, &folder, peer),
        "poses" => poses(&robot, objects, &folder, peer),
        other => println!("edges or poses, not {other}"),
    }
}

fn scene(robot: &Arc<Robot>, objects: Vec<Object>) -> Scene {
    Scene::new(vec![(robot.clone(), Isometry3::identity())], objects).expect("a scene")
}

/// Straight lines of one length, sampled as by VAMP.
fn edges(robot: &Arc<Robot>, mut objects: Vec<Object>, folder: &Folder, peer: &[String]) {
    // VAMP has its robots compiled in, and supports only balls as obstacles.
    objects.retain(|o| o.shapes.iter().all(|s| matches!(s.shape, Shape::Sphere { .. })));
    let balls = objects.iter().flat_map(|o| o.shapes.iter().map(|s| (o.pose * s.pose, s.shape.bounding_radius())));
    let obstacles = balls.flat_map(|(at, radius)| {
        let at = at.translation.vector;
        [at.x, at.y, at.z, radius].map(|x| x as f32)
    });
    folder.write("spheres.f32", obstacles.flat_map(f32::to_le_bytes).collect());
    let scene = scene(robot, objects);
    let edges = lines(robot);
    let numbers = edges.iter().flatten().flatten().map(|x| *x as f32);
    folder.write("edges.f32", numbers.flat_map(f32::to_le_bytes).collect());
    let mut peer = Peer::start(peer, folder);
    let known: Vec<f64> = peer.ready.iter().skip(1).filter_map(|w| w.parse().ok()).collect();
    let [rake, resolution] = known[..] else { panic!("a rake and a resolution") };
    let theirs = std::fs::read(folder.path().join("verdicts")).expect("verdicts");

    let mut fast = FastScene::new(&scene, 0.0).expect("it compiles");
    let sampled: Vec<Vec<f64>> = edges.iter().map(|edge| samples(edge, rake, resolution)).collect();
    let mut free = Vec::new();
    let mut ours = Vec::new();
    for poses in &sampled {
        fast.free(poses, &mut free).expect("whole poses");
        ours.push(free.iter().all(|f| *f));
    }
    let equal = ours.iter().zip(&theirs).filter(|(a, b)| **a == (**b == 1)).count();
    for (i, [from, to]) in edges.iter().enumerate().filter(|(i, _)| ours[*i] != (theirs[*i] == 1)) {
        let line = scene.line(0, &[from], from, to, 1e-4, 0.0);
        let pair = line.pair.map(|(a, b)| format!("{} and {}", scene.shape_name(a), scene.shape_name(b)));
        let verdict = if ours[i] { "free" } else { "blocked" };
        println!("edge {i}: {verdict}; by the scalar engine {:.1e} m, {}", line.min_distance, pair.unwrap_or_default());
    }
    let both: Vec<u8> = ours.iter().zip(&theirs).map(|(a, b)| u8::from(*a) & b).collect();
    folder.write("asked", both.clone());
    println!(
        "{}: {} edges of {LENGTH} rad, {} with equal verdicts, {} free for both; the peer checks {rake} at once",
        robot.name,
        edges.len(),
        equal,
        both.iter().filter(|b| **b == 1).count()
    );
    let poses: Vec<f64> = sampled.iter().zip(&both).filter(|(_, b)| **b == 1).flat_map(|(p, _)| p.clone()).collect();
    compare(&scene, &poses, &mut peer, "configurations");
}

/// Seeded edges between poses within the limits.
fn lines(robot: &Robot) -> Vec<[Vec<f64>; 2]> {
    let mut poses = random_poses(robot, 7);
    let mut edges = Vec::new();
    while edges.len() < EDGES {
        let (Some(from), Some(aim)) = (poses.next(), poses.next()) else { break };
        let change: Vec<f64> = aim.iter().zip(&from).map(|(a, f)| a - f).collect();
        let length = change.iter().map(|w| w * w).sum::<f64>().sqrt();
        // The ends as the peer receives them, in f32.
        let single = |x: f64| f64::from(x as f32);
        let to = from.iter().zip(&change).map(|(f, w)| single(f + w * LENGTH / length)).collect();
        if length > LENGTH {
            edges.push([from.into_iter().map(single).collect(), to]);
        }
    }
    edges
}

/// The configurations that VAMP checks on an edge, in order.
fn samples([from, to]: &[Vec<f64>; 2], rake: f64, resolution: f64) -> Vec<f64> {
    let length = from.iter().zip(to).map(|(a, b)| (b - a) * (b - a)).sum::<f64>().sqrt();
    let count = (rake * (length / rake * resolution).ceil().max(1.0)) as usize;
    let at = |k: usize| k as f64 / count as f64;
    (1..=count).flat_map(|k| from.iter().zip(to).map(move |(a, b)| a + (b - a) * at(k))).collect()
}

/// Random poses: all of them, and the free ones.
fn poses(robot: &Arc<Robot>, objects: Vec<Object>, folder: &Folder, peer: &[String]) {
    let scene = scene(robot, objects);
    // The peer does not support constraints between motors.
    let fit = random_poses(robot, 7).filter(|q| scene.satisfies_constraints(0, q));
    let drawn: Vec<Vec<f64>> = fit.take(POSES).collect();
    folder.write("scene.json", serde_json::to_vec(&described(&scene)).expect("JSON"));
    folder.write("poses.f64", drawn.iter().flatten().copied().flat_map(f64::to_le_bytes).collect());
    let mut peer = Peer::start(peer, folder);
    let theirs = std::fs::read(folder.path().join("verdicts")).expect("verdicts");
    let mut fast = FastScene::new(&scene, 0.0).expect("it compiles");
    let mut free = Vec::new();
    fast.free(&drawn.concat(), &mut free).expect("whole poses");
    let equal = free.iter().zip(&theirs).filter(|(a, b)| **a == (**b == 1)).count();
    println!(
        "{}: {} poses, {equal} with equal verdicts; {} pairs; the peer is at its best with {:?}",
        robot.name,
        drawn.len(),
        scene.pairs().len(),
        peer.ready.get(1)
    );
    for only_free in [false, true] {
        let asked: Vec<u8> = free.iter().map(|f| u8::from(*f || !only_free)).collect();
        folder.write("asked", asked.clone());
        let poses: Vec<f64> = drawn.iter().zip(&asked).filter(|(_, a)| **a == 1).flat_map(|(q, _)| q.clone()).collect();
        compare(&scene, &poses, &mut peer, if only_free { "free poses" } else { "random poses" });
    }
}

/// Runs alternating rounds, with each instruction set.
fn compare(scene: &Scene, poses: &[f64], peer: &mut Peer, what: &str) {
    for set in InstructionSet::available() {
        let mut fast = FastScene::with_instructions(scene, 0.0, set).expect("it compiles");
        let mut ours = Vec::new();
        let mut theirs = Vec::new();
        let mut free = Vec::new();
        for _ in 0..ROUNDS {
            theirs.extend(peer.ask().first());
            ours.push(rate(poses.len() / fast.motors(), || fast.free(poses, &mut free).expect("whole poses")));
        }
        let ours = sorted(ours);
        let theirs = sorted(theirs);
        println!(
            "{what:14} {:>9} {:8.2}x  ours, a second: {:9.0} {:9.0} {:9.0}  peer: {:9.0} {:9.0} {:9.0} (least, median, most)",
            format!("{set:?}"),
            ours[ROUNDS / 2] / theirs[ROUNDS / 2],
            ours[0],
            ours[ROUNDS / 2],
            ours[ROUNDS - 1],
            theirs[0],
            theirs[ROUNDS / 2],
            theirs[ROUNDS - 1]
        );
    }
}
