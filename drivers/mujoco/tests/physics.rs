//! Comparison of arms under MuJoCo with the same arms under the simulation's own physics. Needs the feature
//! `mujoco`.
#![cfg(feature = "mujoco")]

use mobee_contract::{Command, Context, Hardware, KindError, Move, Time};
use mobee_model::{Robot, Scene, load_robot};
use mobee_mujoco as _;
use mobee_sim::{SimHardware, SimSettings};
use nalgebra::Isometry3;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn robot(name: &str) -> Arc<Robot> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../configs/robots/{name}.xml"));
    Arc::new(load_robot(path).unwrap().value)
}

/// A simulated robot in an empty world.
fn arm(robot: &Arc<Robot>, settings: &Value) -> Result<SimHardware, KindError> {
    let hardware = SimHardware::build(settings, &Context { robot: robot.clone(), seed: 1 })?;
    let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], Vec::new()).unwrap();
    hardware.place(&scene, 0)?;
    Ok(hardware)
}

/// The same arm under both kinds of physics.
fn both(robot: &Arc<Robot>, settings: Value) -> [SimHardware; 2] {
    ["builtin", "mujoco"].map(|physics| {
        let mut settings = settings.clone();
        settings["physics"] = json!(physics);
        arm(robot, &settings).unwrap()
    })
}

/// Moves one motor at 0.5 rad/s, and returns the external torques of the last sample after this time, s.
fn sweep(hardware: &SimHardware, motor: usize, q: f64, secs: f64) -> Vec<f64> {
    let mut driver = hardware.connect().unwrap();
    driver.lease(Time::ZERO, Time::from_secs(0.2));
    let there = Move { motors: vec![motor], q: vec![q], relative: false, speed: Some(vec![0.5]), acceleration: None };
    driver.command(Time::ZERO, &Command::Move(there)).unwrap();
    let mut external = Vec::new();
    for i in 1..=(secs * 100.0) as u64 {
        let now = Time::from_secs(i as f64 / 100.0);
        driver.lease(now, now + Duration::from_millis(200));
        if let Some(sample) = driver.sample(now).unwrap() {
            external = sample.external;
        }
    }
    external
}

#[test]
fn an_arm_whose_weight_is_not_compensated_sags_as_under_the_other_physics() {
    let so101 = robot("so101");
    let [builtin, mujoco] = both(&so101, json!({ "profile": "so101" })).map(|hardware| {
        let there = hardware.positions(Time::from_secs(5.0));
        so101.home().iter().zip(there).map(|(home, q)| (q - home).to_degrees()).collect::<Vec<f64>>()
    });
    for (motor, (a, b)) in builtin.iter().zip(&mujoco).enumerate() {
        assert!((a - b).abs() < 0.1 + 0.2 * a.abs(), "motor {motor}: {a} and {b} deg");
    }
    assert!(mujoco.iter().any(|sag| sag.abs() > 0.3), "{mujoco:?}");
}

#[test]
fn a_compensated_arm_goes_where_it_is_sent_and_rests_there() {
    let panda = robot("panda");
    let target = panda.home()[0] + 0.5;
    for hardware in both(&panda, json!({ "profile": "panda" })) {
        sweep(&hardware, 0, target, 3.0);
        let at = Time::from_secs(3.0);
        let (q, v) = (hardware.positions(at), hardware.speeds(at));
        assert!((q[0] - target).abs().to_degrees() < 0.05, "{}", (q[0] - target).to_degrees());
        assert!(v.iter().all(|v| v.abs() < 1e-3), "{v:?}");
        assert_eq!(hardware.pushed(at).0, 0.0);
    }
}

/// Under both kinds of physics, an arm that hits an object outside the model stops, pushes it, and reports a
/// torque of the same sign.
#[test]
fn what_only_physics_knows_is_pushed_and_felt() {
    let panda = robot("panda");
    let home = panda.home();
    let mut frames = Vec::new();
    let scene: Scene = Scene::new(vec![(panda.clone(), Isometry3::identity())], Vec::new()).unwrap();
    scene.skeletons()[0].place(&home, &mut frames);
    let hand = frames.last().unwrap().translation.vector;
    // beside the hand, on its path when the first joint turns
    let way = nalgebra::Vector3::z().cross(&hand).normalize();
    let at = hand + way * 0.2;
    let post = json!([{ "name": "post", "size_m": [0.06, 0.06, 0.6], "at_m": [at.x, at.y, at.z] }]);
    let [builtin, mujoco] = both(&panda, json!({ "profile": "panda", "unknown": post })).map(|hardware| {
        let external = sweep(&hardware, 0, home[0] + 1.0, 3.0);
        let at = Time::from_secs(3.0);
        (hardware.positions(at)[0] - home[0], hardware.pushed(at).0, external[0])
    });
    for (way, force, torque) in [builtin, mujoco] {
        assert!(way < 0.95 && force > 20.0 && torque < -5.0, "{way} rad, {force} N, {torque} N m");
    }
    assert!((builtin.0 - mujoco.0).abs() < 0.05, "{builtin:?} and {mujoco:?}");
}

#[test]
fn the_same_commands_give_the_same_motion_bit_for_bit() {
    let icub = robot("icub");
    let run = || {
        let hardware = arm(&icub, &json!({ "profile": "icub", "physics": "mujoco" })).unwrap();
        sweep(&hardware, 1, icub.home()[1] + 0.3, 1.0);
        hardware.positions(Time::from_secs(1.0))
    };
    assert_eq!(run(), run());
}

#[test]
fn numbers_that_mujoco_does_not_use_are_refused() {
    let panda = robot("panda");
    for key in ["inertia_kgm2", "contact_n_per_m"] {
        let number = if key == "inertia_kgm2" { json!([0.1]) } else { json!(1000.0) };
        let settings = json!({ "profile": "panda", "physics": "mujoco", "servo": { key: number } });
        assert_eq!(arm(&panda, &settings).unwrap_err().path, format!("servo.{key}"));
    }
    let kinematic: SimSettings = serde_json::from_value(json!({ "profile": "ideal", "physics": "mujoco" })).unwrap();
    assert_eq!(kinematic.validate().unwrap_err().path, "physics");
}
