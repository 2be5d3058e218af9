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
