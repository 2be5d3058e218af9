//! Arms with servos, weight and contacts. A hobby arm that sags, with encoders of 4,096 counts and a board whose stop holds the measured position: the paper's loop holds there too.

use super::common::mobee_here;
use serde_json::Value;
use std::path::Path;

/// Runs an SO-101 for five minutes with these tables beside the robot's; the counters of the summary.
fn explores(folder: &Path, tables: &str, driver: &str, controller: &str) -> Value {
    runs(folder, ("so101", "so101_new_calib", 0.3), (tables, driver, controller))
}

/// The same of any arm: its name, which is that of its profile, the motors to explore, and the share of full speed.
fn runs(
    folder: &Path,
    (arm, motors, speed): (&str, &str, f64),
    (tables, driver, controller): (&str, &str, &str),
) -> Value {
    let file = folder.join("arm.toml");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("configs/robots/{arm}.xml"));
    let text = format!(
        r#"
        {tables}
        [[robot]]
        name = "{arm}"
        model = {model:?}
        controller = {{ period_ms = 10, history = 6000 {controller} }}
        driver = {{ kind = "sim", profile = "{arm}" {driver} }}
        agent = {{ kind = "explorer", motors = ["{motors}"], speed = {speed}, vertices = 20, neighbors = 6, seed = 3 }}
        "#
    );
    std::fs::write(&file, text).expect("a behavior");
    let out = folder.join("run");
    let ran = mobee_here()
        .arg("run")
        .args([&file, Path::new("--out"), &out])
        .args(["--clock", "virtual", "--for", "300", "--no-record", "--quiet", "--json"])
        .output()
        .expect("mobee starts");
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let summary: Value = serde_json::from_slice(&ran.stdout).expect("the summary is JSON");
    summary["counters"].clone()
}

fn count(counters: &Value, name: &str) -> u64 {
    counters[name].as_u64().unwrap_or_default()
}

/// It learns by how much it sags, reaches its targets, is taken back from a post, and never lies down.
#[test]
fn an_arm_that_sags_reaches_its_targets_and_is_taken_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let world = r#"<WorldList version="1.0"><object name="post" type="obstacle" px="0.28" py="0.10" pz="0.15"><capsule radius="0.02" height="0.5" hz="1"/></object></WorldList>"#;
    let file = folder.path().join("post.xml");
    std::fs::write(&file, world).expect("a world");
    let counters = explores(folder.path(), &format!("world.file = {file:?}"), "", "");
    let [committed, back, faulted] = ["committed", "rolled_back", "faulted"].map(|name| count(&counters, name));
    assert!(committed >= 25 && back >= 4 && faulted <= 1, "{counters}");
    assert_eq!(count(&counters, "hard_contacts"), 0, "{counters}");
}

/// A post that the model does not know: each motion that it stops is taken back.
#[test]
fn an_arm_that_sags_is_taken_back_from_what_it_does_not_know() {
    let folder = tempfile::tempdir().expect("a folder");
    let post = r#", unknown = [{ name = "post", size_m = [0.04, 0.04, 0.5], at_m = [0.28, 0.10, 0.15] }]"#;
    let counters = explores(folder.path(), "", post, ", stall_deg = 8");
    let [committed, back, faulted] = ["committed", "rolled_back", "faulted"].map(|name| count(&counters, name));
    assert!(committed >= 25 && back >= 1 && faulted == 0, "{counters}");
}

/// Its load includes its weight, which is learned: a slow arm, too, lets go of what it pushes within half a second (1.2 s by the rise of
/// the load alone).
#[test]
fn a_slow_hobby_arm_lets_go_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let post = r#", unknown = [{ name = "post", size_m = [0.06, 0.06, 0.8], at_m = [0.28, 0.10, 0.15] }]"#;
    let counters = runs(folder.path(), ("so101", "so101_new_calib", 0.1), ("", post, ", stall_deg = 8"));
    let [committed, back, faulted] = ["committed", "rolled_back", "faulted"].map(|name| count(&counters, name));
    assert!(committed >= 5 && back >= 3 && faulted == 0, "{counters}");
    // no entry: no touch exceeded 5 N
    let longest = counters["push_s"].as_f64().unwrap_or_default();
    assert!(longest < 0.5, "{longest} s");
}

/// A stiff arm at full speed meets a post that the model does not know: its torque sensors show each contact, each motion is taken back, and
/// no stall needs to be watched for.
#[test]
fn a_stiff_arm_is_taken_back_by_the_torque_of_a_contact() {
    let folder = tempfile::tempdir().expect("a folder");
    let post = r#", unknown = [{ name = "post", size_m = [0.06, 0.06, 0.8], at_m = [0.3, 0.6, 0.4] }]"#;
    let counters = runs(folder.path(), ("ur5", "ur5", 1.0), ("", post, ""));
    let [committed, back, faulted] = ["committed", "rolled_back", "faulted"].map(|name| count(&counters, name));
    assert!(committed >= 10 && back >= 5 && faulted <= 1, "{counters}");
    let folder = tempfile::tempdir().expect("another folder");
    let unwatched = runs(folder.path(), ("ur5", "ur5", 1.0), ("", post, ", contact_nm = 0"));
    assert!(count(&unwatched, "rolled_back") < back, "without looking at torques: {unwatched}");
}

/// Runs a Panda whose board holds the measured position at a stop: its first two joints sweep past a post for a minute. Returns the counters, and
/// how often a retreat took other joints along.
fn sweeps(folder: &Path, table: &str, driver: &str, controller: &str) -> (Value, usize) {
    let file = folder.join("arm.toml");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/panda.xml");
    let text = format!(
        r#"
        {table}
        [[robot]]
        name = "panda"
        model = {model:?}
        controller = {{ period_ms = 10, history = 6000, stall_deg = 2 {controller} }}
        driver = {{ kind = "sim", profile = "panda", servo = {{ stop = "measured" }} {driver} }}
        agent = {{ kind = "random", motors = ["panda_joint1", "panda_joint2"], count = 0, speed = 0.3, range_deg = {{ panda_joint1 = [-50, 80], panda_joint2 = [50, 70] }} }}
        "#
    );
    std::fs::write(&file, text).expect("a behavior");
    let out = folder.join("run");
    let run = |args: &[&str]| {
        let ran = mobee_here().args(args).output().expect("mobee starts");
        assert!(
            ran.status.success(),
            "{}{}",
            String::from_utf8_lossy(&ran.stdout),
            String::from_utf8_lossy(&ran.stderr)
        );
        ran.stdout
    };
    let (file, path) = (file.to_str().expect("UTF-8"), out.to_str().expect("UTF-8"));
    let summary =
        run(&["run", file, "--out", path, "--clock", "virtual", "--for", "60", "--no-record", "--quiet", "--json"]);
    run(&["check", path]);
    let summary: Value = serde_json::from_slice(&summary).expect("the summary is JSON");
    let journal = std::fs::read_to_string(out.join("journal.jsonl")).expect("a journal");
    (summary["counters"].clone(), journal.matches("\"retreat_joined\"").count())
}

/// A contact bends joints that the motion does not name, and the stop holds them there: they are part of the retreat, whether torque or a
/// displaced joint has shown the contact.
#[test]
fn joints_that_a_contact_has_bent_are_taken_back() {
    let post = r#", unknown = [{ name = "post", size_m = [0.06, 0.06, 1.2], at_m = [0.45, 0.3, 0.6] }]"#;
    for controller in ["", ", contact_nm = 0"] {
        let folder = tempfile::tempdir().expect("a folder");
        let (counters, joined) = sweeps(folder.path(), "", post, controller);
        assert!(count(&counters, "rolled_back") >= 5 && count(&counters, "faulted") == 0, "{counters}");
        assert!(joined >= 1, "{counters}");
    }
}

/// Encoder noise of 0.03 deg, a third of the tolerance, adds no joint to a retreat.
#[test]
fn noise_adds_no_joint_to_a_retreat() {
    let folder = tempfile::tempdir().expect("a folder");
    let world = r#"<WorldList version="1.0"><object name="post" type="obstacle" px="0.45" py="0.3" pz="0.6"><box width="0.06" height="0.06" depth="1.2"/></object></WorldList>"#;
    let file = folder.path().join("post.xml");
    std::fs::write(&file, world).expect("a world");
    let (counters, joined) = sweeps(folder.path(), &format!("world.file = {file:?}"), ", noise_deg = 0.03", "");
    assert!(count(&counters, "rolled_back") >= 5 && count(&counters, "faulted") == 0, "{counters}");
    assert_eq!(joined, 0, "{counters}");
}

/// The same loop on the physics of MuJoCo, a second opinion on forces. With the post in the model nothing is ever pushed; without, each
/// contact is taken back.
#[cfg(feature = "mujoco")]
mod mujoco {
    use super::{count, runs};

    fn known(arm: (&str, &str, f64), at: [f64; 3]) {
        let folder = tempfile::tempdir().expect("a folder");
        let [x, y, z] = at;
        let world = format!(
            r#"<WorldList version="1.0"><object name="post" type="obstacle" px="{x}" py="{y}" pz="{z}"><box width="0.06" height="0.06" depth="0.8"/></object></WorldList>"#
        );
        let file = folder.path().join("post.xml");
        std::fs::write(&file, world).expect("a world");
        let counters = runs(folder.path(), arm, (&format!("world.file = {file:?}"), r#", physics = "mujoco""#, ""));
        let [committed, back, faulted] = ["committed", "rolled_back", "faulted"].map(|name| count(&counters, name));
        assert!(committed >= 10 && back >= 3 && faulted <= 1, "{counters}");
        assert_eq!(counters["push_n"].as_f64(), None, "{counters}");
    }

    #[test]
    fn a_stiff_arm_at_full_speed_never_pushes_what_the_model_knows() {
        known(("panda", "arm", 1.0), [0.45, 0.0, 0.4]);
    }

    #[test]
    fn an_arm_that_sags_never_pushes_what_the_model_knows() {
        known(("so101", "so101_new_calib", 0.3), [0.28, 0.10, 0.15]);
    }

    #[test]
    fn a_stiff_arm_is_taken_back_from_what_only_physics_knows() {
        let folder = tempfile::tempdir().expect("a folder");
        let post = r#", physics = "mujoco", unknown = [{ name = "post", size_m = [0.06, 0.06, 0.8], at_m = [0.45, 0.0, 0.4] }]"#;
        let counters = runs(folder.path(), ("panda", "arm", 0.3), ("", post, ", stall_deg = 2"));
        let [committed, back, faulted] = ["committed", "rolled_back", "faulted"].map(|name| count(&counters, name));
        assert!(committed >= 10 && back >= 5 && faulted == 0, "{counters}");
        assert!(counters["push_n"].as_f64().is_some_and(|newtons| newtons > 20.0), "{counters}");
    }
}
