//! Every word of a URDF is used, reported as unused, or rejected: rotations, limits, speeds, sizes, and visual shapes.

use mobee_import::{FitOptions, UrdfOptions, load_urdf_with_surfaces, parse_urdf};

use mobee_model::{FileError, Robot, Shape, parse_robot, write_robot};
use nalgebra::Vector3;

const BALL: &str = "<collision><geometry><sphere radius=\"0.02\"/></geometry></collision>";

/// A chain a - b - c of two joints that rotate about y and z; `first` and `second` are the contents of the joints.
fn chain(robot: &str, (first, second): (&str, &str)) -> String {
    let joint = |name: &str, ends: [&str; 2], kind: &str, axis: &str, more: &str| {
        format!(
            "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{}\"/><child link=\"{}\"/><axis xyz=\"{axis}\"/>{more}</joint>\n",
            ends[0], ends[1]
        )
    };
    let (kind, first) = first.split_once('|').unwrap_or(("revolute", first));
    let (other, second) = second.split_once('|').unwrap_or(("revolute", second));
    format!(
        "<robot name=\"r\" {robot}>\n<link name=\"a\"/>\n<link name=\"b\">{BALL}</link>\n<link name=\"c\">{BALL}</link>\n{}{}</robot>",
        joint("j1", ["a", "b"], kind, "0 0 1", first),
        joint("j2", ["b", "c"], other, "0 1 0", second)
    )
}

const LIMIT: &str = "<limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/>";

fn read(text: &str) -> (Robot, Vec<FileError>) {
    let loaded = parse_urdf("r.urdf", text, &UrdfOptions::default()).unwrap_or_else(|e| panic!("{text}\n{e:?}"));
    (loaded.value, loaded.warnings)
}

fn refused(text: &str, line: usize, message: &str) {
    let error = parse_urdf("r.urdf", text, &UrdfOptions::default()).expect_err(text);
    assert!(error.message().contains(message), "{text}\n{error}");
    assert!(error.line() == line && !error.remedy().is_empty(), "{text}\n{error:?}");
}

/// The only warning of a file, which contains all of these texts.
fn warned(text: &str, parts: &[&str]) {
    let (_, warnings) = read(text);
    let [warning] = &warnings[..] else { panic!("{text}\n{warnings:?}") };
    let all = format!("{} {}", warning.message(), warning.remedy());
    assert!(parts.iter().all(|p| all.contains(p)), "{text}\n{warning:?}");
}

fn limits(text: &str) -> Vec<[f64; 2]> {
    let (robot, _) = read(text);
    robot.motors.iter().map(|m| [m.min, m.max]).collect()
}

#[test]
fn a_quaternion_turns_as_the_angles_that_it_stands_for() {
    let places = |origin: &str, version: &str| {
        let first = format!("<origin xyz=\"0.1 0 0.2\" {origin}/>{LIMIT}");
        let (robot, warnings) = read(&chain(version, (&first, &format!("<origin xyz=\"0.3 0 0\"/>{LIMIT}"))));
        assert!(warnings.is_empty(), "{warnings:?}");
        let at = robot.markers_at(&robot.home());
        at.iter().map(|m| m.position().coords).collect::<Vec<Vector3<f64>>>()
    };
    let angles = places("rpy=\"0 1.5707963267948966 0\"", "");
    assert!((angles[2] - Vector3::new(0.1, 0.0, -0.1)).norm() < 1e-12, "{angles:?}");
    let near = |other: Vec<Vector3<f64>>| angles.iter().zip(&other).all(|(a, b)| (a - b).norm() < 1e-9);
    for version in ["", "version=\"1.0\"", "version=\"1.1\"", "version=\"1.2\""] {
        assert!(near(places("quat_xyzw=\"0 0.7071067811865476 0 0.7071067811865476\"", version)));
    }
    assert!(near(places("quat_xyzw=\"0, 3, 0, 3\"", "")), "of any length");
    assert!(near(places("quat_xyzw=\"0 -1 0 -1\"", "")), "of either sign");
    // A shape and a center of mass have origins, too.
    let text = "<robot name=\"r\"><link name=\"a\">\n<collision><origin xyz=\"1 0 0\" quat_xyzw=\"0 0 1 1\"/><geometry>\
                <box size=\"0.1 0.2 0.3\"/></geometry></collision></link></robot>";
    let pose = read(text).0.nodes[0].solids[0].pose;
    assert!((pose * Vector3::x() - Vector3::y()).norm() < 1e-12, "{pose}");
    for bad in ["0 0 0 0", "0 0 0 nan", "0 0 inf 1", "0 0 1", "0 0 0 0 1", "a b c d", "1e300 0 0 0", ""] {
        refused(&text.replace("0 0 1 1", bad), 2, "quat_xyzw");
        let origin = format!("<origin quat_xyzw=\"{bad}\"/>");
        refused(&chain("", (&format!("{origin}{LIMIT}"), LIMIT)), 5, "quat_xyzw");
        let mass = format!("<inertial><mass value=\"1\"/>{origin}</inertial></link>");
        refused(&text.replace("</link>", &mass), 2, "quat_xyzw");
    }
    refused(&text.replace("xyz=\"1 0 0\"", "rpy=\"0 0 0\""), 2, "both `rpy` and `quat_xyzw`");
}

#[test]
fn words_that_are_none_are_named_in_one_line_and_second_ones_are_refused() {
    let first = format!("<origin xyz=\"0 0 0\" rpt=\"0 0 1\" rot=\"1\"/>{LIMIT}<offset/>");
    let text = chain("version=\"2.0\" vesion=\"1\"", (&first, &format!("<origin rpt=\"1 0 0\"/>{LIMIT}")));
    let text = text.replace(&format!("c\">{BALL}"), &format!("c\"><Collision/>{BALL}"));
    let (_, warnings) = read(&text);
    let messages: Vec<&str> = warnings.iter().map(FileError::message).collect();
    let [version, words] = messages[..] else { panic!("{messages:?}") };
    assert!(version.contains("version \"2.0\""), "{version}");
    for word in [
        "`rpt` of <origin> (2 times)",
        "`rot` of <origin>",
        "<offset> in <joint>",
        "<Collision> in <link>",
        "`vesion` of <robot>",
    ] {
        assert!(words.contains(word), "{word}: {words}");
    }
    assert_eq!(warnings[1].line(), 1, "the first of them");
    for known in ["1.0", "1.1", "1.2"] {
        let (_, warnings) = read(&chain(&format!("version=\"{known}\""), (LIMIT, LIMIT)));
        assert!(warnings.is_empty(), "{warnings:?}");
    }
    for second in [LIMIT, "<origin/><origin/>", "<axis xyz=\"1 0 0\"/>", "<parent link=\"a\"/>"] {
        refused(&chain("", (&format!("{LIMIT}{second}"), LIMIT)), 5, "a second <");
    }
    let shapes = "<geometry><sphere radius=\"0.1\"/><sphere radius=\"0.2\"/></geometry>";
    refused(&chain("", (LIMIT, LIMIT)).replace(BALL, &format!("<collision>{shapes}</collision>")), 3, "a second shape");
    let shape = "<geometry><sphere radius=\"0.1\"/></geometry>";
    let twice = format!("<collision>{shape}{shape}</collision>");
    refused(&chain("", (LIMIT, LIMIT)).replace(BALL, &twice), 3, "a second <geometry>");
}

#[test]
fn what_the_standard_has_and_a_robot_does_not_need_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let soft = "<safety_controller k_velocity=\"10\" k_position=\"15\"/><dynamics damping=\"1\"/>";
    let text = chain("", (&format!("{LIMIT}{soft}"), &format!("{LIMIT}{soft}")));
    let text = text.replace("</robot>", "<transmission/><material name=\"red\"/><drake:x/></robot>");
    std::fs::write(dir.path().join("r.urdf"), text).unwrap();
    let loaded = load_urdf_with_surfaces(dir.path().join("r.urdf"), &UrdfOptions::default()).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let [line] = &loaded.value.notes[..] else { panic!("{:?}", loaded.value.notes) };
    for word in [
        "k_position of <safety_controller> (2 times)",
        "k_velocity",
        "<dynamics>",
        "effort of <limit>",
        "<transmission>",
        "<material>",
        "<drake:x>",
    ] {
        assert!(line.starts_with("not used of the URDF: ") && line.contains(word), "{word}: {line}");
    }
}

#[test]
fn soft_limits_narrow_what_a_joint_may_do() {
    let soft =
        |limits: &str, soft: &str| chain("", (&format!("{limits}<safety_controller k_velocity=\"1\" {soft}/>"), LIMIT));
    let wide = "<limit lower=\"-2\" upper=\"2\" velocity=\"1\"/>";
    let first = |text: &str| limits(text)[0];
    assert_eq!(first(&soft(wide, "soft_lower_limit=\"-1\" soft_upper_limit=\"1.5\"")), [-1.0, 1.5]);
    assert_eq!(first(&soft(wide, "soft_lower_limit=\"-9\" soft_upper_limit=\"1\"")), [-2.0, 1.0], "never wider");
    assert_eq!(first(&soft(wide, "")), [-2.0, 2.0]);
    let half = soft(wide, "soft_upper_limit=\"1\"");
    assert_eq!(first(&half), [0.0, 1.0], "one that is missing is 0 by the standard");
    warned(&half, &["soft limits", "`j1`", "counts as 0"]);
    let slide = soft(
        "prismatic|<limit lower=\"0\" upper=\"0.3\" velocity=\"1\"/>",
        "soft_lower_limit=\"0.1\" soft_upper_limit=\"0.2\"",
    );
    let [min, max] = first(&slide).map(f64::to_degrees);
    assert!((min - 100.0).abs() < 1e-9 && (max - 200.0).abs() < 1e-9, "{min} {max}");
    let endless = soft("continuous|", "soft_lower_limit=\"-1\" soft_upper_limit=\"2\"");
    assert_eq!(first(&endless), [-1.0, 2.0]);
    assert!(!read(&endless).0.motors[0].continuous);
    warned(&soft("continuous|", "soft_lower_limit=\"0\" soft_upper_limit=\"0\""), &["0 to 0 are not used", "`j1`"]);
    for none in [("2.5", "3"), ("1", "-1"), ("nan", "1"), ("-1", "nan")] {
        let text = soft(wide, &format!("soft_lower_limit=\"{}\" soft_upper_limit=\"{}\"", none.0, none.1));
        refused(&text, 5, "no range is left");
    }
}

#[test]
fn velocity_limits_bound_motors_also_through_their_followers_and_files() {
    let limit = |velocity: &str| format!("<limit lower=\"-1\" upper=\"1\" {velocity}/>");
    let speed = |text: &str| read(text).0.motors[0].max_speed;
    let one = |velocity: &str| chain("", (&limit(velocity), LIMIT));
    assert_eq!(speed(&one("velocity=\"0.05\"")), Some(0.05));
    assert_eq!(speed(&one("velocity=\"inf\"")), None);
    let slow = chain("", (&format!("prismatic|{}", limit("velocity=\"0.05\"")), LIMIT));
    assert!((speed(&slow).unwrap().to_degrees() - 50.0).abs() < 1e-9, "mm/s");
    // A follower that rotates twice as far as its leader is twice as fast.
    let follower =
        format!("{}<mimic joint=\"j1\" multiplier=\"-2\"/>", "<limit lower=\"-9\" upper=\"9\" velocity=\"0.5\"/>");
    assert_eq!(speed(&chain("", (&limit("velocity=\"1\""), &follower))), Some(0.25));
    let (robot, _) = read(&one("velocity=\"0.05\""));
    let again = parse_robot("r.xml", &write_robot(&robot)).unwrap();
    assert!(again.warnings.is_empty() && again.value.motors == robot.motors, "{:?}", again.warnings);
    assert_eq!(again.value.motors[0].limit_speed(1.0), 0.05);
    assert_eq!(again.value.motors[0].limit_speed(0.01), 0.01);
    for none in ["velocity=\"0\"", ""] {
        assert_eq!(speed(&one(none)), None);
        warned(&one(none), &["no velocity limit", "`j1`"]);
    }
    for absurd in ["velocity=\"180\"", "velocity=\"50000\""] {
        assert_eq!(speed(&one(absurd)), None);
        warned(&one(absurd), &["`j1` (", "degrees", "rad/s"]);
    }
    for wrong in ["velocity=\"-1\"", "velocity=\"nan\""] {
        refused(&one(wrong), 5, "velocity limit");
    }
    refused(&one("velocity=\"fast\""), 5, "not a number");
    let zrp = write_robot(&robot);
    for wrong in ["0", "-3", "nan", "x"] {
        let at = zrp.find("maxSpeed=\"").unwrap() + 10;
        let end = at + zrp[at..].find('"').unwrap();
        let error = parse_robot("r.xml", &format!("{}{wrong}{}", &zrp[..at], &zrp[end..])).unwrap_err();
        assert!(error.message().contains("maxSpeed"), "{error}");
    }
}

#[test]
fn limits_in_another_unit_are_doubted_with_their_place() {
    let limits = |lower: &str, upper: &str| format!("<limit lower=\"{lower}\" upper=\"{upper}\" velocity=\"1\"/>");
    for (lower, upper) in [("-170", "170"), ("0", "90"), ("-15", "0"), ("-720", "720"), ("-36000", "36000")] {
        let both = chain("", (&limits(lower, upper), &limits(lower, upper)));
        warned(&both, &["radians", "degrees", "`j1`", "`j2`", upper]);
    }
    let turns = chain("", (&limits("-12.56", "12.56"), LIMIT));
    assert!(read(&turns).1.is_empty(), "two turns either way are a robot's: {:?}", read(&turns).1);
    let none = chain("", (&limits("-1e16", "1e16"), &limits("-inf", "inf")));
    assert!(read(&none).1.is_empty(), "{:?}", read(&none).1);
    let endless = chain("", (&format!("continuous|{}", limits("-1", "1")), LIMIT));
    warned(&endless, &["continuous joints", "`j1`", "revolute"]);
    for far in ["350", "11", "850"] {
        let slide = chain("", (&format!("prismatic|{}", limits("0", far)), LIMIT));
        warned(&slide, &["millimeters", "`j1`", far, "meters"]);
    }
}

#[test]
fn a_follower_stays_within_its_own_limits() {
    let follow = |own: &str, mimic: &str| {
        let leader = "<limit lower=\"-1\" upper=\"1\" velocity=\"1\"/>";
        let own = if own.is_empty() {
            String::new()
        } else {
            format!("lower=\"{}\" upper=\"{}\"", own.split_once(' ').unwrap().0, own.split_once(' ').unwrap().1)
        };
        chain("", (leader, &format!("<limit {own} velocity=\"9\"/><mimic joint=\"j1\" {mimic}/>")))
    };
    let range = |text: &str| limits(text).first().copied();
    assert_eq!(range(&follow("-0.5 0.25", "")), Some([-0.5, 0.25]));
    assert_eq!(range(&follow("-0.5 0.25", "multiplier=\"-1\"")), Some([-0.25, 0.5]));
    assert_eq!(range(&follow("-0.5 0.5", "multiplier=\"2\" offset=\"0.1\"")), Some([-0.3, 0.2]));
    warned(&follow("-0.5 0.25", ""), &["narrowed", "`j1` to -28.6 to 14.3 deg by `j2`"]);
    assert_eq!(range(&follow("-1 1", "")), Some([-1.0, 1.0]));
    assert_eq!(range(&follow("", "")), Some([-1.0, 1.0]), "one that has no limits of its own follows");
    assert!(read(&follow("", "")).1.is_empty(), "{:?}", read(&follow("", "")).1);
    // If only one position is left, both are fixed there.
    assert_eq!(range(&follow("0 0", "")), None);
    warned(&follow("0 0", ""), &["narrowed", "`j1`", "`j2`"]);
    refused(&follow("3 4", ""), 6, "beyond its limits wherever its leader `j1` is");
    refused(&follow("3 4", "multiplier=\"0\""), 6, "beyond its limits");
    // A continuous leader becomes limited then.
    let endless = chain("", ("continuous|", "<limit lower=\"-1\" upper=\"2\" velocity=\"1\"/><mimic joint=\"j1\"/>"));
    assert_eq!(range(&endless), Some([-1.0, 2.0]));
    let soft = "<limit lower=\"-1\" upper=\"1\" velocity=\"1\"/><safety_controller k_velocity=\"1\" soft_lower_limit=\"-0.1\" soft_upper_limit=\"0.1\"/>";
    assert_eq!(range(&chain("", (LIMIT, &format!("{soft}<mimic joint=\"j1\"/>")))), Some([-0.1, 0.1]));
}

#[test]
fn sizes_and_places_that_are_no_robots_are_doubted() {
    let with = |shape: &str| {
        let shape = format!("<collision><geometry>{shape}</geometry></collision>");
        chain("", (LIMIT, LIMIT)).replacen(BALL, &shape, 1)
    };
    for long in [
        "<box size=\"50 60 50\"/>",
        "<sphere radius=\"25\"/>",
        "<cylinder radius=\"20\" length=\"300\"/>",
        "<cylinder radius=\"20\" length=\"3\"/>",
        "<capsule radius=\"1\" length=\"300\"/>",
    ] {
        warned(&with(long), &["millimeters", "link `b`", "m long"]);
    }
    for short in [
        "<box size=\"0.001 0.001 0.001\"/>",
        "<sphere radius=\"0.001\"/>",
        "<cylinder radius=\"0.00005\" length=\"0.0003\"/>",
    ] {
        warned(&with(short), &["too small", "link `b`", "mm long"]);
    }
    assert!(read(&with("<box size=\"0.2 0.001 0.001\"/>")).1.is_empty(), "a wire");
    let far = |origin: &str| chain("", (&format!("<origin {origin}/>{LIMIT}"), LIMIT));
    warned(&far("xyz=\"0 0 333\""), &["millimeters", "joint `j1` (0 0 333)"]);
    warned(&far("rpy=\"0 90 0\""), &["degrees", "joint `j1` (0 90 0)"]);
    let both = chain("", (LIMIT, LIMIT)).replace("<collision>", "<collision><origin xyz=\"0 120 0\" rpy=\"180 0 0\"/>");
    let (_, warnings) = read(&both);
    assert!(
        warnings.len() == 2
            && warnings.iter().all(|w| w.message().contains("link `b`") && w.message().contains("link `c`")),
        "{warnings:?}"
    );
}

/// A pyramid of 0.4 m, different in all directions, as an OBJ.
const PYRAMID: &str = "v 0 0 0\nv 0.4 0 0\nv 0 0.2 0\nv 0.1 0.05 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

#[test]
fn a_mesh_that_vanishes_is_refused_and_one_that_is_mirrored_is_the_mirror_image() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("p.obj"), PYRAMID).unwrap();
    let fit = FitOptions { overshoot: 1.0, primitives: 12 };
    let options = UrdfOptions { mesh_folders: vec![dir.path().into()], fit, ..UrdfOptions::default() };
    let text = |scale: &str| {
        format!(
            "<robot name=\"r\">\n<link name=\"a\"><collision><geometry><mesh filename=\"p.obj\" scale=\"{scale}\"/></geometry>\
             </collision></link></robot>"
        )
    };
    for zero in ["0 0 0", "1 0 1", "-0 1 1"] {
        let error = parse_urdf("r.urdf", &text(zero), &options).expect_err(zero);
        assert!(error.message().contains("vanishes") && error.line() == 2, "{error}");
    }
    let volume = |scale: &str| {
        std::fs::write(dir.path().join("r.urdf"), text(scale)).unwrap();
        let loaded = load_urdf_with_surfaces(dir.path().join("r.urdf"), &options).unwrap();
        let mesh = &loaded.value.surfaces[0].meshes[0];
        let corner = |i: u32| mesh.vertices[i as usize];
        let part = |t: &[u32; 3]| corner(t[0]).dot(&corner(t[1]).cross(&corner(t[2])));
        let far = mesh.vertices.iter().map(|v| v.x).fold(0.0, |a: f64, x| if x.abs() > a.abs() { x } else { a });
        (mesh.triangles.iter().map(part).sum::<f64>() / 6.0, far)
    };
    let (inside, far) = volume("1 1 1");
    let (mirrored, other) = volume("-1 1 1");
    assert!(inside > 0.0 && (inside - mirrored).abs() < 1e-12, "its outside stays outside: {inside} {mirrored}");
    assert!((far + other).abs() < 1e-12, "{far} {other}");
    let warnings = |scale: &str| parse_urdf("r.urdf", &text(scale), &options).unwrap().warnings;
    assert!(warnings("1 1 1").is_empty() && warnings("-1 1 1").is_empty());
    for short in ["0.001 0.001 0.001", "0.01 0.01 0.01"] {
        assert!(warnings(short)[0].message().contains("too small"), "{:?}", warnings(short));
    }
    assert!(warnings("1000 1000 1000")[0].message().contains("m long"));
    assert!(warnings("1 1 0.001")[0].message().contains("very different factors"));
}

#[test]
fn links_that_only_show_are_all_named_and_fitted_if_asked() {
    let visual = "<visual><origin xyz=\"0 0 0.1\"/><geometry><box size=\"0.1 0.1 0.1\"/></geometry></visual>";
    let text = chain("", (LIMIT, LIMIT))
        .replace(BALL, visual)
        .replace("<link name=\"a\"/>", &format!("<link name=\"a\">{visual}{BALL}</link>"));
    let (robot, warnings) = read(&text);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(warning.message().contains("`b`, `c`") && warning.remedy().contains("--visual"), "{warning:?}");
    assert_eq!((robot.bare.join(" "), warning.line()), ("b c".to_owned(), 3));
    // The written file repeats the warning when it is read.
    let again = parse_robot("r.xml", &write_robot(&robot)).unwrap();
    assert_eq!(again.value.bare, robot.bare);
    let [told] = &again.warnings[..] else { panic!("{:?}", again.warnings) };
    assert!(told.message().contains("`b`, `c`") && told.line() > 1, "{told:?}");
    let options = UrdfOptions { visual: true, ..UrdfOptions::default() };
    let fitted = parse_urdf("r.urdf", &text, &options).unwrap();
    assert!(fitted.warnings.is_empty() && fitted.value.bare.is_empty(), "{:?}", fitted.warnings);
    let boxes = fitted.value.nodes.iter().flat_map(|n| &n.solids).filter(|p| matches!(p.shape, Shape::Box { .. }));
    let places: Vec<f64> = boxes.map(|p| p.pose.translation.z).collect();
    assert_eq!(places, [0.1, 0.1], "and the visual of a link that has a collision is not");
    assert!(fitted.value.pairs.reflex.len() > robot.pairs.reflex.len() || !fitted.value.left_out.unwrap().is_empty());
    // Visual shapes are not read otherwise, so they can't stop a conversion.
    let odd = text.replace("<box size=\"0.1 0.1 0.1\"/>", "<mesh filename=\"none.stl\"/>");
    assert!(parse_urdf("r.urdf", &odd, &UrdfOptions::default()).is_ok());
    assert!(parse_urdf("r.urdf", &odd, &options).unwrap_err().message().contains("none.stl"));
    for bad in ["<bare/>", "<bare link=\"\"/>"] {
        let text = format!(
            "<ZeroPositionKinematicTree robotName=\"r\"><bodypart name=\"p\"><link z=\"1\"/></bodypart>{bad}</ZeroPositionKinematicTree>"
        );
        assert!(parse_robot("r.xml", &text).unwrap_err().message().contains("<bare> names no link"));
    }
}

#[test]
fn a_joint_that_is_held_has_no_motor_and_its_followers_stand_with_it() {
    let text = chain("", (LIMIT, &format!("{LIMIT}<mimic joint=\"j1\" multiplier=\"0.5\"/>")));
    let held = |name: &str, at: f64| UrdfOptions { held: [(name.to_owned(), at)].into(), ..UrdfOptions::default() };
    let still = parse_urdf("r.urdf", &text, &held("j1", 0.5)).unwrap().value;
    assert!(still.motors.is_empty());
    let follower = parse_urdf("r.urdf", &text, &held("j2", 0.5)).unwrap().value;
    assert_eq!(follower.motors.len(), 1, "what follows is driven by its leader");
}
