//! `mobee new` writes a file that is ready to run, wherever the program is installed, and writes over nothing.

use super::common::{mobee_in, said};
use std::path::Path;
use std::process::Output;

fn mobee(dir: &Path, args: &[&str]) -> Output {
    mobee_in(dir).args(args).output().expect("mobee starts")
}

#[test]
fn every_behavior_to_start_from_is_ready_to_run() {
    for from in ["explore", "ball", "filter", "torture", "explore-yarp"] {
        let dir = tempfile::tempdir().expect("a folder");
        let made = mobee(dir.path(), &["new", "mine", "--from", from]);
        assert!(made.status.success(), "{from}: {}", said(&made));
        let checked = mobee(dir.path(), &["check", "mine.toml"]);
        assert!(checked.status.success(), "{from}: {}", said(&checked));
        let text = std::fs::read_to_string(dir.path().join("mine.toml")).expect("the behavior");
        assert!(text.starts_with("#:schema ./mobee.schema.json") && text.contains("mobee "), "{text}");
        assert!(!text.contains("../") && !text.contains("configs/behaviors/mine"), "{text}");
        // those with a real clock are left to their own tests
        if !text.contains("\nclock = \"real\"") {
            let ran = mobee(dir.path(), &["run", "mine.toml", "--for", "3", "--no-record", "--out", "run"]);
            assert!(ran.status.success(), "{from}: {}", said(&ran));
        }
    }
}

#[test]
fn nothing_is_written_over() {
    let dir = tempfile::tempdir().expect("a folder");
    assert!(mobee(dir.path(), &["new", "one"]).status.success());
    let first = std::fs::read_to_string(dir.path().join("one.toml")).expect("the behavior");
    // another one shares robot, world and schema
    let second = mobee(dir.path(), &["new", "two.toml"]);
    assert_eq!(said(&second), "two.toml\n");
    std::fs::write(dir.path().join("ball.xml"), "mine").expect("written");
    let refusals: &[(&[&str], &str)] = &[
        (&["new", "one"], "one.toml exists already"),
        (&["new", "three", "--from", "ball"], "ball.xml exists already"),
        (&["new", "three", "--from", "exlpore"], "did you mean `explore`"),
        (&["new", "nowhere/three"], "there is no folder nowhere"),
        (&["new", "a b"], "not a valid name for a behavior"),
    ];
    for (args, expected) in refusals {
        let out = mobee(dir.path(), args);
        assert_eq!(out.status.code(), Some(2), "{args:?}");
        assert!(said(&out).contains(expected), "{args:?}: {}", said(&out));
        assert!(!dir.path().join("three.toml").exists(), "{args:?}: nothing is half-done");
    }
    assert_eq!(std::fs::read_to_string(dir.path().join("one.toml")).expect("the behavior"), first);
}
