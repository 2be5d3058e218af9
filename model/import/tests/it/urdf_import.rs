//! URDF import: the same kinematics and shapes, and clear messages for input that can't be converted.

use mobee_import::{FitOptions, UrdfOptions, load_urdf, parse_urdf};

use mobee_model::{JointMotion, Motor, Robot, Scene, Shape, load_robot, parse_robot, write_robot};
use nalgebra::{Isometry3, Matrix4, Point3, Rotation3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

fn data(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(name)
}

/// Link frames computed directly from the URDF's tree: matrices, joint by joint.
fn urdf_frames(urdf: &urdf_rs::Robot, angles: &BTreeMap<String, f64>) -> BTreeMap<String, Matrix4<f64>> {
    let rpy = |r: [f64; 3]| {
        let about = |axis: Vector3<f64>, angle: f64| Rotation3::new(axis * angle);
        about(Vector3::z(), r[2]) * about(Vector3::y(), r[1]) * about(Vector3::x(), r[0])
    };
    let angle = |joint: &urdf_rs::Joint| match &joint.mimic {
        Some(m) => angles[&m.joint] * m.multiplier.unwrap_or(1.0) + m.offset.unwrap_or(0.0),
        None => angles.get(&joint.name).copied().unwrap_or(0.0),
    };
    let root = urdf.links.iter().find(|l| urdf.joints.iter().all(|j| j.child.link != l.name)).unwrap();
    let mut frames = BTreeMap::from([(root.name.clone(), Matrix4::identity())]);
    while frames.len() < urdf.links.len() {
        for joint in &urdf.joints {
            let Some(parent) = frames.get(&joint.parent.link) else { continue };
            let origin =
                Matrix4::new_translation(&joint.origin.xyz.0.into()) * rpy(joint.origin.rpy.0).to_homogeneous();
            let turn = Rotation3::new(Vector3::from(joint.axis.xyz.0).normalize() * angle(joint)).to_homogeneous();
            let turn = match joint.joint_type {
                urdf_rs::JointType::Fixed => Matrix4::identity(),
                urdf_rs::JointType::Prismatic => {
                    Matrix4::new_translation(&(Vector3::from(joint.axis.xyz.0).normalize() * angle(joint)))
                }
                _ => turn,
            };
            let frame = parent * origin * turn;
            frames.insert(joint.child.link.clone(), frame);
        }
    }
    frames
}

/// Converts rad of encoder to rad, or to meters for a prismatic motor.
fn in_joint_units(motor: &Motor, q: f64) -> f64 {
    match motor.motion {
        JointMotion::Turn => q,
        JointMotion::Slide => q.to_degrees() / 1000.0,
    }
}

/// At random poses every link's origin and z axis agree with the URDF.
fn kinematics_agree(urdf: &urdf_rs::Robot, robot: &Robot, poses: usize) {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..poses {
        let q: Vec<f64> = robot.motors.iter().map(|m| random.random_range(m.min..=m.max)).collect();
        let angles = robot.motors.iter().zip(&q).map(|(m, q)| (m.name.clone(), in_joint_units(m, *q))).collect();
        let frames = urdf_frames(urdf, &angles);
        let markers = robot.markers_at(&q);
        assert_eq!(markers.len(), frames.len());
        for (marker, pose) in robot.markers.iter().zip(&markers) {
            let frame = &frames[&marker.name];
            let off = (pose.position() - frame.transform_point(&Point3::origin())).norm();
            let turned = (pose.normal - frame.transform_vector(&Vector3::z())).norm();
            assert!(off < 1e-9 && turned < 1e-9, "{}: {off} m, {turned}", marker.name);
        }
    }
}

#[test]
fn the_converted_arm_moves_as_its_urdf() {
    let path = data("bent_arm.urdf");
    let urdf = urdf_rs::read_file(&path).unwrap();
    let loaded = load_urdf(&path, &UrdfOptions::default()).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let robot = loaded.value;
    let motors: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(motors, ["turn", "shoulder", "elbow", "wrist", "finger_left_joint"]);
    kinematics_agree(&urdf, &robot, 1000);
    let written = parse_robot("converted.xml", &write_robot(&robot)).unwrap();
    assert!(written.warnings.is_empty(), "{:?}", written.warnings);
    kinematics_agree(&urdf, &written.value, 1000);
    assert_eq!(written.value.motors.len(), robot.motors.len());
}

/// The shapes of the converted robot, read from its ZRP file, agree with the URDF.
#[test]
fn shapes_stay_in_their_place() {
    let robot = load_urdf(data("bent_arm.urdf"), &UrdfOptions::default()).unwrap().value;
    let urdf = urdf_rs::read_file(data("bent_arm.urdf")).unwrap();
    let robot = parse_robot("converted.xml", &write_robot(&robot)).unwrap().value;
    let q: Vec<f64> = robot.motors.iter().map(|m| 0.3 * m.min + 0.7 * m.max).collect();
    let angles = robot.motors.iter().zip(&q).map(|(m, q)| (m.name.clone(), *q)).collect();
    let frames = urdf_frames(&urdf, &angles);
    let mut transforms = Vec::new();
    robot.forward(&q, &mut transforms);
    let solids =
        || robot.nodes.iter().zip(&transforms).flat_map(|(n, t)| n.solids.iter().map(move |s| (s.shape, t * s.pose)));
    // The hand's box: the one with these edges, its corner as in the URDF.
    let local = Matrix4::new_translation(&Vector3::new(0.0, 0.0, 0.03))
        * Rotation3::from_euler_angles(0.4, -2.1, 1.3).to_homogeneous();
    let corner = Point3::new(0.015, 0.025, 0.02);
    let expected = (frames["hand"] * local).transform_point(&corner);
    let (_, hand) = solids().find(|(s, _)| *s == Shape::Box { size: Vector3::new(0.03, 0.05, 0.04) }).unwrap();
    assert!((hand * corner - expected).norm() < 1e-9);
    // The forearm's cylinder is along its link's x axis: the center of its end is at half its length.
    let (_, lower) = solids().find(|(s, _)| *s == Shape::Cylinder { radius: 0.03, height: 0.14 }).unwrap();
    let expected = frames["lower"].transform_point(&Point3::new(0.17, 0.0, 0.0));
    assert!((lower * Point3::new(0.0, 0.07, 0.0) - expected).norm() < 1e-9);
}

/// Neighbors are disabled, all other pairs are tested, also of links fixed to a neighbor.
#[test]
fn bodies_beyond_the_next_are_tested() {
    let robot = load_urdf(data("bent_arm.urdf"), &UrdfOptions::default()).unwrap().value;
    let node = |shape: Shape| robot.nodes.iter().position(|n| n.solids.iter().any(|s| s.shape == shape)).unwrap();
    let base = node(Shape::Cylinder { radius: 0.08, height: 0.1 });
    let upper = node(Shape::Cylinder { radius: 0.03, height: 0.2 });
    let lower = node(Shape::Cylinder { radius: 0.03, height: 0.14 });
    let hand = node(Shape::Box { size: Vector3::new(0.03, 0.05, 0.04) });
    let plate = node(Shape::Sphere { radius: 0.035 });
    for pair in [(base, hand), (upper, hand), (base, lower), (lower, hand)] {
        assert!(robot.pairs.reflex.contains(&pair), "{pair:?}");
    }
    for pair in [(upper, lower), (plate, hand)] {
        assert!(!robot.pairs.reflex.contains(&pair), "{pair:?}");
        let left_out = robot.left_out.iter().flatten().find(|l| l.nodes == pair).expect("it is listed");
        assert!(left_out.reason.starts_with("neighbors, joined by "), "{left_out:?}");
    }
    let scene = Scene::new(vec![(Arc::new(robot), Isometry3::identity())], vec![]).unwrap();
    assert!(scene.static_contacts().is_empty());
}

#[test]
fn a_mesh_becomes_a_shape_around_it_or_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let obj = "v 0 0 0\nv 0.2 0 0\nv 0 0.3 0\nv 0 0 0.4\nv 0.2 0.3 0\nv 0.2 0 0.4\nv 0 0.3 0.4\nv 0.2 0.3 0.4\n\
               f 1 2 5 3\nf 4 6 8 7\nf -8 -7 -3 -5\n";
    std::fs::write(folder.path().join("brick.obj"), obj).unwrap();
    let text = |file: &str| {
        format!(
            "<robot name=\"r\"><link name=\"brick\"><collision><origin xyz=\"1 0 0\"/><geometry>\
             <mesh filename=\"{file}\" scale=\"0.1 0.1 0.1\"/></geometry></collision></link></robot>"
        )
    };
    // A bound so small that only a box will do.
    let fit = FitOptions { overshoot: 1e-4, primitives: 1 };
    let options = UrdfOptions { mesh_folders: vec![folder.path().into()], fit, ..Default::default() };
    let robot = parse_urdf("r.urdf", &text("package://any/brick.obj"), &options).unwrap().value;
    let solid = &robot.nodes[0].solids[0];
    assert!((solid.pose.translation.vector - Vector3::new(1.01, 0.015, 0.02)).norm() < 1e-9, "{solid:?}");
    match solid.shape {
        Shape::Box { size } => assert!((size.norm() - Vector3::new(0.02_f64, 0.03, 0.04).norm()).abs() < 1e-6),
        other => panic!("{other:?}"),
    }
    // A URI with an encoded space, and commas between numbers.
    std::fs::copy(folder.path().join("brick.obj"), folder.path().join("a brick.obj")).unwrap();
    let address = format!("file://{}", folder.path().join("a%20brick.obj").display());
    let same = parse_urdf("r.urdf", &text(&address).replace("1 0 0", "1, 0, 0"), &options).unwrap().value;
    assert_eq!(same.nodes, robot.nodes);
    let refused = parse_urdf("r.urdf", &text("package://any/none.stl"), &options).unwrap_err();
    assert!(refused.message().contains("link `brick`") && refused.message().contains("none.stl"), "{refused}");
    assert!(refused.remedy().contains("--package any=DIR"), "{refused:?}");
    let dropped = parse_urdf("r.urdf", &text("none.stl"), &UrdfOptions { drop_meshes: true, ..Default::default() });
    assert_eq!(dropped.unwrap().warnings.len(), 1);
}

fn two_links(joint: &str) -> String {
    format!("<robot name=\"r\">\n<link name=\"a\"/><link name=\"b\"/>\n{joint}\n</robot>")
}

#[test]
fn what_cannot_be_converted_is_named_with_its_place() {
    let ends = "<parent link=\"a\"/><child link=\"b\"/>";
    let limit = "<limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/>";
    let cases = [
        (String::new(), 0, "no element"),
        ("<robot name=\"r\">".into(), 1, "never closed"),
        ("<robot name=\"r\"><link name=\"a\"></robot>".into(), 1, "well-formed"),
        ("<ZeroPositionKinematicTree/>".into(), 1, "does not begin a URDF"),
        ("<!DOCTYPE x [<!ENTITY a \"b\">]><robot name=\"r\"/>".into(), 1, "document type"),
        ("<robot name=\"r\"><link name=\"a\"/>\n<link name=\"a\"/></robot>".into(), 2, "already"),
        (two_links(""), 1, "2 links have no parent"),
        (two_links(&format!("<joint name=\"j\" type=\"planar\">{ends}{limit}</joint>")), 3, "planar"),
        (two_links(&format!("<joint name=\"j\" type=\"bent\">{ends}{limit}</joint>")), 3, "bent"),
        (two_links("<joint name=\"j\" type=\"fixed\"><parent link=\"a\"/><child link=\"c\"/></joint>"), 3, "`c`"),
        (two_links(&format!("<joint name=\"j\" type=\"fixed\">{ends}</joint>\n<joint name=\"k\" type=\"fixed\">{ends}</joint>")), 4, "more than one parent"),
        (two_links(&format!("<joint name=\"j\" type=\"revolute\">{ends}<limit lower=\"1\" upper=\"-1\" effort=\"1\" velocity=\"1\"/></joint>")), 3, "limits"),
        (two_links(&format!("<joint name=\"j\" type=\"revolute\">{ends}{limit}<axis xyz=\"0 0 0\"/></joint>")), 3, "axis"),
        (two_links(&format!("<joint name=\"j\" type=\"revolute\">{ends}{limit}<origin xyz=\"nan 0 0\"/></joint>")), 3, "finite"),
        (two_links(&format!("<joint name=\"j\" type=\"revolute\">{ends}{limit}<mimic joint=\"j\"/></joint>")), 3, "itself"),
        (two_links(&format!("<joint name=\"j\" type=\"revolute\">{ends}{limit}<mimic joint=\"x\"/></joint>")), 3, "does not exist"),
        ("<robot name=\"r\"><link name=\"a\"><collision><geometry><sphere radius=\"-1\"/></geometry></collision></link></robot>".into(), 1, "above zero"),
    ];
    for (text, line, expected) in cases {
        let error = parse_urdf("r.urdf", &text, &UrdfOptions::default()).expect_err(&text);
        assert!(error.to_string().contains(expected), "{text}\n{error}");
        assert!(!error.remedy().is_empty() && error.line() >= line, "{text}\n{error}");
        assert!(line == 0 || error.line() == line, "{text}\n{error}");
    }
    let deep = format!("<robot name=\"r\">{}", "<a>".repeat(100_000));
    assert!(parse_urdf("r.urdf", &deep, &UrdfOptions::default()).unwrap_err().to_string().contains("nested"));
}

fn joint(kind: &str, limits: &str) -> String {
    let ends = "<parent link=\"a\"/><child link=\"b\"/>";
    let text = two_links(&format!("<joint name=\"j\" type=\"{kind}\">{ends}<axis xyz=\"0 0 1\"/>{limits}</joint>"));
    assert!(text.lines().count() == 4);
    text
}

#[test]
fn what_no_motor_moves_stands_still() {
    let options = UrdfOptions { fix_unsupported: true, part: Some("arm".into()), ..Default::default() };
    for kind in ["planar", "floating"] {
        let loaded = parse_urdf("r.urdf", &joint(kind, ""), &options).unwrap();
        assert_eq!((loaded.warnings.len(), loaded.value.motors.len()), (1, 0), "{kind}");
        assert_eq!(loaded.value.parts[0].name, "arm");
    }
    let floating = parse_urdf("r.urdf", &joint("floating", ""), &UrdfOptions::default()).unwrap();
    assert_eq!(floating.warnings.len(), 1, "a floating base needs no option");
}

#[test]
fn a_joint_without_end_gets_limits_that_its_file_may_have() {
    let huge = "<limit lower=\"-1e16\" upper=\"1e16\" effort=\"1\" velocity=\"1\"/>";
    for text in [joint("continuous", ""), joint("revolute", huge)] {
        let robot = parse_urdf("r.urdf", &text, &UrdfOptions::default()).unwrap().value;
        assert!(robot.motors[0].continuous && robot.motors[0].home == 0.0);
        let again = parse_robot("again.xml", &write_robot(&robot)).unwrap();
        assert!(again.warnings.is_empty() && again.value.motors == robot.motors, "{:?}", again.warnings);
    }
    let slide = parse_urdf("r.urdf", &joint("prismatic", huge), &UrdfOptions::default()).unwrap();
    assert_eq!(slide.warnings.len(), 1);
    parse_robot("again.xml", &write_robot(&slide.value)).unwrap();
}

/// A gripper: one prismatic finger follows a revolute lever, the other moves opposite to it, with the numbers of their
/// files.
#[test]
fn fingers_that_slide_follow_a_leader_that_turns() {
    let link = |name: &str| {
        format!("<link name=\"{name}\"><collision><geometry><sphere radius=\"0.01\"/></geometry></collision></link>")
    };
    let joint = |name: &str, kind: &str, child: &str, more: &str| {
        format!(
            "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"palm\"/><child link=\"{child}\"/><axis xyz=\"0 1 0\"/>\
             <limit lower=\"0\" upper=\"0.8\" effort=\"1\" velocity=\"1\"/>{more}</joint>"
        )
    };
    let text = ["palm", "lever", "left", "right"].map(link).concat()
        + &joint("left", "prismatic", "left", "<mimic joint=\"drive\" multiplier=\"0.05\"/>")
        + &joint("right", "prismatic", "right", "<mimic joint=\"drive\" multiplier=\"-0.05\" offset=\"0.01\"/>")
        + &joint("drive", "revolute", "lever", "");
    let text = format!("<robot name=\"gripper\">{text}</robot>");
    let robot = parse_urdf("gripper.urdf", &text, &UrdfOptions::default()).unwrap().value;
    let again = parse_robot("again.xml", &write_robot(&robot)).unwrap();
    assert!(again.warnings.is_empty(), "{:?}", again.warnings);
    kinematics_agree(&urdf_rs::read_from_string(&text).unwrap(), &robot, 100);
    kinematics_agree(&urdf_rs::read_from_string(&text).unwrap(), &again.value, 100);
    assert_eq!(robot.motors.len(), 1);
    assert_eq!((robot.motors[0].name.as_str(), robot.motors[0].motion), ("drive", JointMotion::Turn));
}

/// `MOBEE_URDF=FILE` adds a real one (such as those of the PyPI package icub-models) to the test's own.
#[test]
fn a_real_urdf_converts_if_one_is_given() {
    let Some(path) = std::env::var_os("MOBEE_URDF").map(PathBuf::from) else {
        return eprintln!("SKIPPED: MOBEE_URDF names no file");
    };
    let urdf = urdf_rs::read_file(&path).unwrap();
    let loaded = load_urdf(&path, &UrdfOptions::default()).unwrap();
    loaded.warnings.iter().for_each(|w| eprintln!("{w}"));
    kinematics_agree(&urdf, &loaded.value, 1000);
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), write_robot(&loaded.value)).unwrap();
    kinematics_agree(&urdf, &load_robot(file.path()).unwrap().value, 1000);
}
