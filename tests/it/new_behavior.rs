//! `mobee new` writes a file that is ready to run, wherever the program is installed, and writes over nothing.

use super::common::{HOLD, mobee_in, said};
use std::path::Path;
use std::process::{Command, Output};

fn mobee(dir: &Path, args: &[&str]) -> Output {
    mobee_in(dir).args(args).output().expect("mobee starts")
}

#[test]
fn every_behavior_to_start_from_is_ready_to_run() {
    for from in ["explore", "ball", "plan", "look", "collect", "reach", "filter", "torture", "explore-yarp"] {
        let dir = tempfile::tempdir().expect("a folder");
        let made = mobee(dir.path(), &["new", "mine", "--from", from]);
        assert!(made.status.success(), "{from}: {}", said(&made));
        let checked = mobee(dir.path(), &["check", "mine.toml"]);
        assert!(checked.status.success(), "{from}: {}", said(&checked));
        let text = std::fs::read_to_string(dir.path().join("mine.toml")).expect("the behavior");
        assert!(text.starts_with("#:schema ./mobee.schema.json") && text.contains("mobee "), "{text}");
        assert!(!text.contains("../") && !text.contains("configs/behaviors/mine"), "{text}");
        // those with a real clock are left to their own tests
        // and the maps of `reach` take a minute to build
        if !text.contains("\nclock = \"real\"") && from != "reach" {
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

#[test]
fn a_robot_of_ones_own_explores_from_its_urdf_without_an_edit() {
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::write(dir.path().join("rail.urdf"), RAIL_ARM).expect("written");
    std::fs::write(dir.path().join("arm.srdf"), ARM_GROUP).expect("written");
    let made = mobee(dir.path(), &["new", "pick", "--robot", "rail.urdf", "--srdf", "arm.srdf", "--poses", "500"]);
    assert!(made.status.success(), "{}", said(&made));
    assert!(said(&made).contains("the SRDF's group `arm` (3): rail to lift"), "{}", said(&made));
    let ran = mobee(dir.path(), &["run", "pick.toml", "--for", "600", "--no-record", "--out", "run", "--json"]);
    assert!(ran.status.success(), "{}", said(&ran));
    let checked = mobee(dir.path(), &["check", "run"]);
    assert!(checked.status.success() && said(&checked).contains(HOLD), "{}", said(&checked));
    let summary: serde_json::Value = serde_json::from_slice(&ran.stdout).expect("a summary");
    assert!(summary.to_string().contains("\"hard_contacts\":0"), "{summary}");
    // the SRDF's poses are there for the taking
    let text = std::fs::read_to_string(dir.path().join("pick.toml")).expect("the behavior");
    let (explorer, poses) = text.split_once("[robot.agent]\nkind = \"explorer\"").expect("an agent");
    let (_, poses) = poses.split_once("the one above:\n").expect("poses");
    let uncommented: String = poses.lines().flat_map(|l| [l.strip_prefix("# ").unwrap_or(l), "\n"]).collect();
    std::fs::write(dir.path().join("poses.toml"), explorer.to_owned() + &uncommented).expect("written");
    let posed = mobee(dir.path(), &["run", "poses.toml", "--for", "60", "--no-record", "--out", "posed", "--json"]);
    let posed: serde_json::Value = serde_json::from_slice(&posed.stdout).expect("a summary");
    assert_eq!(posed["counters"]["commits"], 2, "{posed}");
    let again = mobee(dir.path(), &["new", "pick", "--robot", "rail.urdf"]);
    assert_eq!(again.status.code(), Some(2));
    assert!(said(&again).contains("pick.toml exists already"), "{}", said(&again));
    let compared = mobee(dir.path(), &["model", "compare", "rail.xml", "rail.urdf", "--poses", "500"]);
    assert!(compared.status.success() && said(&compared).contains("missed 0"), "{}", said(&compared));
    // without groups there is one part, of the robot's name, which here could be no port's
    let alone = mobee(dir.path(), &["model", "convert", "rail.urdf", "alone.xml", "--poses", "0"]);
    assert!(said(&alone).contains("part \"rail arm\" is called `rail_arm`"), "{}", said(&alone));
}

/// A robot's own driver: a plausible arm, the arm of its make, MuJoCo's physics or boards behind YARP; each file passes `check`.
#[test]
fn a_robot_of_ones_own_gets_the_driver_that_is_asked_for() {
    let cases = [
        ("rail.urdf", "sim", r#"driver = { kind = "sim", profile = "arm" }"#),
        ("so101.urdf", "sim", "stall_deg = 8 }"),
        (
            "rail.urdf",
            "yarp",
            r#"driver = { kind = "yarp", parts = [{ part = "rail_arm", port = "/rail_armSim/rail_arm" }] }"#,
        ),
        ("rail.urdf", "mujoco", r#"driver = { kind = "sim", profile = "arm", physics = "mujoco" }"#),
    ];
    for (urdf, driver, expected) in cases {
        let dir = tempfile::tempdir().expect("a folder");
        std::fs::write(dir.path().join(urdf), RAIL_ARM).expect("written");
        let made = mobee(dir.path(), &["new", "pick", "--robot", urdf, "--driver", driver, "--poses", "200"]);
        assert!(made.status.success(), "{driver}: {}", said(&made));
        assert_eq!(said(&made).contains("the feature `mujoco`"), driver == "mujoco", "{}", said(&made));
        let text = std::fs::read_to_string(dir.path().join("pick.toml")).expect("the behavior");
        assert!(text.contains(expected), "{driver}: {text}");
        let checked = mobee(dir.path(), &["check", "pick.toml"]);
        let runs = driver != "mujoco" || cfg!(feature = "mujoco");
        assert_eq!(checked.status.success(), runs, "{driver}: {}", said(&checked));
        // the obstacle that a comment shows can be taken as it is
        if let Some(line) = text.lines().find(|line| line.starts_with("# driver")).filter(|_| runs) {
            let taken = text.replace(&format!("\n{expected}\n"), "\n").replace(line, line.trim_start_matches("# "));
            std::fs::write(dir.path().join("taken.toml"), taken).expect("written");
            let checked = mobee(dir.path(), &["check", "taken.toml"]);
            assert!(checked.status.success(), "{}", said(&checked));
        }
    }
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::write(dir.path().join("rail.urdf"), RAIL_ARM).expect("written");
    let other = mobee(dir.path(), &["new", "other", "--robot", "rail.urdf", "--driver", "gazebo"]);
    assert_eq!(other.status.code(), Some(2));
    assert!(said(&other).contains("[possible values: sim, yarp, mujoco]"), "{}", said(&other));
    let alone = mobee(dir.path(), &["new", "other", "--driver", "mujoco"]);
    assert_eq!(alone.status.code(), Some(2));
    assert!(said(&alone).contains("--robot"), "{}", said(&alone));
    assert!(!dir.path().join("other.toml").exists());
}

/// The whole corpus takes hours; `tools/corpus` alone goes through it.
#[test]
fn robots_that_people_own_explore_without_an_edit() {
    let quickly_fitted = ["--only", "/z1.urdf,so101.urdf,xarm7.urdf", "--poses", "1000", "--jobs", "2"];
    let mut corpus = Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/corpus"));
    let out = corpus.args(quickly_fitted).args(["--mobee", env!("CARGO_BIN_EXE_mobee")]).output().expect("python3");
    if said(&out).contains("there are no such robots") {
        eprintln!("SKIPPED: {}", said(&out));
        return;
    }
    assert!(out.status.success() && said(&out).contains("3 files, 0 fail"), "{}", said(&out));
}

/// An arm of three motors on a rail, one of which slides and one turns without end; its home at zero touches the post.
const RAIL_ARM: &str = r#"<robot name="rail arm">
  <link name="base"><collision><origin xyz="0 0 0.05"/><geometry><box size="0.6 0.1 0.1"/></geometry></collision></link>
  <link name="post"><collision><origin xyz="0.2 0 0.2"/><geometry><box size="0.05 0.05 0.3"/></geometry></collision></link>
  <link name="sled"><collision><origin xyz="0 0 0.15"/><geometry><box size="0.08 0.08 0.06"/></geometry></collision></link>
  <link name="turret"><collision><origin xyz="0 0 0.05"/><geometry><cylinder radius="0.03" length="0.1"/></geometry></collision></link>
  <link name="arm"><collision><origin xyz="0.12 0 0"/><geometry><box size="0.24 0.04 0.04"/></geometry></collision></link>
  <joint name="bolt" type="fixed"><parent link="base"/><child link="post"/></joint>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="sled"/><axis xyz="1 0 0"/>
    <limit lower="-0.2" upper="0.05" effort="1" velocity="0.2"/></joint>
  <joint name="pan" type="continuous"><origin xyz="0 0 0.18"/><parent link="sled"/><child link="turret"/><axis xyz="0 0 1"/></joint>
  <joint name="lift" type="revolute"><origin xyz="0 0 0.1"/><parent link="turret"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1.2" upper="0.9" effort="1" velocity="1"/></joint>
</robot>
"#;

const ARM_GROUP: &str = r#"<robot name="rail arm"><group name="arm"><chain base_link="base" tip_link="arm"/></group>
  <group_state name="left" group="arm"><joint name="rail" value="-0.1"/><joint name="lift" value="0.2"/></group_state>
  <group_state name="up" group="arm"><joint name="lift" value="-0.5"/></group_state></robot>
"#;

#[test]
fn a_crate_is_written_whole_and_its_name_and_options_are_checked() {
    let dir = tempfile::tempdir().expect("a folder");
    let made = mobee(dir.path(), &["new", "--crate", "lab_arm"]);
    assert!(made.status.success(), "{}", said(&made));
    let read =
        |file: &str| std::fs::read_to_string(dir.path().join("lab_arm").join(file)).expect("a file of the crate");
    for file in [
        "src/main.rs",
        "src/lib.rs",
        "src/driver.rs",
        "src/agent.rs",
        "src/camera.rs",
        "tests/conformance.rs",
        "lab_arm.toml",
    ] {
        let text = read(file);
        assert!(!text.contains("my_arm") && !text.contains("../"), "{file}: {text}");
    }
    let manifest: toml::Table = read("Cargo.toml").parse().expect("a manifest");
    let names = |section: &str| manifest[section].as_table().expect("a table").keys().cloned().collect::<Vec<_>>();
    assert!(manifest.contains_key("workspace") && names("profile").contains(&"release".to_owned()));
    for dependency in names("dependencies").iter().chain(&names("dev-dependencies")) {
        let entry = manifest["dependencies"].get(dependency).or(manifest["dev-dependencies"].get(dependency));
        let path = entry.and_then(|e| e.get("path")).and_then(toml::Value::as_str);
        assert!(path.is_none_or(|path| Path::new(path).join("Cargo.toml").is_file()), "{dependency}: {path:?}");
    }
    for (args, expected) in [
        (&["new", "--crate", "lab_arm"][..], "exists already"),
        (&["new", "--crate", "Lab"], "not a valid name for a crate"),
        (&["new", "--crate", "serde"], "is taken"),
        (&["new", "--crate", "other", "--mobee", "."], "there is no checkout of MoBeE"),
        (&["new", "--crate", "other", "--driver", "yarp"], "cannot be used with"),
        (&["new", "--crate", "other", "--up-axis", "ignore"], "no URDF to import"),
        (&["new", "other", "--shapes", "3"], "no URDF to import"),
    ] {
        let out = mobee(dir.path(), args);
        assert_eq!(out.status.code(), Some(2), "{args:?}");
        assert!(said(&out).contains(expected), "{args:?}: {}", said(&out));
        assert!(!dir.path().join("other").exists(), "{args:?}: nothing is half-done");
    }
}
