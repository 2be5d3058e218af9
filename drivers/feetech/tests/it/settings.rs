//! Settings that can't be used are refused, with their place and a remedy.

use crate::arm::{robot, settings};
use mobee_contract::KindError;
use mobee_feetech::{FeetechHardware, FeetechSettings};
use serde_json::json;
use std::path::Path;

fn refused(change: impl FnOnce(&mut FeetechSettings)) -> KindError {
    let robot = robot();
    let mut settings = settings(Path::new("/dev/null/none"), &robot);
    change(&mut settings);
    FeetechHardware::new(&settings, &robot).err().expect("a refusal")
}

#[test]
fn each_setting_is_refused_at_its_place() {
    let place = |change: &dyn Fn(&mut FeetechSettings)| refused(change).path;
    assert_eq!(place(&|s| s.port = " ".into()), "port");
    assert_eq!(place(&|s| s.baud = 9600), "baud");
    assert_eq!(place(&|s| s.lead_deg = f64::NAN), "lead_deg");
    assert_eq!(place(&|s| s.motors[2].id = Some(254)), "motors[2].id");
    assert_eq!(place(&|s| s.motors[2].id = None), "motors[2]");
    assert_eq!(place(&|s| s.motors[2].id = Some(1)), "motors");
    assert_eq!(place(&|s| s.motors[2].range = Some([3000, 2000])), "motors[2].range");
    assert_eq!(place(&|s| s.motors[2].range = Some([0, 4096])), "motors[2].range");
    assert_eq!(place(&|s| s.motors[2].range = None), "motors[2].range");
    assert_eq!(place(&|s| s.motors[2].middle = Some(f64::INFINITY)), "motors[2].middle");
    assert_eq!(place(&|s| s.motors[2].offset_deg = f64::NAN), "motors[2].offset_deg");
    assert_eq!(place(&|s| s.motors[2].offset_deg = 300.0), "motors");
    assert_eq!(place(&|s| s.motors[2].joint = "elbow".into()), "motors[2].joint");
    assert_eq!(place(&|s| s.motors[2].joint = s.motors[1].joint.clone()), "motors[2].joint");
    assert_eq!(place(&|s| drop(s.motors.pop())), "motors");
    assert_eq!(place(&|s| s.release_torque = true), "rest_deg");
    assert_eq!(place(&|s| s.rest_deg = vec![0.0; 6]), "rest_deg");
    assert_eq!(place(&|s| s.calibration = Some("/nowhere/so101.json".into())), "calibration");
}

#[test]
fn unknown_keys_are_refused() {
    let context = mobee_contract::Context { robot: robot().into(), seed: 0 };
    let build = |settings| FeetechHardware::build(&settings, &context).err().expect("a refusal").what;
    assert!(build(json!({ "port": "/dev/x", "sped": 3 })).contains("sped"));
    assert!(build(json!({ "port": "/dev/x", "motors": [{ "joint": "gripper", "di": 3 }] })).contains("di"));
}

/// A calibration of LeRobot is enough; what it has must not be stated again.
#[test]
fn a_calibration_file_replaces_the_motors() {
    let (robot, folder) = (robot(), tempfile::tempdir().unwrap());
    let file = folder.path().join("so101.json");
    let motor = |(i, name): (usize, &str)| {
        let motor = json!({ "id": i + 1, "drive_mode": 0, "homing_offset": 5, "range_min": 900, "range_max": 3100 });
        (name.to_owned(), motor)
    };
    let all: serde_json::Map<_, _> = robot.motors.iter().map(|m| m.name.as_str()).enumerate().map(motor).collect();
    std::fs::write(&file, serde_json::to_string(&all).unwrap()).unwrap();
    let plain = FeetechSettings { calibration: Some(file.clone()), ..FeetechSettings::at("/dev/x") };
    assert!(FeetechHardware::new(&plain, &robot).is_ok());
    let mut again = settings(Path::new("/dev/x"), &robot);
    again.calibration = Some(file.clone());
    assert!(FeetechHardware::new(&again, &robot).err().unwrap().path.ends_with(".id"));
    let strange = serde_json::to_string(&all).unwrap().replace("gripper", "claw");
    std::fs::write(&file, strange).unwrap();
    let e = FeetechHardware::new(&plain, &robot).err().unwrap();
    assert!(e.path == "calibration" && e.what.contains("claw"), "{e:?}");
}
