//! Verdicts beside samples at 0.1 mm: what the tests do with hundreds of edges, with twenty-one thousand of each robot.

use crate::map::{Dice, Map};
use mobee_fast::{EdgeVerdict, FastScene};
use mobee_model::{Object, Robot, Scene, load_robot, random_poses};
use nalgebra::Isometry3;
use std::path::Path;
use std::sync::Arc;

/// Short edges, on which a hand goes about 23 mm, and long ones.
const SHORT: usize = 20_000;
const LONG: usize = 1_000;
/// No point of any of these robots is farther than this from any axis that moves it here, meters.
const REACH: f64 = 1.3;

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
        let short = random_edges(&robot, &scene, SHORT, 0.03);
        check(&format!("{name}, short edges"), &scene, &short);
        check(&format!("{name}, long edges"), &scene, &random_edges(&robot, &scene, LONG, 1.0));
    }
}

/// From free poses, a share of the way to other random poses.
fn random_edges(robot: &Robot, scene: &Scene, count: usize, share: f64) -> Vec<f64> {
    let mut free = random_poses(robot, 3).filter(|pose| scene.free(&[pose], 0.0));
    let mut others = random_poses(robot, 4);
    let mut edges = Vec::new();
    for (from, to) in free.by_ref().zip(others.by_ref()).take(count) {
        edges.extend_from_slice(&from);
        edges.extend(from.iter().zip(&to).map(|(a, b)| a + (b - a) * share));
    }
    edges
}

fn check(name: &str, scene: &Scene, edges: &[f64]) {
    let mut fast = FastScene::new(scene, 0.0).expect("it compiles");
    let length = 2 * fast.motors();
    let (mut verdicts, mut free) = (Vec::new(), Vec::new());
    fast.certify(edges, &mut verdicts).expect("whole edges");
    let (mut missed, mut invented, mut samples, mut grazed) = (0, 0, 0, 0);
    for (edge, verdict) in edges.chunks_exact(length).zip(&verdicts) {
        let (from, to) = edge.split_at(length / 2);
        let at = |share: f64| from.iter().zip(to).map(move |(a, b)| a + (b - a) * share);
        let way: f64 = from.iter().zip(to).map(|(a, b)| (b - a).abs() * REACH).sum();
        let steps = (way / 1e-4).ceil().max(1.0);
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
