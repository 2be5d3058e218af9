//! The shipped behaviors do what the paper shows, as a user would run them.

use super::common::{HOLD, mobee_here};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

fn mobee(args: &[&str]) -> Output {
    mobee_here().args(args).output().expect("mobee starts")
}

/// Runs a behavior into `out` and returns its summary.
fn run(behavior: &str, out: &Path, more: &[&str]) -> Value {
    let mut args = vec!["run", behavior, "--json", "--out", out.to_str().expect("a readable path")];
    args.extend(more);
    let ran = mobee(&args);
    assert!(ran.status.success(), "{behavior}: {}", String::from_utf8_lossy(&ran.stderr));
    serde_json::from_slice(&ran.stdout).expect("the summary is JSON")
}

fn check(out: &Path, args: &[&str]) -> String {
    let mut all = vec!["check", out.to_str().expect("a readable path")];
    all.extend(args);
    let checked = mobee(&all);
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(checked.status.success(), "{said}{}", String::from_utf8_lossy(&checked.stderr));
    said
}

fn figure(summary: &Value, name: &str) -> f64 {
    let figures = summary["counters"]["done"]["icub"]["figures"].as_array().expect("figures");
    figures.iter().find(|f| f[0] == name).and_then(|f| f[1].as_f64()).unwrap_or_else(|| panic!("no figure {name}"))
}

/// Section 3.1: the exploration ends by itself, is rolled back at least twenty times, never touches anything, and what it
/// learned is what an offline check of the same straight lines finds.
#[test]
fn the_icub_explores_by_itself() {
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("run");
    let s = run("configs/behaviors/explore.toml", &out, &[]);
    assert_eq!(s["reason"], "done");
    assert!(s["counters"]["rolled_back"].as_u64() >= Some(20), "{s}");
    assert_eq!(s["counters"]["hard_contacts"], 0);
    let share = figure(&s, "edges_removed") / figure(&s, "edges");
    assert!((0.2..=0.4).contains(&share), "{share} of the edges are infeasible");
    let said = check(&out, &["--edges"]);
    assert!(said.contains(HOLD) && said.contains(" 0 disagree"), "{said}");
    assert!(out.join("recording.rrd").metadata().expect("a recording").len() > 100_000);
    assert!(out.join("roadmap-icub.json").is_file() && out.join("config.json").is_file());
    assert!(mobee(&["inspect", out.to_str().expect("a readable path")]).status.success());
}

/// At the greatest speed of its motors every retreat still runs along the path that was measured, and none overshoots its end (I22).
#[test]
fn the_icub_comes_back_from_its_fastest_motions() {
    let dir = tempfile::tempdir().expect("a folder");
    for (seed, speed) in [("1", "0.8"), ("2", "0.8"), ("4", "1.0")] {
        let out = dir.path().join(seed);
        let speed = format!("robot.icub.agent.speed={speed}");
        let set = ["--set", &speed, "--set", "robot.icub.agent.vertices=8", "--seed", seed];
        let s =
            run("configs/behaviors/explore.toml", &out, &[&["--clock", "virtual", "--no-record"], &set[..]].concat());
        assert!(s["counters"]["rolled_back"].as_u64() >= Some(5), "{s}");
        assert!(check(&out, &[]).contains(HOLD));
    }
}

/// Figure 5: one rollback at the ball that turned solid, then the way round; a block on the resting arm, a hold, an escape.
#[test]
fn the_robot_goes_round_the_ball_and_escapes_the_block() {
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("run");
    let s = run("configs/behaviors/ball.toml", &out, &["--no-record"]);
    assert_eq!(s["reason"], "done");
    let c = &s["counters"];
    assert_eq!((&c["rolled_back"], &c["escapes"], &c["faulted"]), (&1.into(), &1.into(), &0.into()), "{s}");
    assert_eq!(c["hard_contacts"], 0);
    assert_eq!(figure(&s, "goals_reached"), 3.0);
    let journal = std::fs::read_to_string(out.join("journal.jsonl")).expect("a journal");
    assert!(journal.contains(r#"{"state":"holding","reason":"in_contact"}"#), "the robot held");
    check(&out, &[]);
}

/// A smaller exploration under forces, with the reflex as the last line and without: it ends by itself, and whatever its
/// controller promises holds.
#[test]
fn the_icub_explores_under_forces() {
    let dir = tempfile::tempdir().expect("a folder");
    for reflex in ["true", "false"] {
        let out = dir.path().join(reflex);
        let reflex = format!("robot.icub.controller.reflex={reflex}");
        let set = ["--no-record", "--set", "robot.icub.agent.vertices=8", "--set", &reflex];
        let s = run("configs/behaviors/explore-fields.toml", &out, &set);
        assert_eq!(s["reason"], "done");
        let c = &s["counters"];
        assert!(c["committed"].as_u64() > c["rolled_back"].as_u64() && c["rolled_back"].as_u64() > Some(0), "{s}");
        let said = check(&out, &["--edges"]);
        assert!(said.contains(HOLD) && said.contains("is not driven straight"), "{said}");
    }
}

/// Every configuration that ships can be read, built and checked; those of real robots without reaching for them.
#[test]
fn every_shipped_configuration_is_ready_to_run() {
    for folder in ["configs/behaviors", "configs/robots"] {
        let files = std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)).expect("the folder");
        for file in files.map(|f| f.expect("an entry").path()).filter(|f| f.extension().is_some_and(|e| e == "toml")) {
            let checked = mobee(&["check", file.to_str().expect("a readable path")]);
            assert!(checked.status.success(), "{}: {}", file.display(), String::from_utf8_lossy(&checked.stderr));
        }
    }
}
