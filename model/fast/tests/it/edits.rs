//! A scene that is edited equals one that is made from nothing: same distances, verdicts and certificates.

use crate::scenes::{Dice, hulled, made_up, obstacles, shipped};
use mobee_fast::{EdgeVerdict, FastScene};
use mobee_model::{Contact, Edit, Object, ObjectClass, PairRule, Robot, Scene, ShapeId, random_poses};
use nalgebra::Isometry3;
use std::sync::Arc;

/// A random change of the objects.
fn change(dice: &mut Dice, scene: &Scene, number: usize) -> Edit {
    let names: Vec<String> = scene.objects().map(|(_, o)| o.name.clone()).collect();
    let any = |dice: &mut Dice| names[(dice.roll() * names.len() as f64) as usize].clone();
    match (dice.roll() * 8.0) as usize {
        _ if names.is_empty() => Edit::Add(added(dice, number)),
        0..2 => Edit::Add(added(dice, number)),
        2 => Edit::Remove { name: any(dice) },
        3 => {
            let class = [ObjectClass::Obstacle, ObjectClass::Ghost][number % 2];
            Edit::Class { name: any(dice), class }
        }
        _ => Edit::Move { name: any(dice), pose: dice.pose(1.0) },
    }
}

/// An object of a few shapes.
fn added(dice: &mut Dice, number: usize) -> Object {
    let parts = obstacles(number as u64, 1 + number % 3);
    let shapes = parts.iter().take(1 + number % 3).flat_map(|part| part.shapes.clone()).collect();
    Object { name: format!("new{number}"), pose: dice.pose(0.8), shapes, ..parts[0].clone() }
}

/// Names instead of ids, which depend on the edits before.
fn named(scene: &Scene, pair: (ShapeId, ShapeId)) -> (String, String) {
    (scene.shape_name(pair.0), scene.shape_name(pair.1))
}

fn contacts(scene: &Scene, found: &[Contact]) -> Vec<((String, String), u64)> {
    found.iter().map(|c| (named(scene, c.pair), c.distance.to_bits())).collect()
}

/// Everything that a compiled scene answers at some poses and lines, bit for bit.
fn answers(scene: &Scene, fast: &mut FastScene, poses: &[f64]) -> impl PartialEq + std::fmt::Debug + use<> {
    let motors = fast.motors();
    let (mut free, mut verdicts, mut quick) = (Vec::new(), Vec::new(), Vec::new());
    fast.free(poses, &mut free).expect("whole poses");
    // Long lines, and short ones that are free more often.
    let lines = poses.chunks_exact(2 * motors).enumerate().flat_map(|(i, line)| {
        let (from, to) = line.split_at(motors);
        let share = if i % 2 == 0 { 1.0 } else { 0.05 };
        from.iter().copied().chain(from.iter().zip(to).map(move |(a, b)| a + (b - a) * share)).collect::<Vec<_>>()
    });
    let lines: Vec<f64> = lines.collect();
    fast.certify(&lines, &mut verdicts).expect("whole lines");
    fast.edges_free(&lines, &mut quick).expect("whole lines");
    let sampled = lines.chunks_exact(2 * motors).map(|line| fast.samples_free(line, 32).expect("a line"));
    let sampled: Vec<bool> = sampled.collect();
    let text = |verdict: &EdgeVerdict| match verdict {
        EdgeVerdict::Free => ("free".to_owned(), 0, None),
        EdgeVerdict::Uncertified { at } => ("uncertified".to_owned(), at.to_bits(), None),
        EdgeVerdict::Blocked(o) => ("blocked".to_owned(), o.at.to_bits(), o.pair.map(|pair| named(scene, pair))),
    };
    let verdicts: Vec<_> = verdicts.iter().map(text).collect();
    let figures = fast.figures();
    (free, verdicts, quick, sampled, figures.pairs, figures.pruned)
}

fn compare(name: &str, robot: Arc<Robot>, seed: u64, clearance: f64) {
    let robots = vec![(robot.clone(), Isometry3::translation(0.1, -0.05, 0.02))];
    let mut dice = Dice(seed);
    let mut scene = Scene::new(robots.clone(), obstacles(seed, 5)).expect("a scene");
    let mut patched = FastScene::new(&scene, clearance).expect("it compiles");
    let rule = robot.parts.first().map(|part| {
        let names = format!("{}:o1", part.name);
        if seed.is_multiple_of(2) { PairRule::may_touch(&names) } else { PairRule::near(&names, clearance / 2.0) }
    });
    let rules: Vec<PairRule> = rule.flatten().into_iter().collect();
    let poses: Vec<f64> = random_poses(&robot, seed).take(64).flatten().collect();
    let mut first = (scene.clone(), patched.clone());
    let at_first = answers(&first.0, &mut first.1, &poses);
    for round in 0..12 {
        for number in 0..1 + round % 3 {
            scene = scene.edit(&change(&mut dice, &scene, 10 * round + number)).unwrap_or(scene);
        }
        // Rules from the middle on.
        let rules = if round < 6 { &[][..] } else { &rules };
        scene = scene.with_pair_rules_of_present(0, rules);
        patched.set_scene(&scene, |_, _| true).expect("it compiles");
        let objects: Vec<Object> = scene.objects().map(|(_, object)| Object::clone(object)).collect();
        let fresh = Scene::new(robots.clone(), objects).expect("a scene").with_pair_rules_of_present(0, rules);
        assert_eq!(scene.pairs(), fresh.pairs(), "{name}, round {round}");
        for pose in poses.chunks_exact(robot.motors.len()).take(8) {
            let all = |scene: &Scene| contacts(scene, &scene.contacts(&[pose], 0.1));
            assert_eq!(all(&scene), all(&fresh), "{name}, round {round}");
        }
        let fixed = |scene: &Scene| contacts(scene, scene.static_contacts());
        assert_eq!(fixed(&scene), fixed(&fresh), "{name}, round {round}");
        let mut compiled = FastScene::new(&fresh, clearance).expect("it compiles");
        let mut shared = patched.among(&scene, |_, _| true).expect("it compiles");
        let expected = answers(&fresh, &mut compiled, &poses);
        assert_eq!(answers(&scene, &mut patched, &poses), expected, "{name}, round {round}: patched");
        assert_eq!(answers(&scene, &mut shared, &poses), expected, "{name}, round {round}: shared");
    }
    assert_eq!(answers(&first.0, &mut first.1, &poses), at_first, "{name}: a clone is independent of edits");
}

#[test]
fn a_patched_scene_gives_the_results_of_a_new_one() {
    for seed in 0..4 {
        compare("made up", made_up("r", seed), seed, 0.004 * seed as f64);
    }
    compare("with hulls", hulled(&made_up("r", 1), 1), 10, 0.01);
    compare("katana", shipped("katana"), 3, 0.0);
    compare("icub", shipped("icub"), 5, 0.012);
}
