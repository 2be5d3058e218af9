//! Robot and world files: accepted and rejected input, and the locations of messages.

use mobee_model::{FileError, ObjectClass, load_robot, parse_robot, parse_world, write_robot};
use proptest::prelude::*;

fn edge() -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/edge/edge_a.xml");
    std::fs::read_to_string(path).unwrap()
}

/// A robot with one motor; `inner` is inserted into its joint.
fn robot(inner: &str) -> String {
    format!(
        "<ZeroPositionKinematicTree version=\"1.0\" robotName=\"r\">\n<bodypart name=\"p\">\n<motor name=\"m\" minPos=\"-10\" maxPos=\"20\">\n<joint z=\"1\">\n{inner}\n</joint>\n</motor>\n</bodypart>\n</ZeroPositionKinematicTree>"
    )
}

fn refused(text: &str) -> FileError {
    let error = parse_robot("r.xml", text).expect_err("should be refused");
    assert!(!error.remedy().is_empty() && error.line() > 0 && error.column() > 0, "{error:?}");
    error
}

/// Checks that the error is located at the first occurrence of `marked` in the text.
fn points_at(text: &str, marked: &str, says: &str) {
    let error = refused(text);
    let at = text.find(marked).unwrap();
    let line = text[..at].matches('\n').count() + 1;
    let column = at - text[..at].rfind('\n').map_or(0, |n| n + 1) + 1;
    assert_eq!((error.line(), error.column()), (line, column), "{error}");
    assert!(error.message().contains(says), "{error}");
}

#[test]
fn a_missing_file_is_named_with_a_remedy() {
    let error = load_robot("no/such/robot.xml").unwrap_err();
    assert_eq!(error.file(), "no/such/robot.xml");
    assert!(error.remedy().contains("path"));
}

#[test]
fn each_mistake_is_told_at_its_place() {
    points_at(&robot("<link x=\"abc\"/>"), "abc", "not a number");
    points_at(&robot("<link x=\"NaN\"/>"), "NaN", "beyond");
    points_at(&robot("<link x=\"1e7\"/>"), "1e7", "beyond");
    points_at(&robot("<link/>"), "link", "no direction");
    points_at(&robot("<sphere radius=\"0\"/>"), "0\"/>", "above 0");
    points_at(&robot("<sphere/>"), "sphere", "no `radius`");
    points_at(&robot("<link x=\"1\" radius=\"-2\"/>"), "-2", "negative");
    points_at(&robot("<joint x=\"1\" minPos=\"5\" maxPos=\"-5\"/>"), "5\" maxPos", "limits reversed");
    points_at(&robot("<joint x=\"1\" type=\"screw\"/>"), "screw", "not supported");
    points_at(&robot("<link x=\"1\" x=\"2\"/>"), "x=\"2\"", "twice");
    points_at(&robot("<link x=\"&own;\"/>"), "&own;", "cannot be read");
    points_at(&robot("<link x=\"1\">"), "</joint>", "closes <link>");
    points_at(&robot("hello"), "hello", "text");
    points_at(&robot("<constraintList></constraintList>"), "constraintList", "never be satisfied");
    points_at(
        &robot("<constraintList><constraint a=\"1\" q=\"1\"/></constraintList>"),
        "1\"/></c",
        "no motor with index 1",
    );
    points_at(&robot("<constraintList><constraint a=\"1 2\" q=\"0\"/></constraintList>"), "0\"/></c", "`a` has 2");
    points_at(&robot("<marker name=\"a\"/><marker name=\"a\"/>"), "a\"/>\n", "already");
    points_at(
        &robot("<bodypart name=\"h\"><motor name=\"k\" idx=\"1\"/></bodypart>"),
        "bodypart name=\"h\"",
        "index 0",
    );
    points_at(&robot("<motor name=\"k\" idx=\"0\"/>"), "0\"/>\n", "taken by motor `m`");
    points_at(&robot("<sphere radius=\"1\" hull=\"0 1\"/>"), "0 1", "no multiple of three");
    points_at(&robot("<sphere radius=\"1\" hull=\"0 1 x\"/>"), "0 1 x", "no usable number");
    points_at(&robot("<sphere radius=\"1\" hull=\"\"/>"), "\"/>\n", "0 points");
    points_at(&robot("<sphere radius=\"1\" hull=\"0 0 0.9\" hullRadius=\"-7.5\"/>"), "-7.5", "negative");
    points_at(&robot("<sphere radius=\"1\" hull=\"0 0 0.9\" hullRadius=\"0.2\"/>"), "0 0 0.9", "sticks out");
    points_at(&robot("<sphere radius=\"1\" field=\"true\" hull=\"0 0 0\"/>"), "0 0 0", "force field");
    let crowd = "0 0 0 ".repeat(113);
    points_at(&robot(&format!("<sphere radius=\"1\" hull=\"{crowd}\"/>")), &crowd, "113 points");
}

#[test]
fn what_stands_in_the_wrong_place_is_refused() {
    let outer = |inner: &str| format!("<ZeroPositionKinematicTree>\n{inner}\n</ZeroPositionKinematicTree>");
    for (inner, says) in [
        ("<link x=\"1\"/>", "outside any body part"),
        ("<bodypart name=\"p\"><joint x=\"1\"/></bodypart>", "outside any motor"),
        ("<bodypart name=\"p\"><sphere radius=\"1\"/></bodypart>", "outside any link or joint"),
        ("<bodypart name=\"p\"><marker name=\"m\"/></bodypart>", "outside any link or joint"),
        ("", "no links"),
    ] {
        let error = refused(&outer(inner));
        assert!(error.message().contains(says), "{error}");
    }
    for text in ["", "  \n", "<robot name=\"x\"/>", "<ZeroPositionKinematicTree>", "<WorldList/>", "<", "<a/><b/>"] {
        refused(text);
    }
}

#[test]
fn unknown_names_only_warn() {
    let text = robot("<link x=\"1\" Radius=\"3\"/><wheel/>");
    let loaded = parse_robot("r.xml", &text).unwrap();
    let said: Vec<String> = loaded.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].starts_with("r.xml:5:13:") && said[0].contains("Radius"), "{}", said[0]);
    assert!(said[1].contains("<wheel>"), "{}", said[1]);
    assert!(loaded.warnings.iter().all(FileError::is_warning));
}

#[test]
fn too_deep_and_too_many_are_refused() {
    let deep = "<link x=\"1\">".repeat(2000);
    assert!(refused(&robot(&deep)).message().contains("deep"));
    let many = "<link x=\"1\"/>".repeat(5000);
    assert!(refused(&robot(&many)).message().contains("more than"));
    let motors: String = (0..5000).map(|i| format!("<motor name=\"m{i}\"/>")).collect();
    assert!(refused(&robot(&motors)).message().contains("more than"));
    let attributes: String = (0..100).map(|i| format!(" a{i}=\"1\"")).collect();
    assert!(refused(&robot(&format!("<link x=\"1\"{attributes}/>"))).message().contains("attributes"));
    let unknown = robot(&"<wheel/>".repeat(50_000));
    assert_eq!(parse_robot("r.xml", &unknown).unwrap().warnings.len(), 100);
}

#[test]
fn the_quirks_of_motors_are_kept() {
    let robot = parse_robot("edge_a.xml", &edge()).unwrap().value;
    let names: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["M_first", "M_free", "M_late", "G_a", "G_b"], "idx sets the order");
    let late = &robot.motors[2];
    assert!(late.is_part_root, "the first created, whatever its idx");
    assert_eq!(late.home, 60_f64.to_radians(), "home is clamped to the limits");
    assert_eq!(robot.motors[3].joints, [8, 12], "a motor entered again by name drives both joints");
    assert_eq!((robot.motors[1].min, robot.motors[1].max), ((-1_f64).to_radians(), 1_f64.to_radians()));
}

#[test]
fn a_part_entered_again_gives_way_to_the_part_around_its_first_mention() {
    let text = "<ZeroPositionKinematicTree robotName=\"r\"><bodypart name=\"a\"><link x=\"1\"/></bodypart>\
        <bodypart name=\"b\"><link x=\"1\"><bodypart name=\"a\"><link x=\"1\"/></bodypart><link x=\"1\"/></link></bodypart>\
        </ZeroPositionKinematicTree>";
    assert!(refused(text).message().contains("outside any body part"));
}

#[test]
fn a_capsule_takes_the_place_of_the_automatic_cylinder() {
    let text =
        robot("<link x=\"0.3\" radius=\"0.05\" capsule=\"true\"/><capsule radius=\"0.1\" height=\"0.2\" pz=\"1\"/>");
    let robot = parse_robot("r.xml", &text).unwrap().value;
    let shape = robot.nodes[1].solids[0].shape;
    assert_eq!(shape, mobee_model::Shape::Capsule { radius: 0.05, height: 0.3 });
    assert_eq!(robot.nodes[0].solids.len(), 1);
}

#[test]
fn links_and_joints_have_colors_that_are_written_again() {
    let text = robot("<link x=\"0.3\" r=\"190\" g=\"40\"><sphere radius=\"0.1\"/></link>");
    let read = parse_robot("r.xml", &text).unwrap();
    assert!(read.warnings.is_empty());
    let colors: Vec<_> = read.value.nodes.iter().map(|n| n.color).collect();
    assert_eq!(colors, [None, Some([190, 40, 0])]);
    assert_eq!(parse_robot("again.xml", &mobee_model::write_robot(&read.value)).unwrap().value, read.value);
    points_at(&robot("<link x=\"1\" b=\"256\"/>"), "256", "outside 0 to 255");
}

#[test]
fn a_world_has_obstacles_targets_and_ghosts() {
    let text = "<WorldList version=\"1.0\"><object name=\"table\" pz=\"-.02\" persistent=\"1\"><box width=\"1\" height=\"2\" depth=\".1\"/></object>\
        <object type=\"target\" r=\"0\" g=\"100\" b=\"0\"><sphere radius=\".05\"/></object><object type=\"ghost\"/></WorldList>";
    let objects = parse_world("w.xml", text).unwrap().value;
    let seen: Vec<_> = objects.iter().map(|o| (o.name.as_str(), o.class, o.persistent, o.color)).collect();
    assert_eq!(
        seen,
        [
            ("table", ObjectClass::Obstacle, true, None),
            ("object1", ObjectClass::Target, false, Some([0, 100, 0])),
            ("object2", ObjectClass::Ghost, false, None)
        ]
    );
}

/// The original program's words are accepted in worlds and in all data with classes (scripts, cues, journals).
#[test]
fn the_originals_words_for_classes_mean_the_same() {
    for (word, original) in [("obstacle", "obs"), ("target", "tgt"), ("ghost", "gho")] {
        let world =
            |word: &str| format!("<WorldList><object type=\"{word}\"><sphere radius=\".05\"/></object></WorldList>");
        let class = |word: &str| parse_world("w.xml", &world(word)).unwrap().value[0].class;
        assert_eq!(class(word), class(original));
        let read: ObjectClass = serde_json::from_str(&format!("\"{original}\"")).unwrap();
        assert_eq!(read, class(word));
        assert_eq!(serde_json::to_string(&read).unwrap(), format!("\"{word}\""), "our own word is written");
    }
}

#[test]
fn a_bad_world_is_refused_at_its_place() {
    for (inner, column, says) in [
        ("<object type=\"wall\"/>", 15, "not an object type"),
        ("<object><object/></object>", 10, "within"),
        ("<sphere radius=\"1\"/>", 2, "outside any object"),
        ("<object name=\"a\"/><object name=\"a\"/>", 33, "already"),
        ("<object r=\"300\"/>", 12, "outside 0 to 255"),
        ("<object><sphere radius=\"x\"/></object>", 25, "not a number"),
    ] {
        let error = parse_world("w.xml", &format!("<WorldList>\n{inner}\n</WorldList>")).unwrap_err();
        assert_eq!((error.line(), error.column()), (2, column), "{error}");
        assert!(error.message().contains(says), "{error}");
    }
}

#[test]
fn the_examples_of_the_reference_load_without_a_warning() {
    let doc = include_str!("../../../../docs/zrp.md");
    let blocks: Vec<&str> = doc.split("```xml\n").skip(1).filter_map(|b| b.split("```").next()).collect();
    let robot = blocks.iter().find(|b| b.starts_with("<Zero")).expect("an example of a robot");
    let world = blocks.iter().find(|b| b.starts_with("<World")).expect("an example of a world");
    assert!(parse_robot("doc", robot).unwrap().warnings.is_empty());
    assert!(parse_world("doc", world).unwrap().warnings.is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Any mutation of a file loads or is rejected at a location, without a panic.
    #[test]
    fn a_damaged_file_loads_or_is_refused_at_a_place(
        cuts in prop::collection::vec((0.0..1.0, 0_usize..30, "[<>/=\"'& a-z0-9.\\-\u{0}\u{e9}]{0,6}"), 1..4)
    ) {
        let mut text = edge();
        for (at, len, insert) in cuts {
            let clamp = |i: usize| (0..=i.min(text.len())).rev().find(|i| text.is_char_boundary(*i)).unwrap();
            let start = clamp((at * text.len() as f64) as usize);
            let end = clamp(start + len);
            text.replace_range(start.min(end)..end, &insert);
        }
        match parse_robot("edge.xml", &text) {
            Ok(loaded) => {
                let again = parse_robot("again.xml", &write_robot(&loaded.value));
                prop_assert!(again.is_ok(), "{:?}", again.err());
            }
            Err(error) => prop_assert!(error.line() > 0 && error.column() > 0 && !error.remedy().is_empty()),
        }
    }
}
