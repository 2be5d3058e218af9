//! A configuration is put together from layers, later ones win, and every value can be traced to where it was written.

use super::common::{mobee_in, said};
use mobee::config::{Config, Source};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Output;

const BASE: &str = r#"seed = 3
world.file = "world.xml"

[[robot]]
name = "edge"
model = "robot.xml"
controller = { period_ms = 20, history = 500 }

[robot.agent]
kind = "scripted"
speed = 0.5
poses = [{ q_deg = { M_first = 20 } }]
"#;

const MAIN: &str = r#"include = ["parts/base.toml"]
seed = 7

[[robot]]
name = "edge"
controller.history = 600
agent.speed = 0.25
"#;

const WORLD: &str =
    r#"<WorldList version="1.0"><object name="post" px="3"><sphere radius="0.1"/></object></WorldList>"#;

const ROBOT: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="edge"><bodypart name="base"><link z="0.2" radius="0.03">
<motor name="M_first" minPos="-30" maxPos="60" home="0"><joint z="1" minPos="-30" maxPos="60"><link x="0.3" radius="0.02"/></joint></motor>
</link></bodypart></ZeroPositionKinematicTree>"#;

/// A folder with a main file, and a folder `parts` beside it with what it includes.
fn folder(main: &str, more: &[(&str, &str)]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(dir.path().join("parts")).expect("a folder");
    let files =
        [("main.toml", main), ("parts/base.toml", BASE), ("parts/world.xml", WORLD), ("parts/robot.xml", ROBOT)];
    for (name, text) in files.iter().chain(more) {
        std::fs::write(dir.path().join(name), text).expect("a file");
    }
    dir
}

fn mobee(dir: &Path, args: &[&str], environment: &[(&str, &str)]) -> Output {
    mobee_in(dir).args(args).envs(environment.iter().copied()).output().expect("mobee starts")
}

#[test]
fn later_layers_win_and_paths_stay_with_their_file() {
    let dir = folder(MAIN, &[]);
    let path = dir.path().join("main.toml");
    let (config, source) = Config::load(&path, &["robot.edge.agent.repeat=2".into()]).expect("it loads");
    let robot = &config.robot[0];
    assert_eq!(config.robot.len(), 1, "robots of one name are one robot");
    assert_eq!((config.seed, robot.controller.history, robot.controller.period_ms), (7, 600, 20.0));
    let agent = robot.agent.as_ref().expect("an agent");
    assert_eq!((&agent["speed"], &agent["repeat"], &agent["kind"]), (&0.25.into(), &2.into(), &"scripted".into()));
    assert_eq!(robot.model, Path::new("parts/robot.xml"), "the path stood in parts/base.toml");
    mobee::compose::compose(config, &source).expect("its files are found");
    // from any folder
    let out = mobee(Path::new("/"), &["check", path.to_str().expect("a readable path")], &[]);
    assert!(out.status.success(), "{}", said(&out));
}

#[test]
fn the_environment_is_over_the_file_and_set_over_the_environment() {
    let dir = folder(MAIN, &[]);
    let path = dir.path().join("main.toml");
    let environment = BTreeMap::from([
        ("MOBEE_SET__seed".to_owned(), "11".to_owned()),
        ("MOBEE_SET__robot__edge__agent__speed".to_owned(), "0.125".to_owned()),
    ]);
    let source = Source::layers(&path, &environment, &["seed=12".into()]).expect("it loads");
    assert_eq!(source.value["seed"], 12);
    assert_eq!(source.value["robot"][0]["agent"]["speed"], 0.125);
    let out = mobee(dir.path(), &["check", "main.toml"], &[("MOBEE_SET__robot__edge__agent__sped", "0.1")]);
    let text = said(&out);
    assert_eq!(out.status.code(), Some(2), "{text}");
    assert!(text.contains("MOBEE_SET__robot__edge__agent__sped") && text.contains("did you mean `speed`"), "{text}");
}

#[test]
fn a_table_of_another_kind_replaces_the_earlier_one() {
    let main = "include = [\"parts/base.toml\"]\n[[robot]]\nname = \"edge\"\nagent = { kind = \"random\", motors = [\"base\"] }\n";
    let dir = folder(main, &[]);
    let source = Source::load(&dir.path().join("main.toml"), &[]).expect("it loads");
    let agent = &source.value["robot"][0]["agent"];
    assert_eq!(*agent, serde_json::json!({ "kind": "random", "motors": ["base"] }));
    let set = ["robot.edge.agent.kind=\"explorer\"".into(), "robot.edge.agent.vertices=3".into()];
    let source = Source::load(&dir.path().join("main.toml"), &set).expect("it loads");
    assert_eq!(source.value["robot"][0]["agent"], serde_json::json!({ "kind": "explorer", "vertices": 3 }));
}

#[test]
fn mistakes_are_shown_in_the_file_that_made_them() {
    let broken = BASE.replace("M_first = 20", "M_first = 200");
    let dir = folder(MAIN, &[("parts/base.toml", &broken)]);
    let text = said(&mobee(dir.path(), &["check", "main.toml"], &[]));
    assert!(text.contains("parts/base.toml:12") && text.contains("200 deg is outside the limits"), "{text}");
}

#[test]
fn circles_depth_and_missing_files_are_refused() {
    let circle = ("parts/other.toml", "include = [\"../main.toml\"]\n");
    let cases = [
        ("include = [\"main.toml\"]\n", "main.toml:1", "includes itself"),
        ("include = [\"parts/other.toml\"]\n", "other.toml:1", "includes itself"),
        ("seed = 1\ninclude = [\"parts/none.toml\"]\n", "main.toml:2", "can't read"),
        ("include = [3]\n", "main.toml:1", "not a file path"),
    ];
    for (main, place, what) in cases {
        let dir = folder(main, &[circle]);
        let out = mobee(dir.path(), &["check", "main.toml"], &[]);
        let text = said(&out);
        assert_eq!(out.status.code(), Some(2), "{text}");
        assert!(text.contains(place) && text.contains(what), "{main}: {text}");
    }
    let chain: Vec<(String, String)> =
        (0..12).map(|i| (format!("{i}.toml"), format!("include = [\"{}.toml\"]\n", i + 1))).collect();
    let chain: Vec<(&str, &str)> = chain.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    let dir = folder("include = [\"0.toml\"]\n", &chain);
    let text = said(&mobee(dir.path(), &["check", "main.toml"], &[]));
    assert!(text.contains("nested more than 8 deep"), "{text}");
}

/// What is shown says the same as the layers did, and where each value is from.
#[test]
fn the_resolved_file_is_the_same_configuration() {
    let dir = folder(MAIN, &[]);
    let set = ["--set", "robot.edge.agent.repeat=2"];
    let out =
        mobee(dir.path(), &["config", "show", "main.toml", set[0], set[1]], &[("MOBEE_SET__record__poses_hz", "5")]);
    let text = said(&out);
    assert!(out.status.success(), "{text}");
    for line in [
        "seed = 7  # main.toml:2",
        "period_ms = 20.0  # parts/base.toml:7",
        "history = 600  # main.toml:6",
        "speed = 0.25  # main.toml:7",
        "repeat = 2  # --set",
        "poses_hz = 5.0  # environment MOBEE_SET__record__poses_hz",
        "margin_mm = 10.0  # default",
        "kind = \"rollback\"  # default",
        "rate_hz = 100.0  # default",
    ] {
        assert!(text.lines().any(|l| l == line), "{line:?} is missing in\n{text}");
    }
    std::fs::write(dir.path().join("shown.toml"), &text).expect("written");
    let (mut shown, _) = Config::load(&dir.path().join("shown.toml"), &[]).expect("what is shown can be read");
    // a default of the controller's kind, which the shown file spells out
    let reflex = "robot.edge.controller.reflex=true".into();
    let set = ["robot.edge.agent.repeat=2".into(), "record.poses_hz=5".into(), reflex];
    let (mut config, _) = Config::load(&dir.path().join("main.toml"), &set).expect("it loads");
    // so it does for the driver's
    for c in [&mut shown, &mut config] {
        c.robot[0].driver = serde_json::Value::Null;
    }
    assert_eq!(serde_json::to_value(&shown).expect("values"), serde_json::to_value(&config).expect("values"));
}

/// A report in one line.
fn unwrapped(text: &str) -> String {
    text.split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ")
}

#[test]
fn a_path_may_begin_in_the_home_folder() {
    let base =
        BASE.replace("\"world.xml\"", "\"$HOME/parts/world.xml\"").replace("\"robot.xml\"", "\"~/parts/robot.xml\"");
    let home = folder("", &[("parts/base.toml", &base)]);
    let elsewhere = folder("include = [\"~/parts/base.toml\"]\n", &[("parts/base.toml", "")]);
    let home = [("HOME", home.path().to_str().expect("a readable path"))];
    for set in [&[][..], &["--set", "robot.edge.model=${HOME}/parts/robot.xml"]] {
        let out = mobee(elsewhere.path(), &[&["check", "main.toml"], set].concat(), &home);
        assert!(out.status.success(), "{}", said(&out));
    }
}

#[test]
fn a_path_as_on_windows_and_a_variable_are_named() {
    for (path, help) in [
        (r#""robots\new\table.xml""#, "in \"...\" a backslash begins an escape"),
        (r#""robots\pt.xml""#, "in \"...\" a backslash begins an escape"),
        (r#""C:\users\robot.xml""#, "in \"...\" a backslash begins an escape"),
        (r#""robots\""#, "in \"...\" a backslash begins an escape"),
        (r#"'parts\robot.xml'"#, "write / between folders, not \\"),
        (r#""parts\\robot.xml""#, "write / between folders, not \\"),
        (r#""$ROBOTS/robot.xml""#, "expanded"),
        (r#""~other/robot.xml""#, "expanded"),
    ] {
        let dir = folder(&MAIN.replace("agent.speed = 0.25", &format!("model = {path}")), &[]);
        let out = mobee(dir.path(), &["check", "main.toml"], &[]);
        let text = said(&out);
        assert_eq!(out.status.code(), Some(2), "{text}");
        let text = unwrapped(&text);
        assert!(text.contains("main.toml:7") && text.contains(help), "{path}: {text}");
    }
}

#[test]
fn files_in_other_encodings_are_named() {
    let wide: Vec<u8> = std::iter::once(0xfeff).chain(MAIN.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    let latin = [MAIN.as_bytes(), b"# Ren\xe9\n"].concat();
    let dir = folder(MAIN, &[]);
    for (name, bytes, words) in [
        ("main.toml", &wide, &["line 1", "UTF-16", "save it as UTF-8"][..]),
        ("main.toml", &latin, &["line 8", "0xe9", "Latin-1", "save it as UTF-8"]),
        ("parts/base.toml", &latin, &["line 8", "0xe9", "Latin-1", "save it as UTF-8"]),
        ("parts/robot.xml", &latin, &["robot.xml:8", "0xe9", "Latin-1", "save it as UTF-8"]),
        ("parts/world.xml", &wide, &["world.xml:1", "UTF-16", "save it as UTF-8"]),
    ] {
        let (path, before) = (dir.path().join(name), std::fs::read(dir.path().join(name)).expect("a file"));
        std::fs::write(&path, bytes).expect("written");
        let out = mobee(dir.path(), &["check", "main.toml"], &[]);
        let text = unwrapped(&said(&out));
        assert_eq!(out.status.code(), Some(2), "{text}");
        assert!(words.iter().all(|w| text.contains(w)), "{name}: {text}");
        std::fs::write(&path, [b"\xef\xbb\xbf", before.as_slice()].concat()).expect("written");
        let out = mobee(dir.path(), &["check", "main.toml"], &[]);
        assert!(out.status.success(), "{name} with a byte order mark: {}", said(&out));
    }
}
