//! Validation of a complete map: 5,000 poses of torso and right arm over a table, each connected with its eight
//! nearest, among 20 obstacles; [`FastScene::certify`] compared with samples at 1 mm of the hand's path
//! ([`FastScene::free`], and [`Scene::line_free`] on a part), in interleaved rounds, processor time of one core.
//!
//! ```text
//! cargo bench -p mobee-fast --bench edges
//! MOBEE_CHECK=1 cargo bench -p mobee-fast --bench edges   # 21,000 edges of each robot beside samples at 0.1 mm; minutes
//! ```
//!
//! # Measured
//! 25,989 edges (the hand goes 18 mm in the mean), one core of a busy machine, processor time, medians of seven rounds:
//!
//! | what | AVX-512, ms |
//! |---|---|
//! | self and 20 obstacles, 5.5 intervals per edge, 0.03 % uncertified | 108 (AVX2: 132, portable: 284) |
//! | the same, yes or no | 71 |
//! | self only | 28 |
//! | 20 obstacles only | 90 |
//! | one object: compiled; all edges against it; a thirtieth of them | 1.3; 12; 0.5 |
//! | with a table of half a square meter under the hand (AVX2: 227) | 184 |
//! | the same, yes or no | 88 |
//! | 506,815 samples in lanes | 303 |
//! | `Scene::line_free` at 1 mm | 8,375 |
//! | 1,000 long edges at once; yes or no; one by one | 31; 20; 51 |
//!
//! Without velocities in the bounds (`motion.rs`), with levers only, the first took 1.9 times as long and 3.8 times the
//! intervals.
//!
//! Compared with samples at 0.1 mm, none missed on any of these; uncertified 0.035 % of 20,000 edges of the map, 1 of
//! 1,000 long ones; Panda 0.010 % of 20,000 edges of 23 mm, none of 1,000 long ones; UR5 0.005 %, none.
#![allow(clippy::disallowed_methods)] // a measurement of the processor

mod check;
mod map;
mod measure;

use map::{Map, is_object, object};
use measure::{processor_time, sorted};
use mobee_fast::{EdgeVerdict, FastScene, InstructionSet};
use mobee_model::{Scene, Shape, load_robot};
use nalgebra::{Isometry3, Vector3};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Number of rounds; minimum, median and maximum time are reported.
const ROUNDS: usize = 7;
/// The scalar engine checks every n-th edge.
const SLICE: usize = 100;

fn main() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/icub.xml");
    let robot = Arc::new(load_robot(file).expect("the robot loads").value);
    let map = Map::new(robot, 5_000);
    let paths = sorted((0..map.edges.len()).map(|e| map.hand_path(e)).collect());
    let mean = paths.iter().sum::<f64>() / paths.len() as f64;
    println!(
        "{} poses, {} edges; the hand goes {:.1} mm on an edge in the mean, {:.1} in the median",
        map.poses.len(),
        map.edges.len(),
        1e3 * mean,
        1e3 * paths[paths.len() / 2]
    );
    let objects = map.obstacles();
    if std::env::var_os("MOBEE_CHECK").is_some() {
        check::all(&map, &objects);
        return;
    }
    let scene = map.scene(objects.clone());
    let table = object(
        "table".into(),
        Isometry3::translation(-0.4, 0.1, -0.04),
        Shape::Box { size: Vector3::new(0.5, 1.2, 0.04) },
    );
    let with_table = map.scene([objects, vec![table]].concat());
    validate("20 obstacles", &map, &scene, true);
    validate("20 obstacles and a table", &map, &with_table, false);
    one_object(&map, &scene);
    long_edges(&map, &scene);
}

/// Edges between any two poses of the map, all at once and one by one.
fn long_edges(map: &Map, scene: &Scene) {
    let mut dice = map::Dice(1);
    let mut pick = || map.poses[(dice.roll() * map.poses.len() as f64) as usize].clone();
    let edges: Vec<f64> = (0..2_000).flat_map(|_| pick()).collect();
    let mut fast = FastScene::new(scene, 0.0).expect("it compiles");
    let mut verdicts = Vec::new();
    let mut verdict = Vec::new();
    let mut free = Vec::new();
    let mut together = Vec::new();
    let mut alone = Vec::new();
    let mut quick = Vec::new();
    for _ in 0..ROUNDS {
        together.push(time(|| fast.certify(&edges, &mut verdicts).expect("whole edges")));
        quick.push(time(|| fast.edges_free(&edges, &mut free).expect("whole edges")));
        alone.push(time(|| {
            for edge in edges.chunks_exact(2 * map.robot.motors.len()) {
                fast.certify(edge, &mut verdict).expect("a whole edge");
            }
        }));
    }
    println!("1,000 long edges: {}", shares(&verdicts));
    report("1,000 long edges", together, 1.0);
    report("1,000 long edges, yes or no", quick, 1.0);
    report("1,000 long edges, one by one", alone, 1.0);
}

/// Measures all methods in rounds, and reports the times of each.
fn validate(name: &str, map: &Map, scene: &Scene, sampled: bool) {
    let edges = map.lines();
    let of_object = |a: u32, b: u32| (0..=20).any(|n| is_object(scene, a, n) || is_object(scene, b, n));
    let whole = FastScene::new(scene, 0.0).expect("it compiles");
    let own = FastScene::of_pairs(scene, 0.0, |a, b| !of_object(a, b)).expect("it compiles");
    let world = FastScene::of_pairs(scene, 0.0, of_object).expect("it compiles");
    let samples = samples(map);
    let poses: usize = samples.iter().map(Vec::len).sum::<usize>() / whole.motors();
    let (mut yes_or_no, mut quick) = (whole.clone(), Vec::new());
    let with = |set| FastScene::with_instructions(scene, 0.0, set).expect("it compiles");
    let others = InstructionSet::available().into_iter().filter(|set| *set != whole.instructions());
    let parts = [("continuous", whole.clone()), ("continuous, self only", own), ("continuous, world only", world)];
    let mut ways = parts.map(|(way, fast)| (way.to_string(), fast)).to_vec();
    ways.extend(others.map(|set| (format!("continuous, {set:?}"), with(set))));
    let mut times = vec![Vec::new(); ways.len()];
    let mut free = whole;
    let mut discrete = Vec::new();
    let mut scalar = Vec::new();
    let mut verdicts = Vec::new();
    let mut answers = Vec::new();
    for round in 0..ROUNDS {
        for ((way, fast), times) in ways.iter_mut().zip(&mut times) {
            times.push(time(|| fast.certify(&edges, &mut verdicts).expect("whole edges")));
            if round == 0 {
                let figures = fast.figures();
                let per_edge = figures.intervals as f64 / verdicts.len() as f64;
                println!(
                    "{name}, {way}: {}; {per_edge:.1} intervals per edge, {} asked of the scalar engine",
                    shares(&verdicts),
                    figures.stuck
                );
            }
        }
        quick.push(time(|| yes_or_no.edges_free(&edges, &mut answers).expect("whole edges")));
        if sampled {
            discrete.push(time(|| {
                let mut verdicts = Vec::new();
                for poses in &samples {
                    free.free(poses, &mut verdicts).expect("whole poses");
                }
            }));
            scalar.push(time(|| line_free(map, scene)) * SLICE as f64);
        }
    }
    let continuous = sorted(times[0].clone())[ROUNDS / 2];
    for ((way, _), times) in ways.iter().zip(times) {
        report(&format!("{name}, {way}"), times, continuous);
    }
    report(&format!("{name}, continuous, yes or no"), quick, continuous);
    if sampled {
        report(&format!("{name}, {poses} samples in lanes, all of each edge"), discrete, continuous);
        report(&format!("{name}, Scene::line_free at 1 mm, by every {SLICE}th edge"), scalar, continuous);
    }
}

/// The poses of each edge, 1 mm of the hand's path apart.
fn samples(map: &Map) -> Vec<Vec<f64>> {
    let of_edge = |(e, (i, j)): (usize, &(usize, usize))| {
        let steps = (map.hand_path(e) / 1e-3).ceil().max(1.0);
        let pose = |k: usize| {
            let at = k as f64 / steps;
            map.poses[*i].iter().zip(&map.poses[*j]).map(move |(a, b)| a + (b - a) * at)
        };
        (0..=steps as usize).flat_map(pose).collect()
    };
    map.edges.iter().enumerate().map(of_edge).collect()
}

fn line_free(map: &Map, scene: &Scene) {
    for (i, j) in map.edges.iter().step_by(SLICE) {
        let from = &map.poses[*i];
        let to = &map.poses[*j];
        std::hint::black_box(scene.line_free(0, &[from], from, to, 1e-3, 0.0));
    }
}

/// One moved object: compiled again and tested against the complete map without an index, and against a thirtieth of
/// it, which is what an index leaves. The mean of twenty objects.
fn one_object(map: &Map, scene: &Scene) {
    let edges = map.lines();
    let few: Vec<f64> = edges.chunks_exact(2 * map.robot.motors.len()).step_by(30).flatten().copied().collect();
    let mut compiled = Vec::new();
    let mut complete = Vec::new();
    let mut indexed = Vec::new();
    let mut verdicts = Vec::new();
    for _ in 0..ROUNDS {
        let mut fast = Vec::new();
        compiled.push(time(|| {
            for number in 0..20 {
                let keep = |a: u32, b: u32| is_object(scene, a, number) || is_object(scene, b, number);
                fast.extend(FastScene::of_pairs(scene, 0.0, keep));
            }
        }));
        complete.push(time(|| fast.iter_mut().for_each(|f| f.certify(&edges, &mut verdicts).expect("whole edges"))));
        indexed.push(time(|| fast.iter_mut().for_each(|f| f.certify(&few, &mut verdicts).expect("whole edges"))));
    }
    let mean = |times: Vec<f64>| times.into_iter().map(|t| t / 20.0).collect();
    report("one object: compiled", mean(compiled), 1.0);
    report("one object: all edges against it", mean(complete), 1.0);
    report("one object: a thirtieth of them", mean(indexed), 1.0);
}

fn shares(verdicts: &[EdgeVerdict]) -> String {
    let share =
        |is: fn(&EdgeVerdict) -> bool| 100.0 * verdicts.iter().filter(|v| is(v)).count() as f64 / verdicts.len() as f64;
    format!(
        "{:.2} % free, {:.2} % blocked, {:.3} % uncertified",
        share(|v| matches!(v, EdgeVerdict::Free)),
        share(|v| matches!(v, EdgeVerdict::Blocked(_))),
        share(|v| matches!(v, EdgeVerdict::Uncertified { .. }))
    )
}

fn time(run: impl FnOnce()) -> f64 {
    let start = Instant::now();
    let begin = processor_time(start);
    run();
    processor_time(start) - begin
}

fn report(what: &str, times: Vec<f64>, base: f64) {
    let times = sorted(times);
    let middle = times[times.len() / 2];
    println!(
        "{what:70} {:9.2} {:9.2} {:9.2} ms min med max  {:8.1}x the first",
        1e3 * times[0],
        1e3 * middle,
        1e3 * times[times.len() - 1],
        middle / base
    );
}
