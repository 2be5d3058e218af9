//! The layer of verdicts on a map's edges: after any edits of the world it equals a layer that has
//! seen only the last world, and its verdicts are correct.

use crate::world::*;
use mobee_contract::View;
use mobee_fast::EdgeVerdict;
use mobee_model::*;
use mobee_planning::roadmap::validity::{EdgeEnds, Validity, edge_between};
use mobee_planning::roadmap::{Roadmap, Vertex};
use nalgebra::Isometry3;
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_3;
use std::path::Path;
use std::sync::Arc;

/// Creates a map of random poses of some motors.
fn random_map(scene: &Scene, motors: &[usize], vertices: usize, k: usize, seed: u64) -> Roadmap {
    let robot = &scene.robots()[0];
    let mut map = Roadmap::new(motors.to_vec(), robot);
    for q in random_poses(robot, seed).take(vertices) {
        let mut whole: Vec<f64> = scene.home()[0].to_vec();
        motors.iter().for_each(|m| whole[*m] = q[*m]);
        map.add(Vertex { name: None, q: whole, at: [0.0; 3] });
    }
    map.join_nearest(k);
    map
}

fn undirected(map: &Roadmap) -> BTreeSet<EdgeEnds> {
    map.edges().into_iter().map(|(a, b, _)| edge_between(a, b)).collect()
}

/// Makes a random edit of the objects within reach.
fn edit(scene: &Scene, rng: &mut ChaCha8Rng, reach: f64, flat: bool) -> Edit {
    let names: Vec<String> = scene.objects().map(|(_, o)| o.name.clone()).collect();
    let mut at = || {
        let z = if flat { 0.0 } else { rng.random_range(-0.2..0.6) };
        Isometry3::translation(rng.random_range(-reach..reach), rng.random_range(-reach..reach), z)
    };
    let pose = at();
    let add = |rng: &mut ChaCha8Rng, pose| {
        let shape = |rng: &mut ChaCha8Rng| match rng.random_range(0..3) {
            0 => Shape::Sphere { radius: rng.random_range(0.02..0.12) },
            1 => Shape::Capsule { radius: 0.03, height: rng.random_range(0.05..0.3) },
            _ => Shape::Box { size: nalgebra::Vector3::new(0.1, rng.random_range(0.02..0.3), 0.08) },
        };
        let shapes = (0..rng.random_range(1..3)).map(|i| {
            let pose = Isometry3::translation(0.1 * f64::from(i), 0.0, 0.0);
            Primitive { shape: shape(rng), pose }
        });
        let shapes = shapes.collect();
        let name = format!("object{}", scene.epoch());
        Edit::Add(Object { name, class: ObjectClass::Obstacle, persistent: false, pose, shapes, color: None })
    };
    if names.is_empty() {
        return add(rng, pose);
    }
    let name = names[rng.random_range(0..names.len())].clone();
    match rng.random_range(0..10) {
        0..4 => Edit::Move { name, pose },
        4..7 => add(rng, pose),
        7 => Edit::Remove { name },
        8 => Edit::Class { name, class: ObjectClass::Ghost },
        _ => Edit::Class { name, class: ObjectClass::Obstacle },
    }
}

/// Edits a world, and compares a layer that saw all edits with one that sees only the last world;
/// returns the number of edges blocked by objects, summed over all worlds.
fn follow(scene: &Arc<Scene>, map: &Roadmap, seed: u64, edits: usize, reach: f64, flat: bool) -> usize {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let all = undirected(map);
    let mut scene = scene.clone();
    let home = scene.home()[0].clone();
    let mut layer = Validity::new(map.motors());
    assert!(layer.look(&view(&scene, &home)).forgotten);
    layer.certify(map, all.iter().copied());
    let mut blocked = 0;
    for step in 0..edits {
        let before: Vec<_> = all.iter().map(|edge| layer.verdict(*edge).copied()).collect();
        // Sometimes several at once, as after a motion of the robot.
        for _ in 0..rng.random_range(1..3) {
            scene = Arc::new(scene.edit(&edit(&scene, &mut rng, reach, flat)).unwrap());
        }
        let seen = view(&scene, &home);
        let news = layer.look(&seen);
        assert!(!news.forgotten, "the robot is the same");
        let mut fresh = Validity::new(map.motors());
        fresh.look(&seen);
        fresh.certify(map, all.iter().copied());
        for (edge, before) in all.iter().zip(before) {
            let verdict = layer.verdict(*edge).copied();
            assert_eq!(verdict, fresh.verdict(*edge).copied(), "edge {edge:?} after edit {step}");
            let objects = |v: &Validity| v.blocked_by(*edge).collect::<BTreeSet<_>>();
            assert_eq!(objects(&layer), objects(&fresh), "edge {edge:?} after edit {step}");
            assert!(verdict == before || news.edges.contains(edge), "edge {edge:?} changed without news");
            blocked += objects(&layer).len();
        }
    }
    tell_the_truth(&layer, map, &view(&scene, &home));
    blocked
}

/// Compares every verdict with samples of the edge.
fn tell_the_truth(layer: &Validity, map: &Roadmap, view: &View) {
    for (a, b) in undirected(map) {
        let robot = &view.scene.robots()[0];
        let from = &map.vertex(a).unwrap().q;
        let to = robot.nearest_equivalent(from, &map.vertex(b).unwrap().q);
        let at = |s: f64| from.iter().zip(&to).map(|(a, b)| a + (b - a) * s).collect::<Vec<_>>();
        match layer.verdict((a, b)).unwrap() {
            EdgeVerdict::Free => {
                let free = view.scene.line_free(0, &view.poses, from, &to, 0.002, view.clearance);
                assert!(free, "{a} - {b} touches");
            }
            EdgeVerdict::Blocked(found) => {
                assert!(!view.scene.free(&[at(found.at)], view.clearance), "{a} - {b} is free at {}", found.at);
            }
            EdgeVerdict::Uncertified { .. } => {}
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, rng_seed: proptest::test_runner::RngSeed::Fixed(15), ..ProptestConfig::default() })]

    #[test]
    fn after_any_edits_an_arm_s_edges_are_what_a_fresh_look_says(seed in any::<u64>(), joints in 2usize..4) {
        let robot = arm(joints);
        let scene = scene(&robot, vec![]);
        let motors: Vec<usize> = (0..joints).collect();
        let map = random_map(&scene, &motors, 14, 4, seed);
        follow(&scene, &map, seed, 8, 0.3 * joints as f64, true);
    }
}

#[test]
fn so_it_is_on_the_icub() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let robot = Arc::new(load_robot(configs.join("robots/icub.xml")).unwrap().value);
    let objects = load_world(configs.join("worlds/explore.xml")).unwrap().value;
    let scene = Arc::new(Scene::new(vec![(robot.clone(), Isometry3::identity())], objects).unwrap());
    let names = ["torso", "r_shoulder_pitch", "r_shoulder_roll", "r_shoulder_yaw", "r_elbow"].map(String::from);
    let motors = mobee_planning::group::motors("motors", &names, &robot).unwrap();
    let map = random_map(&scene, &motors, 12, 3, 4);
    let blocked = follow(&scene, &map, 4, 8, 0.4, false);
    assert!(blocked > 20, "too little stands in the way for this to say anything: {blocked}");
}

#[test]
fn an_object_that_goes_takes_its_blocks_along_and_no_other_s() {
    let robot = arm(2);
    let on_the_way = |name: &str, y| ball(name, 0.6, y, 0.05, ObjectClass::Obstacle);
    let both = scene(&robot, vec![on_the_way("ball", 0.0), on_the_way("other", 0.05)]);
    let mut map = Roadmap::new(vec![0, 1], &robot);
    for q in [60f64, -60.0] {
        map.add(Vertex { name: None, q: vec![q.to_radians(), 0.0], at: [0.0; 3] });
    }
    map.join(0, 1);
    let home = both.home()[0].clone();
    let mut layer = Validity::new(&[0, 1]);
    layer.look(&view(&both, &home));
    assert_eq!(layer.verdict((0, 1)), None, "nobody asked");
    layer.certify(&map, [(0, 1)]);
    let by = |layer: &Validity| layer.blocked_by((0, 1)).collect::<Vec<_>>();
    assert_eq!(by(&layer), [0, 1]);

    let one = Arc::new(both.edit(&Edit::Remove { name: "ball".into() }).unwrap());
    let news = layer.look(&view(&one, &home));
    assert_eq!((news.objects, news.edges), (BTreeSet::from([0]), BTreeSet::from([(0, 1)])));
    assert_eq!(by(&layer), [1]);
    let aside = Edit::Move { name: "other".into(), pose: Isometry3::translation(0.0, 0.0, 1.0) };
    let none = Arc::new(one.edit(&aside).unwrap());
    layer.look(&view(&none, &home));
    assert_eq!(layer.verdict((0, 1)), Some(&EdgeVerdict::Free));
    assert_eq!(layer.look(&view(&none, &home)), Default::default(), "no news");

    // Another clearance, another robot: all verdicts are discarded.
    let back = Edit::Class { name: "other".into(), class: ObjectClass::Ghost };
    let mut wide = view(&Arc::new(none.edit(&back).unwrap()), &home);
    wide.clearance = 0.02;
    let news = layer.look(&wide);
    assert!(news.forgotten && news.objects == BTreeSet::from([1]), "{news:?}");
    assert_eq!(layer.verdict((0, 1)), None);
}

#[test]
fn a_motor_that_rests_elsewhere_makes_all_be_asked_anew() {
    let robot = arm(3);
    let scene = scene(&robot, vec![ball("ball", 0.6, 0.3, 0.05, ObjectClass::Obstacle)]);
    let mut map = Roadmap::new(vec![0, 1], &robot);
    for q in [60f64, -60.0] {
        map.add(Vertex { name: None, q: vec![q.to_radians(), 0.0, 0.0], at: [0.0; 3] });
    }
    map.join(0, 1);
    let mut layer = Validity::new(&[0, 1]);
    for (rest, forgotten) in [(0.0, true), (0.001, false), (0.5, true), (0.501, false), (0.4, true)] {
        let seen = view(&scene, &[0.1, 0.2, rest]);
        assert_eq!(layer.look(&seen).forgotten, forgotten, "at {rest}");
        layer.certify(&map, [(0, 1)]);
        let blocked = !scene.line_free(0, &seen.poses, &[FRAC_PI_3, 0.0, rest], &[-FRAC_PI_3, 0.0, rest], 0.001, 0.012);
        assert_eq!(layer.verdict((0, 1)) != Some(&EdgeVerdict::Free), blocked, "at {rest}");
    }
}
