//! Each scene, each set of instructions, pose for pose.

use crate::scenes::{Dice, alone, hulled, made_up, obstacles, shipped, two_shapes};
use mobee_fast::{FastError, FastScene, InstructionSet};
use mobee_model::{Scene, random_poses};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// Random poses of all robots of a scene, concatenated robot by robot.
fn poses(scene: &Scene, seed: u64, count: usize) -> Vec<f64> {
    let mut robots: Vec<_> = scene.robots().iter().map(|r| random_poses(r, seed)).collect();
    (0..count).flat_map(|_| robots.iter_mut().filter_map(Iterator::next).flatten().collect::<Vec<_>>()).collect()
}

/// Verdicts of the scalar engine, pose by pose.
fn expected(scene: &Scene, poses: &[f64], clearance: f64) -> Vec<bool> {
    let motors: usize = scene.robots().iter().map(|r| r.motors.len()).sum();
    let free = |pose: &[f64]| {
        let mut rest = pose;
        let split = |robot: &std::sync::Arc<mobee_model::Robot>| {
            let (own, others) = rest.split_at(robot.motors.len());
            rest = others;
            own
        };
        scene.free(&scene.robots().iter().map(split).collect::<Vec<_>>(), clearance)
    };
    poses.chunks_exact(motors).map(free).collect()
}

/// Compares every instruction set with the scalar engine, at two clearances.
fn agree(name: &str, scene: &Scene, count: usize) {
    for clearance in [0.0, 0.012] {
        let poses = poses(scene, 7, count);
        let expected = expected(scene, &poses, clearance);
        let share = expected.iter().filter(|free| **free).count() as f64 / count as f64;
        for set in InstructionSet::available() {
            let mut fast = FastScene::with_instructions(scene, clearance, set).expect("it compiles");
            let mut free = Vec::new();
            fast.free(&poses, &mut free).expect("whole poses");
            let differ = free.iter().zip(&expected).position(|(a, b)| a != b);
            assert_eq!(differ, None, "{name}, {set:?}, {clearance} m: the first pose that differs");
            assert_eq!(free.len(), count);
            let figures = fast.figures();
            eprintln!("{name}, {set:?}, {clearance} m: {:.1} % free, {figures:?}", 100.0 * share);
            assert!(figures.doubtful * 20 <= figures.poses, "the lanes decide: {figures:?}");
        }
    }
}

#[test]
fn shipped_robots() {
    for name in ["icub", "katana"] {
        agree(name, &alone(shipped(name)), 10_000);
    }
}

/// If only hulls within the shapes are solid, the lanes agree with the scalar engine and decide most contacts
/// themselves.
#[test]
fn robots_with_hulls() {
    for (seed, clearance) in [(1, 0.0), (4, 0.0), (5, 0.0), (5, 0.012)] {
        let bare = made_up("one", seed);
        let scene = alone(hulled(&bare, seed));
        let poses = poses(&scene, 7, 1000);
        let verdicts = expected(&scene, &poses, clearance);
        let by_shapes = expected(&alone(bare), &poses, clearance);
        let freed = verdicts.iter().zip(&by_shapes).filter(|(with, without)| **with && !**without).count();
        assert!(freed > 20, "hulls make a difference");
        for set in InstructionSet::available() {
            let mut free = Vec::new();
            let mut fast = FastScene::with_instructions(&scene, clearance, set).expect("it compiles");
            fast.free(&poses, &mut free).expect("whole poses");
            assert_eq!(free, verdicts, "seed {seed}, {set:?}");
            let doubtful = fast.figures().doubtful as usize;
            let blocked = by_shapes.iter().filter(|free| !**free).count();
            // Poses in doubt: about half of the blocked poses, and all poses that only the hulls free.
            assert!(2 * doubtful < blocked + freed, "seed {seed}: {doubtful} doubtful of {blocked}, {freed} freed");
        }
    }
}

#[test]
fn shipped_robots_among_obstacles() {
    for name in ["icub", "katana"] {
        let scene = Scene::new(vec![(shipped(name), Isometry3::identity())], obstacles(3, 20)).expect("a scene");
        agree(name, &scene, 3_000);
    }
}

#[test]
fn robots_of_all_shapes_and_joints() {
    for seed in 0..12 {
        agree(&format!("made up {seed}"), &alone(made_up("r", seed)), 1_000);
    }
}

/// Two shapes of each kind are pushed together until they touch, and then tested slightly before and after that: from a
/// centimeter to a tenth of a micrometer, flat on flat and corner on rim.
#[test]
fn shapes_at_the_verge_of_contact() {
    let mut dice = Dice(1);
    let mut doubtful = 0;
    let mut judged = 0;
    for kinds in 0..16 {
        for turned in 0..48 {
            let scene = two_shapes(&mut dice, (kinds / 4, kinds % 4));
            let clearance = [0.0, 0.012][turned % 2];
            // Every fourth has its axes along those of the world.
            let angle = |dice: &mut Dice| if turned % 4 == 3 { 0.0 } else { (dice.roll() - 0.5) * 6.0 };
            let start: Vec<f64> =
                (0..6).map(|i| if i < 3 { (dice.roll() - 0.5) * 5.0 } else { angle(&mut dice) }).collect();
            let at = |way: f64| {
                let mut pose = start.clone();
                pose[turned % 3] = (way * 1000.0).to_radians();
                pose
            };
            // From far outside to the first contact, if there is one: bisection with the scalar engine.
            let free = |way: f64| scene.free(&[at(way)], clearance);
            let Some(mut inside) = (0..200).map(|i| 1.0 - f64::from(i) * 0.01).find(|way| !free(*way)) else {
                continue;
            };
            let mut outside = inside + 0.01;
            while outside - inside > 1e-10 {
                let middle = (inside + outside) / 2.0;
                if free(middle) { outside = middle } else { inside = middle }
            }
            let ways = [1e-2, 1e-3, 1e-4, 3e-5, 1e-5, 1e-6, 1e-7].map(|d| [inside + d, inside - d]);
            let poses: Vec<f64> = ways.iter().flatten().flat_map(|way| at(*way)).collect();
            let expected = expected(&scene, &poses, clearance);
            for set in InstructionSet::available() {
                let mut fast = FastScene::with_instructions(&scene, clearance, set).expect("it compiles");
                let mut free = Vec::new();
                fast.free(&poses, &mut free).expect("whole poses");
                assert_eq!(free, expected, "kinds {} and {}, {turned}, {set:?}", kinds / 4, kinds % 4);
                doubtful += fast.figures().doubtful;
                judged += fast.figures().poses;
            }
        }
    }
    eprintln!("{doubtful} of {judged} in doubt");
    let sets = InstructionSet::available().len();
    assert!(judged > 4_000 * sets as u64, "they touch: {judged}, by {sets} instruction sets");
    // In doubt are all distances below the error bounds: two of the seven, and most of those of 1 to 10 micrometers.
    assert!((judged / 4..judged * 3 / 4).contains(&doubtful), "{doubtful} of {judged}");
}

#[test]
fn several_robots_in_one_world() {
    for seed in 0..3 {
        let turned = Isometry3::from_parts(
            nalgebra::Translation3::new(0.4, 0.7, 0.1),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.2, 2.0)),
        );
        let robots = vec![
            (made_up("one", seed), Isometry3::identity()),
            (made_up("two", seed + 50), turned),
            (shipped("katana"), Isometry3::translation(-0.5, 0.0, 0.0)),
        ];
        agree("three robots", &Scene::new(robots, obstacles(seed, 10)).expect("a scene"), 1_000);
    }
}

/// A motor position beyond its limits counts as the limit. So does one that is not a number, unless a constraint reads
/// that motor.
#[test]
fn poses_that_nothing_has() {
    let scene = alone(shipped("icub"));
    let mut poses = poses(&scene, 11, 200);
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 0.0];
    for (i, q) in poses.iter_mut().enumerate().filter(|(i, _)| i % 37 == 0) {
        *q = odd[i / 37 % odd.len()];
    }
    let mut free = Vec::new();
    FastScene::new(&scene, 0.0).expect("it compiles").free(&poses, &mut free).expect("whole poses");
    assert_eq!(free, expected(&scene, &poses, 0.0));
}

#[test]
fn what_can_not_be_judged_is_refused() {
    let scene = alone(shipped("katana"));
    for clearance in [-0.001, f64::NAN, f64::INFINITY] {
        assert!(matches!(FastScene::new(&scene, clearance), Err(FastError::Clearance(_))));
    }
    let mut fast = FastScene::new(&scene, 0.0).expect("it compiles");
    let given = vec![0.0; fast.motors() + 1];
    let motors = fast.motors();
    assert_eq!(fast.free(&given, &mut Vec::new()), Err(FastError::Length { given: motors + 1, motors }));
}
