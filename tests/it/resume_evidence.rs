//! A resumed run believes nothing that its journal contradicts, and one that died in contact goes on from there.

use super::common::{EDGE, events, mobee_in, said, text};
use mobee_contract::{Entry, Sink, Time};
use mobee_journal::ring;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;

const BEHAVIOR: &str = r#"world.file = "world.xml"
[[robot]]
name = "edge"
model = "robot.xml"
controller = { period_ms = 20, history = 500 }
driver = { kind = "sim", profile = "ideal" }
agent = { kind = "random", motors = ["base"], count = 40, speed = 0.5 }
"#;
const WORLD: &str =
    r#"<WorldList><object name="post" px="0.306" py="0.257" pz="0.2"><sphere radius="0.05"/></object></WorldList>"#;
/// Where the forearm is 3 mm from the post, rad of both motors.
const AT_THE_POST: [f64; 2] = [0.5146, 0.0];

/// A folder with a behavior, and a run of it that ended in order.
fn ended() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("a folder");
    for (name, text) in [("behavior.toml", BEHAVIOR), ("world.xml", WORLD), ("robot.xml", EDGE)] {
        std::fs::write(dir.path().join(name), text).expect("a file");
    }
    let run = dir.path().join("run");
    let out = mobee(dir.path(), &["run", "behavior.toml", "--no-record", "--for", "60", "--out", text(&run)]);
    assert!(out.status.success(), "{}", said(&out));
    (dir, run)
}

fn mobee(dir: &Path, args: &[&str]) -> Output {
    mobee_in(dir).args(args).output().expect("mobee starts")
}

fn resumed(run: &Path) -> Output {
    mobee(run, &["run", "--resume", ".", "--no-record", "--for", "120"])
}

/// Keeps the lines of the journal up to the first one that holds this.
fn cut_after(run: &Path, what: &str) {
    let journal = run.join("journal.jsonl");
    let all = std::fs::read_to_string(&journal).expect("a journal");
    let lines: Vec<&str> = all.lines().collect();
    let last = lines.iter().position(|l| l.contains(what)).expect("such a line");
    std::fs::write(&journal, lines[..=last].join("\n") + "\n").expect("written");
}

/// What was said, as if the terminal were wide.
fn answer(out: &Output) -> String {
    said(out).replace('│', " ").split_whitespace().collect::<Vec<_>>().join(" ")
}

fn edit(file: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(file).expect("a text");
    assert!(text.contains(from), "{} holds {from}", file.display());
    std::fs::write(file, text.replacen(from, to, 1)).expect("written");
}

#[test]
fn what_contradicts_the_journal_is_refused_and_named() {
    type Damage = fn(&Path);
    let remove = |run: &Path, file: &str| std::fs::remove_file(run.join(file)).expect("it was there");
    let cases: &[(&str, Damage, &[&str])] = &[
        (
            "an empty journal",
            |run| std::fs::write(run.join("journal.jsonl"), "").expect("written"),
            &["journal.jsonl", "cut off"],
        ),
        (
            "an empty journal without its seal",
            |run| {
                std::fs::write(run.join("journal.jsonl"), "").expect("written");
                std::fs::remove_file(run.join("journal.seal")).expect("removed");
            },
            &["journal.jsonl", "holds no event"],
        ),
        ("a journal cut at the end of a line", |run| cut_after(run, "\"outcome\""), &["journal.jsonl", "cut off"]),
        (
            "the same without its seal",
            |run| {
                cut_after(run, "\"outcome\"");
                std::fs::remove_file(run.join("journal.seal")).expect("removed");
            },
            &["summary.json", "cut off"],
        ),
        (
            "another margin",
            |run| edit(&run.join("config.json"), "\"margin_mm\": 10.0", "\"margin_mm\": 1.0"),
            &["config.json", "robot.0.controller.margin_mm is 1.0, not 10.0", "--set"],
        ),
        (
            "a seal that is none",
            |run| std::fs::write(run.join("journal.seal"), "x").expect("written"),
            &["journal.seal"],
        ),
        (
            "the seal of another run",
            |run| std::fs::write(run.join("journal.seal"), r#"{"events":5,"hash":"00"}"#).expect("written"),
            &["another journal"],
        ),
        (
            "a summary that is none",
            |run| std::fs::write(run.join("summary.json"), "x").expect("written"),
            &["summary.json"],
        ),
        (
            "recorded poses of another robot",
            |run| {
                let mut ring = ring::Rings::create(run, &[("edge".into(), 3, 10)]).expect("a ring");
                let q = vec![0.0; 3].into();
                ring.write(Time(1), &Entry::Pose { robot: 0, q, contacts: Vec::new().into() }).expect("written");
            },
            &["poses-edge.ring", "3 motors"],
        ),
    ];
    let (_dir, run) = ended();
    let whole = events(&run);
    for (what, damage, expected) in cases {
        let copy = tempfile::tempdir_in(run.parent().expect("a folder")).expect("a folder");
        for file in ["config.json", "journal.jsonl", "journal.seal", "summary.json"] {
            std::fs::copy(run.join(file), copy.path().join(file)).expect("a copy");
        }
        damage(copy.path());
        let before = std::fs::read(copy.path().join("journal.jsonl")).expect("a journal");
        let out = resumed(copy.path());
        let answer = answer(&out);
        assert_eq!(out.status.code(), Some(2), "{what}: {answer}");
        assert!(expected.iter().all(|part| answer.contains(part)) && answer.contains("help"), "{what}: {answer}");
        assert_eq!(
            before,
            std::fs::read(copy.path().join("journal.jsonl")).expect("a journal"),
            "{what}: nothing is told"
        );
    }
    // of an older version, or with the traces of one: what is there agrees
    remove(&run, "journal.seal");
    let out = resumed(&run);
    assert!(out.status.success(), "{}", said(&out));
    assert_eq!(whole, events(&run)[..whole.len()], "what was told stays told");
    // and it can be gone on with once more
    let out =
        mobee(&run, &["run", "--resume", ".", "--no-record", "--for", "200", "--set", "robot.edge.agent.speed=0.2"]);
    assert!(out.status.success(), "{}", said(&out));
    let configs: Vec<Value> = events(&run).into_iter().filter(|e| e["event"] == "resumed").collect();
    assert_eq!(configs.len(), 2);
    assert_eq!(configs[1]["config"]["robot"][0]["agent"]["speed"], 0.2);
}

#[test]
fn a_journal_that_was_cut_short_is_noticed_by_all_who_read_it() {
    let (dir, run) = ended();
    cut_after(&run, "\"outcome\"");
    for command in ["check", "inspect"] {
        let out = mobee(dir.path(), &[command, "run"]);
        assert_eq!(out.status.code(), Some(2), "{command}: {}", said(&out));
        assert!(answer(&out).contains("its end was cut off"), "{command}: {}", answer(&out));
    }
}

#[test]
fn a_run_that_died_in_contact_goes_on_from_there() {
    let (dir, run) = ended();
    // as a crash leaves it in mid-motion: the commit is told, its outcome is not, and the robot stands at the post
    cut_after(&run, "\"event\":\"commit\"");
    for file in ["journal.seal", "summary.json"] {
        std::fs::remove_file(run.join(file)).expect("removed");
    }
    let mut ring = ring::Rings::create(&run, &[("edge".into(), 2, 10)]).expect("a ring");
    let pose = Entry::Pose { robot: 0, q: AT_THE_POST.to_vec().into(), contacts: Vec::new().into() };
    ring.write(Time(10_000_000_000), &pose).expect("written");
    let before = events(&run).len();
    let out = resumed(&run);
    assert!(out.status.success(), "{}", said(&out));
    let all = events(&run);
    let since = &all[before..];
    let count = |what: &str| all.iter().filter(|e| e["event"] == what).count();
    assert_eq!(count("commit"), count("outcome"), "no commit without an outcome");
    let holds = |e: &&Value| e["event"] == "state" && e["status"]["reason"] == "in_contact";
    let hold = since.iter().position(|e| holds(&e)).expect("it holds in contact");
    let escape = since.iter().position(|e| e["event"] == "commit" && e["escape"] == true).expect("an escape");
    assert!(hold < escape);
    assert_eq!(since.iter().find(|e| e["event"] == "outcome").expect("an outcome")["outcome"], "faulted");
    let free = |e: &&Value| e["event"] == "commit" && e["escape"] == false;
    assert!(since.iter().any(|e| free(&e)), "after it the agent goes on");
    let checked = mobee(dir.path(), &["check", "run"]);
    assert!(checked.status.success(), "{}", said(&checked));
}
