//! Signals, and a process that is suspended (F14, F27).

use super::{Run, count, events, holds, said};
use std::time::Duration;

#[test]
fn an_end_that_is_asked_for_is_in_order_whoever_asks() {
    let scratch = tempfile::tempdir().expect("a folder");
    for name in ["INT", "TERM", "HUP"] {
        let args = ["configs/behaviors/explore.toml", "--no-record"];
        let mut run = Run::start(scratch.path().join(name), &args);
        let out = run.out.clone();
        run.wait(|all| count(all, "commit") > 0);
        run.signal(name);
        let end = run.end();
        assert!(end.status.success(), "{name}: {}", said(&end));
        assert!(said(&end).contains("stopping; again to stop now"), "{name}");
        assert!(holds(&out).last().is_some_and(|e| e["event"] == "ended" && e["reason"] == "interrupted"), "{name}");
    }
}

#[test]
fn a_hang_up_that_is_to_be_ignored_ends_nothing() {
    let scratch = tempfile::tempdir().expect("a folder");
    let out = scratch.path().join("run");
    let mut command = std::process::Command::new("nohup");
    command.arg(env!("CARGO_BIN_EXE_mobee")).current_dir(env!("CARGO_MANIFEST_DIR"));
    command.args(["run", "configs/behaviors/explore.toml", "--no-record", "--clock", "real", "--json", "--out"]);
    let pipe = std::process::Stdio::piped;
    let child = command.arg(&out).stdout(pipe()).stderr(pipe()).spawn().expect("nohup starts");
    let mut run = Run { child: Some(child), out: out.clone() };
    run.wait(|all| count(all, "commit") > 0);
    run.signal("HUP");
    run.signal("TERM");
    let end = run.end();
    // with the hang-up heard, this would have been the second wish
    assert!(!said(&end).contains("stopping now"), "{}", said(&end));
    assert!(end.status.success());
    holds(&out);
}

#[test]
fn a_suspended_process_wakes_up_to_stale_readings_and_goes_on() {
    let scratch = tempfile::tempdir().expect("a folder");
    let mut run = Run::start(scratch.path().join("run"), &["configs/behaviors/explore.toml", "--no-record"]);
    let out = run.out.clone();
    let commits = |all: &[serde_json::Value]| count(all, "commit");
    for nap in 0..3 {
        let before = commits(&run.wait(|all| commits(all) > count(all, "outcome")));
        run.signal("STOP");
        // five control periods make a reading stale
        std::thread::park_timeout(Duration::from_millis(150 + 200 * nap));
        let asleep = events(&out).len();
        run.signal("CONT");
        let all = run.wait(|all| commits(all) > before);
        let since = &all[asleep..];
        let at = |what: &str| since.iter().position(|e| e["event"] == what);
        let moves = since.iter().position(|e| e["event"] == "command" && e["writer"] == "agent");
        let (closed, opened) = (at("disabled").expect("the filter closes"), at("enabled").expect("it opens again"));
        assert_eq!(since[closed]["cause"], "stale", "{}", since[closed]);
        assert!(closed < opened && moves.is_some_and(|m| opened < m), "nothing moves on stale readings");
    }
    run.signal("TERM");
    let end = run.end();
    assert!(end.status.success(), "{}", said(&end));
    holds(&out);
}

/// A machine that is too slow for its run, for more than a moment: people and scripts are told.
#[test]
fn a_run_that_is_held_up_again_and_again_ends_with_a_code_of_its_own() {
    let scratch = tempfile::tempdir().expect("a folder");
    let mut run = Run::start(scratch.path().join("run"), &["configs/behaviors/explore.toml", "--no-record"]);
    run.wait(|all| count(all, "commit") > 0);
    for _ in 0..11 {
        run.signal("STOP");
        std::thread::park_timeout(Duration::from_millis(150));
        run.signal("CONT");
        // each in a second of its own
        std::thread::park_timeout(Duration::from_millis(870));
    }
    let out = run.out.clone();
    run.signal("TERM");
    let end = run.end();
    assert_eq!(end.status.code(), Some(3), "{}", said(&end));
    let summary: serde_json::Value = serde_json::from_slice(&end.stdout).expect("a summary");
    assert!(summary["overload"].as_str().is_some_and(|o| o.contains("control periods missed")), "{summary}");
    holds(&out);
}
