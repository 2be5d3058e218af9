//! The paper's third experiment as a configuration composes it: a cup that eyes see is reached, again where it was moved to, and round what
//! the map does not know.

use super::common::{answer, complaint, thin_map, thinned};
use mobee::run::{Done, example, in_order};
use serde_json::{Value, json};
use std::path::Path;

/// The behavior with a map of poses three centimeters apart, which is built in half a second.
fn reach(folder: &Path, set: &[&str]) -> Done {
    reach_by("configs/behaviors/reach.toml", folder, set)
}

/// A behavior that is built on that of the iCub.
fn reach_by(file: &str, folder: &Path, set: &[&str]) -> Done {
    let map = format!("robot.icub.agent.map=\"{}\"", thin_map(folder).display());
    run(file, &[&[map.as_str()], set].concat())
}

fn run(file: &str, set: &[&str]) -> Done {
    let done = example(file, &[&["record.enabled=false", "clock=\"virtual\""], set].concat()).expect("a run");
    assert!(in_order(&done.end) && done.complaints.is_empty(), "{:?}", done.complaints);
    assert_eq!(done.end.counts.hard_contacts, 0);
    done
}

fn figure(done: &Done, name: &str) -> f64 {
    let told = done.end.counts.done.values().next().expect("it is done");
    told.figures.iter().find(|(n, _)| n == name).unwrap_or_else(|| panic!("no figure {name}")).1
}

/// How far the hand was from above the cup in truth when it was before it last, mm.
fn off(done: &Done, truth: [f64; 3]) -> f64 {
    let should = [truth[0] * 1e3, truth[1] * 1e3, truth[2] * 1e3 + 140.0];
    let at = ["hand_x_mm", "hand_y_mm", "hand_z_mm"].map(|name| figure(done, name));
    at.iter().zip(should).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn the_cup_is_reached_wherever_it_is_put_and_equal_seeds_reach_alike() {
    let folder = tempfile::tempdir().expect("a folder");
    // the thin map is driven faster than the file's own, so that the cup is moved earlier to be moved on the way
    let script = "script=[{when={at_s=1},edit={object=\"cup\",position_m=[-0.34,0.16,-0.10]}},\
                  {when={at_s=16},edit={object=\"cup\",position_m=[-0.40,0.05,-0.10]}},\
                  {when={at_s=30},edit={object=\"cup\",position_m=[-0.30,0.12,-0.10]}}]";
    let (done, again) = (reach(folder.path(), &[script]), reach(folder.path(), &[script]));
    assert_eq!(done.hash, again.hash);
    assert_eq!(figure(&done, "reached"), 4.0, "{:?}", done.end.counts.done);
    assert!(figure(&done, "replanned") >= 1.0, "it was moved while the hand was on its way");
    let mm = off(&done, [-0.30, 0.12, -0.10]);
    assert!(mm < 10.0, "{mm} mm off");
}

/// The maps of both arms, of poses three centimeters apart.
fn both_maps(folder: &Path) -> String {
    format!("robot.icub.agent.map={:?}", ["reach.toml", "reach-left.toml"].map(|file| thinned(file, folder)))
}

/// The torso turns the eyes away from the cup, and onto something that looks like it, half a table away: the hand went after that, and home
/// again, for as long as there was time.
#[test]
fn what_looks_like_the_cup_leads_the_hand_nowhere_while_the_eyes_are_off_the_cup() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = format!("--set={}", both_maps(folder.path()));
    let told = answer(&["bench", "reach", "--json", "--seeds=1", "--first=3067", &set]);
    let told: Value = serde_json::from_str(&told).expect("JSON");
    assert_eq!(told["totals"]["ends"], json!({ "reached": { "solvable": 1, "others": 0 } }), "{told}");
}

#[test]
fn each_arm_reaches_what_is_on_its_side() {
    let folder = tempfile::tempdir().expect("a folder");
    let map = both_maps(folder.path());
    let script = "script=[{when={at_s=1},edit={object=\"cup\",position_m=[-0.34,0.20,-0.10]}},\
                  {when={at_s=9},edit={object=\"cup\",position_m=[-0.34,-0.20,-0.10]}}]";
    let done = run("configs/behaviors/reach.toml", &[map.as_str(), script, "robot.icub.agent.repeat=2"]);
    let by = ["reached", "reached_by_r_hand_dh_frame", "reached_by_l_hand_dh_frame"].map(|name| figure(&done, name));
    assert_eq!(by, [2.0, 1.0, 1.0], "{:?}", done.end.counts.done);
    let mm = off(&done, [-0.34, -0.20, -0.10]);
    assert!(mm < 10.0, "{mm} mm off");
}

#[test]
fn nothing_but_the_detector_changes_where_another_one_finds_the_cup() {
    let folder = tempfile::tempdir().expect("a folder");
    let script = "script=[{when={at_s=1},edit={object=\"cup\",position_m=[-0.34,0.16,-0.10]}},\
                  {when={at_s=16},edit={object=\"cup\",position_m=[-0.40,0.05,-0.10]}}]";
    for file in ["configs/behaviors/reach-tag.toml", "configs/behaviors/reach-cgp.toml"] {
        let done = reach_by(file, folder.path(), &[script, "robot.icub.agent.repeat=2"]);
        assert_eq!(figure(&done, "reached"), 2.0, "{file}: {:?}", done.end.counts.done);
        let mm = off(&done, [-0.40, 0.05, -0.10]);
        assert!(mm < 12.0, "{file}: {mm} mm off");
    }
}

#[test]
fn an_arm_from_a_urdf_reaches_by_the_cameras_of_a_stand() {
    let script = "script=[{when={at_s=1},edit={object=\"cup\",position_m=[0.50,-0.06,0.05]}},\
                  {when={at_s=12},edit={object=\"cup\",position_m=[0.44,0.14,0.05]}}]";
    let done = run("configs/behaviors/reach-arm.toml", &[script, "robot.panda.agent.repeat=2"]);
    assert_eq!(figure(&done, "reached"), 2.0, "{:?}", done.end.counts.done);
    assert!(figure(&done, "replanned") >= 1.0, "it was moved while the hand was on its way");
    let mm = off(&done, [0.44, 0.14, 0.05]);
    assert!(mm < 12.0, "{mm} mm off");
}

#[test]
fn what_the_map_does_not_know_is_gone_round_where_edges_are_certified() {
    let folder = tempfile::tempdir().expect("a folder");
    for mode in ["lazy", "verified"] {
        let mode = format!("robot.icub.agent.validation=\"{mode}\"");
        let script = "script=[{when={at_s=0.1},edit={object=\"cup\",position_m=[-0.36,0.02,-0.10]}},\
                      {when={at_s=0.2},edit={object=\"lamp\",position_m=[-0.33,0.14,0.03]}},\
                      {when={at_s=0.2},edit={object=\"bottle\",position_m=[-0.60,-0.30,-0.03]}}]";
        let done = reach(folder.path(), &[&mode, script, "robot.icub.agent.repeat=1"]);
        assert_eq!(figure(&done, "reached"), 1.0, "{mode}: {:?}", done.end.counts.done);
        // the lamp is put too near to the resting arm; after that nothing is taken back
        assert!(done.end.counts.rolled_back <= 1, "{mode}: {} rolled back", done.end.counts.rolled_back);
    }
}

#[test]
fn the_paper_s_own_mode_arrives_as_well() {
    let folder = tempfile::tempdir().expect("a folder");
    let done = reach(folder.path(), &["robot.icub.agent.validation=\"optimistic\""]);
    assert_eq!(figure(&done, "reached"), 4.0, "{:?}", done.end.counts.done);
    assert!(done.end.counts.rolled_back <= 4, "{} rolled back", done.end.counts.rolled_back);
}

#[test]
fn random_scenes_are_drawn_where_the_file_s_own_table_is() {
    let bench = ["bench", "reach", "--file", "configs/behaviors/reach-arm.toml", "--json", "--seeds"];
    let areas = ["--cup-m=0.40,0.56,-0.15,0.15", "--posts-m=0.35,0.70,-0.35,0.35"];
    let told: Value = serde_json::from_str(&answer(&[&bench[..], &["1", "--first=2"], &areas].concat())).expect("JSON");
    let ends = &told["totals"]["ends"];
    assert_eq!(ends, &json!({ "reached": { "solvable": 1, "others": 0 } }), "{told}");
    let none = complaint(&[&bench[..], &["0"]].concat());
    assert!(none.contains("no scenes") && none.contains("--seeds 1"), "{none}");
}

#[test]
fn settings_of_a_map_are_refused_at_their_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let map = folder.path().join("map.toml");
    std::fs::write(&map, "robot = \"nowhere.xml\"\nmotors = [\"torso\"]\n").expect("written");
    let map = format!("robot.icub.agent.map=\"{}\"", map.display());
    let refused = example("configs/behaviors/reach.toml", &[&map]).err().expect("refused");
    let said = format!("{:?}", miette::Report::msg(refused.to_string()));
    assert!(said.contains("table"), "{said}");
    for (wrong, what) in [
        ("hand=[\"r_hand_dh_frame\",\"r_hand_dh_frame\"]", "is named twice"),
        ("hand=[\"r_hand_dh_frame\",\"l_foot\"]", "has no marker"),
        ("hand=[]", "no hand is named"),
        ("map=[\"../roadmaps/reach.toml\",\"nowhere.json\"]", "can't read"),
        ("map=[]", "none and at least one"),
        ("map=[\"../roadmaps/reach.toml\",7]", "a map of version"),
    ] {
        let refused =
            example("configs/behaviors/reach.toml", &[&format!("robot.icub.agent.{wrong}")]).err().expect("refused");
        let said = format!("{:?}", miette::Report::msg(refused.to_string()));
        assert!(said.contains(what), "{wrong}: {said}");
    }
}
