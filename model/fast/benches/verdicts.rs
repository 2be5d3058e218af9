//! Poses per second and core: [`FastScene::free`] against [`Scene::free`], the same shapes, pairs and poses, in
//! interleaved rounds.
//!
//! On random poses, and on straight lines of 64 poses between them. Robots: the shipped ones, the original `icub.xml`
//! if the shared reference data exist (`MOBEE_SHARED`, or `../shared`), and the files in the arguments: `cargo bench -p
//! mobee-fast --bench verdicts -- ur5.xml panda.xml`. Every verdict is compared; `MOBEE_POSES` sets the number of
//! poses.
#![allow(clippy::disallowed_methods)] // a measurement of the processor

mod measure;
#[path = "measure/rate.rs"]
mod rate;

use measure::{processor_time, sorted};
use mobee_fast::{FastScene, InstructionSet};
use mobee_model::{Robot, Scene, load_robot, load_world, random_poses};
use nalgebra::Isometry3;
use rate::rate;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Number of rounds; the median and the extremes are reported.
const ROUNDS: usize = 7;
/// Number of poses per line.
const LINE: usize = 64;

fn main() {
    let given = std::env::args().skip(1).filter(|a| !a.starts_with("--")).map(PathBuf::from);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let shared =
        std::env::var_os("MOBEE_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from).join("reference");
    let own = ["icub", "katana"].map(|name| root.join(format!("configs/robots/{name}.xml")));
    let reference = ["mobee-original-data/icub.xml", "mobee-oracle/edge/edge_a.xml"].map(|file| shared.join(file));
    let count = std::env::var("MOBEE_POSES").ok().and_then(|n| n.parse().ok()).unwrap_or(20_000);
    println!("{}", header());
    for file in reference.into_iter().chain(own).chain(given) {
        let Ok(robot) = load_robot(&file) else {
            println!("{}: not there, or not a robot", file.display());
            continue;
        };
        let robot = Arc::new(robot.value);
        let scene = |objects| Scene::new(vec![(robot.clone(), Isometry3::identity())], objects).expect("a scene");
        let mut name: Vec<_> = file.iter().rev().take(2).map(|p| p.to_string_lossy()).collect();
        name.reverse();
        let name = name.join("/");
        compare(&name, &robot, &scene(Vec::new()), count);
        let world = shared.join("mobee-oracle/icub/world20.xml");
        if name.contains("icub.xml")
            && let Ok(objects) = load_world(world)
        {
            compare(&format!("{name}, 20 obstacles"), &robot, &scene(objects.value), count);
        }
    }
}

fn header() -> String {
    format!(
        "{:44} {:7} {:>6} {:>8} {:>6} {:>9}  {:>8}  {:>26}  {:>22}  {:>8}  compiled in",
        "robot",
        "poses",
        "free",
        "pairs",
        "pruned",
        "lanes",
        "ratio",
        "fast, poses/s min med max",
        "scalar, poses/s",
        "doubtful"
    )
}

/// Random poses, or straight lines between random ones.
fn poses(robot: &Robot, count: usize, lines: bool) -> Vec<f64> {
    let mut random = random_poses(robot, 7);
    if !lines {
        return random.take(count).flatten().collect();
    }
    let ends: Vec<Vec<f64>> = random.by_ref().take(count / LINE + 1).collect();
    let between = |pair: &[Vec<f64>]| {
        let from = pair[0].clone();
        let to = pair[1].clone();
        // A fifth of the line: about the length of a roadmap's edges.
        let at = move |i: usize| 0.2 * i as f64 / LINE as f64;
        (0..LINE)
            .flat_map(move |i| from.iter().zip(&to).map(|(a, b)| a + (b - a) * at(i)).collect::<Vec<_>>())
            .collect::<Vec<_>>()
    };
    ends.windows(2).flat_map(between).collect()
}

fn compare(name: &str, robot: &Robot, scene: &Scene, count: usize) {
    for lines in [false, true] {
        let poses = poses(robot, count, lines);
        let motors = robot.motors.len();
        let count = poses.len() / motors;
        let sets = InstructionSet::available();
        let start = Instant::now();
        let begin = processor_time(start);
        drop(FastScene::new(scene, 0.0));
        let compiled = processor_time(start) - begin;
        let mut fast: Vec<FastScene> =
            sets.iter().map(|set| FastScene::with_instructions(scene, 0.0, *set).expect("it compiles")).collect();
        let mut scalar_rates = Vec::new();
        let mut rates = vec![Vec::new(); fast.len()];
        let mut expected = Vec::new();
        let mut free = Vec::new();
        // A million poses serve only for comparing the verdicts.
        let rounds = if count > 200_000 { 1 } else { ROUNDS };
        for _ in 0..rounds {
            // A part of them is enough for the slow one, except in the first round, which compares all.
            let slice = if expected.is_empty() { count } else { count.min(4000) };
            let mut verdicts = Vec::new();
            scalar_rates.push(rate(slice, || {
                verdicts = poses.chunks_exact(motors).take(slice).map(|pose| scene.free(&[pose], 0.0)).collect();
            }));
            if expected.is_empty() {
                expected = verdicts;
            }
            for (fast, rates) in fast.iter_mut().zip(&mut rates) {
                rates.push(rate(count, || fast.free(&poses, &mut free).expect("whole poses")));
                assert!(free == expected, "{name}: verdicts differ");
            }
        }
        let share = expected.iter().filter(|free| **free).count() as f64 / count as f64;
        let scalar = sorted(scalar_rates);
        for (fast, rates) in fast.iter().zip(rates) {
            let rates = sorted(rates);
            let figures = fast.figures();
            println!(
                "{name:44} {:7} {:5.1}% {:8} {:6} {:>9}  {:7.1}x  {:8.0} {:8.0} {:8.0}  {:6.0} {:7.0} {:7.0}  {:.4}%  {:.0} ms",
                if lines { "lines" } else { "random" },
                100.0 * share,
                figures.pairs,
                figures.pruned,
                format!("{:?}", fast.instructions()),
                rates[rounds / 2] / scalar[rounds / 2],
                rates[0],
                rates[rounds / 2],
                rates[rounds - 1],
                scalar[0],
                scalar[rounds / 2],
                scalar[rounds - 1],
                100.0 * figures.doubtful as f64 / figures.poses as f64,
                1e3 * compiled
            );
        }
    }
}
