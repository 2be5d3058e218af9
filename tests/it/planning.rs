//! `mobee plan` and `mobee bench plan` as a user meets them: paths that hold, equal questions with equal answers, and inputs that are
//! none, refused with place and remedy.

use super::common::{answer, complaint, mobee_here, said, text};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;

const PROBLEMS: &str = "tests/data/mbm/panda.json";
const PANDA: &str = "configs/robots/panda.xml";

fn bench(more: &[&str]) -> Value {
    let told = answer(&[&["bench", "plan", PROBLEMS, "--json"][..], more].concat());
    serde_json::from_str::<Value>(&told).expect("JSON")[PROBLEMS].clone()
}

/// Steps of the judge: fine enough to see what a sampled planner misses, coarse enough for a test.
#[test]
fn public_problems_are_solved_and_no_path_is_refuted_by_brute_force() {
    let told = bench(&["--check", "0.001", "--threads", "2"]);
    let totals = &told["totals"];
    assert_eq!(
        [&totals["problems"], &totals["valid"], &totals["solved"], &totals["refuted"]],
        [12, 12, 12, 0],
        "{totals}"
    );
    let problems = told["problems"].as_array().expect("problems");
    for problem in problems {
        assert!(problem["simplified_cost"].as_f64() <= problem["cost"].as_f64().map(|c| c + 1e-9), "{problem}");
    }
    // equal questions have equal answers, on any number of threads
    let paths = |told: &Value| {
        let problems = told["problems"].as_array().expect("problems").iter();
        problems.map(|p| (p["lines"].clone(), p["cost"].clone(), p["simplified_cost"].clone())).collect::<Vec<_>>()
    };
    assert_eq!(paths(&bench(&["--threads", "1"])), paths(&told));
    let some = bench(&["--scene", "bookshelf_tall", "--every", "2"]);
    assert_eq!(some["totals"]["problems"], 2);
    // parts of the files that are not used are listed: the fingers have no motors in this URDF
    let notes = told["notes"].to_string();
    for note in ["others.panda_finger_joint2 is not used", "pose `extended` is beyond limits", "`path` of <robot>"] {
        assert!(notes.contains(note), "{note}: {notes}");
    }
}

#[test]
fn problem_files_that_are_none_are_refused_with_place_and_remedy() {
    let dir = tempfile::tempdir().expect("a folder");
    let whole = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(PROBLEMS)).expect("problems");
    let refused = |from: &str, to: &str| {
        let file = dir.path().join("panda.json");
        assert!(whole.contains(from), "{from}");
        std::fs::write(&file, whole.replacen(from, to, 1)).expect("written");
        complaint(&["bench", "plan", text(&file)])
    };
    for (from, to, told) in [
        ("mbm 1", "mbm 2", "the format \"mbm 2\" is unknown"),
        ("\"index\"", "\"indx\"", "unknown field `indx`"),
        // the last one would have replaced the first
        ("\"bookshelf_tall\"", "\"bookshelf_small\"", "the key `bookshelf_small` is there twice at line"),
        (
            "\"panda_finger_joint2\"",
            "\"panda_finger_joint1\"",
            "the key `panda_finger_joint1` is there twice at line 1",
        ),
        ("\"robot\"", "\"pair_clearance_mm\":{\"a:b\":1,\"a:b\":2},\"robot\"", "the key `a:b` is there twice"),
        ("\"start\":[0,", "\"start\":[", "start has 6 numbers"),
        ("0.03,0.14]", "0.03,-0.14]", "cylinders[0] has a size that is not positive"),
        ("-0.5233762", "-0.1233762", "quaternion whose length is not 1"),
        ("\"robot\":\"panda\"", "\"robot\":\"../panda\"", "names no file"),
        ("{", "", "invalid type: string"),
        // all else is right, but there is no robot beside the file
        ("\"index\":1", "\"index\":100", "panda.xml"),
    ] {
        let said = refused(from, to);
        assert!(said.contains(told) && said.contains("help"), "{from} to {to}: {said}");
    }
    let said = complaint(&["bench", "plan", PROBLEMS, "--scene", "bookshelf_smal"]);
    assert!(said.contains("has no scene `bookshelf_smal`") && said.contains("bookshelf_small"), "{said}");
}

#[test]
fn a_path_is_planned_from_the_command_line_printed_and_written() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let goal = "panda_joint1=90,panda_joint4=-60";
    let told = answer(&["plan", PANDA, "--to", goal, "--csv", text(&at("path.csv"))]);
    assert!(told.contains("certified free at 12 mm"), "{told}");
    let table = std::fs::read_to_string(at("path.csv")).expect("the table");
    let last = table.lines().last().expect("a row");
    assert!(table.starts_with("t_s,") && last.contains("90.0000000") && last.contains("-60.0000000"), "{table}");
    let json = answer(&["plan", PANDA, "--to", goal, "--json", "-"]);
    let points = serde_json::from_str::<Value>(&json).expect("JSON")["points"].as_array().expect("points").len();
    assert_eq!(points, table.lines().count() - 1);

    for (args, told) in [
        (vec!["plan", PANDA, "--to", "panda_joint9=1"], "has no motor \"panda_joint9\""),
        (vec!["plan", PANDA, "--to", "panda_joint1=900"], "outside the limits"),
        (vec!["plan", PANDA, "--to", "1,2"], "2 numbers for"),
        (vec!["plan", PANDA, "--to", "panda_joint1"], "is not a number"),
        (vec!["plan", PANDA, "--to", "panda_joint1=1,panda_joint1=2"], "twice"),
        (vec!["plan", PANDA, "--motors", "panda_joint2", "--to", goal], "not in --motors"),
        (vec!["plan", PANDA, "--to-hand", "0.3,0.1"], "--to-hand has 2 numbers"),
        (vec!["plan", PANDA, "--to", goal, "--every", "0.1"], "nothing writes them"),
        (vec!["plan", PANDA, "--to", goal, "--may-touch", "panda_hand"], "may_touch[0]: \"panda_hand\" is not a pair"),
        (vec!["plan", PANDA, "--to", goal, "--may-touch", "panda_hnad:cup"], "did you mean `panda_hand`?"),
        (
            vec!["plan", PANDA, "--to", goal, "--pair-clearance-mm", "a:b=-1"],
            "pair_clearance_mm.a:b: -1 is out of bounds",
        ),
    ] {
        let said = complaint(&args);
        assert!(said.contains(told), "{args:?}: {said}");
    }
}

#[test]
fn aorrtc_shortens_every_path_and_a_recording_shows_the_robot_on_it() {
    let first = bench(&["--check", "0.001"]);
    let best = bench(&["--check", "0.001", "--planner", "aorrtc", "--iterations", "500"]);
    assert_eq!(best["totals"]["refuted"], 0, "{best}");
    let cost = |told: &Value| told["totals"]["simplified_cost"]["mean"].as_f64().expect("a cost");
    assert!(cost(&best) < 0.97 * cost(&first), "{} rad, {} by RRT-Connect", cost(&best), cost(&first));
    let wrong = mobee_here().args(["bench", "plan", PROBLEMS, "--planner", "prm"]).output().expect("mobee starts");
    assert!(wrong.status.code() == Some(2) && said(&wrong).contains("`rrt_connect` and `aorrtc`"), "{}", said(&wrong));

    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("path.rrd");
    let record = ["--planner", "aorrtc", "--iterations", "50", "--record", text(&file)];
    let told = answer(&[&["plan", PANDA, "--to", "panda_joint1=90,panda_joint4=-60"][..], &record].concat());
    assert!(told.contains("now: mobee view"), "{told}");
    let contents = mobee_recorder::Contents::read(&file).expect("a recording");
    let rows =
        |entity: &str| contents.rows.iter().filter(|(name, _)| name.contains(entity)).map(|(_, n)| n).sum::<u64>();
    assert!(rows("world/map/poses") >= 60 && rows("world/map/path") > 0, "{:?}", contents.rows);
    // options without an effect are refused
    let idle = complaint(&["plan", PANDA, "--to", "home", "--iterations", "5"]);
    assert!(idle.contains("add --planner aorrtc"), "{idle}");
    let idle = complaint(&["bench", "plan", PROBLEMS, "--iterations", "5"]);
    assert!(idle.contains("add --planner aorrtc"), "{idle}");
    let nowhere = complaint(&["plan", PANDA, "--to", "home", "--record", "-"]);
    assert!(nowhere.contains("can't be written to -"), "{nowhere}");
    let again = complaint(&[&["plan", PANDA, "--to", "home"][..], &["--record", text(&file)]].concat());
    assert!(again.contains("exists already"), "{again}");
}

/// The public problems at a clearance that no pick and no folded wrist has: the pairs concerned get their own, or may touch.
#[test]
fn a_problem_file_can_have_a_pick_that_ends_nearer_than_the_clearance() {
    let dir = tempfile::tempdir().expect("a folder");
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mbm");
    std::fs::create_dir(dir.path().join("robots")).expect("a folder");
    for entry in std::fs::read_dir(data.join("robots")).expect("robots").flatten() {
        std::fs::copy(entry.path(), dir.path().join("robots").join(entry.file_name())).expect("copied");
    }
    let whole = std::fs::read_to_string(data.join("panda.json")).expect("problems");
    let file = dir.path().join("panda.json");
    let first = |own: &str, may_touch: &str| {
        let changed = whole.replacen("\"robot\"", &format!("\"pair_clearance_mm\":{own},\"robot\""), 1);
        let changed = changed.replacen("\"index\":1,", &format!("\"index\":1,\"may_touch\":{may_touch},"), 1);
        std::fs::write(&file, changed).expect("written");
        let args = ["bench", "plan", text(&file), "--scene", "bookshelf_small", "--every", "4", "--json"];
        let told = answer(&[&args[..], &["--clearance-mm", "30", "--check", "0.001"]].concat());
        serde_json::from_str::<Value>(&told).expect("JSON")[text(&file)]["problems"][0].clone()
    };
    let fingers = "[\"panda_hand:obstacle6\",\"panda_leftfinger:obstacle6\",\"panda_rightfinger:obstacle6\"]";
    let wrist = "{\"panda_link5:panda_link7\":10}";
    for (own, may_touch, why) in
        [("{}", fingers, "panda_link5#0 is too near"), (wrist, "[]", "is too near to obstacle6#0")]
    {
        let told = first(own, may_touch);
        assert!(told["unsolved"].as_str().is_some_and(|said| said.contains(why)), "{told}");
    }
    let told = first(wrist, fingers);
    assert!(told["solved"] == true && told["refuted"] == false, "{told}");
    std::fs::write(&file, whole.replacen("\"index\":1,", "\"index\":1,\"may_touch\":[\"panda_hand:obstacl\"],", 1))
        .expect("written");
    let said = complaint(&["bench", "plan", text(&file)]);
    assert!(said.contains("bookshelf_small, problem 1") && said.contains("did you mean `obstacle"), "{said}");
}

/// A cup where the hand is at the goal: planned to only if hand and cup may touch. Several goals are one set.
#[test]
fn a_pick_and_a_set_of_goals_are_planned_from_the_command_line() {
    let dir = tempfile::tempdir().expect("a folder");
    let robot = Arc::new(mobee_model::load_robot(PANDA).expect("a robot").value);
    let scene = mobee_model::Scene::new(vec![(robot.clone(), Default::default())], vec![]).expect("a scene");
    let mut goal = robot.home();
    goal[0] += 1.0;
    let tip = robot.nodes.iter().position(|n| n.name.as_deref() == Some("panda_leftfinger")).expect("a finger");
    let at = scene.node_transforms(&[&goal])[0][tip].translation.vector;
    let world = dir.path().join("cup.xml");
    let cup = format!("<sphere radius=\"0.03\" px=\"{}\" py=\"{}\" pz=\"{}\"/>", at.x, at.y, at.z);
    std::fs::write(&world, format!("<WorldList version=\"1.0\"><object name=\"cup\">{cup}</object></WorldList>"))
        .expect("written");
    let degrees = goal.iter().map(|q| q.to_degrees().to_string()).collect::<Vec<_>>().join(",");
    let args = ["plan", PANDA, "--world", text(&world), "--to", &degrees];
    let refused = mobee_here().args(args).output().expect("mobee starts");
    let told = String::from_utf8_lossy(&refused.stdout).into_owned();
    assert!(refused.status.code() == Some(1) && told.contains("is too near to cup#0"), "{told}");
    let pick = ["--may-touch", "hand:cup", "--may-touch", "panda_hand:cup", "--may-touch", "panda_link7:cup"];
    let told = answer(&[&args[..], &pick].concat());
    assert!(told.contains("certified free at 12 mm"), "{told}");

    // the first goal is blocked, so the second one is reached
    let more = ["--to", "panda_joint1=-20", "--to", "panda_joint1=160", "--may-touch", "panda_link0:panda_link1"];
    let output = mobee_here().args(args).args(more).output().expect("mobee starts");
    let [told, noted] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(told.contains("goal 2 of 3"), "{told}");
    assert!(noted.contains("goal 1 of 3 is left out: the goal is not free"), "{noted}");
    assert!(noted.contains("no pair of panda_link0 and panda_link1 is tested"), "neighbors: {noted}");
    let told = complaint(&[&args[..], &["--pair-clearance-mm", "panda_hand:cup=13"]].concat());
    assert!(told.contains("13 mm, more than the 12 mm of all pairs"), "{told}");

    let place = format!("{},{},{}", -at.x, at.y, at.z);
    let told = answer(&["plan", PANDA, "--to-hand", &place, "--hand", "panda_leftfinger"]);
    assert!(told.contains("certified free"), "{told}");
}
