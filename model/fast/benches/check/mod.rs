//! Comparison of verdicts with samples at 0.1 mm: the tests' check of hundreds of edges, for twenty-one thousand per
//! robot.

use crate::map::{Dice, Map};
use mobee_fast::{EdgeVerdict, FastScene};
use mobee_model::{Object, Robot, Scene, load_robot, random_poses};
use nalgebra::Isometry3;
use std::path::Path;
use std::sync::Arc;

/// Number of short edges, on which a hand moves about 23 mm, and of long ones.
const SHORT: usize = 20_000;
const LONG: usize = 1_000;

pub fn all(map: &Map, objects: &[Object]) {
    let scene = map.scene(objects.to_vec());
    let mut dice = Dice(1);
    let short: Vec<f64> = map.lines().chunks_exact(2 * map.robot.motors.len()).take(SHORT).flatten().copied().collect();
    check("icub, edges of the map", &scene, &short);
    let mut pick = || map.poses[(dice.roll() * map.poses.len() as f64) as usize].clone();
    let long: Vec<f64> = (0..2 * LONG).flat_map(|_| pick()).collect();
    check("icub, long edges", &scene, &long);
    for name in ["panda", "ur5"] {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../configs/robots/{name}.xml"));
        let robot = Arc::new(load_robot(file).expect("the robot loads").value);
        let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], objects.to_vec()).expect("a scene");
        check(&format!("{name}, short edges"), &scene, &random_edges(&robot, &scene, SHORT, Some(0.023)));
        check(&format!("{name}, long edges"), &scene, &random_edges(&robot, &scene, LONG, None));
    }
}

/// Edges from free poses toward other random poses: complete, or until the hand has moved about `hand_path` meters.
fn random_edges(robot: &Robot, scene: &Scene, count: usize, hand_path: Option<f64>) -> Vec<f64> {
    let mut free = random_poses(robot, 3).filter(|pose| scene.free(&[pose], 0.0));
    let mut others = random_poses(robot, 4);
    let mut edges = Vec::new();
    for (from, to) in free.by_ref().zip(others.by_ref()).take(count) {
        let at = |share: f64| from.iter().zip(&to).map(|(a, b)| a + (b - a) * share).collect::<Vec<f64>>();
        let hand = |share: f64| scene.node_transforms(&[at(share)])[0].last().expect("a hand").translation.vector;
        let share = hand_path.map_or(1.0, |path| (path * 1e-3 / (hand(1e-3) - hand(0.0)).norm()).min(1.0));
        edges.extend_from_slice(&from);
        edges.extend(at(share));
    }
    edges
}

/// Maximum displacement of any link along an edge, meters.
fn longest_way(scene: &Scene, from: &[f64], to: &[f64]) -> f64 {
    let places = |k: usize| {
        let pose: Vec<f64> = from.iter().zip(to).map(|(a, b)| a + (b - a) * k as f64 / 16.0).collect();
        scene.node_transforms(&[pose]).concat()
    };
    let mut ways = vec![0.0; places(0).len()];
    for k in 0..16 {
        for (way, (a, b)) in ways.iter_mut().zip(places(k).iter().zip(&places(k + 1))) {
            *way += (a.translation.vector - b.translation.vector).norm();
        }
    }
    ways.into_iter().fold(0.0, f64::max)
}

fn check(name: &str, scene: &Scene, edges: &[f64]) {
    let mut fast = FastScene::new(scene, 0.0).expect("it compiles");
    let length = 2 * fast.motors();
    let mut verdicts = Vec::new();
    let mut free = Vec::new();
    fast.certify(edges, &mut verdicts).expect("whole edges");
    let mut missed = 0;
    let mut invented = 0;
    let mut samples = 0;
    let mut grazed = 0;
    for (edge, verdict) in edges.chunks_exact(length).zip(&verdicts) {
        let (from, to) = edge.split_at(length / 2);
        let at = |share: f64| from.iter().zip(to).map(move |(a, b)| a + (b - a) * share);
        let steps = (longest_way(scene, from, to) / 1e-4).ceil().max(1.0);
        let poses: Vec<f64> = (0..=steps as usize).flat_map(|k| at(k as f64 / steps)).collect();
        fast.free(&poses, &mut free).expect("whole poses");
        samples += free.len();
        let all_free = free.iter().all(|free| *free);
        match verdict {
            EdgeVerdict::Free => missed += usize::from(!all_free),
            EdgeVerdict::Blocked(found) => {
                grazed += usize::from(all_free);
                let pose: Vec<f64> = at(found.at).collect();
                invented += usize::from(scene.free(&[pose], 0.0));
            }
            EdgeVerdict::Uncertified { .. } => {}
        }
    }
    println!(
        "{name}: {} edges, {samples} samples; {}; {missed} missed, {invented} invented, {grazed} contacts between samples",
        verdicts.len(),
        crate::shares(&verdicts)
    );
}
