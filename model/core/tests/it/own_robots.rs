//! The shipped robots and worlds: kinematics as published, and collision-free at home.

use mobee_model::{Edit, ObjectClass, Robot, Scene, load_robot, load_world};
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use std::{collections::BTreeMap, path::PathBuf, sync::Arc};

/// "The shipped robots and every world leave the home pose free by 20 mm."
const FREE_AT_HOME: f64 = 0.020;
/// Third-party robots are built closer together: the minimum with which a robot starts.
const FREE_ENOUGH: f64 = 0.013;
/// Distance within which a motion counts as contact, plus hysteresis: the clearance of planners.
const PLANNED: f64 = 0.012;

fn project(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

fn files(folder: &str) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(project(folder)).unwrap().map(|e| e.unwrap().path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "xml"));
    files.sort();
    assert!(!files.is_empty(), "{folder} is empty");
    files
}

fn own_robot(name: &str) -> Robot {
    load_robot(project(&format!("configs/robots/{name}.xml"))).unwrap().value
}

/// Compares markers with frames of a table: the position, and the normal with the frame's z axis.
fn markers_agree(robot: &Robot, table: &str, motor_suffix: &str, expected_markers: &[&str]) {
    let text = std::fs::read_to_string(project(&format!("tests/data/{table}"))).unwrap();
    let mut lines = text.lines();
    let columns: Vec<&str> = lines.next().unwrap().split(',').collect();
    let motors: Vec<(usize, usize)> = columns
        .iter()
        .enumerate()
        .filter_map(|(at, c)| Some((at, robot.motor_index(c.strip_suffix(motor_suffix)?)?)))
        .collect();
    let joints = columns.iter().skip(1).take_while(|c| !c.ends_with("_x")).count();
    assert_eq!(motors.len(), joints, "every joint column has a motor of its name");
    let column: BTreeMap<&str, usize> = columns.iter().enumerate().map(|(i, c)| (*c, i)).collect();
    let mut rows = 0;
    for line in lines {
        let row: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        let mut q = robot.home();
        for (at, motor) in &motors {
            q[*motor] = row[*at].to_radians();
            let m = &robot.motors[*motor];
            assert!(
                (m.min - 1e-9..=m.max + 1e-9).contains(&q[*motor]),
                "{} = {} deg is beyond its limits",
                m.name,
                row[*at]
            );
        }
        let poses = robot.markers_at(&q);
        for name in expected_markers {
            let index =
                robot.markers.iter().position(|m| m.name == *name).unwrap_or_else(|| panic!("no marker {name}"));
            let value = |suffix: &str| row[column[format!("{name}_{suffix}").as_str()]];
            let position = Vector3::new(value("x"), value("y"), value("z"));
            let frame =
                UnitQuaternion::new_normalize(Quaternion::new(value("qw"), value("qx"), value("qy"), value("qz")));
            let off = (poses[index].position().coords - position).norm();
            let turned = poses[index].normal.angle(&(frame * Vector3::z()));
            assert!(off < 1e-5 && turned < 1e-4, "{name}, row {}: {off} m, {turned} rad", row[0]);
        }
        rows += 1;
    }
    assert!(rows >= 100, "{rows} rows");
}

#[test]
fn the_icub_moves_as_its_urdf() {
    let frames = ["l_hand", "r_hand", "l_hand_dh_frame", "r_hand_dh_frame", "head", "l_eye", "r_eye"];
    markers_agree(&own_robot("icub"), "icub-urdf-oracle.csv", "", &frames);
}

#[test]
fn the_katana_moves_as_its_urdf() {
    markers_agree(&own_robot("katana"), "katana-400-6m180-oracle.csv", "_deg", &["tool"]);
}

#[test]
fn the_icub_has_its_parts_in_the_order_of_its_boards() {
    let robot = own_robot("icub");
    let parts: Vec<&str> = robot.parts.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(parts, ["torso", "head", "left_arm", "right_arm"]);
    let names = |part: &str| -> Vec<&str> {
        let range = robot.part(part).unwrap().motors.clone();
        robot.motors[range].iter().map(|m| m.name.as_str()).collect()
    };
    assert_eq!(names("torso"), ["torso_yaw", "torso_roll", "torso_pitch"]);
    assert_eq!(names("head"), ["neck_pitch", "neck_roll", "neck_yaw", "eyes_tilt", "eyes_vers", "eyes_verg"]);
    assert_eq!(names("left_arm").len(), 16);
    assert_eq!(names("right_arm")[3], "r_elbow");
    assert_eq!(names("right_arm")[15], "r_pinky");
}

#[test]
fn shipped_files_load_without_a_warning() {
    for file in files("configs/robots") {
        let loaded = load_robot(&file).unwrap();
        assert!(loaded.warnings.is_empty(), "{}: {:?}", file.display(), loaded.warnings);
    }
    for file in files("configs/worlds") {
        let loaded = load_world(&file).unwrap();
        assert!(loaded.warnings.is_empty(), "{}: {:?}", file.display(), loaded.warnings);
    }
}

#[test]
fn home_is_lawful_and_free_of_oneself_and_of_nothing_constant() {
    for file in files("configs/robots") {
        let of_others = std::fs::read_to_string(&file).unwrap().contains("tools/shelf");
        let wanted = if of_others { FREE_ENOUGH } else { FREE_AT_HOME };
        let robot = Arc::new(load_robot(&file).unwrap().value);
        let scene = Scene::new(vec![(robot, Isometry3::identity())], vec![]).unwrap();
        assert!(scene.static_contacts().is_empty(), "{}", file.display());
        assert!(scene.free(&scene.home(), wanted), "{}: {:?}", file.display(), scene.clearance(&scene.home(), 1.0));
    }
}

/// Also if every ghost and target becomes an obstacle.
#[test]
fn every_world_leaves_the_icub_free_at_home() {
    let robot = Arc::new(own_robot("icub"));
    for file in files("configs/worlds") {
        let mut objects = load_world(&file).unwrap().value;
        objects.iter_mut().for_each(|o| o.class = ObjectClass::Obstacle);
        let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], objects).unwrap();
        assert!(
            scene.free(&scene.home(), FREE_AT_HOME),
            "{}: {:?}",
            file.display(),
            scene.clearance(&scene.home(), 1.0)
        );
    }
}

#[test]
fn the_short_way_leads_through_the_ball_and_the_long_way_does_not() {
    let robot = Arc::new(own_robot("icub"));
    let ghost = load_world(project("configs/worlds/ball.xml")).unwrap().value;
    let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], ghost).unwrap();
    let class = ObjectClass::Obstacle;
    let solid = scene.edit(&Edit::Class { name: "ball".into(), class }).unwrap();
    let arm = robot.part("right_arm").unwrap().motors.start;
    let pose = |degrees: [f64; 7]| {
        let mut q = robot.home();
        degrees.iter().enumerate().for_each(|(i, d)| q[arm + i] = d.to_radians());
        q
    };
    let right = pose([-20.0, 75.0, 0.0, 60.0, 10.0, -15.0, 5.0]);
    let left = pose([-45.0, 35.0, 35.0, 95.0, 15.0, -25.0, -5.0]);
    let below = pose([0.0, 55.0, 10.0, 60.0, 20.0, -10.0, -5.0]);
    let home = robot.home();
    let line = |scene: &Scene, a: &[f64], b: &[f64]| scene.line(0, &[&home], a, b, 0.001, PLANNED);
    assert!(line(&scene, &right, &left).free, "{:?}", line(&scene, &right, &left));
    assert!(line(&solid, &right, &left).min_distance < -0.02);
    for (a, b) in [(&home, &right), (&right, &below), (&below, &left)] {
        assert!(line(&solid, a, b).free, "{:?}", line(&solid, a, b));
    }
}
