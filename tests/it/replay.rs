//! A run in virtual time can be run again from its folder: equal event by event, or with another future from an instant on.

use super::common::{mobee_here, text};
use mobee_recorder::Contents;
use std::path::Path;
use std::process::Output;

fn mobee(args: &[&str]) -> Output {
    mobee_here().args(args).env_remove("RERUN").output().expect("mobee starts")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A run of the ball behavior, 20 s long.
fn run(out: &Path) {
    let ran = mobee(&["run", "configs/behaviors/ball.toml", "--for", "20", "--no-record", "--out", text(out)]);
    assert!(ran.status.success(), "{}", said(&ran));
}

fn events(run: &Path) -> Vec<String> {
    let journal = std::fs::read_to_string(run.join("journal.jsonl")).expect("a journal");
    journal.lines().skip(1).map(str::to_owned).collect()
}

#[test]
fn unchanged_it_is_equal_message_by_message() {
    let dir = tempfile::tempdir().expect("a folder");
    let (first, second) = (dir.path().join("first"), dir.path().join("second"));
    run(&first);
    let again = mobee(&["replay", text(&first), "--out", text(&second)]);
    assert!(again.status.success(), "{}", said(&again));
    assert_eq!(events(&first), events(&second));
}

#[test]
fn it_ends_at_the_first_difference_and_shows_it() {
    let dir = tempfile::tempdir().expect("a folder");
    let first = dir.path().join("first");
    run(&first);
    // the same journal, told to be of another seed
    let config = std::fs::read_to_string(first.join("config.json")).expect("a configuration");
    let seed = config.find("\"seed\": 1").expect("the seed stands in it");
    let other = format!("{}\"seed\": 9{}", &config[..seed], &config[seed + 9..]);
    std::fs::write(first.join("config.json"), other).expect("it can be written");
    let again = mobee(&["replay", text(&first), "--out", text(&dir.path().join("second"))]);
    assert_eq!(again.status.code(), Some(1));
    assert!(said(&again).contains("the first difference is at event 0"), "{}", said(&again));
}

#[test]
fn both_futures_are_in_one_recording() {
    let dir = tempfile::tempdir().expect("a folder");
    let (first, second) = (dir.path().join("first"), dir.path().join("second"));
    let ran = mobee(&["run", "configs/behaviors/ball.toml", "--for", "20", "--out", text(&first)]);
    assert!(ran.status.success(), "{}", said(&ran));
    let speed = "robot.icub.agent.speed=0.05";
    let other = mobee(&["replay", text(&first), "--at", "5", "--set", speed, "--out", text(&second)]);
    assert!(other.status.success(), "{}", said(&other));
    let (was, is) = (events(&first), events(&second));
    let at = |line: &String| -> u64 {
        let line: serde_json::Value = serde_json::from_str(line).expect("a line of a journal");
        line["t_ns"].as_u64().expect("a time")
    };
    let before =
        |events: &[String]| -> Vec<String> { events.iter().take_while(|e| at(e) < 5_000_000_000).cloned().collect() };
    assert_eq!(before(&was), before(&is), "the past is the same");
    assert_ne!(was, is, "the future is not");
    let checked = mobee(&["check", text(&second)]);
    assert!(checked.status.success(), "{}{}", said(&checked), String::from_utf8_lossy(&checked.stdout));
    let contents = Contents::read(&second.join("recording.rrd")).expect("a recording");
    for root in ["/recorded/world/", "/changed/world/", "/recorded/log/", "/changed/log/"] {
        assert!(contents.rows.keys().any(|entity| entity.starts_with(root)), "nothing below {root}");
    }
}

#[test]
fn another_controller_takes_over_from_that_instant_on() {
    let dir = tempfile::tempdir().expect("a folder");
    let first = dir.path().join("first");
    run(&first);
    let was = events(&first);
    let fields = "={ kind = \"fields\", period_ms = 20, history = 6000 }";
    for (name, set) in [("wider", ".margin_mm=14.0"), ("fields", fields)] {
        let second = dir.path().join(name);
        let set = format!("robot.icub.controller{set}");
        let other = mobee(&["replay", text(&first), "--at", "5", "--set", &set, "--out", text(&second)]);
        assert!(other.status.success(), "{name}: {}", said(&other));
        let is = events(&second);
        let swaps: Vec<serde_json::Value> = is
            .iter()
            .map(|e| serde_json::from_str(e).expect("a line of a journal"))
            .filter(|e: &serde_json::Value| e["event"]["event"] == "swap")
            .collect();
        let steps: Vec<&str> = swaps.iter().filter_map(|s| s["event"]["step"].as_str()).collect();
        assert_eq!(steps, ["offered", "took_over", "settled"], "{name}");
        assert!(swaps.iter().all(|s| s["event"]["part"] == "controller" && s["t_ns"].as_u64() >= Some(5_000_000_000)));
        let same = was.iter().zip(&is).take_while(|(a, b)| a == b).count();
        assert!(is[same].contains("offered"), "{name}: {} was {}", is[same], was[same]);
        let checked = mobee(&["check", text(&second)]);
        assert!(checked.status.success(), "{name}: {}{}", said(&checked), String::from_utf8_lossy(&checked.stdout));
    }
}

#[test]
fn what_can_t_be_replayed_is_refused_with_a_remedy() {
    let dir = tempfile::tempdir().expect("a folder");
    let first = dir.path().join("first");
    run(&first);
    let out = dir.path().join("out");
    let refused = |more: &[&str], what: &str| {
        let args = [&["replay", text(&first), "--out", text(&out)], more].concat();
        let output = mobee(&args);
        assert_eq!(output.status.code(), Some(2), "{more:?}");
        assert!(said(&output).contains(what), "{more:?}: {}", said(&output));
        assert!(!out.exists(), "{more:?} left something behind");
    };
    refused(&["--at", "1e6", "--set", "robot.icub.agent.speed=0.05"], "give seconds between 0 and 20");
    refused(&["--at", "5", "--set", "for_s=20.0"], "nothing is changed");
    refused(&["--at", "5", "--set", "robot.icub.base.yaw_deg=10.0"], "can't change during a run");
    refused(&["--at", "5", "--set", "seed=2"], "seed can't change during a run");
    refused(&["--at", "5"], "--set");
    assert_eq!(mobee(&["replay", text(dir.path())]).status.code(), Some(2));
}

#[test]
fn recorded_poses_are_played_as_a_robot() {
    let dir = tempfile::tempdir().expect("a folder");
    let (first, second) = (dir.path().join("first"), dir.path().join("second"));
    let ran = mobee(&["run", "configs/behaviors/ball.toml", "--for", "20", "--out", text(&first)]);
    assert!(ran.status.success(), "{}", said(&ran));
    let table = |run: &Path, name: &str| {
        let file = dir.path().join(name);
        let taken = mobee(&["inspect", text(run), "--poses", text(&file)]);
        assert!(taken.status.success(), "{}", said(&taken));
        std::fs::read_to_string(file).expect("a table")
    };
    let was = table(&first, "poses.csv");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/icub.xml");
    let config = dir.path().join("played.toml");
    let robot =
        format!("name = \"icub\"\nmodel = {:?}\ncontroller = {{ period_ms = 20, history = 6000 }}", text(&model));
    let driver = "driver = { kind = \"replay\", file = \"poses.csv\" }";
    std::fs::write(&config, format!("for_s = 20.0\n[[robot]]\n{robot}\n{driver}\n")).expect("it can be written");
    let played = mobee(&["run", text(&config), "--out", text(&second)]);
    assert!(played.status.success(), "{}", said(&played));
    let is = table(&second, "again.csv");
    let newest = |table: &str| -> Vec<f64> {
        let row = table.lines().last().expect("a row");
        row.split(',').skip(1).map(|v| v.parse().expect("a number")).collect()
    };
    assert!(was.lines().count() > 100, "the robot moved");
    let home = was.lines().nth(1).expect("a row").split(',').skip(1).map(|v| v.parse().expect("a number"));
    let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b): (&f64, &f64)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart(&newest(&was), &home.collect::<Vec<f64>>()) > 5.0, "it went somewhere");
    assert!(apart(&newest(&was), &newest(&is)) < 0.15, "and the played robot did too");
}
