//! `mobee doctor FILE --move MOTOR` finds out how a simulated board behaves, and proposes nothing that the file has.

use super::common::mobee_here;
use std::path::Path;

/// Measures a motor of an arm with this driver and these further settings of the controller: exit code, findings, and settings.
fn measured(arm: &str, motor: &str, driver: &str, controller: &str) -> (Option<i32>, String, String) {
    let folder = tempfile::tempdir().expect("a folder");
    measured_in(folder.path(), arm, (motor, driver, controller), &[])
}

fn measured_in(
    folder: &Path,
    arm: &str,
    (motor, driver, controller): (&str, &str, &str),
    more: &[&str],
) -> (Option<i32>, String, String) {
    let file = folder.join("arm.toml");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("configs/robots/{arm}.xml"));
    let text = format!(
        r#"
        for_s = 1.0
        record.enabled = false
        [[robot]]
        name = "{arm}"
        model = {model:?}
        driver = {{ kind = "sim", {driver} }}
        controller = {{ period_ms = 10, history = 6000, tolerance_deg = 0.5, {controller} }}
        "#
    );
    std::fs::write(&file, text).expect("a behavior");
    let out = mobee_here().arg("doctor").arg(&file).args(["--move", motor]).args(more).current_dir(folder).output();
    let out = out.expect("mobee starts");
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    let (said, settings) = said.split_once("\nsettings for ").unwrap_or((said.as_str(), ""));
    (out.status.code(), said.to_owned(), settings.to_owned())
}

/// The number before these words.
fn number(said: &str, words: &str) -> f64 {
    let before = said.split(words).next().unwrap_or_default();
    let word = before.split_whitespace().last().unwrap_or_default();
    word.trim_start_matches('+').parse().unwrap_or_else(|_| panic!("a number before {words}: {said}"))
}

/// A hobby arm: 4,096 counts, no compensation of the weight, a stop that holds the measured position, a servo without feed-forward.
#[test]
fn a_hobby_arm_is_told_from_a_kinematic_one() {
    let (code, said, settings) = measured("so101", "shoulder_lift", r#"profile = "so101""#, "");
    assert_eq!(code, Some(0), "{said}");
    assert!((number(&said, " deg, with noise of") - 0.0879).abs() < 1e-3, "{said}");
    let [sag, lag] =
        [" deg from its commanded position", " ms behind its set-points"].map(|words| number(&said, words));
    assert!((1.0..3.0).contains(&sag) && (80.0..300.0).contains(&lag), "{said}");
    // what its stop makes the commanded position is where it sags from
    assert!(number(&said, " deg back, and stays there") > 0.5, "{said}");
    assert!(said.contains("its board reports up to") && settings.contains("stall_deg = "), "{said}{settings}");

    let (code, said, settings) = measured("so101", "shoulder_lift", r#"profile = "ideal""#, "stall_deg = 2.0");
    assert!(code == Some(0) && settings.is_empty(), "{said}{settings}");
    let [sag, lag] =
        [" deg from its commanded position", " ms behind its set-points"].map(|words| number(&said, words));
    assert!(sag < 0.1 && lag < 80.0, "{said}");
    assert!(said.contains("further on, and stays there") && !said.contains("its board reports up to"), "{said}");
}

/// Stiff arms, with weight compensated, whatever their stop means; a board that takes reference speeds for gains is found out.
#[test]
fn stiff_arms_stay_where_they_are_stopped() {
    for (arm, motor) in [("panda", "panda_joint2"), ("ur5", "elbow_joint")] {
        for stop in ["commanded", "measured"] {
            let (code, said, _) =
                measured(arm, motor, &format!(r#"profile = "{arm}", servo = {{ stop = "{stop}" }}"#), "");
            assert!(code == Some(0) && said.contains("and stays there"), "{arm}, {stop}: {said}");
            assert!(said.contains("honors reference speeds") && said.contains("has arrived"), "{said}");
        }
    }
    let (code, said, _) = measured("so101", "shoulder_lift", r#"imitates = "iCub_SIM""#, "");
    assert!(code == Some(1) && said.contains("does not honor reference speeds"), "{said}");
    assert!(said.contains("*done* is reported") && said.contains("before shoulder_lift has arrived"), "{said}");
}

#[test]
fn a_motor_that_is_not_there_is_not_moved() {
    let (code, said, settings) = measured("so101", "shoulder_left", r#"profile = "so101""#, "");
    assert!(code == Some(1) && settings.is_empty(), "{said}{settings}");
    assert!(said.contains("was not moved") && said.contains("did you mean `shoulder_lift`?"), "{said}");
}

/// What is measured goes into a new file, which a run can use at once; a file that is there stays as it is.
#[test]
fn the_settings_are_written_into_a_file_that_includes_the_measured_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let of = |profile| ("shoulder_lift", profile, "");
    let write = ["--write", "tuned.toml"];
    let (code, _, settings) = measured_in(folder.path(), "so101", of(r#"profile = "so101""#), &write);
    assert!(code == Some(0) && settings.contains("written into tuned.toml, which includes "), "{settings}");
    let text = std::fs::read_to_string(folder.path().join("tuned.toml")).expect("the new file");
    assert!(text.contains("include = [\"arm.toml\"]") && text.contains("[robot.controller]\nstall_deg = "), "{text}");
    let check = mobee_here().args(["check", "tuned.toml"]).current_dir(&folder).output().expect("mobee starts");
    assert!(check.status.success(), "{}", String::from_utf8_lossy(&check.stderr));

    let again = ["doctor", "arm.toml", "--move", "shoulder_lift", "--write", "tuned.toml"];
    let again = mobee_here().args(again).current_dir(&folder).output().expect("mobee starts");
    let refused = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(!again.status.success() && refused.contains("exists already"), "{refused}");
    assert_eq!(std::fs::read_to_string(folder.path().join("tuned.toml")).expect("the new file"), text);
}
