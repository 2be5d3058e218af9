//! Comparison with results of the original MoBeE: loaded data, and transforms at its poses.
//!
//! `edge` is part of this repository; `icub` and `icub_big_hands` are searched in the shared reference folder.

use mobee_model::{NodeKind, Primitive, Robot, Shape, load_robot, write_robot};
use nalgebra::{Isometry3, Matrix3, Vector3};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

struct Oracle {
    robot: Robot,
    folder: PathBuf,
}

/// The named oracle set with its robot; `None` (with a printed note) if it does not exist on this machine.
fn oracle(name: &str) -> Option<Oracle> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (file, folder) = if name == "edge" {
        let folder = root.join("tests/data/edge");
        (folder.join("edge_a.xml"), folder)
    } else {
        let shared = std::env::var_os("MOBEE_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from);
        let reference = shared.join("reference");
        let file = reference.join("mobee-original-data").join(format!("{name}.xml"));
        (file, reference.join("mobee-oracle").join(name))
    };
    if !file.exists() {
        eprintln!("SKIPPED: {} is not here", file.display());
        return None;
    }
    let loaded = load_robot(&file).unwrap();
    Some(Oracle { robot: loaded.value, folder })
}

impl Oracle {
    fn text(&self, name: &str) -> String {
        let path = self.folder.join(name);
        if let Ok(text) = std::fs::read_to_string(&path) {
            return text;
        }
        let packed = std::fs::File::open(path.with_extension("csv.gz")).unwrap();
        let mut text = String::new();
        flate2::read::GzDecoder::new(packed).read_to_string(&mut text).unwrap();
        text
    }

    fn model(&self) -> Value {
        serde_json::from_str(&self.text("model.json")).unwrap()
    }

    /// Every pose, in rad of encoder; the columns are `part.motor` in the order of motors.
    fn poses(&self) -> Vec<Vec<f64>> {
        let text = self.text("poses.csv");
        let mut lines = text.lines();
        let columns: Vec<String> = lines.next().unwrap().split(',').skip(2).map(str::to_owned).collect();
        let ours = self.robot.motors.iter().map(|m| format!("{}.{}", self.robot.parts[m.part].name, m.name));
        assert_eq!(columns, ours.collect::<Vec<_>>());
        lines.map(|l| l.split(',').skip(2).map(|v| v.parse::<f64>().unwrap().to_radians()).collect()).collect()
    }
}

fn floats(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn int(v: &Value) -> usize {
    v.as_u64().unwrap() as usize
}

fn assert_near(ours: f64, theirs: f64, tolerance: f64, what: &str) {
    assert!((ours - theirs).abs() <= tolerance, "{what}: {ours} instead of {theirs}");
}

fn assert_frame(ours: &Isometry3<f64>, theirs: &[f64], what: &str) {
    let m = ours.to_homogeneous();
    for (i, value) in theirs.iter().enumerate() {
        assert_near(m[(i / 4, i % 4)], *value, 1e-6, what);
    }
}

fn assert_primitive(ours: &Primitive, theirs: &Value, what: &str) {
    let (name, sizes) = match ours.shape {
        Shape::Sphere { radius } => ("sphere", vec![("radius", radius)]),
        Shape::Cylinder { radius, height } => ("cylinder", vec![("radius", radius), ("height", height)]),
        Shape::Capsule { .. } => panic!("{what}: the original has no capsules"),
        Shape::Box { size } => {
            for (a, b) in size.iter().zip(floats(&theirs["size"])) {
                assert_near(*a, b, 1e-6, what);
            }
            ("box", vec![])
        }
    };
    assert_eq!(theirs["shape"], name, "{what}");
    for (key, value) in sizes {
        assert_near(value, theirs[key].as_f64().unwrap(), 1e-6, what);
    }
    let mut local = floats(&theirs["T_local"]);
    let r = Matrix3::from_fn(|i, j| local[4 * i + j]);
    if r.determinant() < 0.0 {
        // Heading -y: the original has a point reflection, our model the rotation without it.
        for i in 0..3 {
            for j in 0..3 {
                local[4 * i + j] = -r[(i, j)];
            }
        }
    }
    assert_frame(&ours.pose, &local, what);
}

fn pairs(v: &Value) -> Vec<(usize, usize)> {
    let mut pairs: Vec<_> = v.as_array().unwrap().iter().map(|p| (int(&p[0]), int(&p[1]))).collect();
    pairs.iter_mut().for_each(|(a, b)| (*a, *b) = ((*a).min(*b), (*a).max(*b)));
    pairs.sort_unstable();
    pairs
}

fn loads_the_same(name: &str) {
    let Some(oracle) = oracle(name) else { return };
    let (robot, model) = (&oracle.robot, oracle.model());
    assert_eq!(model["robot"], robot.name.as_str());
    let parts = model["body_parts"].as_array().unwrap();
    assert_eq!(parts.len(), robot.parts.len());
    for (part, theirs) in robot.parts.iter().zip(parts) {
        assert_eq!(theirs["name"], part.name.as_str());
        assert_eq!(part.root_node, Some(int(&theirs["root_node"])));
        let motors = theirs["motors"].as_array().unwrap();
        assert_eq!(motors.len(), part.motors.len());
        for (motor, theirs) in robot.motors[part.motors.clone()].iter().zip(motors) {
            assert_eq!(theirs["name"], motor.name.as_str());
            for (key, ours) in [("min", motor.min), ("max", motor.max), ("home", motor.home)] {
                assert_near(ours.to_degrees(), theirs[key].as_f64().unwrap(), 1e-6, &motor.name);
            }
            assert_eq!(theirs["is_body_part_root"], motor.is_part_root, "{}", motor.name);
            let joints: Vec<usize> = theirs["joint_nodes"].as_array().unwrap().iter().map(int).collect();
            assert_eq!(joints, motor.joints);
        }
        let clauses = theirs["constraints"].as_array().unwrap();
        assert_eq!(clauses.len(), part.clauses.len());
        for (clause, theirs) in part.clauses.iter().zip(clauses) {
            let theirs = theirs.as_array().unwrap();
            assert_eq!(clause.0.len(), theirs.len());
            for (member, theirs) in clause.0.iter().zip(theirs) {
                let a: Vec<f64> = member.terms.iter().map(|t| t.1).collect();
                let q: Vec<f64> = member.terms.iter().map(|t| (t.0 - part.motors.start) as f64).collect();
                assert_eq!((a, q), (floats(&theirs["a"]), floats(&theirs["q"])));
                assert_near(member.b, theirs["b"].as_f64().unwrap(), 1e-4, &part.name);
            }
        }
    }
    let nodes = model["nodes"].as_array().unwrap();
    assert_eq!(nodes.len(), robot.nodes.len());
    for (id, (node, theirs)) in robot.nodes.iter().zip(nodes).enumerate() {
        let what = format!("node {id}");
        assert_eq!(node.parent.map_or(-1, |p| p as i64), theirs["parent"].as_i64().unwrap(), "{what}");
        assert_eq!(theirs["part"], robot.parts[node.part].name.as_str(), "{what}");
        assert_eq!(theirs["near_root"], node.near_root, "{what}");
        let axis = match &node.kind {
            NodeKind::Link { offset } => {
                assert_eq!(theirs["type"], "link", "{what}");
                *offset
            }
            NodeKind::Joint { axis, motor, min, max, length, .. } => {
                assert_eq!(theirs["type"], "joint", "{what}");
                assert_eq!(theirs["motor"], robot.motors[*motor].name.as_str(), "{what}");
                assert_near(min.to_degrees(), theirs["min_deg"].as_f64().unwrap(), 1e-5, &what);
                assert_near(max.to_degrees(), theirs["max_deg"].as_f64().unwrap(), 1e-5, &what);
                **axis * *length
            }
        };
        for (a, b) in axis.iter().zip(floats(&theirs["axis"])) {
            assert_near(*a, b, 1e-6, &what);
        }
        for (ours, theirs) in [(&node.solids, &theirs["primitives"]), (&node.fields, &theirs["fields"])] {
            let theirs = theirs.as_array().unwrap();
            assert_eq!(ours.len(), theirs.len(), "{what}");
            for (ours, theirs) in ours.iter().zip(theirs) {
                assert_primitive(ours, theirs, &what);
            }
        }
    }
    let markers = model["markers"].as_array().unwrap();
    assert_eq!(markers.len(), robot.markers.len());
    for (marker, theirs) in robot.markers.iter().zip(markers) {
        assert_eq!((theirs["name"].as_str().unwrap(), int(&theirs["node"])), (marker.name.as_str(), marker.node));
        for (a, b) in marker.normal.iter().zip(floats(&theirs["normal_local"])) {
            assert_near(*a, b, 1e-6, &marker.name);
        }
    }
    assert_eq!(robot.pairs.reflex, pairs(&model["reflex_node_pairs"]));
    assert_eq!(robot.pairs.visual_only, pairs(&model["visual_only_node_pairs"]));
    assert_eq!(robot.pairs.field, pairs(&model["field_node_pairs"]));
}

fn stands_the_same(name: &str) {
    let Some(oracle) = oracle(name) else { return };
    let (robot, poses) = (&oracle.robot, oracle.poses());
    let rows = |file: &str| -> Vec<Vec<String>> {
        let text = oracle.text(file);
        text.lines().skip(1).map(|l| l.split(',').map(str::to_owned).collect()).collect()
    };
    let number = |s: &String| s.parse::<f64>().unwrap();
    let index = |s: &String| s.parse::<usize>().unwrap();

    let mut frames: BTreeMap<usize, Vec<Isometry3<f64>>> = BTreeMap::new();
    let mut compared = 0;
    for row in rows("transforms.csv") {
        let at = frames.entry(index(&row[0])).or_insert_with(|| {
            let mut frames = Vec::new();
            robot.forward(&poses[index(&row[0])], &mut frames);
            frames
        });
        let theirs: Vec<f64> = row[2..].iter().map(number).collect();
        assert_frame(&at[index(&row[1])], &theirs, &format!("pose {} node {}", row[0], row[1]));
        compared += 1;
    }
    assert!(compared >= robot.nodes.len());

    for row in rows("markers.csv") {
        let at = robot.markers.iter().position(|m| m.name == row[1]).unwrap();
        let marker = &robot.markers_at(&poses[index(&row[0])])[at];
        let ours = marker.position().coords.iter().chain(marker.normal.iter()).copied().collect::<Vec<_>>();
        for (a, b) in ours.into_iter().zip(row[2..].iter().map(number)) {
            assert_near(a, b, 1e-6, &format!("pose {} marker {}", row[0], row[1]));
        }
    }

    for row in rows("constraints.csv") {
        let q = &poses[index(&row[0])];
        let part = robot.part(&row[1]).unwrap();
        let clause = index(&row[3]);
        let value = robot.clause_value(&part.clauses[clause], q);
        assert_near(value, number(&row[4]), 1e-5, &format!("pose {} {} clause {clause}", row[0], row[1]));
        let broken: Vec<usize> =
            robot.violated(q).filter(|(p, _)| robot.parts[*p].name == row[1]).map(|(_, c)| c).collect();
        assert_eq!(broken.contains(&clause), row[5] == "0", "pose {} {} clause {clause}", row[0], row[1]);
        assert_eq!(!broken.is_empty(), row[2] == "1", "pose {} {}", row[0], row[1]);
    }
}

/// Equal except for the last digits of directions and orientations.
fn assert_equal(a: &Robot, b: &Robot) {
    let mut snapped = b.clone();
    for (x, y) in a.nodes.iter().zip(&mut snapped.nodes) {
        let shapes = x.solids.iter().chain(&x.fields);
        for (p, s) in shapes.zip(y.solids.iter_mut().chain(&mut y.fields)) {
            let symmetric =
                p.pose.rotation * nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
            let turn = p.pose.rotation.angle_to(&s.pose.rotation).min(symmetric.angle_to(&s.pose.rotation));
            assert!(turn < 1e-7 && (p.pose.translation.vector - s.pose.translation.vector).norm() < 1e-14);
            let r =
                p.pose.rotation.to_rotation_matrix().into_inner() - s.pose.rotation.to_rotation_matrix().into_inner();
            assert!(turn == 0.0 || r.norm() < 1e-14 || r.norm() > 1.0, "{p:?} {s:?}");
            s.pose = p.pose;
            if let (Shape::Cylinder { radius: r, height: h }, Shape::Cylinder { radius: r2, height: h2 }) =
                (p.shape, s.shape)
            {
                assert!(r == r2 && (h - h2).abs() < 1e-15);
                s.shape = p.shape;
            }
        }
        if let (NodeKind::Joint { axis: x, .. }, NodeKind::Joint { axis: y, .. }) = (&x.kind, &mut y.kind) {
            assert!((x.into_inner() - y.into_inner()).norm() < 1e-15);
            *y = *x;
        }
    }
    for (x, y) in a.markers.iter().zip(&mut snapped.markers) {
        assert!((x.normal.into_inner() - y.normal.into_inner()).norm() < 1e-15);
        y.normal = x.normal;
    }
    assert_eq!(*a, snapped);
}

#[test]
fn edge_loads_as_in_the_original() {
    loads_the_same("edge");
}

#[test]
fn icub_loads_as_in_the_original() {
    loads_the_same("icub");
}

#[test]
fn icub_big_hands_loads_as_in_the_original() {
    loads_the_same("icub_big_hands");
}

#[test]
fn edge_stands_as_in_the_original() {
    stands_the_same("edge");
}

#[test]
fn icub_stands_as_in_the_original() {
    stands_the_same("icub");
}

#[test]
fn icub_big_hands_stands_as_in_the_original() {
    stands_the_same("icub_big_hands");
}

#[test]
fn a_written_robot_reads_back_as_the_same() {
    let ours = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots");
    let ours = ["icub.xml", "katana.xml"].map(|name| load_robot(ours.join(name)).unwrap().value);
    let theirs = ["edge", "icub", "icub_big_hands", "icubSim"].into_iter().filter_map(oracle).map(|o| o.robot);
    for robot in theirs.chain(ours) {
        let again = mobee_model::parse_robot("again.xml", &write_robot(&robot)).unwrap();
        assert!(again.warnings.is_empty(), "{:?}", again.warnings);
        assert_equal(&robot, &again.value);
        // Writing it again changes nothing.
        assert_equal(&robot, &mobee_model::parse_robot("b.xml", &write_robot(&again.value)).unwrap().value);
    }
}
