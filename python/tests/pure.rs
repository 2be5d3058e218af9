//! What needs no Python, and the table of verdicts that pytest compares with.
#![allow(dead_code)] // of each file only a part is tested here

#[path = "../src/callback_arm.rs"]
mod callback_arm;
#[path = "../src/chain.rs"]
mod chain;
#[path = "../src/failure.rs"]
mod failure;
#[path = "../src/joints.rs"]
mod joints;
#[path = "../src/pose.rs"]
mod pose;

use callback_arm::{CallbackArm, CycleTargets};
use chain::Chain;
use joints::{Beyond, JointTable};
use mobee_contract::{Axis, Command, ControlMode, Move, Time};
use mobee_model::{Robot, Scene, Skeleton, load_robot, parse_robot, random_poses};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;

/// One joint that slides 0 to 200 mm, one that turns -90 to 90 degrees.
fn arm() -> Robot {
    let xml = r#"<ZeroPositionKinematicTree robotName="arm"><bodypart name="arm">
      <motor name="lift" idx="0" minPos="0" maxPos="200"/><motor name="turn" idx="1" minPos="-90" maxPos="90"/>
      <link name="foot" z="0.1"><motor name="lift"><joint type="prismatic" z="1" minPos="0" maxPos="200"><link z="0.1"><motor name="turn"><joint y="1" minPos="-90" maxPos="90">
        <link x="0.3"><link name="tip" x="0.1"><marker name="tip"/></link></link></joint></motor></link></joint></motor></link></bodypart></ZeroPositionKinematicTree>"#;
    parse_robot("arm.xml", xml).expect("an arm").value
}

fn shipped(name: &str) -> Robot {
    load_robot(format!("{}/../configs/robots/{name}.xml", env!("CARGO_MANIFEST_DIR"))).expect("a shipped robot").value
}

fn chain_of(robot: &Robot, node: usize) -> Chain {
    Chain::new(&Skeleton::new(robot, Isometry3::identity()), node, &UnitQuaternion::identity()).expect("a node")
}

#[test]
fn configurations_are_radians_and_meters() {
    let robot = arm();
    let joints = JointTable::new([&robot]);
    assert_eq!(joints.units().collect::<Vec<_>>(), ["m", "rad"]);
    let upper = joints.si(|m| m.max);
    assert!((upper[0] - 0.2).abs() < 1e-12 && (upper[1] - std::f64::consts::FRAC_PI_2).abs() < 1e-12, "{upper:?}");
    let mut row = [0.15, 0.5];
    joints.convert("q", &mut row, None, Beyond::Refused).expect("within");
    assert!((row[0].to_degrees() - 150.0).abs() < 1e-9, "the encoder counts millimeters: {row:?}");
    let back = joints.configuration(&row);
    assert!((back[0] - 0.15).abs() < 1e-12 && (back[1] - 0.5).abs() < 1e-12);
}

#[test]
fn what_is_beyond_a_limit_is_refused_or_passed_and_rounding_is_neither() {
    let robot = arm();
    let joints = JointTable::new([&robot]);
    let refused = joints.convert("q", &mut [0.1, 0.0, 0.21, 0.0], Some(7), Beyond::Refused).expect_err("beyond");
    assert_eq!((refused.code, refused.place.as_deref()), ("limits", Some("q[8]")));
    assert!(refused.message.contains("lift at 0.210000 m") && refused.message.contains("0.200000"), "{refused:?}");
    let mut passed = [0.21, 0.0];
    joints.convert("q", &mut passed, None, Beyond::Passed).expect("passed");
    assert!((passed[0].to_degrees() - 210.0).abs() < 1e-9);
    assert_eq!(joints.within(&[0.21, 0.0, 0.2 + 1e-12, 0.0]), [false, true]);
    let mut rounded = [0.2 + 1e-12, 0.0];
    joints.convert("q", &mut rounded, None, Beyond::Refused).expect("rounding");
    assert_eq!(rounded[0], robot.motors[0].max);
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for beyond in [Beyond::Passed, Beyond::Refused] {
            let refused = joints.convert("q", &mut [0.1, wrong], None, beyond).expect_err("not finite");
            assert_eq!((refused.code, refused.place.as_deref()), ("not_finite", Some("q")));
        }
    }
}

#[test]
fn a_chain_is_the_models_own_kinematics() {
    for robot in [arm(), shipped("ur5"), shipped("icub")] {
        for pose in random_poses(&robot, 3).take(20) {
            let mut frames = Vec::new();
            robot.forward(&pose, &mut frames);
            for (node, expected) in frames.iter().enumerate().step_by(7) {
                let frame = chain_of(&robot, node).forward(&pose);
                let apart = (frame.translation.vector - expected.translation.vector).norm();
                assert!(apart < 1e-12 && frame.rotation.angle_to(&expected.rotation) < 1e-7, "{} {node}", robot.name);
            }
        }
    }
}

#[test]
fn a_jacobian_is_the_derivative_of_its_chain() {
    for robot in [arm(), shipped("ur5"), shipped("icub")] {
        let (motors, step) = (robot.motors.len(), 1e-6);
        let chain = chain_of(&robot, robot.nodes.len() - 1);
        let within =
            |q: Vec<f64>| q.iter().zip(&robot.motors).map(|(q, m)| m.min + (q - m.min) * 0.99 + 1e-5).collect();
        let pose: Vec<f64> = random_poses(&robot, 5).map(within).next().expect("a pose");
        let mut jacobian = vec![f64::NAN; 6 * motors];
        chain.jacobian(&pose, motors, &mut jacobian);
        for m in 0..motors {
            let at = |by: f64| {
                let mut pose = pose.clone();
                pose[m] += by;
                chain.forward(&pose)
            };
            let (before, after) = (at(-step), at(step));
            let linear = (after.translation.vector - before.translation.vector) / (2.0 * step);
            let angular = (after.rotation * before.rotation.inverse()).scaled_axis() / (2.0 * step);
            let column = Vector3::from_fn(|r, _| jacobian[r * motors + m]);
            let turn = Vector3::from_fn(|r, _| jacobian[(r + 3) * motors + m]);
            assert!((column - linear).norm() < 1e-7 && (turn - angular).norm() < 1e-7, "{} {m}", robot.name);
        }
    }
}

#[test]
fn only_rotations_are_taken_for_poses() {
    let matrix = |m: [f64; 16]| pose::from_matrix("pose", &m);
    let sound = Isometry3::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.4, -0.5, 0.6));
    let read = matrix(pose::matrix(&sound)).expect("a pose");
    assert!(
        (read.inverse() * sound).translation.vector.norm() < 1e-12 && read.rotation.angle_to(&sound.rotation) < 1e-7
    );
    let mut wrong = vec![[f64::NAN; 16], [0.0; 16], [1.0; 16]];
    for (entry, value) in [(0, 2.0), (0, -1.0), (3, 1e300), (3, f64::INFINITY), (12, 0.1), (15, 0.0)] {
        let mut m = pose::matrix(&Isometry3::identity());
        m[entry] = value;
        wrong.push(m);
    }
    for m in wrong {
        let failure = matrix(m).expect_err("no pose");
        assert!(["pose", "not_finite"].contains(&failure.code) && !failure.remedy.is_empty(), "{failure:?}");
    }
    for q in [[0.0; 4], [f64::NAN; 4], [f64::INFINITY, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 2.0]] {
        assert!(pose::from_quaternion("q", q).is_err(), "{q:?}");
    }
}

/// `ur5_verdicts.csv` has the scalar engine's verdicts: configuration, free (1 or 0), distance. Written anew with `MOBEE_WRITE=1`.
#[test]
fn the_table_of_verdicts_is_the_engines() {
    let robot = Arc::new(shipped("ur5"));
    let joints = JointTable::new([robot.as_ref()]);
    let scene = Scene::new(vec![(Arc::clone(&robot), Isometry3::identity())], Vec::new()).expect("a scene");
    let mut table = String::new();
    for pose in random_poses(&robot, 11).take(200) {
        joints.configuration(&pose).iter().for_each(|q| {
            let _ = write!(table, "{q},");
        });
        let distance = scene.clearance(&[&pose], f64::INFINITY).expect("pairs").distance;
        let _ = writeln!(table, "{},{distance:.9}", i32::from(scene.free(&[&pose], 0.0)));
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ur5_verdicts.csv");
    if std::env::var_os("MOBEE_WRITE").is_some() {
        std::fs::write(path, &table).expect("the table is written");
    }
    let kept = std::fs::read_to_string(path).expect("the table");
    assert!(kept.lines().eq(table.lines()), "the engine's verdicts changed: MOBEE_WRITE=1 writes them anew");
}

const PERIOD: Duration = Duration::from_millis(10);

/// An arm of one joint, in cycles in which its motor is where it is sent.
struct Cycles {
    arm: CallbackArm,
    now: Time,
    q: f64,
}

impl Cycles {
    /// Driven, at rest at zero, with a lease.
    fn new() -> Cycles {
        let axis = Axis { min: -2.0, max: 2.0, max_speed: 1.0, max_acceleration: 10.0, ..Axis::default() };
        let mut arm = CallbackArm::new(vec![axis], PERIOD);
        let now = Time::from_secs(1.0);
        arm.take_reading(now, vec![0.0], Vec::new());
        assert_eq!(arm.tick(now), CycleTargets::default(), "it is only read");
        arm.take_over(&[]).expect("it is within its limits");
        arm.lease(now, now + Duration::from_secs(60));
        Cycles { arm, now, q: 0.0 }
    }

    fn move_to(&mut self, q: f64) {
        let to = Move { motors: vec![0], q: vec![q], relative: false, speed: Some(vec![1.0]), acceleration: None };
        self.arm.command(self.now, &Command::Move(to)).expect("a move under a lease");
    }

    /// One cycle, so long after the last; the distance of its step, and whether the motor is to be stopped.
    fn cycle(&mut self, after: Duration) -> (f64, bool) {
        self.now = self.now + after;
        self.arm.take_reading(self.now, vec![self.q], Vec::new());
        let targets = self.arm.tick(self.now);
        let q = targets.q.map_or(self.q, |q| q[0]);
        let step = q - self.q;
        self.q = q;
        (step, targets.stop)
    }
}

#[test]
fn a_late_cycle_makes_no_step() {
    let mut arm = Cycles::new();
    arm.move_to(1.0);
    for _ in 0..40 {
        arm.cycle(PERIOD);
    }
    let (usual, _) = arm.cycle(PERIOD);
    let (late, _) = arm.cycle(100 * PERIOD);
    assert!(usual > 0.003 && late <= 2.0 * 0.0101, "{usual} {late}");
}

#[test]
fn a_lost_reading_brakes_and_the_next_motion_begins_from_there() {
    let mut arm = Cycles::new();
    arm.move_to(1.0);
    for _ in 0..40 {
        arm.cycle(PERIOD);
    }
    arm.arm.lose_reading();
    let at = arm.q;
    for _ in 0..100 {
        arm.cycle(PERIOD);
    }
    // 1 rad/s at 10 rad/s^2
    assert!(arm.q > at && arm.q < at + 0.06, "it went on from {at} to {}", arm.q);
    assert!(arm.arm.take_sample().expect("a sample").done[0]);
    arm.move_to(0.0);
    for _ in 0..300 {
        arm.cycle(PERIOD);
    }
    assert!(arm.q.abs() < 1e-6);
}

#[test]
fn an_arm_without_a_lease_brakes_and_its_motors_are_stopped_once() {
    let mut arm = Cycles::new();
    arm.move_to(1.0);
    for _ in 0..40 {
        arm.cycle(PERIOD);
    }
    arm.arm.lease(arm.now, Time::ZERO);
    let stops: Vec<bool> = (0..100).map(|_| arm.cycle(PERIOD).1).collect();
    assert_eq!(stops.iter().filter(|stop| **stop).count(), 1);
    assert!(arm.q < 0.6 && arm.arm.is_at_rest());
    let to = Move { motors: vec![0], q: vec![1.0], relative: false, speed: None, acceleration: None };
    assert!(arm.arm.command(arm.now, &Command::Move(to)).is_err());
}

#[test]
fn an_arm_outside_its_limits_is_not_driven_and_one_that_was_moved_resumes_where_it_is() {
    let mut arm = Cycles::new();
    arm.move_to(0.5);
    for _ in 0..100 {
        arm.cycle(PERIOD);
    }
    // it sags by two degrees, and resumes at its target and in its mode
    let direct = Command::Mode { motors: vec![0], mode: ControlMode::PositionDirect };
    arm.arm.command(arm.now, &direct).expect("a mode");
    arm.arm.release();
    arm.q -= 0.03;
    arm.cycle(PERIOD);
    arm.arm.take_over(&[]).expect("within its limits");
    arm.arm.lease(arm.now, arm.now + Duration::from_secs(1));
    arm.cycle(PERIOD);
    assert!((arm.q - 0.5).abs() < 1e-6);
    assert_eq!(arm.arm.modes(), [ControlMode::PositionDirect]);
    // moved by hand, it resumes there
    arm.arm.release();
    arm.q = -0.5;
    arm.cycle(PERIOD);
    arm.arm.take_over(&[]).expect("within its limits");
    arm.arm.lease(arm.now, arm.now + Duration::from_secs(1));
    arm.cycle(PERIOD);
    assert!((arm.q + 0.5).abs() < 1e-6);
    // its hardware holds another position than it measures
    arm.arm.release();
    arm.cycle(PERIOD);
    arm.arm.take_over(&[-0.47]).expect("within its limits");
    arm.arm.lease(arm.now, arm.now + Duration::from_secs(1));
    arm.cycle(PERIOD);
    assert!((arm.q + 0.47).abs() < 1e-6);
    arm.arm.release();
    arm.q = 2.1;
    arm.cycle(PERIOD);
    assert!(arm.arm.take_over(&[]).expect_err("outside").contains("outside its limits"));
}
