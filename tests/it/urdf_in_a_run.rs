//! What a URDF and an SRDF say of limits, speeds, names and shapes holds in the run that `mobee new` writes.

use super::common::{HOLD, events, mobee_in, said};
use std::path::Path;
use std::process::Output;

fn mobee(dir: &Path, args: &[&str]) -> Output {
    mobee_in(dir).args(args).output().expect("mobee starts")
}

const BALL: &str = "<collision><geometry><sphere radius=\"0.02\"/></geometry></collision>";

/// A robot of three links on a base, each with a joint of its own: names, and what stands in the joints.
fn robot(name: &str, joints: [(&str, &str); 3]) -> String {
    let mut text = format!("<robot name=\"{name}\">\n<link name=\"base\"/>\n");
    let mut parent = "base".to_owned();
    for (i, (joint, more)) in joints.into_iter().enumerate() {
        let axis = if i == 0 { "0 0 1" } else { "0 1 0" };
        text += &format!(
            "<link name=\"link {i}\">{BALL}</link>\n<joint name=\"{joint}\" type=\"revolute\"><parent link=\"{parent}\"/>\
             <child link=\"link {i}\"/><origin xyz=\"0.2 0 0.1\"/><axis xyz=\"{axis}\"/>{more}</joint>\n"
        );
        parent = format!("link {i}");
    }
    text + "</robot>"
}

const LIMIT: &str = "<limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/>";

/// Writes the files into a folder and has a behavior made of them; all that is said.
fn new(dir: &Path, urdf: &str, srdf: Option<&str>) -> String {
    std::fs::write(dir.join("r.urdf"), urdf).expect("written");
    let mut args = vec!["new", "b", "--robot", "r.urdf", "--poses", "200"];
    if let Some(srdf) = srdf {
        std::fs::write(dir.join("r.srdf"), srdf).expect("written");
        args.extend(["--srdf", "r.srdf"]);
    }
    let made = mobee(dir, &args);
    assert!(made.status.success(), "{}", said(&made));
    said(&made)
}

/// Runs the behavior, which `check` then finds nothing wrong with.
fn run(dir: &Path, secs: &str) {
    let ran = mobee(dir, &["run", "b.toml", "--for", secs, "--no-record", "--out", "run"]);
    assert!(ran.status.success(), "{}", said(&ran));
    let checked = mobee(dir, &["check", "run"]);
    assert!(checked.status.success() && said(&checked).contains(HOLD), "{}", said(&checked));
}

#[test]
fn soft_and_velocity_limits_hold_in_a_run() {
    let dir = tempfile::tempdir().expect("a folder");
    let slow = "<limit lower=\"-2\" upper=\"2\" effort=\"1\" velocity=\"0.05\"/>\
                <safety_controller k_velocity=\"1\" soft_lower_limit=\"-0.5\" soft_upper_limit=\"1\"/>";
    let told = new(dir.path(), &robot("r", [("j1", slow), ("j2", LIMIT), ("j3", LIMIT)]), None);
    assert!(
        told.contains("not used of the URDF: effort of <limit> (3 times), k_velocity of <safety_controller>"),
        "{told}"
    );
    run(dir.path(), "120");
    let events = events(&dir.path().join("run"));
    let text = |e: &serde_json::Value| e.to_string();
    let robot = events.iter().find(|e| text(e).contains("\"max_speed\"")).expect("the robot");
    let robot = robot.get("robot").filter(|r| r.is_object()).unwrap_or(robot);
    let number = |key: &str| robot[key][0].as_f64().expect("a number");
    assert!((number("max_speed") - 0.05).abs() < 1e-9 && (number("min") + 0.5).abs() < 1e-9, "{robot}");
    assert!((number("max") - 1.0).abs() < 1e-9, "{robot}");
}

#[test]
fn a_robot_a_part_and_a_joint_of_one_name_run() {
    for group in [
        None,
        Some(
            "<robot name=\"gripper\"><group name=\"jaw\"><joint name=\"gripper\"/><joint name=\"jaw\"/></group></robot>",
        ),
    ] {
        let dir = tempfile::tempdir().expect("a folder");
        let told = new(dir.path(), &robot("gripper", [("gripper", LIMIT), ("jaw", LIMIT), ("a/b", LIMIT)]), group);
        assert!(told.contains("_part`, as a motor has that name"), "{told}");
        run(dir.path(), "20");
    }
}

#[test]
fn a_link_that_only_shows_is_named_until_it_has_a_shape() {
    let dir = tempfile::tempdir().expect("a folder");
    let visual = "<visual><geometry><box size=\"0.05 0.05 0.05\"/></geometry></visual>";
    let urdf = robot("r", [("j1", LIMIT), ("j2", LIMIT), ("j3", LIMIT)]).replacen(BALL, visual, 2);
    let told = new(dir.path(), &urdf, None);
    assert!(told.contains("`link 0`, `link 1`"), "{told}");
    let checked = said(&mobee(dir.path(), &["check", "b.toml"]));
    assert!(checked.contains("`link 0`, `link 1`"), "{checked}");
    let fitted = said(&mobee(dir.path(), &["model", "convert", "r.urdf", "v.xml", "--visual", "--poses", "0"]));
    assert!(fitted.contains("3 shapes") && fitted.contains("around their visual: `link 0`, `link 1`"), "{fitted}");
    assert!(!fitted.contains("warning"), "{fitted}");
}

#[test]
fn what_an_srdf_can_not_have_is_said() {
    let urdf = robot("r", [("j1", LIMIT), ("j2", LIMIT), ("j3", LIMIT)]);
    let srdf = "<robot name=\"r\"><group name=\"arm\"><chain base_link=\"base\" tip_link=\"link 2\"/></group>\n\
                <group_state name=\"home\" group=\"arm\"><joint name=\"j1\" value=\"1.6\"/><joint name=\"j3\" value=\"0.5\"/></group_state>\n\
                <passive_joint name=\"j3\"/></robot>";
    let dir = tempfile::tempdir().expect("a folder");
    let told = new(dir.path(), &urdf, Some(srdf));
    for part in [
        "`j1` at 57.3 deg, not 91.7 deg",
        "the SRDF's pose `home`, but j1 at its limit of 57.3 deg, not at 91.7",
        "passive: j3 (at 0.5 rad or m)",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
    let behavior = std::fs::read_to_string(dir.path().join("b.toml")).expect("the behavior");
    assert!(behavior.contains("motors = [\"j1\", \"j2\"]"), "{behavior}");
    run(dir.path(), "20");
    for (base, tip) in [("link 2", "base"), ("link 2", "link 1")] {
        let wrong =
            srdf.replace("base_link=\"base\" tip_link=\"link 2\"", &format!("base_link=\"{base}\" tip_link=\"{tip}\""));
        std::fs::write(dir.path().join("r.srdf"), wrong).expect("written");
        let out = mobee(dir.path(), &["model", "convert", "r.urdf", "other.xml", "--srdf", "r.srdf", "--poses", "0"]);
        assert_eq!(out.status.code(), Some(2), "{}", said(&out));
        assert!(said(&out).contains("group `arm`: the chain") && said(&out).contains("r.srdf:1"), "{}", said(&out));
    }
}
