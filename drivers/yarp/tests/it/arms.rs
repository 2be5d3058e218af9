//! Simulated arms of second order: they sag, lag and push as their profiles say, and the same whoever reads them when.

use mobee_contract::{Command, Context, Driver, Hardware, Move, Time};
use mobee_driver_yarp::{SimBoard, SimClock};
use mobee_model::{Robot, Scene};
use mobee_sim::SimHardware;
use mobee_yarp::board::Device;
use mobee_yarp::{Bottle, Dialect, JointField, Message};
use nalgebra::Isometry3;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn robot(name: &str) -> Arc<Robot> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../configs/robots/{name}.xml"));
    Arc::new(mobee_model::load_robot(file).unwrap().value)
}

/// A simulated robot alone in the world.
fn arm(robot: &Arc<Robot>, settings: Value) -> SimHardware {
    let hardware = SimHardware::build(&settings, &Context { robot: robot.clone(), seed: 5 }).unwrap();
    let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], vec![]).unwrap();
    hardware.place(&scene, 0).unwrap();
    hardware
}

fn to(motor: usize, q: f64, speed: f64) -> Command {
    Command::Move(Move {
        motors: vec![motor],
        q: vec![q],
        relative: false,
        speed: Some(vec![speed]),
        acceleration: None,
    })
}

/// Moves on in steps, with a lease.
fn pass(driver: &mut dyn Driver, from: f64, secs: f64, step: f64) {
    let n = (secs / step).round() as usize;
    for i in 1..=n {
        let now = Time::from_secs(from + i as f64 * step);
        driver.lease(now, now + Duration::from_millis(200));
        let _ = driver.sample(now);
    }
}

/// Per motor how far it is from where it was, deg.
fn moved(from: &[f64], to: &[f64]) -> Vec<f64> {
    from.iter().zip(to).map(|(a, b)| (b - a).to_degrees()).collect()
}

fn most(all: &[f64]) -> f64 {
    all.iter().copied().map(f64::abs).fold(0.0, f64::max)
}

#[test]
fn an_arm_whose_weight_is_not_compensated_sags_and_a_compensated_one_does_not() {
    let so101 = robot("so101");
    let sagged = |settings: Value| {
        let hardware = arm(&so101, settings);
        let start = so101.home();
        most(&moved(&start, &hardware.positions(Time::from_secs(5.0))))
    };
    let felt = sagged(json!({ "profile": "so101" }));
    assert!((0.3..4.0).contains(&felt), "{felt} deg");
    let half = sagged(json!({ "profile": "so101", "servo": { "compensated": 0.5 } }));
    assert!((half / felt - 0.5).abs() < 0.2, "half of the weight: {half} of {felt} deg");
    let none = sagged(json!({ "profile": "so101", "servo": { "compensated": 1.0 } }));
    assert!(none < 1e-6, "{none} deg");
}

/// A hobby servo whose hold is *goal := present* sinks with each stop, from where the last one left it.
/// Where a stop makes the sagged position the commanded one, an arm would sink with each: the driver sends it only to joints that move.
#[test]
fn an_arm_that_sags_is_not_lowered_by_stops_that_find_it_at_rest() {
    let so101 = robot("so101");
    for stop in ["measured", "commanded"] {
        let hardware = arm(&so101, json!({ "profile": "so101", "servo": { "stop": stop } }));
        let mut driver = hardware.connect().unwrap();
        pass(driver.as_mut(), 0.0, 2.0, 0.01);
        let before = hardware.positions(Time::from_secs(2.0));
        for i in 0..20 {
            let now = 2.0 + 0.2 * f64::from(i);
            driver.command(Time::from_secs(now), &Command::Stop { motors: vec![] }).unwrap();
            pass(driver.as_mut(), now, 0.2, 0.01);
        }
        let lowered = most(&moved(&before, &hardware.positions(Time::from_secs(6.0))));
        assert!(lowered < 0.01, "{stop}: {lowered} deg");
        // one that moves is stopped
        driver.lease(Time::from_secs(6.0), Time::from_secs(6.2));
        driver.command(Time::from_secs(6.0), &to(0, 1.0, 0.5)).unwrap();
        pass(driver.as_mut(), 6.0, 1.0, 0.01);
        driver.command(Time::from_secs(7.0), &Command::Stop { motors: vec![] }).unwrap();
        pass(driver.as_mut(), 7.0, 1.0, 0.01);
        let [stopped, later] = [8.0, 9.0].map(|at| hardware.positions(Time::from_secs(at)));
        assert!(stopped[0] > 0.05 && stopped[0] < 0.9, "{stop}: {} rad", stopped[0]);
        assert!(most(&moved(&stopped, &later)) < 0.05, "{stop}");
    }
}

/// The fixed grid of the integration: however often anybody looks, the arm is at the same places at the same times.
#[test]
fn the_motion_does_not_depend_on_when_it_is_read() {
    let katana = robot("katana");
    let after = |step: f64| {
        let hardware = arm(&katana, json!({ "profile": "ur5", "servo": { "compensated": 0.9 } }));
        let mut driver = hardware.connect().unwrap();
        driver.lease(Time::ZERO, Time::from_secs(0.2));
        driver.command(Time::ZERO, &to(0, katana.home()[0] + 0.5, 0.5)).unwrap();
        pass(driver.as_mut(), 0.0, 0.6, step);
        hardware.positions(Time::from_secs(0.6))
    };
    assert_eq!(after(0.1), after(0.0005));
}

#[test]
fn a_servo_without_feed_forward_lags_and_its_board_is_done_before_it_arrives() {
    let so101 = robot("so101");
    let of = |done: &str| {
        let servo = json!({ "compensated": 1.0, "damping_nms_per_rad": [3.0], "done": done });
        arm(&so101, json!({ "profile": "so101", "move_profile": "trapezoidal", "servo": servo }))
    };
    let (hardware, careful) = (of("trajectory"), of("arrived"));
    let target = so101.home()[0] + 0.6;
    let off_when_done = |hardware: &SimHardware| {
        let mut driver = hardware.connect().unwrap();
        driver.lease(Time::ZERO, Time::from_secs(0.2));
        driver.command(Time::ZERO, &to(0, target, 1.5)).unwrap();
        let mut now = 0.03;
        loop {
            pass(driver.as_mut(), now, 0.005, 0.005);
            now += 0.005;
            assert!(now < 10.0);
            if hardware.done(Time::from_secs(now))[0] {
                return (hardware.positions(Time::from_secs(now))[0] - target).abs().to_degrees();
            }
        }
    };
    let (early, late) = (off_when_done(&hardware), off_when_done(&careful));
    assert!(early > 0.51 && late < 0.5, "{early} and {late} deg");
}

/// It pushes what only physics knows, no harder than its servo can, and is bent by that.
#[test]
fn an_unknown_box_is_pushed_with_the_servo_s_force() {
    let katana = robot("katana");
    let scene = Scene::new(vec![(katana.clone(), Isometry3::identity())], vec![]).unwrap();
    let mut frames = Vec::new();
    scene.skeletons()[0].place(&katana.home(), &mut frames);
    let tip = frames.last().unwrap().translation.vector;
    // a post beside the hand, in the way of the first motor
    let side = nalgebra::Vector3::z().cross(&tip).normalize() * 0.12;
    let at: Vec<f64> = (tip + side).iter().copied().collect();
    let unknown = json!([{ "name": "post", "size_m": [0.04, 0.04, 1.5], "at_m": at }]);
    let hardware = arm(&katana, json!({ "profile": "panda", "unknown": unknown }));
    let mut driver = hardware.connect().unwrap();
    driver.lease(Time::ZERO, Time::from_secs(0.2));
    let target = (katana.home()[0] + 1.0).min(katana.motors[0].max);
    driver.command(Time::ZERO, &to(0, target, 0.5)).unwrap();
    pass(driver.as_mut(), 0.0, 6.0, 0.01);
    let now = Time::from_secs(6.0);
    let (force, pressing) = hardware.pushed(now);
    let lever = tip.xy().norm();
    assert!(force > 20.0 && force < 3.0 * 87.0 / lever, "{force} N at {lever} m");
    assert!(pressing > Duration::from_secs(1), "it presses on: {pressing:?}");
    let held = (target - hardware.positions(now)[0]).to_degrees();
    assert!(held > 2.0, "held back by {held} deg");
    let effort = hardware.efforts(now).unwrap()[0];
    assert!(effort > 10.0 && effort <= 87.0, "{effort} N m");
    // kinematic joints touch nothing
    let refused =
        SimHardware::build(&json!({ "profile": "ideal", "unknown": unknown }), &Context { robot: katana, seed: 1 })
            .unwrap_err();
    assert_eq!(refused.path, "unknown");
}

#[test]
fn servo_numbers_without_a_joint_are_refused() {
    let katana = robot("katana");
    let build = |list: Vec<f64>| {
        let settings = json!({ "profile": "panda", "servo": { "torque_nm": list } });
        SimHardware::build(&settings, &Context { robot: katana.clone(), seed: 1 })
    };
    let joints = katana.parts.iter().map(|part| part.motors.len()).max().unwrap();
    assert!(build(vec![5.0; joints]).is_ok());
    for (numbers, cause) in [(0, "empty"), (joints + 1, "have no joint")] {
        let refused = build(vec![5.0; numbers]).unwrap_err();
        assert_eq!(refused.path, "servo.torque_nm");
        assert!(refused.to_string().contains(cause), "{refused}");
    }
}

/// The boards of a robot as `mobee sim` serves them.
async fn boards(name: &str, settings: Value) -> Result<Vec<SimBoard>, String> {
    let robot = robot(name);
    let context = Context { robot: robot.clone(), seed: 5 };
    let settings = mobee_contract::settings(&settings).map_err(|e| e.to_string())?;
    let clock = SimClock::start(1.0, 0.0);
    tokio::time::advance(Duration::from_millis(7)).await;
    let boards = SimBoard::all(&settings, &context, clock).map_err(|e| e.to_string())?;
    let scene = Scene::new(vec![(robot, Isometry3::identity())], vec![]).unwrap();
    boards.iter().try_for_each(|board| board.place(&scene, 0)).map_err(|e| e.to_string())?;
    Ok(boards)
}

/// An arm behind YARP moves as the arm inside the program, and publishes what its joints exert; kinematic joints exert nothing.
#[tokio::test(start_paused = true)]
async fn a_served_arm_sags_and_publishes_its_torques() {
    for (profile, sags) in [("so101", true), ("ideal", false)] {
        let boards = boards("so101", json!({ "profile": profile })).await.unwrap();
        let [board] = boards.as_slice() else { panic!("a board for its only part") };
        let start = board.positions();
        tokio::time::advance(Duration::from_secs(3)).await;
        let (_, joints) = board.state().unwrap();
        let sagged = most(&moved(&start, &board.positions()));
        assert_eq!(sagged > 0.3, sags, "{profile}: {sagged} deg");
        if !sags {
            assert_eq!(joints.torque, JointField::unknown(6));
            continue;
        }
        let torques = joints.torque.valid().unwrap();
        assert!(torques.len() == 6 && (0.05..2.9).contains(&most(torques)), "{torques:?}");
        // its servos hold it up: what they exert is against the direction in which it sags
        let shoulder = moved(&start, &board.positions())[1];
        assert!(torques[1] * shoulder < 0.0, "{torques:?} N m, {shoulder} deg");
    }
}

/// Sends a request to a board.
async fn request(board: &SimBoard, words: &str) {
    let payload = Bottle::parse(words, Dialect::V3).unwrap().into();
    let request = Message { payload, envelope: None, from: "/test".into(), connection: 0, wants_reply: true };
    let answer = board.rpc(request).await.bottle(Dialect::V3).unwrap().to_string();
    assert!(answer.contains("[ok]"), "{words}: {answer}");
}

/// Joints of one arm push each other, wherever its boards are cut: one arm is behind all boards of a robot. Each board moves its
/// own motors.
#[tokio::test(start_paused = true)]
async fn boards_of_several_parts_move_one_arm() {
    // half of the weight is compensated, so that the torque of a shoulder depends on the torso's posture
    let boards = boards("icub", json!({ "profile": "icub", "servo": { "compensated": 0.5 } })).await.unwrap();
    let icub = robot("icub");
    assert_eq!(boards.len(), icub.parts.len());
    let named = |name: &str| boards.iter().find(|board| board.part() == name).unwrap();
    let (torso, arm) = (named("torso"), named("right_arm"));
    let part = icub.parts.iter().find(|part| part.name == "right_arm").unwrap();
    assert_eq!(arm.positions().len(), part.motors.len());
    tokio::time::advance(Duration::from_secs(2)).await;
    let torques = || arm.state().unwrap().1.torque.valid().unwrap().to_vec();
    let (before, leaned, held) = (torques(), torso.positions(), arm.positions());
    let pitch = icub.motors.iter().position(|m| m.name == "torso_pitch").unwrap();
    request(torso, &format!("[set] [vel] {pitch} 20.0")).await;
    request(torso, &format!("[set] [pos] {pitch} 30.0")).await;
    tokio::time::advance(Duration::from_secs(5)).await;
    let after = torques();
    assert!((torso.positions()[pitch].to_degrees() - 30.0).abs() < 2.0, "{:?} from {leaned:?}", torso.positions());
    assert!(most(&moved(&held, &arm.positions())) < 2.0, "no other board moves its motors");
    let changed = before.iter().zip(&after).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(changed > 0.1, "the weight of the arm acts across parts: {before:?} {after:?}");
    // a motor of a later part has another index in the arm than at its board
    let held = torso.positions();
    let from = arm.positions();
    let elbow = icub.motors.iter().position(|m| m.name == "r_elbow").unwrap() - part.motors.start;
    request(arm, &format!("[set] [vel] {elbow} 20.0")).await;
    request(arm, &format!("[set] [pos] {elbow} 90.0")).await;
    tokio::time::advance(Duration::from_secs(1)).await;
    request(arm, "[set] [stos]").await;
    tokio::time::advance(Duration::from_secs(5)).await;
    let went = moved(&from, &arm.positions());
    assert!(went[elbow].abs() > 5.0 && (arm.positions()[elbow].to_degrees() - 90.0).abs() > 5.0, "stopped: {went:?}");
    assert!(went.iter().enumerate().all(|(j, deg)| j == elbow || deg.abs() < 2.0), "{went:?}");
    assert!(most(&moved(&held, &torso.positions())) < 2.0);
}

/// Without a profile, a robot has that of its name, and any other is a plausible arm; what is imitated has kinematic joints.
#[test]
fn a_robot_without_a_profile_is_a_plausible_arm() {
    let built = |name: &str, settings: Value| {
        let hardware = arm(&robot(name), settings);
        let mut driver = hardware.connect().unwrap();
        driver.lease(Time::ZERO, Time::from_secs(0.2));
        let home = robot(name).home()[0];
        driver.command(Time::ZERO, &to(0, home + 0.2, 0.5)).unwrap();
        pass(driver.as_mut(), 0.0, 0.3, 0.01);
        (driver.board().axes.clone(), hardware.positions(Time::from_secs(0.3)))
    };
    for (name, profile) in [("katana", "arm"), ("icub", "icub"), ("panda", "panda"), ("ur5", "ur5"), ("so101", "so101")]
    {
        let default = built(name, json!({}));
        assert_eq!(default, built(name, json!({ "profile": profile })), "{name}");
        assert_ne!(default.1, built(name, json!({ "profile": "ideal" })).1, "{name} lags");
    }
    let imitates = json!({ "imitates": "iCub_SIM" });
    let context = Context { robot: robot("icub"), seed: 5 };
    let hardware = SimHardware::build(&imitates, &context).unwrap();
    assert_eq!(hardware.efforts(Time::ZERO), None, "kinematic joints");
}
