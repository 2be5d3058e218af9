//! The end of a run is a planned motion: each robot with a rest pose is moved there, or the run says why not.

use super::common::{HOLD, mobee_in, said};
use serde_json::Value;
use std::path::Path;

/// A Katana with this agent and these further lines of its table, in this world, as `arm.toml`.
fn write(dir: &Path, robot: &str, more: &str) {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/katana.xml");
    let world = r#"<WorldList version="1.0"><object name="ball" px="3" py="0" pz="0.2"><sphere radius="0.1"/></object></WorldList>"#;
    std::fs::write(dir.join("world.xml"), world).expect("a world");
    let text = format!(
        r#"
seed = 3
world.file = "world.xml"

[[robot]]
name = "arm"
model = {model:?}
controller = {{ period_ms = 20, history = 3000 }}
driver = {{ kind = "sim", profile = "ideal" }}
{robot}
{more}
"#
    );
    std::fs::write(dir.join("arm.toml"), text).expect("a behavior");
}

/// Runs it for so many seconds; the summary. The journal must hold, and replay must give it again.
fn run(dir: &Path, secs: &str) -> Value {
    let args = ["run", "arm.toml", "--for", secs, "--no-record", "--out", "run", "--json"];
    let ran = mobee_in(dir).args(args).output().expect("mobee starts");
    assert!(ran.status.success(), "{}", said(&ran));
    let checked = mobee_in(dir).args(["check", "run"]).output().expect("mobee starts");
    assert!(checked.status.success() && said(&checked).contains(HOLD), "{}", said(&checked));
    let again = mobee_in(dir).args(["replay", "run", "--out", "again"]).output().expect("mobee starts");
    assert!(again.status.success() && said(&again).contains("the run matched the journal"), "{}", said(&again));
    serde_json::from_slice(&ran.stdout).expect("the summary is JSON")
}

/// The events of a kind in the run's journal.
fn events(dir: &Path, kind: &str) -> Vec<Value> {
    let text = std::fs::read_to_string(dir.join("run/journal.jsonl")).expect("a journal");
    let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).expect("a line of JSON"));
    lines.map(|line| line["event"].clone()).filter(|event| event["event"] == kind).collect()
}

#[test]
fn a_run_ends_in_the_rest_pose() {
    let dir = tempfile::tempdir().expect("a folder");
    let robot = r#"agent = { kind = "random", motors = ["arm"], count = 0, speed = 0.3, range_deg = { motor1_pan = [40, 90] } }
rest = { q_deg = { motor1_pan = -30, motor5_wrist_roll = 20 } }"#;
    write(dir.path(), robot, "");
    let summary = run(dir.path(), "20");
    assert_eq!(summary["rest"]["arm"], "reached", "{summary}");
    assert_eq!(summary["reason"], "time");
    let outcomes = events(dir.path(), "outcome");
    let last = outcomes.last().expect("an outcome");
    assert_eq!(last["outcome"], "committed", "{last}");
    let pan = last["q"][0].as_f64().expect("a position");
    assert!((pan.to_degrees() + 30.0).abs() < 0.5, "{last}");
    let commits = events(dir.path(), "commit");
    assert_eq!(commits.last().expect("a commit")["agent"], "arm/rest");
    let steps: Vec<Value> = events(dir.path(), "rest").iter().map(|e| e["step"]["step"].clone()).collect();
    assert_eq!(steps, ["begun", "reached"]);
}

#[test]
fn a_pose_of_the_agent_and_the_home_of_the_robots_file_can_be_rest_poses() {
    for (rest, pan) in [("ready", 25.0), ("home", 0.0)] {
        let dir = tempfile::tempdir().expect("a folder");
        let robot = format!(
            r#"agent = {{ kind = "plan", goals = ["out"], speed = 0.3, poses = [{{ name = "out", q_deg = {{ motor1_pan = 60 }} }}, {{ name = "ready", q_deg = {{ motor1_pan = 25 }} }}] }}
rest = "{rest}""#
        );
        write(dir.path(), &robot, "");
        let summary = run(dir.path(), "60");
        assert_eq!((&summary["rest"]["arm"], &summary["reason"]), (&"reached".into(), &"done".into()), "{summary}");
        let outcomes = events(dir.path(), "outcome");
        let q = outcomes.last().expect("an outcome")["q"][0].as_f64().expect("a position").to_degrees();
        assert!((q - pan).abs() < 0.5, "{rest}: {q}");
    }
}

#[test]
fn a_run_that_cannot_get_there_says_why_and_the_robot_holds() {
    let dir = tempfile::tempdir().expect("a folder");
    let moved = r#"
[[script]]
when = { at_s = 1 }
edit = { object = "ball", position_m = [0.0, 0.0, 0.0] }
"#;
    let robot = r#"rest = { q_deg = { motor1_pan = 90 } }"#;
    write(dir.path(), robot, "");
    let free = run(dir.path(), "2");
    assert_eq!(free["rest"]["arm"], "reached", "without a ball in its way: {free}");
    let hand = hand_at(90.0);
    std::fs::remove_dir_all(dir.path().join("run")).expect("removed");
    std::fs::remove_dir_all(dir.path().join("again")).expect("removed");
    write(dir.path(), robot, &moved.replace("[0.0, 0.0, 0.0]", &format!("{hand:?}")));
    let blocked = run(dir.path(), "2");
    let why = blocked["rest"]["arm"].as_str().expect("a text");
    assert!(why.starts_with("not reached: there is no plan: ") && why.contains("ball"), "{why}");
    assert!(events(dir.path(), "commit").is_empty());
}

/// Where the arm's hand is when it is turned so far about the vertical from home, m.
fn hand_at(pan_deg: f64) -> [f64; 3] {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/katana.xml");
    let robot = mobee_model::load_robot(&model).expect("a robot").value;
    let mut q: Vec<f64> = robot.motors.iter().map(|m| m.home).collect();
    q[0] = pan_deg.to_radians();
    let at = robot.markers_at(&q).first().expect("a marker").position();
    [at.x, at.y, at.z]
}

#[test]
fn a_motion_that_takes_too_long_is_given_up() {
    let dir = tempfile::tempdir().expect("a folder");
    write(dir.path(), r#"rest = { q_deg = { motor1_pan = 90 }, within_s = 1 }"#, "");
    let summary = run(dir.path(), "2");
    assert_eq!(summary["rest"]["arm"], "not reached: 1 s were not enough; it was still moving", "{summary}");
    assert_eq!(summary["counters"]["stopped"], 1, "{summary}");
}

#[test]
fn a_rest_pose_that_is_none_is_refused_with_its_place() {
    let cases = [
        (r#"rest = "hoem""#, "did you mean `home`?"),
        (r#"rest = { pose = "there" }"#, "arm has no pose \"there\""),
        (r#"rest = { q_deg = { motor9 = 1 } }"#, "motor9"),
        (r#"rest = { q_deg = { motor1_pan = 1000 } }"#, "outside the limits of motor1_pan"),
        (r#"rest = {}"#, "a rest pose has no position"),
        (r#"rest = { pose = "home", q_deg = { motor1_pan = 1 } }"#, "a rest pose has two positions"),
        (r#"rest = { pose = "home", within = 3 }"#, "there is no key `within` here"),
        (r#"rest = { pose = "home", within_s = 0 }"#, "0 s is out of range"),
        (r#"rest = { pose = "home", speed = 2 }"#, "2 is out of range"),
        (r#"rest = 7"#, "expected text in quotes or a table"),
    ];
    for (rest, expected) in cases {
        let dir = tempfile::tempdir().expect("a folder");
        write(dir.path(), rest, "");
        for args in [&["check", "arm.toml"][..], &["run", "arm.toml", "--for", "1", "--out", "run"]] {
            let out = mobee_in(dir.path()).args(args).output().expect("mobee starts");
            assert_eq!(out.status.code(), Some(2), "{rest}: {}", said(&out));
            assert!(said(&out).contains(expected) && said(&out).contains("arm.toml:"), "{rest}: {}", said(&out));
        }
        assert!(!dir.path().join("run").exists());
    }
}
