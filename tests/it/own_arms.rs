//! `mobee new --arm` and `mobee calibrate`: what is given wrong is answered with a remedy, and nothing is written.

use super::common::{mobee_in, said};
use std::path::Path;

/// Exit code and words of a command in this folder, whose standard input is empty.
fn mobee(folder: &Path, args: &[&str]) -> (Option<i32>, String) {
    let out = mobee_in(folder).args(args).stdin(std::process::Stdio::null()).output().expect("mobee starts");
    (out.status.code(), said(&out))
}

fn refuses(folder: &Path, args: &[&str], parts: &[&str]) {
    let before = std::fs::read_dir(folder).expect("a folder").count();
    let (code, said) = mobee(folder, args);
    assert_eq!(code, Some(2), "{args:?}: {said}");
    // lines are wrapped where they are long
    let words = said.split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ");
    for part in parts {
        assert!(words.contains(part), "{args:?} says {part:?}: {words}");
    }
    assert_eq!(std::fs::read_dir(folder).expect("a folder").count(), before, "{args:?}: nothing is written");
}

#[test]
fn arms_and_ports_that_are_given_wrong_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    refuses(folder, &["new", "arm", "--arm", "so102", "--port", "/dev/ttyACM0"], &["there is no arm `so102`", "so101"]);
    refuses(folder, &["new", "arm", "--arm", "so101"], &["so101 needs the serial port", "--port /dev/ttyACM0"]);
    refuses(folder, &["new", "arm", "--port", "/dev/ttyACM0"], &["--arm"]);
    refuses(folder, &["new", "arm", "--arm", "so101", "--from", "ball"], &["cannot be used with"]);
    refuses(folder, &["calibrate", "--out", "arm.json"], &["--port"]);
    refuses(folder, &["calibrate", "--port", "tty", "--out", "arm.json", "--arm", "ur5"], &["there is no arm `ur5`"]);
    refuses(folder, &["calibrate", "--port", "tty", "--out", "arm.json", "--yes"], &["--write-offsets"]);
    std::fs::write(folder.join("arm.json"), "mine").expect("written");
    refuses(folder, &["calibrate", "--port", "tty", "--out", "arm.json"], &["arm.json exists already", "--force"]);
    assert_eq!(std::fs::read_to_string(folder.join("arm.json")).expect("the file"), "mine");
    if !cfg!(feature = "feetech") {
        let remedy = ["feature `feetech`", "cargo install --path . --features feetech"];
        refuses(folder, &["new", "arm", "--arm", "so101", "--port", "/dev/ttyACM0"], &remedy);
        refuses(folder, &["calibrate", "--port", "tty", "--out", "other.json"], &remedy);
    }
}

#[cfg(feature = "feetech")]
mod feetech {
    use super::{mobee, refuses};
    use std::path::Path;

    /// A calibration of all motors but for one text that is replaced.
    fn calibration(folder: &Path, from: &str, to: &str) {
        let names = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"];
        let motor = |(i, name): (usize, &&str)| {
            let id = i + 1;
            format!(
                r#""{name}": {{"id": {id}, "drive_mode": 0, "homing_offset": 12, "range_min": 950, "range_max": 3150}}"#
            )
        };
        let motors: Vec<String> = names.iter().enumerate().map(motor).collect();
        let text = format!("{{{}}}", motors.join(",\n"));
        assert!(text.contains(from), "{from}");
        std::fs::write(folder.join("cal.json"), text.replacen(from, to, 1)).expect("written");
    }

    /// The written behavior passes `check`, with and without a calibration, and so do the settings that its comments show; files beside it
    /// are shared.
    #[test]
    fn a_behavior_for_an_arm_is_right_as_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = folder.path();
        calibration(folder, "950", "950");
        let arm = ["--arm", "so101", "--port", "/dev/ttyACM0"];
        let (code, said) = mobee(folder, &[&["new", "plain"], &arm[..]].concat());
        assert!(code == Some(0) && said.contains("mobee calibrate --port /dev/ttyACM0"), "{said}");
        let (code, said) = mobee(folder, &[&["new", "made", "--calibration", "cal.json"], &arm[..]].concat());
        assert!(code == Some(0) && !said.contains("so101.xml") && !said.contains("mobee calibrate"), "{said}");
        for name in ["plain", "made"] {
            let (code, said) = mobee(folder, &["check", &format!("{name}.toml")]);
            assert!(code == Some(0) && !said.contains("warn"), "{name}: {said}");
            let text = std::fs::read_to_string(folder.join(format!("{name}.toml"))).expect("the behavior");
            assert_eq!(text.contains("calibration = \"cal.json\""), name == "made", "{text}");
            let released = text.replace("# release_torque", "release_torque").replace("# rest_deg", "rest_deg");
            assert_ne!(released, text);
            std::fs::write(folder.join("released.toml"), released).expect("written");
            let (code, said) = mobee(folder, &["check", "released.toml"]);
            assert_eq!(code, Some(0), "{name}: {said}");
        }
        // without the arm, `doctor` finds no port
        let nowhere = ["--set", "robot.so101.driver.port=nowhere", "--set", "robot.so101.driver.connect_s=0.1"];
        let (code, said) = mobee(folder, &[&["doctor", "plain.toml"], &nowhere[..]].concat());
        assert!(code == Some(1) && said.contains("nowhere can't be opened"), "{said}");
        refuses(folder, &[&["new", "made"], &arm[..]].concat(), &["made.toml exists already"]);
    }

    /// A calibration from elsewhere is written by its full path.
    #[test]
    fn a_calibration_of_another_folder_is_found() {
        let (folder, other) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("another"));
        calibration(other.path(), "950", "950");
        let file = other.path().join("cal.json");
        let args = ["new", "arm", "--arm", "so101", "--port", "tty", "--calibration"];
        let (code, said) = mobee(folder.path(), &[&args[..], &[file.to_str().expect("UTF-8")]].concat());
        assert_eq!(code, Some(0), "{said}");
        let (code, said) = mobee(folder.path(), &["check", "arm.toml"]);
        assert_eq!(code, Some(0), "{said}");
    }

    #[test]
    fn calibrations_that_do_not_fit_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = folder.path();
        let args = ["new", "arm", "--arm", "so101", "--port", "tty", "--calibration", "cal.json"];
        refuses(folder, &args, &["cal.json can't be read"]);
        for (from, to, expected) in [
            ("gripper", "claw", "no motor `claw`"),
            ("\"id\": 2", "\"id\": 1", "is the id of"),
            ("\"drive_mode\": 0", "\"drive_mode\": 1", "drive_mode"),
            ("950", "3140", "`shoulder_pan.range_min`"),
        ] {
            calibration(folder, from, to);
            refuses(folder, &args, &[expected]);
        }
    }

    #[test]
    fn a_calibration_needs_an_arm_and_a_place() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = folder.path();
        let to = |out: &str| ["calibrate", "--port", "nowhere", "--out", out].map(str::to_owned);
        let refuse = |args: &[String], parts: &[&str]| {
            refuses(folder, &args.iter().map(String::as_str).collect::<Vec<_>>(), parts);
        };
        refuse(&to("arm.json"), &["nowhere can't be opened", "USB cable"]);
        refuse(&to("no/such/arm.json"), &["there is no folder no/such"]);
        refuse(&[&to("arm.json")[..], &["--write-offsets".to_owned()]].concat(), &["needs an answer", "--yes"]);
    }
}
