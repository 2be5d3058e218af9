//! Goals of the hand as a behavior names them: the hand gets there in a whole run, `mobee check` prints joint values that can be copied, and
//! equal seeds find equal ones.

use super::common::{answer, events, text};
use mobee_model::{Scene, load_robot};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde_json::Value;
use std::path::Path;

const POSITION: [f64; 3] = [-0.28, 0.22, 0.12];
const RPY_DEG: [f64; 3] = [170.0, -20.0, 60.0];

fn behavior(folder: &Path, pose: &str, agent: &str) -> std::path::PathBuf {
    let root = env!("CARGO_MANIFEST_DIR");
    let file = folder.join("there.toml");
    let toml = format!(
        "[world]\nfile = \"{root}/configs/worlds/ball.xml\"\n[[robot]]\nname = \"icub\"\nmodel = \"{root}/configs/robots/icub.xml\"\n\
         controller = {{ period_ms = 20, history = 6000 }}\ndriver = {{ kind = \"sim\", profile = \"ideal\" }}\n[robot.agent]\n{agent}\nspeed = 0.3\nposes = [{{ {pose} }}]\n"
    );
    std::fs::write(&file, toml).expect("written");
    file
}

/// How far the right hand is from the goal where a run ended, mm and degrees.
fn off(run: &Path) -> (f64, f64) {
    let outcome = events(run).into_iter().rev().find(|e| e["event"] == "outcome").expect("a motion");
    assert_eq!(outcome["outcome"], "committed", "{outcome}");
    let q: Vec<f64> = outcome["q"].as_array().expect("a pose").iter().filter_map(Value::as_f64).collect();
    let robot = load_robot("configs/robots/icub.xml").expect("the robot").value;
    let node = robot.markers.iter().find(|m| m.name == "r_hand").expect("the hand").node;
    let scene = Scene::new(vec![(robot.into(), Isometry3::identity())], Vec::new()).expect("a scene");
    let at = scene.node_transforms(&[q.as_slice()])[0][node];
    let [roll, pitch, yaw] = RPY_DEG.map(f64::to_radians);
    let wanted = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    let mm = (at.translation.vector - Vector3::from(POSITION)).norm() * 1e3;
    (mm, at.rotation.angle_to(&wanted).to_degrees())
}

fn run(folder: &Path, file: &Path, name: &str) -> std::path::PathBuf {
    let out = folder.join(name);
    answer(&["run", text(file), "--no-record", "--json", "--out", text(&out)]);
    out
}

#[test]
fn the_hand_gets_there_in_a_whole_run_and_values_that_check_prints_lead_there_too() {
    let dir = tempfile::tempdir().expect("a folder");
    let hand = format!("hand_at = {{ hand = \"r_hand\", position_m = {POSITION:?}, rpy_deg = {RPY_DEG:?} }}");
    let plan = "kind = \"plan\"\ngoals = [\"there\"]";
    let file = behavior(dir.path(), &format!("name = \"there\", {hand}"), plan);
    let told = answer(&["check", text(&file)]);
    assert_eq!(told, answer(&["check", text(&file)]), "equal seeds");
    let (mm, deg) = off(&run(dir.path(), &file, "by_hand"));
    assert!(mm < 1.0 && deg < 1.0, "{mm} mm, {deg} deg");

    let values = told.lines().find_map(|l| l.split_once("pose \"there\" by r_hand: ")).expect("joint values").1;
    let file = behavior(dir.path(), &format!("name = \"there\", {values}"), plan);
    let (mm, deg) = off(&run(dir.path(), &file, "copied"));
    assert!(mm < 1.0 && deg < 1.0, "{values}: {mm} mm, {deg} deg");

    // the other agents that take poses
    let file = behavior(dir.path(), &hand, "kind = \"scripted\"");
    let (mm, deg) = off(&run(dir.path(), &file, "scripted"));
    assert!(mm < 1.0 && deg < 1.0, "scripted: {mm} mm, {deg} deg");
    let poses = format!("name = \"there\", {hand} }}, {{ name = \"home\", q_deg = {{ r_elbow = 60 }}");
    let file = behavior(dir.path(), &poses, "kind = \"roadmap\"\nneighbors = 1\ngoals = [\"home\", \"there\"]");
    let (mm, deg) = off(&run(dir.path(), &file, "roadmap"));
    assert!(mm < 1.0 && deg < 1.0, "roadmap: {mm} mm, {deg} deg");
}

/// The classes of the original program in worlds and scripts.
#[test]
fn scripts_take_the_originals_words_for_classes() {
    let dir = tempfile::tempdir().expect("a folder");
    let file = behavior(dir.path(), "q_deg = { r_elbow = 60 }", "kind = \"scripted\"");
    for word in ["obstacle", "obs", "tgt", "gho"] {
        let set = format!("script=[{{when={{at_s=1}},edit={{object=\"ball\",class=\"{word}\"}}}}]");
        answer(&["check", text(&file), "--set", &set]);
    }
}
