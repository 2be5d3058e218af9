//! Promises: a sweep finds the minimum distances between two poses; no shape moves farther than its bounds.

use mobee_model::{Contact, Robot, Scene, ShapeId, Sweep, Watch, load_robot};
use nalgebra::Isometry3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Search distance, meters, and the possible undercut of a distance between two steps a millimeter apart.
const WITHIN: f64 = 0.012;
const MISSED: f64 = 0.0005;

/// Two Katanas that reach each other.
fn scene() -> Arc<Scene> {
    let own = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/katana.xml");
    let one = load_robot(own).expect("the robot loads").value;
    let other = Robot { name: "other".into(), ..one.clone() };
    let stands = |y: f64, yaw: f64| Isometry3::new([0.0, y, 0.0].into(), [0.0, 0.0, yaw].into());
    let quarter = std::f64::consts::FRAC_PI_2;
    let robots = vec![(Arc::new(one), stands(0.25, -quarter)), (Arc::new(other), stands(-0.25, quarter))];
    Arc::new(Scene::new(robots, Vec::new()).expect("a scene"))
}

fn any_pose(robot: &Robot, rng: &mut ChaCha8Rng) -> Vec<f64> {
    robot.motors.iter().map(|m| m.min + (m.max - m.min) * rng.random::<f64>()).collect()
}

fn between(contact: &Contact) -> bool {
    matches!((contact.pair.0, contact.pair.1), (ShapeId::Robot { robot: a, .. }, ShapeId::Robot { robot: b, .. }) if a != b)
}

#[test]
fn a_sweep_finds_what_is_nearest_on_the_way() {
    let (scene, mut rng) = (scene(), ChaCha8Rng::seed_from_u64(1));
    let mut sweep = Sweep::new(scene.clone(), WITHIN);
    let mut met = 0;
    for _ in 0..12_000 {
        let from: Vec<Vec<f64>> = scene.robots().iter().map(|r| any_pose(r, &mut rng)).collect();
        if scene.contacts(&from, 0.06).iter().all(|c| !between(c)) {
            continue;
        }
        let to: Vec<Vec<f64>> =
            from.iter().map(|q| q.iter().map(|q| q + rng.random_range(-0.012..0.012)).collect()).collect();
        let at = |part: f64| -> Vec<Vec<f64>> {
            let line = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a + (b - a) * part).collect();
            from.iter().zip(&to).map(line).collect()
        };
        let mut truth = BTreeMap::new();
        for k in 0..=100 {
            for c in scene.contacts(&at(f64::from(k) / 100.0), 2.0 * WITHIN).iter().filter(|c| between(c)) {
                let least = truth.entry(c.pair).or_insert(f64::INFINITY);
                *least = c.distance.min(*least);
            }
        }
        sweep.jump();
        let mut found = BTreeMap::new();
        for c in [&from, &to].map(|poses| sweep.to(poses).to_vec()).concat() {
            let least = found.entry(c.pair).or_insert(f64::INFINITY);
            *least = c.distance.min(*least);
        }
        for (pair, least) in &truth {
            match found.get(pair) {
                Some(d) => assert!((least - 1e-4..least + MISSED).contains(d), "{pair:?}: {d} for {least}"),
                None => assert!(*least > WITHIN - MISSED, "{pair:?} came to {least}"),
            }
        }
        assert!(found.keys().all(|pair| truth.contains_key(pair)), "pairs of two robots alone");
        met += found.len();
    }
    assert!(met > 50, "{met}: no test");
}

/// The groups that may come near while no motor leaves its range, computed at the centers of the ranges, are complete:
/// no sweep within the ranges finds another pair of the robot.
#[test]
fn groups_that_are_left_out_have_nothing_near() {
    let (scene, mut rng) = (scene(), ChaCha8Rng::seed_from_u64(3));
    let of_all = || Sweep::of_all(scene.clone(), WITHIN, WITHIN / 2.0);
    let (mut all, mut some, mut watch) = (of_all(), of_all(), Watch::new(scene.clone(), WITHIN));
    let (mut met, mut empty) = (0, 0);
    let mut here: Vec<Vec<f64>> = scene.home().iter().map(|q| q.to_vec()).collect();
    let mut goal = here.clone();
    let mut last: Option<Vec<Vec<f64>>> = None;
    for k in 0..6000 {
        if k % 60 == 0 {
            goal = scene.robots().iter().map(|r| any_pose(r, &mut rng)).collect();
        }
        let robot = k % 2;
        here[robot].iter_mut().zip(&goal[robot]).for_each(|(q, to)| *q += (to - *q).clamp(-0.02, 0.02));
        // Ahead of the robot, sometimes farther.
        let far = if k % 7 == 0 { 0.2 } else { 0.04 };
        let ahead: Vec<Vec<f64>> = here
            .iter()
            .zip(&goal)
            .map(|(q, goal)| q.iter().zip(goal).map(|(q, to)| q + (to - q).clamp(-far, far)).collect())
            .collect();
        let away = |poses: &[Vec<f64>]| -> Vec<f64> {
            here.concat().iter().zip(poses.concat()).map(|(q, to)| (to - q).abs()).collect()
        };
        let from = last.as_ref().map_or_else(|| vec![0.0; here.concat().len()], |last| away(last));
        let ranges: Vec<f64> = away(&ahead).iter().zip(from).map(|(to, from)| to.max(from)).collect();
        // Sometimes up to a smaller distance than the margin.
        let within = WITHIN * [1.0, 0.3, 0.7][k % 3];
        let groups = watch.near_groups(robot, &here, &ranges, within);
        let own = |c: &&Contact| c.distance < within && [c.pair.0.robot(), c.pair.1.robot()].contains(&Some(robot));
        let expected: Vec<Contact> = all.to(&ahead).iter().filter(own).copied().collect();
        let found: Vec<Contact> = some.to_of(&ahead, &groups).iter().filter(own).copied().collect();
        assert_eq!(found, expected, "step {k}");
        (met, empty) = (met + usize::from(!found.is_empty()), empty + usize::from(groups.is_empty()));
        last = Some(ahead);
    }
    assert!(met > 100 && empty > 100, "{met} ways with contacts, {empty} with nothing near: no test");
}

#[test]
fn no_shape_goes_farther_than_its_bounds() {
    let (scene, mut rng) = (scene(), ChaCha8Rng::seed_from_u64(2));
    for _ in 0..300 {
        let poses: Vec<Vec<f64>> = scene.robots().iter().map(|r| any_pose(r, &mut rng)).collect();
        let (mut frames, mut firsts) = (Vec::new(), Vec::new());
        for (skeleton, pose) in scene.skeletons().iter().zip(&poses) {
            firsts.push(frames.len());
            skeleton.place(pose, &mut frames);
        }
        for collider in scene.colliders() {
            let robot = firsts.iter().rposition(|first| *first <= collider.frame).expect("it is a robot's");
            let at = (frames[collider.frame] * collider.pose).translation.vector;
            let (far, reach) = ((at - scene.base(robot).translation.vector).norm(), scene.reach(robot));
            assert!(far <= reach && reach < 1.5, "{far} m of {reach}");
        }
        let next: Vec<Vec<f64>> =
            poses.iter().map(|q| q.iter().map(|q| q + rng.random_range(-0.1..0.1)).collect()).collect();
        let [before, after] = [&poses, &next].map(|q| scene.node_transforms(q));
        for (robot, (a, b)) in before.iter().zip(&after).enumerate() {
            let went = a.iter().zip(b).map(|(a, b)| (a.translation.vector - b.translation.vector).norm());
            let travel = scene.travel(robot, &poses[robot], &next[robot]);
            assert!(went.clone().fold(0.0, f64::max) <= travel + 1e-9, "{:?} of {travel}", went.collect::<Vec<_>>());
        }
    }
    assert_eq!((scene.reach(2), scene.travel(2, &[0.0], &[1.0])), (0.0, 0.0));
}
