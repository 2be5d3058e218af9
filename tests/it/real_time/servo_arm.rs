//! An SO-101 behind simulated servos on a pseudo-terminal, from its calibration to an exploration on its own: each motion has one
//! outcome, and the record holds.

#![cfg(all(unix, feature = "feetech"))]

use super::ctl::Run;
use crate::common::{mobee_here, mobee_in, said};
use mobee_conformance::servos::{ServoTerminal, ServoWorld};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Output, Stdio};
use std::time::Duration;

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

fn mobee(folder: &Path, args: &[&str]) -> Output {
    mobee_in(folder).args(args).output().expect("mobee starts")
}

/// Counts by the nominal middle of a joint's angle, deg.
fn count_at(deg: f64) -> f64 {
    2047.0 + deg * 4095.0 / 360.0
}

/// `mobee new --arm` writes a behavior that `doctor` finds right and that runs: motions are committed, the arm is folded at the end, and where
/// the file says so, its torque is released there.
#[test]
fn a_new_behavior_for_an_arm_explores_and_ends_at_its_rest_pose() {
    let folder = tempfile::tempdir().expect("a folder");
    let (folder, terminal) = (folder.path(), servos(folder.path()));
    let made = mobee(folder, &["new", "arm", "--arm", "so101", "--port", "tty"]);
    assert!(made.status.success(), "{}", said(&made));
    let doctor = mobee(folder, &["doctor", "arm.toml"]);
    assert!(doctor.status.success() && said(&doctor).contains("so101 is at shoulder_pan 0.1 deg"), "{}", said(&doctor));
    assert!(!terminal.with(|world| world.servos().any(|s| s.has_torque())), "a look gives no torque");
    let file = folder.join("arm.toml");
    let text = std::fs::read_to_string(&file).expect("the behavior");
    let released = text.replace("# release_torque", "release_torque").replace("# rest_deg", "rest_deg");
    std::fs::write(&file, released).expect("written");
    let quick = ["--set", "robot.so101.agent.speed=0.6", "--set", "robot.so101.controller.reserve_mm=10"];
    let run = ["run", "arm.toml", "--for", "12", "--no-record", "--quiet", "--json", "--out", "run"];
    let ran = mobee(folder, &[&run[..], &quick].concat());
    assert!(ran.status.success(), "{}", said(&ran));
    let summary: Value = serde_json::from_slice(&ran.stdout).expect("the summary is JSON");
    let count = |name: &str| summary["counters"][name].as_u64().unwrap_or_default();
    println!("{}", summary["counters"]);
    assert!(count("committed") >= 3 && count("faulted") == 0, "{summary}");
    assert_eq!(summary["rest"]["so101"], "reached", "{summary}");
    let (at, torque) = terminal.with(|world| {
        let at: Vec<f64> = world.servos().map(|s| s.position()).collect();
        (at, world.servos().any(|s| s.has_torque()))
    });
    assert!((at[1] - count_at(-88.0)).abs() < 30.0 && (at[2] - count_at(76.0)).abs() < 30.0, "{at:?}");
    assert!(!torque, "the arm lies, and its torque is released");
}

/// `mobee doctor --move` measures a servo: its counts, and that it stays where it is stopped. No stored register is written.
#[test]
fn a_servo_is_measured_by_small_motions() {
    let folder = tempfile::tempdir().expect("a folder");
    let terminal = servos(folder.path());
    terminal.with(|world| world.servo(3).expect("the elbow").sag = 20.0);
    behavior(folder.path(), Path::new("tty"));
    // quick; and the machine may take all processors away for half a second
    let set = ["--set", "robot.so101.driver.max_speed_deg_per_s=180", "--set", "robot.so101.controller.stale_ms=1000"];
    let out = mobee(folder.path(), &[&["doctor", "so101.toml", "--move", "elbow_flex"], &set[..]].concat());
    let text = said(&out);
    println!("{text}");
    assert!(out.status.success() && text.contains("so101 is at ") && text.contains("and stays there"), "{text}");
    let stored = terminal.with(|world| world.servos().map(|s| s.stored_writes).sum::<u64>());
    assert_eq!(stored, 0);
}

/// `mobee calibrate`, and the hand that moves the arm.
struct Calibration {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Calibration {
    fn start(folder: &Path, more: &[&str]) -> Calibration {
        let mut command = mobee_in(folder);
        command.args(["calibrate", "--port", "tty", "--out", "arm.json"]).args(more);
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("mobee starts");
        let input = child.stdin.take().expect("an input");
        let output = BufReader::new(child.stdout.take().expect("an output"));
        Calibration { child, input, output }
    }

    /// Waits for a line with this text.
    fn expect(&mut self, text: &str) {
        let mut line = String::new();
        while !line.contains(text) {
            line.clear();
            let count = self.output.read_line(&mut line).expect("a line");
            assert!(count > 0, "the output ended without `{text}`");
        }
    }

    fn enter(&mut self) {
        self.input.write_all(b"\n").expect("the input is open");
    }

    /// Exit code and all that remains to be read.
    fn end(self) -> (Option<i32>, String) {
        let Calibration { child, input, mut output } = self;
        let mut rest = String::new();
        std::io::Read::read_to_string(&mut output, &mut rest).expect("text");
        drop(input);
        let out = child.wait_with_output().expect("it ends");
        (out.status.code(), rest + &String::from_utf8_lossy(&out.stderr))
    }
}

/// Moves every joint there, and waits until that has been read.
fn hand(terminal: &ServoTerminal, at: [f64; 6]) {
    let before = terminal.with(|world| {
        world.servos().zip(at).for_each(|(servo, at)| servo.place(at.rem_euclid(4096.0)));
        world.requests
    });
    let seen = (0..10_000).any(|_| {
        std::thread::park_timeout(Duration::from_millis(1));
        terminal.with(|world| world.requests > before + 2)
    });
    assert!(seen, "the joints are not read");
}

/// An arm that was never homed: its ranges contain the end of the encoders' turns. It is homed and calibrated by hand, and `mobee new` and
/// `doctor` accept it.
#[test]
fn an_arm_that_was_never_homed_is_calibrated_by_hand() {
    let folder = tempfile::tempdir().expect("a folder");
    let (folder, terminal) = (folder.path(), servos(folder.path()));
    let middle = [3900.0, 4000.0, 100.0, 4090.0, 2000.0, 300.0];
    let moved = |by: f64| middle.map(|at| at + by);
    let mut calibration = Calibration::start(folder, &["--write-offsets", "--yes"]);
    calibration.expect("to the middle of its range");
    terminal.with(|world| world.servos().zip(middle).for_each(|(servo, at)| servo.place(at)));
    calibration.enter();
    calibration.expect("but not wrist_roll");
    let stored = |terminal: &ServoTerminal| terminal.with(|world| world.servos().map(|s| s.stored_writes).sum::<u64>());
    [0.0, -1100.0, 0.0, 1090.0, 0.0].into_iter().for_each(|by| hand(&terminal, moved(by)));
    assert_eq!(stored(&terminal), 0, "nothing is written before the end");
    calibration.enter();
    let (code, text) = calibration.end();
    assert!(code == Some(0) && text.contains("shoulder_pan (id 1): offset 0 -> 1853"), "{text}");
    let text = std::fs::read_to_string(folder.join("arm.json")).expect("the calibration");
    let made: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(
        made["shoulder_pan"],
        serde_json::json!({ "id": 1, "drive_mode": 0, "homing_offset": 1853, "range_min": 947, "range_max": 3137 })
    );
    assert_eq!((&made["wrist_roll"]["range_min"], &made["wrist_roll"]["range_max"]), (&0.into(), &4095.into()));
    let new = mobee(folder, &["new", "arm", "--arm", "so101", "--port", "tty", "--calibration", "arm.json"]);
    assert!(new.status.success(), "{}", said(&new));
    let doctor = mobee(folder, &["doctor", "arm.toml"]);
    assert!(doctor.status.success(), "{}", said(&doctor));
    assert!(said(&doctor).contains("so101 is at shoulder_pan 0.4 deg"), "{}", said(&doctor));
}

/// Joints that were not moved are named; an interrupt leaves no file. Neither writes a servo.
#[test]
fn a_calibration_that_is_not_finished_leaves_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let (folder, terminal) = (folder.path(), servos(folder.path()));
    let files = || std::fs::read_dir(folder).expect("a folder").count();
    let before = files();
    let mut still = Calibration::start(folder, &[]);
    still.expect("Enter ends");
    hand(&terminal, [2100.0; 6]);
    still.enter();
    let (code, said) = still.end();
    assert!(code == Some(2) && said.contains("`shoulder_pan` was moved by") && said.contains("`gripper`"), "{said}");
    let mut interrupted = Calibration::start(folder, &["--write-offsets", "--yes"]);
    interrupted.expect("to the middle of its range");
    let sent = Command::new("kill").args(["-INT", &interrupted.child.id().to_string()]).status().expect("kill");
    assert!(sent.success());
    let (code, said) = interrupted.end();
    assert!(code == Some(2) && said.contains("interrupted"), "{said}");
    terminal.with(|world| world.servo(4).expect("a servo").write(40, &[1]));
    let (code, said) = Calibration::start(folder, &[]).end();
    assert!(code == Some(2) && said.contains("wrist_flex (id 4) has torque"), "{said}");
    assert_eq!(files(), before);
    assert_eq!(terminal.with(|world| world.servos().map(|s| s.stored_writes).sum::<u64>()), 0);
}
