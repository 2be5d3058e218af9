//! Promise: an edge that is certified free is free at every pose; a blocked edge is blocked at the reported position.

use crate::scenes::{Dice, alone, hulled, made_up, obstacles, shipped, two_shapes};
use mobee_fast::{EdgeVerdict, FastError, FastScene, InstructionSet};
use mobee_model::{PairRule, Robot, Scene, ShapeId, random_poses};
use nalgebra::Isometry3;
use std::sync::Arc;

/// Distance of samples of short edges, meters: no point of a robot moves farther between two.
const STEP: f64 = 1e-4;
/// Precision of the position of a contact, meters.
const PLACE: f64 = 1e-3;
/// Maximum distance of any point of the robots here from any axis, meters.
const REACH: f64 = 1.3;
/// As `REACH`, for a body that translates 1 mm per degree.
const BODY: f64 = 0.12;

/// Splits one list of numbers into the poses of all robots.
fn split<'a>(scene: &Scene, pose: &'a [f64]) -> Vec<&'a [f64]> {
    let mut rest = pose;
    let own = |robot: &Arc<Robot>| {
        let (own, others) = rest.split_at(robot.motors.len());
        rest = others;
        own
    };
    scene.robots().iter().map(own).collect()
}

fn between(from: &[f64], to: &[f64], at: f64) -> Vec<f64> {
    from.iter().zip(to).map(|(a, b)| a + (b - a) * at).collect()
}

/// Edges from random poses, every second one from a free pose if one is found: short ones, whose motors move less than
/// `step` of their range, or long ones to other random poses.
fn edges(scene: &Scene, seed: u64, count: usize, step: f64) -> Vec<f64> {
    let mut dice = Dice(seed);
    let mut robots: Vec<_> = scene.robots().iter().map(|r| random_poses(r, seed)).collect();
    let mut pose = || robots.iter_mut().filter_map(Iterator::next).flatten().collect::<Vec<f64>>();
    let mut all = Vec::new();
    for i in 0..count {
        let mut from = pose();
        for _ in 0..(i % 2) * 50 {
            if scene.free(&split(scene, &from), 0.0) {
                break;
            }
            from = pose();
        }
        let to = pose();
        // A line toward another random pose stays within the limits.
        let share = if step >= 1.0 { 1.0 } else { step * (0.2 + dice.roll()) };
        all.extend_from_slice(&from);
        all.extend(between(&from, &to, share));
    }
    all
}

/// Compares verdicts with dense samples; returns the share of each kind: free, blocked, uncertified.
fn compare(name: &str, scene: &Scene, edges: &[f64], clearance: f64, (step, reach): (f64, f64)) -> [f64; 3] {
    let mut fast = FastScene::new(scene, clearance).expect("it compiles");
    let length = 2 * fast.motors();
    let (mut verdicts, mut free, mut counts) = (Vec::new(), Vec::new(), [0; 3]);
    fast.certify(edges, &mut verdicts).expect("whole edges");
    assert_eq!(verdicts.len(), edges.len() / length);
    for (e, (edge, verdict)) in edges.chunks_exact(length).zip(&verdicts).enumerate() {
        let (from, to) = edge.split_at(length / 2);
        let way: f64 = from.iter().zip(to).map(|(a, b)| (b - a).abs() * reach).sum();
        let steps = (way / step).ceil().max(1.0);
        let samples: Vec<f64> = (0..=steps as usize).flat_map(|k| between(from, to, k as f64 / steps)).collect();
        fast.free(&samples, &mut free).expect("whole poses");
        let first = free.iter().position(|free| !free).map(|k| k as f64 / steps);
        match *verdict {
            EdgeVerdict::Free => {
                counts[0] += 1;
                assert_eq!(first, None, "{name}, edge {e}: a missed contact");
                let some = between(from, to, 0.37);
                assert!(
                    scene.free(&split(scene, &some), clearance),
                    "{name}, edge {e}: blocked according to the scalar engine"
                );
            }
            EdgeVerdict::Blocked(found) => {
                counts[1] += 1;
                let pose = between(from, to, found.at);
                let poses = split(scene, &pose);
                assert!(!scene.free(&poses, clearance), "{name}, edge {e}: not in contact at {}", found.at);
                let contacts = scene.contacts(&poses, clearance + 1e-6);
                match found.pair {
                    Some(pair) => assert!(contacts.iter().any(|c| c.pair == pair), "{name}, edge {e}: {pair:?}"),
                    None => assert!((0..poses.len()).any(|r| !scene.satisfies_constraints(r, poses[r]))),
                }
                // A sample may detect a contact of less than the resolution that an interval's midpoint misses.
                let places = |at: f64| scene.node_transforms(&split(scene, &between(from, to, at)));
                let moved = |first: f64| {
                    let then = places(first).concat();
                    let now = places(found.at).concat();
                    let ways = then.iter().zip(&now).map(|(a, b)| (a.translation.vector - b.translation.vector).norm());
                    ways.fold(0.0, f64::max)
                };
                let early = first.is_none_or(|first| found.at <= first || moved(first) < 2.0 * PLACE);
                let grazed = |at: f64| scene.clearance(&split(scene, &between(from, to, at)), clearance + 0.001);
                let depth = || first.and_then(grazed).map_or(0.0, |near| clearance - near.distance);
                assert!(early || depth() < PLACE, "{name}, edge {e}: {} after {first:?}", found.at);
            }
            EdgeVerdict::Uncertified { at } => {
                counts[2] += 1;
                let near = scene.clearance(&split(scene, &between(from, to, at)), clearance + 2.0 * STEP);
                assert!(
                    near.is_some(),
                    "{name}, edge {e}: nothing is near at {at}, {:?}",
                    scene.clearance(&split(scene, &between(from, to, at)), 1.0)
                );
            }
        }
    }
    let shares = counts.map(|count| f64::from(count) / verdicts.len() as f64);
    eprintln!("{name}, {clearance} m: {shares:.4?} of {} free, blocked, uncertified", verdicts.len());
    assert!(shares[2] < 0.01, "{name}: {shares:?}");
    shares
}

#[test]
fn short_edges_of_shipped_robots_among_obstacles() {
    for name in ["icub", "katana", "panda", "ur5"] {
        let among =
            |seed| Scene::new(vec![(shipped(name), Isometry3::identity())], obstacles(seed, 20)).expect("a scene");
        let scene =
            (3..200).map(among).find(|scene| scene.free(&scene.home(), 0.0)).expect("obstacles beside the base");
        for clearance in [0.0, 0.012] {
            let edges = edges(&scene, 5, 120, 0.02);
            let [free, blocked, _] = compare(name, &scene, &edges, clearance, (STEP, REACH));
            assert!(clearance > 0.0 || free > 0.02 && blocked > 0.02, "both kinds: {free}, {blocked}");
        }
    }
}

#[test]
fn long_edges_of_shipped_robots() {
    for name in ["icub", "katana", "panda", "ur5"] {
        let scene = alone(shipped(name));
        compare(name, &scene, &edges(&scene, 6, 40, 1.0), 0.0, (20.0 * STEP, REACH));
    }
}

/// A body of each shape that translates and rotates past an obstacle of each shape.
#[test]
fn edges_of_all_shapes() {
    let mut dice = Dice(4);
    let mut all = [0.0; 3];
    for kinds in 0..16 {
        for _ in 0..3 {
            let scene = two_shapes(&mut dice, (kinds / 4, kinds % 4));
            let mut at = |i: usize| (dice.roll() - 0.5) * if i % 6 < 3 { 800f64.to_radians() } else { 6.0 };
            let edges: Vec<f64> = (0..20 * 12).map(&mut at).collect();
            let shares =
                compare(&format!("kinds {} and {}", kinds / 4, kinds % 4), &scene, &edges, 0.012, (STEP, BODY));
            (0..3).for_each(|i| all[i] += shares[i] / 48.0);
        }
    }
    assert!(all[0] > 0.2 && all[1] > 0.2, "both kinds: {all:?}");
}

/// Prismatic joints, motors with several joints, shapes of all kinds, three robots in one world.
#[test]
fn edges_of_all_joints() {
    for seed in [1, 4, 5] {
        let robots = vec![
            (made_up("one", seed), Isometry3::identity()),
            (shipped("katana"), Isometry3::translation(0.7, 0.5, 0.1)),
        ];
        let scene = Scene::new(robots, obstacles(seed, 3)).expect("a scene");
        compare(&format!("made up {seed}"), &scene, &edges(&scene, seed, 60, 0.03), 0.0, (STEP, REACH));
    }
}

/// If only hulls within the shapes are solid, the scalar engine decides what the lanes can't.
#[test]
fn edges_of_robots_with_hulls() {
    for seed in [1, 4] {
        let scene = Scene::new(vec![(hulled(&made_up("one", seed), seed), Isometry3::identity())], obstacles(seed, 3));
        let scene = scene.expect("a scene");
        compare(&format!("hulled {seed}"), &scene, &edges(&scene, seed, 60, 0.03), 0.0, (STEP, REACH));
    }
}

#[test]
fn verdicts_do_not_depend_on_company() {
    let scene = Scene::new(vec![(shipped("icub"), Isometry3::identity())], obstacles(3, 20)).expect("a scene");
    let mut fast = FastScene::new(&scene, 0.0).expect("it compiles");
    let length = 2 * fast.motors();
    let edges = [edges(&scene, 1, 200, 0.05), edges(&scene, 2, 20, 1.0)].concat();
    let (mut together, mut alone, mut verdict) = (Vec::new(), Vec::new(), Vec::new());
    fast.certify(&edges, &mut together).expect("whole edges");
    for edge in edges.chunks_exact(length).rev() {
        fast.certify(edge, &mut verdict).expect("whole edges");
        alone.extend(verdict.iter().copied());
    }
    alone.reverse();
    assert_eq!(together, alone);
    let mut free = Vec::new();
    fast.edges_free(&edges, &mut free).expect("whole edges");
    assert!(free.iter().zip(&together).all(|(free, verdict)| *free == (*verdict == EdgeVerdict::Free)));
}

/// Instruction sets with different rounding may differ in uncertified edges, but do not contradict each other's proofs.
#[test]
fn no_instructions_contradict_others() {
    let scene = Scene::new(vec![(shipped("icub"), Isometry3::identity())], obstacles(3, 20)).expect("a scene");
    let motors: usize = scene.robots().iter().map(|r| r.motors.len()).sum();
    let edges = edges(&scene, 8, 400, 0.03);
    let by = |set| {
        let mut verdicts = Vec::new();
        let mut fast = FastScene::with_instructions(&scene, 0.0, set).expect("it compiles");
        fast.certify(&edges, &mut verdicts).expect("whole edges");
        verdicts
    };
    let all: Vec<Vec<EdgeVerdict>> = InstructionSet::available().into_iter().map(by).collect();
    assert_eq!(all[0].len(), edges.len() / motors / 2);
    for verdicts in &all[1..] {
        for (one, other) in all[0].iter().zip(verdicts) {
            let doubtful = [one, other].iter().any(|v| matches!(v, EdgeVerdict::Uncertified { .. }));
            let free = [one, other].map(|v| *v == EdgeVerdict::Free);
            assert!(doubtful || free[0] == free[1], "{one:?}, {other:?}");
        }
    }
}

/// The results for the robot itself and for the world combine to the result for both.
#[test]
fn pairs_can_be_certified_apart() {
    let scene = Scene::new(vec![(shipped("icub"), Isometry3::identity())], obstacles(3, 20)).expect("a scene");
    let edges = edges(&scene, 9, 300, 0.03);
    let of_object =
        |a: u32, b: u32| [a, b].iter().any(|shape| matches!(scene.shape_id(*shape), Some(ShapeId::Object { .. })));
    let certify = |mut fast: FastScene| {
        let mut verdicts = Vec::new();
        fast.certify(&edges, &mut verdicts).expect("whole edges");
        (verdicts, fast.figures().pairs)
    };
    let (whole, all) = certify(FastScene::new(&scene, 0.0).expect("it compiles"));
    let (own, of_self) = certify(FastScene::of_pairs(&scene, 0.0, |a, b| !of_object(a, b)).expect("it compiles"));
    let (world, of_world) = certify(FastScene::of_pairs(&scene, 0.0, of_object).expect("it compiles"));
    assert_eq!(of_self + of_world, all);
    let at = |verdict: &EdgeVerdict| match verdict {
        EdgeVerdict::Free => f64::INFINITY,
        EdgeVerdict::Blocked(found) => found.at,
        EdgeVerdict::Uncertified { .. } => -1.0,
    };
    for ((whole, own), world) in whole.iter().zip(&own).zip(&world) {
        let first = at(own).min(at(world));
        assert!(at(whole) == first || at(whole) < 0.0 || first < 0.0, "{whole:?}, {own:?}, {world:?}");
    }
}

/// A motor at its limit is free; beyond it, and for NaN, it is not.
#[test]
fn edges_that_leave_the_limits() {
    let robot = shipped("katana");
    let scene = alone(robot.clone());
    let mut fast = FastScene::new(&scene, 0.0).expect("it compiles");
    let home = robot.home();
    let mut verdict = |to: &[f64]| {
        let mut verdicts = Vec::new();
        fast.certify(&[home.clone(), to.to_vec()].concat(), &mut verdicts).expect("a whole edge");
        verdicts[0]
    };
    assert_eq!(verdict(&home), EdgeVerdict::Free);
    let mut to = home.clone();
    to[0] = robot.motors[0].max;
    assert_eq!(verdict(&to), EdgeVerdict::Free);
    to[0] = home[0] + 2.0 * (robot.motors[0].max - home[0]);
    let EdgeVerdict::Blocked(found) = verdict(&to) else { panic!("beyond the limit") };
    assert!((found.at - 0.5).abs() < 1e-6 && found.pair.is_none(), "{found:?}");
    for odd in [f64::NAN, f64::INFINITY, -1e300] {
        to[0] = odd;
        let EdgeVerdict::Blocked(found) = verdict(&to) else { panic!("{odd}") };
        assert!(found.at < 1e-6 && found.pair.is_none(), "{found:?}");
    }
    let motors = fast.motors();
    let refused = fast.certify(&vec![0.0; 3 * motors], &mut Vec::new());
    assert_eq!(refused, Err(FastError::Edges { given: 3 * motors, motors }));
}

/// A contact that only the scalar engine can detect ends its edge at once, without bisection down to the resolution.
#[test]
fn a_deep_contact_of_hulls_ends_its_edge_soon() {
    for seed in [1, 4] {
        let scene = Scene::new(vec![(hulled(&made_up("one", seed), seed), Isometry3::identity())], obstacles(seed, 3));
        let scene = scene.expect("a scene");
        let mut fast = FastScene::new(&scene, 0.0).expect("it compiles");
        let (mut free, mut intervals) = (Vec::new(), Vec::new());
        for edge in edges(&scene, seed, 200, 1.0).chunks_exact(2 * fast.motors()) {
            let before = fast.figures().intervals;
            fast.edges_free(edge, &mut free).expect("a whole edge");
            if free == [false] {
                intervals.push(fast.figures().intervals - before);
            }
        }
        intervals.sort_unstable();
        assert!(intervals.len() > 50, "only {} are blocked", intervals.len());
        let median = intervals[intervals.len() / 2];
        let most = intervals[intervals.len() * 9 / 10];
        eprintln!("seed {seed}: {median} intervals in the median, {most} for one in ten");
        assert!(median <= 256 && most <= 256, "{median} intervals in the median, {most} for one in ten");
    }
}

/// Samples agree with the poses, with hulls and constraints, and a certified edge has free samples.
#[test]
fn samples_of_an_edge_are_its_poses() {
    let scenes = [
        Scene::new(vec![(shipped("icub"), Isometry3::identity())], obstacles(3, 20)),
        Scene::new(vec![(shipped("katana"), Isometry3::identity())], obstacles(5, 6)),
        Scene::new(vec![(hulled(&made_up("one", 1), 1), Isometry3::identity())], obstacles(1, 3)),
    ];
    let mut all = [0; 2];
    for (s, scene) in scenes.into_iter().enumerate() {
        let scene = scene.expect("a scene");
        let mut fast = FastScene::new(&scene, 0.0).expect("it compiles");
        let edges = [edges(&scene, 7, 150, 0.02), edges(&scene, 8, 150, 0.2)].concat();
        let (mut verdicts, mut free, mut seen) = (Vec::new(), Vec::new(), [0; 2]);
        fast.certify(&edges, &mut verdicts).expect("whole edges");
        for (e, (edge, verdict)) in edges.chunks_exact(2 * fast.motors()).zip(verdicts).enumerate() {
            let sampled = fast.samples_free(edge, 20).expect("a whole edge");
            let (from, to) = edge.split_at(edge.len() / 2);
            let poses: Vec<f64> = (1..=32).flat_map(|k| between(from, to, f64::from(k) / 32.0)).collect();
            fast.free(&poses, &mut free).expect("whole poses");
            assert_eq!(sampled, !free.contains(&false), "scene {s}, edge {e}");
            assert!(sampled || verdict != EdgeVerdict::Free, "scene {s}, edge {e}: certified, but not free");
            seen[usize::from(sampled)] += 1;
        }
        all.iter_mut().zip(seen).for_each(|(all, seen)| *all += seen);
    }
    assert!(all.iter().all(|count| *count > 100), "{all:?} blocked and free");
}

/// Facts about a robot hold among any obstacles.
#[test]
fn a_robot_among_other_obstacles_has_the_verdicts_of_a_new_scene() {
    let robot = shipped("icub");
    let other = shipped("icub");
    let place = Isometry3::translation(0.1, 0.2, 0.3);
    let alone = Scene::new(vec![(robot.clone(), place)], Vec::new()).expect("a scene");
    let mut fast = FastScene::new(&alone, 0.005).expect("it compiles");
    let same = |robot: &Arc<Robot>, place, seed| {
        Scene::new(vec![(robot.clone(), place)], obstacles(seed, 12)).expect("a scene")
    };
    let scenes = [
        same(&robot, place, 3),
        same(&robot, place, 4),
        // Shares the robots with the scene that was compiled first.
        alone.with_objects(obstacles(8, 12)).expect("a scene"),
        same(&robot, Isometry3::identity(), 4),
        same(&other, place, 5),
    ];
    for (s, scene) in scenes.iter().enumerate() {
        fast = fast.among(scene, |_, _| true).expect("it compiles");
        let mut fresh = FastScene::new(scene, 0.005).expect("it compiles");
        assert_eq!((fast.figures().pairs, fast.figures().pruned), (fresh.figures().pairs, fresh.figures().pruned));
        let edges = edges(scene, 6, 150, 0.05);
        let (mut a, mut b) = (Vec::new(), Vec::new());
        fast.certify(&edges, &mut a).expect("whole edges");
        fresh.certify(&edges, &mut b).expect("whole edges");
        let poses: Vec<f64> = random_poses(&scene.robots()[0], 11).take(500).flatten().collect();
        let (mut p, mut q) = (Vec::new(), Vec::new());
        fast.free(&poses, &mut p).expect("whole poses");
        fresh.free(&poses, &mut q).expect("whole poses");
        assert_eq!(p, q, "scene {s}");
        let kind = |v: &EdgeVerdict| matches!(v, EdgeVerdict::Free);
        assert_eq!(a.iter().map(kind).collect::<Vec<_>>(), b.iter().map(kind).collect::<Vec<_>>(), "scene {s}");
    }
}

/// Clearances of single pairs, and pairs that may touch: verdicts of poses and edges are those of the scalar engine.
#[test]
fn pairs_with_clearances_of_their_own_are_judged_at_these() {
    let scene = Scene::new(vec![(shipped("panda"), Isometry3::identity())], obstacles(5, 12)).expect("a scene");
    let part = scene.robots()[0].parts[0].name.clone();
    let clearance = 0.03;
    let names = scene.objects().map(|(_, o)| o.name.clone()).enumerate();
    let rules = names.filter_map(|(i, name)| match i % 3 {
        0 => PairRule::may_touch(&format!("{part}:{name}")),
        1 => PairRule::near(&format!("{part}:{name}"), 0.01 * (i % 4) as f64),
        _ => None,
    });
    let rules: Vec<PairRule> = rules.chain(PairRule::near(&format!("{part}:{part}"), 0.002)).collect();
    let ruled = scene.with_pair_rules(0, &rules).expect("names that exist");
    let mut differs = 0;
    let mut fast = FastScene::new(&ruled, clearance).expect("it compiles");
    let poses: Vec<f64> = random_poses(&ruled.robots()[0], 9).take(3000).flatten().collect();
    let mut free = Vec::new();
    fast.free(&poses, &mut free).expect("whole poses");
    for (pose, free) in poses.chunks(fast.motors()).zip(free) {
        assert_eq!(free, ruled.free(&[pose], clearance), "{pose:?}");
        differs += usize::from(free != scene.free(&[pose], clearance));
    }
    assert!(differs > 20, "the rules matter at {differs} poses");
    let edges = edges(&ruled, 11, 60, 0.05);
    let [free, blocked, _] = compare("with rules", &ruled, &edges, clearance, (STEP, REACH));
    assert!(free > 0.05 && blocked > 0.05, "{free} {blocked}");
}
