//! An SO-101 behind simulated servos on a pseudo-terminal explores on its own: each motion has one outcome, and the record holds.

#![cfg(all(unix, feature = "feetech"))]

use super::ctl::Run;
use crate::common::mobee_here;
use mobee_conformance::servos::{ServoTerminal, ServoWorld};
use serde_json::Value;
use std::path::{Path, PathBuf};

const BAUD: u32 = 1_000_000;

/// An SO-101 at this port that explores with three of its joints.
fn behavior(folder: &Path, port: &Path) -> PathBuf {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/so101.xml");
    let names = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"];
    let motor = |(i, name): (usize, &&str)| format!("{{ joint = \"{name}\", id = {}, range = [1700, 2396] }}", i + 1);
    let motors: Vec<String> = names.iter().enumerate().map(motor).collect();
    let text = format!(
        r#"
        clock = "real"

        [[robot]]
        name = "so101"
        model = {model:?}
        controller = {{ period_ms = 10, history = 6000, stall_deg = 8 }}
        driver = {{ kind = "feetech", port = {port:?}, motors = [{}] }}
        agent = {{ kind = "explorer", motors = ["shoulder_pan", "elbow_flex", "wrist_flex"], speed = 0.5, vertices = 6, neighbors = 3, seed = 3 }}
        "#,
        motors.join(", ")
    );
    let file = folder.join("so101.toml");
    std::fs::write(&file, text).expect("a behavior");
    file
}

fn servos(folder: &Path) -> ServoTerminal {
    ServoTerminal::start(&folder.join("tty"), ServoWorld::new(1..=6), BAUD).expect("a pseudo-terminal")
}

/// Explores for so many seconds; the summary.
fn explore(folder: &Path, port: &Path, seconds: u32) -> Value {
    let ran = mobee_here()
        .arg("run")
        .args([&behavior(folder, port), Path::new("--out"), &folder.join("run")])
        .args(["--for", &seconds.to_string(), "--no-record", "--quiet", "--json"])
        .output()
        .expect("mobee starts");
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    serde_json::from_slice(&ran.stdout).expect("the summary is JSON")
}

#[test]
fn an_arm_of_servos_explores_and_each_motion_has_one_outcome() {
    let folder = tempfile::tempdir().expect("a folder");
    let terminal = servos(folder.path());
    // its weight bends the arm by two degrees
    terminal.with(|world| world.servo(3).expect("the elbow").sag = 20.0);
    let summary = explore(folder.path(), terminal.port(), 15);
    let count = |name: &str| summary["counters"][name].as_u64().unwrap_or_default();
    println!("{}", summary["counters"]);
    assert!(count("committed") >= 4 && count("faulted") == 0, "{}", summary["counters"]);
    let check = mobee_here().arg("check").arg(folder.path().join("run")).output().expect("mobee starts");
    let seen = String::from_utf8_lossy(&check.stdout).into_owned() + &String::from_utf8_lossy(&check.stderr);
    assert!(check.status.success(), "{seen}");
    let (stored, torque) = terminal.with(|world| {
        let servos: Vec<_> = world.servos().map(|s| (s.stored_writes, s.has_torque())).collect();
        (servos.iter().map(|(stored, _)| stored).sum::<u64>(), servos.iter().all(|(_, torque)| *torque))
    });
    assert!(stored == 0 && torque, "{stored} stored writes; the arm holds: {torque}");
}

/// A servo that falls silent in a run: the arm holds, a person repairs the cable and asks to recover, and the arm explores on.
#[test]
fn an_arm_recovers_from_a_dead_servo_within_a_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let terminal = servos(folder.path());
    let run = Run::start(folder.path(), &behavior(folder.path(), terminal.port()), &[]);
    let until = |text: &str, words: &[&str]| {
        let mut last = String::new();
        // each query takes some milliseconds
        let seen = (0..2_000).any(|_| {
            if !words.is_empty() {
                run.ctl(words);
            }
            last = run.says(&["status"]);
            last.contains(text)
        });
        assert!(seen, "never `{text}`: {last}");
    };
    until("so101  ARMED", &[]);
    terminal.with(|world| world.servo(3).expect("the elbow").answers = false);
    until("the board reports a fault", &[]);
    terminal.with(|world| world.servo(3).expect("the elbow").answers = true);
    until("so101  ARMED", &["recover"]);
}
