//! A run whose process died goes on: its journal's open transaction gets one outcome, measured before anything moves, and
//! what was learned is there.

use crate::common::{events, mobee_here, text};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

fn mobee(args: &[&str]) -> Command {
    let mut command = mobee_here();
    command.args(args);
    command
}

fn count(events: &[Value], what: &str) -> usize {
    events.iter().filter(|e| e["event"] == what).count()
}

/// Goes on with a run until so many seconds of its own clock, and checks that all of it holds together.
fn resume(run: &Path, until: f64, extra: &[&str]) -> Vec<Value> {
    let until = until.to_string();
    let args = ["run", "--resume", text(run), "--no-record", "--json", "--for", &until];
    let out = mobee(&[&args, extra].concat()).output().expect("mobee starts");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let checked = mobee(&["check", text(run)]).output().expect("mobee starts");
    let said = String::from_utf8_lossy(&checked.stdout);
    assert!(checked.status.success(), "{said}{}", String::from_utf8_lossy(&checked.stderr));
    let all = events(run);
    assert_eq!(count(&all, "commit"), count(&all, "outcome"), "every commit has one outcome: {said}");
    all
}

#[test]
fn a_journal_that_was_cut_anywhere_is_gone_on_with() {
    let scratch = tempfile::tempdir().expect("a folder");
    let whole = scratch.path().join("whole");
    let args = ["run", "configs/behaviors/explore.toml", "--no-record", "--json", "--for", "400", "--out"];
    assert!(mobee(&[&args[..], &[text(&whole)]].concat()).stdout(Stdio::null()).status().expect("mobee").success());
    let bytes = std::fs::read(whole.join("journal.jsonl")).expect("a journal");
    for cut in 1..=6 {
        let run = scratch.path().join(format!("cut{cut}"));
        std::fs::create_dir(&run).expect("a folder");
        std::fs::copy(whole.join("config.json"), run.join("config.json")).expect("a copy");
        // odd places, so that lines are cut in the middle
        let keep = bytes.len() * cut / 7 + 13 * cut;
        std::fs::write(run.join("journal.jsonl"), &bytes[..keep]).expect("a cut journal");
        let before = events(&run);
        let all = resume(&run, 600.0, &[]);
        assert_eq!(count(&all, "resumed"), 1);
        assert_eq!(before, all[..before.len()], "what was told stays told");
        assert!(count(&all, "commit") > count(&before, "commit"), "the agent goes on");
        // the map that was learned is not drawn anew
        let vertices = |events: &[Value]| events.iter().filter(|e| e["note"]["note"] == "vertex").count();
        if vertices(&before) == 20 {
            assert_eq!(vertices(&all), 20);
        }
        let removed = |e: &&Value| e["note"]["note"] == "edge" && e["note"]["state"] == "removed";
        let map = std::fs::read_to_string(run.join("roadmap-icub.json")).expect("a roadmap");
        let map: Value = serde_json::from_str(&map).expect("JSON");
        for gone in before.iter().filter(removed) {
            let same = |e: &&Value| e["from"] == gone["note"]["from"] && e["to"] == gone["note"]["to"];
            let edge = map["edges"].as_array().and_then(|all| all.iter().find(same)).expect("the edge");
            assert_eq!(edge["state"], "removed", "{edge}");
        }
        // its log of tried motions is that of all processes
        let log = |all: &[Value]| {
            let motion = |t: &Value| (t["from"].as_u64(), t["to"].as_u64(), t["reached"].as_bool());
            all.iter().map(motion).collect::<Vec<_>>()
        };
        let told = all.iter().map(|e| &e["note"]).filter(|note| note["note"] == "tried").cloned();
        assert_eq!(log(map["tried"].as_array().expect("a log")), log(&told.collect::<Vec<_>>()));
    }
}

/// `MOBEE_KILLS` says how often (default 3).
#[test]
fn a_process_that_was_killed_is_gone_on_with() {
    let kills = std::env::var("MOBEE_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(3_u64);
    let (mut open, mut lost) = (0, 0);
    for kill in 0..kills {
        let scratch = tempfile::tempdir().expect("a folder");
        let run = scratch.path().join("run");
        let args = ["run", "configs/behaviors/ball.toml", "--clock", "real", "--json", "--out", text(&run)];
        let mut child = mobee(&args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("mobee starts");
        // any instant of its first seconds; nobody waits for anything but the clock
        let lived = 300 + kill * 7919 % 6000;
        std::thread::park_timeout(Duration::from_millis(lived));
        child.kill().expect("SIGKILL");
        child.wait().expect("an end");
        let before = events(&run);
        if before.is_empty() {
            continue; // killed before there was a run
        }
        let was_open = count(&before, "commit") > count(&before, "outcome");
        let recording = mobee_recorder::Contents::read(&run.join("recording.rrd"));
        // it is behind by about a second, and so holds nothing at first
        assert!(recording.is_ok() || lived < 2500, "the recording loads: {:?}", recording.err());
        let all = resume(&run, 9.0, &[]);
        let first = all[before.len()..].iter().find(|e| e["event"] == "outcome");
        open += usize::from(was_open);
        lost += usize::from(was_open && first.is_some_and(|e| e["outcome"] == "faulted"));
        let moved = all[before.len()..].iter().position(|e| e["event"] == "command" && e["kind"] == "move");
        let settled = all[before.len()..].iter().position(|e| e["event"] == "outcome");
        if let (true, Some(moved)) = (was_open, moved) {
            assert!(settled.is_some_and(|s| s < moved), "nothing moves before the outcome");
        }
    }
    println!("{kills} kills, {open} in mid-motion, of which {lost} rested at neither end");
}
