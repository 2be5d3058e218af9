//! The motion to a rest pose by a real clock: a signal begins it, a second signal or a halt ends it.

use super::ctl::Run;
use crate::common::events;
use std::path::Path;
use std::process::Command;

/// A slow way of 90 degrees to the rest pose, of a Katana that does nothing else.
fn slow(dir: &Path) -> Run {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/katana.xml");
    let file = dir.join("arm.toml");
    let text = format!(
        r#"
[[robot]]
name = "arm"
model = {model:?}
controller = {{ period_ms = 20, history = 3000, stale_ms = 3000 }}
driver = {{ kind = "sim", profile = "ideal" }}
rest = {{ q_deg = {{ motor1_pan = 90 }}, speed = 0.02 }}
"#
    );
    std::fs::write(&file, text).expect("a behavior");
    Run::start(dir, &file, &[])
}

fn interrupt(run: &Run) {
    let kill = Command::new("kill").args(["-INT", &run.child.id().to_string()]).status().expect("kill");
    assert!(kill.success());
}

/// Waits until the motion is under way: each look at the run takes a moment.
fn wait_for_motion(run: &Run) {
    let moves = || events(&run.out).iter().any(|e| e["event"] == "commit" && e["agent"] == "arm/rest");
    let looks = (0..20_000).any(|_| {
        run.ctl(&["pose"]);
        moves()
    });
    assert!(looks, "no motion begins");
}

/// What the summary has of the rest pose once the run has ended in order.
fn rest(mut run: Run) -> String {
    let status = run.child.wait().expect("an end");
    assert!(status.success(), "{status}");
    let text = std::fs::read_to_string(run.out.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    summary["rest"]["arm"].as_str().expect("a text").to_owned()
}

#[test]
fn a_second_signal_stops_the_motion_to_the_rest_pose() {
    let dir = tempfile::tempdir().expect("a folder");
    let run = slow(dir.path());
    interrupt(&run);
    wait_for_motion(&run);
    interrupt(&run);
    assert_eq!(rest(run), "not reached: the run was stopped at once");
}

#[test]
fn a_robot_that_is_halted_on_its_way_to_the_rest_pose_holds() {
    let dir = tempfile::tempdir().expect("a folder");
    let run = slow(dir.path());
    interrupt(&run);
    wait_for_motion(&run);
    run.says(&["halt"]);
    assert_eq!(rest(run), "not reached: it is halted");
}
