//! `mobee roadmap path --csv` and `--json`: joint values with times that another program can drive.

use super::common::{answer, complaint, mobee_here, text};
use mobee_model::load_robot;
use mobee_planning::map_file::MapFile;
use mobee_planning::roadmap::{Roadmap, Vertex};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// A motor whose file limits its speed, one that slides, and one that turns without end.
const ROBOT: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="crane">
  <bodypart name="arm"><link z="0.2" radius="0.03">
    <motor name="pan, turn" minPos="-100" maxPos="100" maxSpeed="20"><joint z="1" minPos="-100" maxPos="100"><link x="0.3" radius="0.02">
      <motor name="boom" minPos="0" maxPos="300"><joint x="1" type="prismatic" minPos="0" maxPos="300"><link x="0.1" radius="0.02"/>
        <motor name="hook" minPos="-60" maxPos="60"><joint z="1"><link x="0.1" radius="0.01"/></joint></motor>
      </joint></motor>
    </link></joint></motor>
  </link></bodypart>
</ZeroPositionKinematicTree>"#;

/// Degrees (millimeters) of the vertices: the map moves the first two motors.
const POSES: [[f64; 2]; 4] = [[0.0, 0.0], [10.0, 5.0], [10.0, 205.0], [-30.0, 200.0]];
const MAX_SPEEDS: [f64; 2] = [20.0, 100.0];

struct Map {
    _dir: tempfile::TempDir,
    robot: PathBuf,
    map: PathBuf,
}

impl Map {
    fn new() -> Map {
        let dir = tempfile::tempdir().expect("a folder");
        let (robot, map) = (dir.path().join("crane.xml"), dir.path().join("map.json"));
        std::fs::write(&robot, ROBOT).expect("written");
        let model = load_robot(&robot).expect("a robot").value;
        let mut roadmap = Roadmap::new(vec![0, 1], &model);
        for (i, [pan, boom]) in POSES.iter().enumerate() {
            let name = [None, Some("by the wall".to_owned()), None, Some("end".to_owned())][i].clone();
            roadmap.add(Vertex { name, q: vec![pan.to_radians(), boom.to_radians(), 0.0], at: [0.0; 3] });
        }
        (0..3).for_each(|i| roadmap.join(i, i + 1));
        roadmap.add(Vertex { name: Some("island".into()), q: vec![1.0, 1.0, 0.0], at: [0.0; 3] });
        std::fs::write(&map, roadmap.file(&model).text()).expect("written");
        Map { _dir: dir, robot, map }
    }

    fn args<'a>(&'a self, from: &'a str, to: &'a str, more: &[&'a str]) -> Vec<&'a str> {
        let path = ["roadmap", "path", text(&self.map), from, to, "--robot", text(&self.robot)];
        [&path[..], more].concat()
    }

    fn path(&self, from: &str, to: &str, more: &[&str]) -> String {
        answer(&self.args(from, to, more))
    }
}

/// The header, and the rows as numbers.
fn table(csv: &str) -> (String, Vec<Vec<f64>>) {
    let (header, rows) = csv.split_once('\n').expect("a header");
    let number = |field: &str| field.parse::<f64>().expect("a number");
    (header.to_owned(), rows.lines().map(|row| row.split(',').map(number).collect()).collect())
}

/// Times increase and no motor is faster than its share; answers the greatest share that is used.
fn fastest(rows: &[Vec<f64>]) -> f64 {
    let mut most: f64 = 0.0;
    for pair in rows.windows(2) {
        let dt = pair[1][0] - pair[0][0];
        assert!(dt > 0.0, "{rows:?}");
        for (i, max) in MAX_SPEEDS.iter().enumerate() {
            most = most.max((pair[1][i + 1] - pair[0][i + 1]).abs() / dt / max);
        }
    }
    most
}

#[test]
fn a_table_has_the_maps_vertices_and_its_times_keep_the_speeds() {
    let map = Map::new();
    let (header, rows) = table(&map.path("0", "end", &["--csv", "-", "--speed", "0.5"]));
    assert_eq!(header, "t_s,\"pan, turn_deg\",boom_mm");
    assert_eq!(rows.len(), POSES.len());
    for (row, pose) in rows.iter().zip(POSES) {
        assert!((row[1] - pose[0]).abs() < 1e-6 && (row[2] - pose[1]).abs() < 1e-6, "{row:?} is not {pose:?}");
    }
    // 10 deg at 10 deg/s, 200 mm at 50 mm/s, 40 deg at 10 deg/s
    let times: Vec<f64> = rows.iter().map(|row| row[0]).collect();
    assert!(times.iter().zip([0.0, 1.0, 5.0, 9.0]).all(|(t, s)| (t - s).abs() < 1e-6), "{times:?}");
    let share = fastest(&rows);
    assert!((share - 0.5).abs() < 1e-6, "{share}");
    // where the file states no speed, it is given
    let (_, slow) = table(&map.path("0", "end", &["--csv", "-", "--speed", "0.5", "--max-speed", "10"]));
    assert!((slow[2][0] - slow[1][0] - 40.0).abs() < 1e-6, "{slow:?}");
}

#[test]
fn rows_at_equal_times_lie_on_the_lines_between_vertices_and_end_at_the_last() {
    let map = Map::new();
    let (_, rows) = table(&map.path("0", "end", &["--csv", "-", "--speed", "0.5", "--every", "0.4"]));
    assert_eq!(rows.len(), 24, "0, 0.4, ... 8.8, and the end at 9");
    assert!((fastest(&rows) - 0.5).abs() < 1e-4);
    assert!((rows[1][0] - 0.4).abs() < 1e-6 && (rows[1][1] - 4.0).abs() < 1e-5 && (rows[1][2] - 2.0).abs() < 1e-5);
    assert_eq!(rows.last().expect("a row")[1..], POSES[3]);
    // where the end is one of these times it stands there once
    let (_, rows) = table(&map.path("0", "end", &["--csv", "-", "--speed", "0.5", "--every", "1"]));
    assert_eq!(rows.len(), 10);
    assert_eq!(rows[9][0], 9.0);
}

#[test]
fn json_names_motors_units_and_vertices_and_both_files_are_written() {
    let map = Map::new();
    let at = |name: &str| map.map.parent().expect("a folder").join(name);
    let (csv, json) = (at("path.csv"), at("path.json"));
    let told = map.path("by the wall", "2", &["--csv", text(&csv), "--json", text(&json)]);
    assert!(told.contains("1 by the wall") && told.contains("s at 0.1 of the maximum speeds"), "{told}");
    let value: Value = serde_json::from_str(&std::fs::read_to_string(&json).expect("a file")).expect("JSON");
    assert_eq!(value["joint_names"], serde_json::json!(["pan, turn", "boom"]));
    assert_eq!(value["units"], serde_json::json!(["deg", "mm"]));
    assert_eq!((&value["points"][0]["name"], &value["points"][1]["vertex"]), (&"by the wall".into(), &2.into()));
    assert!(value["points"][1].get("name").is_none(), "the vertex has none: {value}");
    let (_, rows) = table(&std::fs::read_to_string(&csv).expect("a file"));
    for (row, point) in rows.iter().zip(value["points"].as_array().expect("points")) {
        assert_eq!((&point["t_s"], &point["positions"]), (&row[0].into(), &serde_json::json!(row[1..])));
    }
    // nothing is written over unawares
    assert!(complaint(&map.args("0", "2", &["--csv", text(&csv)])).contains("exists already"));
    map.path("0", "2", &["--csv", text(&csv), "--force"]);
    // a path of one vertex is one row
    let (_, rows) = table(&map.path("2", "2", &["--csv", "-", "--every", "0.1"]));
    assert_eq!(rows, [vec![0.0, 10.0, 205.0]]);
}

#[test]
fn what_makes_no_table_is_refused() {
    let map = Map::new();
    let refused = |more: &[&str], words: &str| {
        let told = complaint(&map.args("0", "end", more));
        assert!(told.contains(words), "{words}: {told}");
    };
    refused(&["--every", "1"], "add --csv FILE");
    refused(&["--csv", "-", "--json", "-"], "one place");
    refused(&["--csv", "x", "--json", "x"], "one place");
    refused(&["--csv", "-", "--every", "0.000001"], "more than 1000000 rows");
    refused(&["--csv", text(map.map.parent().expect("a folder"))], "is a folder");
    for (key, wrong) in
        [("--speed", "0"), ("--speed", "NaN"), ("--speed", "30"), ("--every", "-1"), ("--max-speed", "inf")]
    {
        let option = format!("{key}={wrong}");
        let out = mobee_here().args(map.args("0", "end", &["--csv", "-", &option])).output().expect("mobee starts");
        assert_eq!(out.status.code(), Some(2), "{option}");
        assert!(out.stdout.is_empty(), "{option}");
    }
    // no path: nothing but an exit code for a program that reads the table; names for people
    let out = mobee_here().args(map.args("1", "island", &["--csv", "-"])).output().expect("mobee starts");
    assert_eq!(out.status.code(), Some(1));
    assert!(out.stdout.is_empty() && String::from_utf8_lossy(&out.stderr).contains("from by the wall to island"));
}

/// Robots and maps as people know them: no node numbers, and what no map recorded in plain words.
#[test]
fn people_read_link_names_and_plain_words() {
    let map = Map::new();
    let told = answer(&["roadmap", "info", text(&map.map)]);
    assert!(told.contains("world: none recorded") && told.contains("hand: none recorded"), "{told}");

    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("map.json");
    let icub = "configs/robots/icub.xml";
    let model = load_robot(Path::new(icub)).expect("a robot").value;
    let motor = |name: &str| model.motors.iter().position(|m| m.name == name).expect("a motor");
    let mut roadmap = Roadmap::new(vec![motor("r_shoulder_roll"), motor("r_elbow")], &model);
    let mut inside = model.home();
    // the arm straight down, in the table
    (inside[motor("r_shoulder_roll")], inside[motor("r_elbow")]) = (0.0, 0.0);
    roadmap.add(Vertex { name: None, q: model.home(), at: [0.0; 3] });
    roadmap.add(Vertex { name: None, q: inside, at: [0.0; 3] });
    roadmap.join(0, 1);
    std::fs::write(&file, roadmap.file(&model).text()).expect("written");
    let world = ["--world", "configs/worlds/table.xml"];
    let validate = [&["roadmap", "validate", text(&file), "--robot", icub], &world[..]].concat();
    let stored = |file: &Path| MapFile::parse(&std::fs::read_to_string(file).expect("the map")).expect("a map").text();
    for told in [answer(&validate), answer(&["roadmap", "info", text(&file), "--robot", icub])] {
        assert!(stored(&file).contains("icub:right_arm/"), "something is in the way");
        assert!(told.contains("pairs that block most edges: icub ") && !told.contains('#'), "{told}");
        assert!(told.contains("behind r_") || told.contains("r_hand"), "{told}");
    }
    let told = answer(&["roadmap", "info", text(&file)]);
    assert!(told.contains("icub right_arm and ") && !told.contains('#'), "{told}");
}
