//! Internal tests: bounds hold.

use crate::bound::U;
use crate::chain::LaneFrame;
use crate::compile::{Compiled, RobotFacts};
use crate::isa::{InstructionSet, checked};
use crate::kernel::{Block, place_group, place_region, sine_cosine, start_placing};
use crate::lanes::{LaneMask, Lanes, Portable, Row, WIDTH, WideRow};
use crate::motion::{Motions, coarse, fine, place_twists, start, sum_up};
use crate::program::Step;
use crate::proof::{JointInterval, Proofs};
use crate::sweep::{Sphere, above, common, least_distance};
use mobee_model::{IndexPair, Motor, Pair, Robot, Scene, load_robot, random_poses};
use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

fn scene(name: &str) -> (Arc<Robot>, Scene) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../configs/robots/{name}.xml"));
    let robot = Arc::new(load_robot(file).expect("the robot loads").value);
    // Away from the origin: distance from it costs digits, which the bound must include.
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -1.0, 0.5));
    let base = Isometry3::from_parts(Translation3::new(1.3, -0.4, 0.2), turn);
    let scene = Scene::new(vec![(robot.clone(), base)], Vec::new()).expect("a scene");
    (robot, scene)
}

/// The robots of a scene without objects.
fn compiled(scene: &Scene, clearance: f64) -> Compiled {
    crate::compile::compile(scene, scene.pairs(), &[], clearance, &mut RobotFacts::new(scene))
}

/// Calls `look` with the poses in the lanes, and the block in which they were tested, for each instruction set.
fn judged(name: &str, mut look: impl FnMut(&Scene, &[LaneFrame], &[Vec<f64>], &Block, &[usize])) {
    let (robot, scene) = scene(name);
    let mut compiled = compiled(&scene, 10.0);
    // At a clearance of ten meters everything is near, but without units nothing ends the block: only the frames matter
    // here.
    compiled.program.units.clear();
    compiled.program.cuts = vec![0, 0];
    compiled.program.regions.truncate(1);
    compiled.program.regions[0] = 0..compiled.program.joints.len();
    let frames: Vec<usize> = compiled.program.joints.iter().map(|j| j.frame).collect();
    for set in InstructionSet::available() {
        let runner = checked(set).expect("available");
        let mut block = Block::new(&compiled.program);
        let mut poses = random_poses(&robot, 5);
        for _ in 0..50 {
            let poses: Vec<Vec<f64>> = poses.by_ref().take(WIDTH).collect();
            for (lane, pose) in poses.iter().enumerate() {
                for (row, q) in block.motors.iter_mut().zip(pose) {
                    row.0[lane] = *q;
                }
            }
            runner.judge(&compiled.program, &mut block, LaneMask::MAX, 0);
            look(&scene, &compiled.movers.frames, &poses, &block, &frames);
        }
    }
}

#[test]
fn frames_stay_within_their_bounds() {
    for name in ["icub", "katana"] {
        let mut worst = 0.0f64;
        let mut largest = 0.0f64;
        judged(name, |scene, frames, poses, block, moving| {
            for (lane, pose) in poses.iter().enumerate() {
                let mut exact = Vec::new();
                scene.skeletons()[0].place(pose, &mut exact);
                for &f in moving {
                    let vector = |i: usize| Vector3::from_fn(|r, _| f64::from(block.frames[f][i][r].0[lane]));
                    let expected = exact[f] * frames[f].choice;
                    let bound = frames[f].bound;
                    let place = (vector(3) - expected.translation.vector).norm();
                    let turn = Matrix3::from_columns(&[vector(0), vector(1), vector(2)]);
                    let turn = (turn - expected.rotation.to_rotation_matrix().matrix()).norm() / 3f64.sqrt();
                    assert!(
                        place <= bound.place && turn <= bound.turn,
                        "{name}, frame {f}: {place}, {turn}, {bound:?}"
                    );
                    worst = worst.max(place / bound.place).max(turn / bound.turn);
                    largest = largest.max(bound.place);
                }
            }
        });
        eprintln!("{name}: at most {:.1} % of a bound; the largest bound is {largest:.2e} m", 100.0 * worst);
        assert!(worst > 0.01, "a bound a hundred times too wide would prove nothing");
    }
}

#[test]
fn a_pair_has_at_least_the_proved_distance() {
    for name in ["icub", "katana"] {
        let (robot, scene) = scene(name);
        let frames = compiled(&scene, 0.0).movers.frames;
        let balls: Vec<(usize, Sphere)> = scene
            .colliders()
            .map(|c| {
                let center = (frames[c.frame].choice.inverse() * c.pose).translation.vector;
                (c.frame, Sphere { center, radius: c.shape.bounding_radius() })
            })
            .collect();
        for pose in random_poses(&robot, 9).take(300) {
            let mut exact = Vec::new();
            scene.skeletons()[0].place(&pose, &mut exact);
            for &(i, j) in scene.pairs() {
                let a = balls[i as usize];
                let b = balls[j as usize];
                let at = |(frame, ball): (usize, Sphere)| {
                    exact[frame] * frames[frame].choice * nalgebra::Point3::from(ball.center)
                };
                let distance = (at(a) - at(b)).norm() - a.1.radius - b.1.radius;
                assert!(distance >= least_distance(&frames, a, b) - 1e-9, "{name}: {i} and {j}");
            }
        }
    }
}

/// On intervals of all lengths, the distance of any two end points of two cores changes by no more than the bound; and
/// the bound is not much larger than the actual motion.
#[test]
fn motion_stays_within_its_bound() {
    for name in ["icub", "katana", "panda"] {
        let (robot, scene) = scene(name);
        let Compiled { mut program, layout, mut movers, .. } = compiled(&scene, 0.0);
        layout.write_motions(&mut program, &mut movers, false);
        program.slips = vec![0.0; program.limits.len()];
        let slip = movers.slip().among(0.0);
        program.joints.iter().for_each(|j| program.slips[j.motor] += (slip * j.gain.abs()) as f32);
        let mut block = Block::new(&program);
        let mut motions = Motions::new(&program);
        let mut poses = random_poses(&robot, 6);
        let mut worst = 0.0f64;
        let mut bounds = 0;
        let mut coarser = 0;
        for round in 0..12 {
            let share = 0.25 * 0.3f64.powi(round % 4);
            let lines: Vec<(Vec<f64>, Vec<f64>)> =
                poses.by_ref().zip(random_poses(&robot, round as u64)).take(WIDTH).collect();
            let at = |lane: usize, way: f64| -> Vec<f64> {
                let (middle, toward) = &lines[lane];
                middle.iter().zip(toward).map(|(q, to)| q + (to - q) * share * way).collect()
            };
            for lane in 0..WIDTH {
                for (m, (q, end)) in at(lane, 0.0).into_iter().zip(at(lane, 1.0)).enumerate() {
                    block.motors[m].0[lane] = q;
                    motions.steps[m].0[lane] = (end - q) as f32;
                }
            }
            start_placing::<Portable>(&program, &mut block);
            start::<Portable>(&program, &mut motions);
            for region in 0..program.regions.len() {
                place_region::<Portable>(&program, &mut block, region);
                place_twists::<Portable>(&program, &block, &mut motions, region);
            }
            (0..program.groups.len()).for_each(|g| place_group::<Portable>(&program, &mut block, g));
            // The other direction from the midpoint is equivalent: the line continues beyond it, except for motors at
            // their limits.
            let frames = |lane: usize, way: f64| {
                let mut exact = Vec::new();
                scene.skeletons()[0].place(&at(lane, way), &mut exact);
                exact
            };
            let placed: Vec<Vec<_>> =
                (0..WIDTH).map(|lane| [0.0, 0.5, 1.0].map(|way| frames(lane, way)).to_vec()).collect();
            for (step, relative) in program.robots.steps.iter().zip(&program.robots.motions) {
                let Step::Pair(pair) = *step else { continue };
                let pair = &program.robots.pairs[pair];
                let [a, b] = [pair.a, pair.b].map(|solid| program.balls.len() + solid as usize);
                sum_up::<Portable>(&program, &mut motions, relative);
                let mut fine_row = Row::default();
                let mut coarse_row = Row::default();
                fine::<Portable>(&program, &block, &motions, relative, a, b).store(&mut fine_row);
                coarse::<Portable>(&motions, relative).store(&mut coarse_row);
                for (lane, placed) in placed.iter().enumerate() {
                    let distance = |frames: &[Isometry3<f64>], i: usize, j: usize| {
                        let at = |mover: usize, end: usize| {
                            let mover = &movers.movers[mover];
                            let frame = frames[mover.frame] * movers.frames[mover.frame].choice;
                            frame * nalgebra::Point3::from(mover.ends[end].center)
                        };
                        (at(a, i) - at(b, j)).norm()
                    };
                    let bound = f64::from(fine_row.0[lane]);
                    for (i, j) in [(0, 0), (movers.movers[a].ends.len() - 1, movers.movers[b].ends.len() - 1)] {
                        for way in 1..3 {
                            let change = (distance(&placed[way], i, j) - distance(&placed[0], i, j)).abs();
                            assert!(change <= bound, "{name}, step {step:?}, lane {lane}: {change} beyond {bound}");
                            worst = worst.max(change / bound);
                        }
                    }
                    bounds += 1;
                    coarser += usize::from(fine_row.0[lane] < 0.7 * coarse_row.0[lane]);
                }
            }
        }
        eprintln!(
            "{name}: at most {:.1} % of a bound; of {bounds}, {coarser} are much finer than the coarse one",
            100.0 * worst
        );
        assert!(worst > 0.5, "a bound twice too wide would prove nothing");
        assert!(coarser * 4 > bounds, "velocities give tighter bounds than levers: {coarser} of {bounds}");
    }
}

#[test]
fn a_ball_contains_the_balls_inside_it() {
    let ball = |x: f64, y: f64, radius: f64| Sphere { center: Vector3::new(x, y, 0.1 * x), radius };
    let balls = [ball(0.0, 0.0, 0.1), ball(1.0, 0.2, 0.3), ball(-0.5, 1.0, 0.05)];
    for count in 1..=3 {
        let around = Sphere::around(&balls[..count]);
        for ball in &balls[..count] {
            assert!((ball.center - around.center).norm() + ball.radius <= around.radius + 1e-12);
        }
    }
    assert_eq!(Sphere::around(&balls[..1]), balls[0]);
}

#[test]
fn fingers_are_regions_of_their_own() {
    let (_, scene) = scene("icub");
    let program = compiled(&scene, 0.0).program;
    let fingers = program.regions.iter().skip(1).filter(|joints| (3..=4).contains(&joints.len())).count();
    assert_eq!(fingers, 10, "two hands: {:?}", program.regions);
    // A finger's ball is tested before the finger is placed: it is on the frame that carries the finger.
    let carried: Vec<usize> =
        program.regions[1..].iter().flat_map(|joints| program.joints[joints.clone()].iter().map(|j| j.frame)).collect();
    let hands_and_fingers = &program.balls[program.groups.len()..];
    assert!(hands_and_fingers.iter().all(|ball| !carried.contains(&ball.frame)), "{hands_and_fingers:?}");
}

/// Omitted pairs never touch, nor come closer than the clearance: at random poses, and with every joint at an end of
/// its range, which random poses do not reach.
#[test]
fn omitted_pairs_stay_apart() {
    for (name, least) in [("icub", 70), ("katana", 0), ("panda", 0)] {
        let (robot, scene) = scene(name);
        for clearance in [0.0, 0.02] {
            let selected: BTreeSet<IndexPair> = compiled(&scene, clearance).program.tested_pairs().collect();
            let left: Vec<Pair> = scene
                .pairs()
                .iter()
                .filter(|pair| !selected.contains(pair))
                .filter_map(|(a, b)| scene.shape_id(*a).zip(scene.shape_id(*b)))
                .collect();
            assert!(left.len() >= least, "{name}: {} pairs are omitted", left.len());
            let random: Vec<Vec<f64>> = random_poses(&robot, 4).take(500).collect();
            let ends = random.iter().map(|pose| {
                let end =
                    |(q, motor): (&f64, &Motor)| if q + q > motor.min + motor.max { motor.max } else { motor.min };
                pose.iter().zip(&robot.motors).map(end).collect::<Vec<f64>>()
            });
            for pose in ends.chain(random.iter().cloned()) {
                for contact in scene.contacts(&[pose], clearance) {
                    assert!(!left.contains(&contact.pair), "{name}, {clearance} m: {contact:?}");
                }
            }
        }
    }
}

/// From any frame to any other that is few joints away a point is transformed as by the scalar engine. Anywhere else in
/// a part of the joints' ranges it is no farther from there than the bound.
#[test]
fn a_point_crosses_joints_within_its_bound() {
    for name in ["icub", "panda"] {
        let (robot, scene) = scene(name);
        let frames = compiled(&scene, 0.0).movers.frames;
        let proofs = Proofs::new(&frames, &[], 0.0);
        let mut ways = 0;
        let mut worst = 0.0f64;
        for pose in random_poses(&robot, 8).take(20) {
            let mut exact = Vec::new();
            scene.skeletons()[0].place(&pose, &mut exact);
            let world = |frame: usize| exact[frame] * frames[frame].choice;
            for (from, to) in (0..exact.len()).flat_map(|f| (0..exact.len()).map(move |g| (f, g))) {
                let crossings = proofs.crossings(from, to);
                let Some(common) = common(&frames, from, to).filter(|_| !crossings.is_empty()) else { continue };
                let carriers = |frame| above(&frames, frame).take_while(|f| *f != common).collect::<Vec<usize>>();
                let all = carriers(from).into_iter().chain(carriers(to).into_iter().rev());
                let point = Vector3::new(0.1, -0.2, 0.3);
                let mut here = point;
                let mut near = point;
                let mut spread = 0.0;
                for ((crossing, range), frame) in crossings.iter().zip(all) {
                    let joint = &frames[frame].carried.as_ref().expect("a joint").joint;
                    let at = joint.start + (pose[joint.motor] - joint.low) * joint.gain;
                    assert!((at - range.middle).abs() <= range.half + 1e-9);
                    here = crossing.cross(here, &JointInterval::new(at, 0.0)).0;
                    let (next, more) =
                        crossing.cross(near, &JointInterval::new(at + 0.1 * range.half, 0.1 * range.half));
                    near = next;
                    spread += more;
                }
                let expected = (world(to).inverse() * world(from)).transform_point(&point.into()).coords;
                assert!((here - expected).norm() < 1e-9, "{name}, {from} to {to}: {here} instead of {expected}");
                assert!((here - near).norm() <= spread + 1e-9, "{name}, {from} to {to}: farther than {spread}");
                worst = worst.max((here - near).norm() / spread);
                ways += 1;
            }
        }
        assert!(ways > 1_000 && worst > 0.99, "{name}: {ways} ways, {worst} of a bound");
    }
}

/// The error of sine and cosine together is within the bound in `bound.rs`, for any magnitude of the angle.
#[test]
fn sine_and_cosine_stay_within_their_bound() {
    let (_, scene) = scene("katana");
    let mut joint = Some(compiled(&scene, 0.0).program.joints[0].clone());
    let mut worst = 0.0f64;
    for turns in [0.0, 1.0, -1000.0] {
        let joint = joint.as_mut().expect("a joint");
        (joint.start, joint.low, joint.gain) = (turns * std::f64::consts::TAU, 0.0, 1.0);
        for i in 0..100_000 {
            let angles: [f64; WIDTH] = std::array::from_fn(|lane| f64::from(i * 16 + lane as u32) * 4e-6);
            let mut sine = Row::default();
            let mut cosine = Row::default();
            sine_cosine::<Portable>(&WideRow(angles), joint, &mut sine, &mut cosine);
            for (lane, angle) in angles.iter().enumerate() {
                let (s, c) = angle.sin_cos();
                worst = worst.max((f64::from(sine.0[lane]) - s).hypot(f64::from(cosine.0[lane]) - c));
            }
        }
    }
    assert!(worst <= 1.65 * U && worst > 1.2 * U, "{} units", worst / U);
}
