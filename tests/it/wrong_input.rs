//! Whatever a user writes wrong is answered with its place and a remedy, exit code 2, and nothing half-done.

use super::common::{EDGE, mobee_in};
use std::path::{Path, PathBuf};
use std::process::Output;

const BEHAVIOR: &str = r#"world.file = "world.xml"

[[robot]]
name = "edge"
model = "robot.xml"
controller = { period_ms = 20, history = 500 }

[robot.agent]
kind = "scripted"
speed = 0.5
poses = [{ q_deg = { M_first = 20 } }]
"#;

const WORLD: &str = r#"<WorldList version="1.0">
  <object name="post" px="3"><sphere radius="0.1"/></object>
</WorldList>
"#;

fn mobee(dir: &Path, args: &[&str]) -> Output {
    mobee_in(dir).args(args).output().expect("mobee starts")
}

/// A folder with a good behavior, in which one text of one file is replaced.
fn folder(file: &str, from: &str, to: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    for (name, text) in [("behavior.toml", BEHAVIOR), ("world.xml", WORLD), ("robot.xml", EDGE)] {
        let text = if name == file {
            assert!(text.contains(from), "the good {name} holds {from:?}");
            text.replacen(from, to, 1)
        } else {
            text.to_owned()
        };
        std::fs::write(dir.path().join(name), text).expect("a file");
    }
    dir
}

#[test]
fn the_good_behavior_runs() {
    let dir = folder("behavior.toml", "", "");
    let out = mobee(dir.path(), &["run", "behavior.toml", "--no-record", "--out", "run"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let checked = mobee(dir.path(), &["check", "run"]);
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
}

#[test]
fn every_mistake_is_named_with_place_and_remedy_before_anything_moves() {
    // file, what is replaced, by what, and what the answer must hold (its place first)
    let cases: &[(&str, &str, &str, &[&str])] = &[
        ("behavior.toml", "period_ms = 20", "period = 20", &["behavior.toml:6", "period", "did you mean `period_ms`"]),
        ("behavior.toml", "period_ms = 20", "period_ms = \"20 ms\"", &["behavior.toml:6", "expected a number", "help"]),
        (
            "behavior.toml",
            "period_ms = 20",
            "period_ms = -20",
            &["behavior.toml:6", "out of range", "give 1 to 1000 ms"],
        ),
        ("behavior.toml", "history = 500", "history = 500, margin = 3", &["behavior.toml:6", "margin_mm"]),
        ("behavior.toml", "history = 500", "history = 500, kind = \"rolback\"", &["toml:6", "did you mean `rollback`"]),
        (
            "behavior.toml",
            "history = 500",
            "history = 500, kind = 3",
            &["behavior.toml:6", "expected text in quotes", "help"],
        ),
        ("behavior.toml", "history = 500", "history = 500, kind = \"fields\", field_m = 3", &["toml:6", "`field_mm`"]),
        ("behavior.toml", "history = 500", "history = 500, kind = \"fields\", field_mm = -3", &["toml:6", "0 to 500"]),
        ("behavior.toml", "20, history = 500", "80, history = 500, kind = \"fields\"", &["toml:6", "1 to 50 ms"]),
        ("behavior.toml", "history = 500", "history = 500, field_mm = 3", &["behavior.toml:6", "field_mm"]),
        ("behavior.toml", "controller = { period_ms = 20, history = 500 }", "", &["controller", "help"]),
        ("behavior.toml", "robot.xml", "robots.xml", &["behavior.toml:5", "there is no file", "help"]),
        ("behavior.toml", "world.xml", "word.xml", &["behavior.toml:1", "there is no file", "help"]),
        ("behavior.toml", "scripted", "scriptd", &["behavior.toml:9", "did you mean `scripted`"]),
        ("behavior.toml", "scripted", "python", &["behavior.toml:9", "is Python code", "mobee.run(file, agent=...)"]),
        ("behavior.toml", "M_first", "M_frist", &["behavior.toml:11", "M_frist", "M_first"]),
        ("behavior.toml", "M_first = 20", "M_first = 200", &["behavior.toml:11", "200", "60"]),
        ("behavior.toml", "M_first = 20", "M_first = nan", &["behavior.toml:11", "finite"]),
        ("behavior.toml", "speed = 0.5", "speed = 5.0", &["behavior.toml:10", "speed"]),
        ("behavior.toml", "[robot.agent]", "[robot.agent", &["behavior.toml:8", "help"]),
        ("robot.xml", "radius=\"0.03\"", "radius=\"0.0e3x\"", &["robot.xml:3:27", "0.0e3x", "help"]),
        (
            "robot.xml",
            "minPos=\"-30\" maxPos=\"60\" home",
            "minPos=\"60\" maxPos=\"-30\" home",
            &["robot.xml:4", "help"],
        ),
        ("robot.xml", "</joint>", "", &["robot.xml:", "help"]),
        ("world.xml", "radius=\"0.1\"", "radius=\"0\"", &["world.xml:2", "help"]),
        ("world.xml", "px=\"3\"", "px=\"0.45\" pz=\"0.2\"", &["behavior.toml:5", "at home", "deep in", "help"]),
    ];
    for (file, from, to, expected) in cases {
        let dir = folder(file, from, to);
        for command in ["run", "check"] {
            let out = mobee(dir.path(), &[command, "behavior.toml"]);
            let said = String::from_utf8_lossy(&out.stderr);
            assert_eq!(out.status.code(), Some(2), "{command} with {to:?}: {said}");
            for part in *expected {
                assert!(said.contains(part), "{command} with {to:?} says {part:?}:\n{said}");
            }
            assert!(!said.contains("panicked"), "{said}");
        }
        assert!(!dir.path().join("runs").exists(), "{to:?}: nothing is left behind");
    }
}

#[test]
fn arguments_are_answered_too() {
    let dir = folder("behavior.toml", "", "");
    let cases: &[(&[&str], &str)] = &[
        (&["run", "nowhere.toml"], "nowhere.toml"),
        (&["run", "behavior.toml", "--set", "robot.edge.agent.sped=0.1"], "did you mean `speed`"),
        (&["run", "behavior.toml", "--set", "speed"], "there is no `=`"),
        (&["run", "behavior.toml", "--set", "robot.nobody.name=x"], "no `nobody` in this list"),
        (&["run", "behavior.toml", "--set", "robot.edg.agent.speed=0.1"], "mean `edge`?"),
        (
            &["check", "behavior.toml", "--set", "robot.edge.agent.kind=roadmap"],
            "starts without the other kind's settings",
        ),
        (&["run", "behavior.toml", "--clock", "sundial"], "the clocks are"),
        (&["run", "behavior.toml", "--for", "-3"], "out of range"),
        (&["run", "behavior.toml", "--out", "."], "exists already"),
        (&["kinds", "explorr"], "did you mean `explorer`"),
        (&["kinds", "roleback"], "did you mean `rollback`"),
        (&["run", "behavior.toml", "--set", "robot.edge.controller.kind=rolback"], "did you mean `rollback`"),
        (&["view", "."], "there is no recording"),
        (&["inspect", "."], "journal"),
        (&["check", "nowhere"], "nowhere"),
        (&["model", "info", "world.xml"], "world.xml:1"),
        (&["model", "view", "world.xml"], "world.xml:1"),
        (&["model", "view", "robot.xml", "--urdf", "nowhere.urdf"], "nowhere.urdf"),
        (&["model", "view", "robot.xml", "--drop-meshes"], "name the URDF with --urdf"),
        (&["model", "view", "robot.xml", "--out", "world.xml"], "exists already"),
        (&["model", "view", "robot.xml", "--out", "no/such/view.rrd"], "no/such/view.rrd"),
        (&["model", "view", "robot.xml", "--margin", "-1"], "give 0 to 500 mm"),
    ];
    for (args, expected) in cases {
        let out = mobee(dir.path(), args);
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{args:?}: {said}");
        assert!(said.contains(expected), "{args:?} says {expected:?}:\n{said}");
    }
}

/// A robot whose last link stands in its base at home, as its file lists no more pairs than it must.
const FOLDED: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="folded">
  <pairs><leaveOut a="base" b="arm" reason="neighbors"/><leaveOut a="arm" b="tool" reason="neighbors"/></pairs>
  <bodypart name="all">
    <link name="base" z="0.2" radius="0.03">
      <motor name="M_first" minPos="-30" maxPos="60" home="0">
        <joint z="1" minPos="-30" maxPos="60"><link name="arm" x="0.3" radius="0.02">
          <motor name="M_second" minPos="-30" maxPos="30"><joint z="1"><link name="tool" x="-0.3" radius="0.02"/></joint></motor>
        </link></joint>
      </motor>
    </link>
  </bodypart>
</ZeroPositionKinematicTree>"#;

#[test]
fn a_robot_that_is_in_its_own_way_is_told_the_line_that_helps() {
    let dir = folder("behavior.toml", "", "");
    std::fs::write(dir.path().join("robot.xml"), FOLDED).expect("a file");
    let out = mobee(dir.path(), &["check", "behavior.toml"]);
    let said: String = String::from_utf8_lossy(&out.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(out.status.code(), Some(2), "{said}");
    for part in ["edge base", "edge tool", "can't hurt each other", "<pairs>", "robot.xml"] {
        assert!(said.contains(part) || said.contains(&part.replace("edge", "folded")), "{part:?} in {said}");
    }
    let line = said.split_once("<leaveOut").and_then(|(_, rest)| rest.split_once("/>")).map(|(inside, _)| inside);
    let line = format!("<leaveOut{}/>", line.expect("a line to write"));
    assert!(line.contains("a=\"base\" b=\"tool\""), "{line}");
    std::fs::write(dir.path().join("robot.xml"), FOLDED.replacen("<pairs>", &format!("<pairs>{line}"), 1))
        .expect("a file");
    let out = mobee(dir.path(), &["check", "behavior.toml"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
}

#[test]
fn a_damaged_journal_is_named_by_its_line() {
    let dir = folder("behavior.toml", "", "");
    assert!(mobee(dir.path(), &["run", "behavior.toml", "--no-record", "--out", "run"]).status.success());
    let journal: PathBuf = dir.path().join("run/journal.jsonl");
    let good = std::fs::read(&journal).expect("a journal");

    std::fs::write(&journal, &good[..good.len() - 40]).expect("written");
    let out = mobee(dir.path(), &["check", "run"]);
    assert_eq!(out.status.code(), Some(2), "a truncated journal is wrong input");
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(said.contains("journal.jsonl:") && said.contains("help"), "{said}");

    let mut flipped = good.clone();
    let at = flipped.len() / 2;
    flipped[at] ^= 1;
    std::fs::write(&journal, &flipped).expect("written");
    let line = good[..at].iter().filter(|b| **b == b'\n').count() + 1;
    let out = mobee(dir.path(), &["check", "run"]);
    assert_eq!(out.status.code(), Some(2));
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(said.contains(&format!("journal.jsonl:{line}")), "line {line}: {said}");
}
