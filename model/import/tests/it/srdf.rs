//! SRDF: groups, poses and pairs map to the robot's motors and links, and mismatches with the URDF are reported.

use super::robots_corpus::{files, installed};
use mobee_import::{
    LinkTree, Srdf, UrdfOptions, load_link_tree, load_srdf, load_urdf, parse_link_tree, parse_srdf, parse_urdf,
};
use mobee_model::{Part, Robot, parse_robot, write_robot};

/// base -shoulder-> upper -elbow-> lower -mount-> hand -finger-> tip, and a head on the base.
fn urdf() -> String {
    let link = |n: &str| format!("<link name=\"{n}\"/>");
    let joint = |name: &str, kind: &str, parent: &str, child: &str| {
        format!(
            "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>\
             <origin xyz=\"0 0 0.1\"/><limit lower=\"-1\" upper=\"2\" effort=\"1\" velocity=\"1\"/></joint>"
        )
    };
    let links: String = ["base", "upper", "lower", "hand", "tip", "head"].map(link).concat();
    let joints = joint("shoulder", "revolute", "base", "upper")
        + &joint("elbow", "revolute", "upper", "lower")
        + &joint("mount", "fixed", "lower", "hand")
        + &joint("finger", "revolute", "hand", "tip")
        + &joint("neck", "revolute", "base", "head");
    format!("<robot name=\"r\">{links}{joints}</robot>")
}

fn tree() -> LinkTree {
    parse_link_tree("r.urdf", &urdf()).unwrap()
}

fn read(inner: &str) -> (Srdf, Vec<String>) {
    let loaded = parse_srdf("r.srdf", &format!("<robot name=\"r\">\n{inner}</robot>"), &tree()).unwrap();
    (loaded.value, loaded.warnings.iter().map(ToString::to_string).collect())
}

#[test]
fn a_group_is_the_motors_of_its_joints_links_chains_and_groups() {
    let (srdf, warnings) = read(
        "<group name=\"chain\"><chain base_link=\"base\" tip_link=\"hand\"/></group>\
         <group name=\"middle\"><chain base_link=\"upper\" tip_link=\"tip\"/></group>\
         <group name=\"links\"><link name=\"base\"/><link name=\"head\"/></group>\
         <group name=\"joints\"><joint name=\"elbow\"/><joint name=\"mount\"/></group>\
         <group name=\"all\"><group name=\"chain\"/><group name=\"links\"/><group name=\"joints\"/></group>\
         <group name=\"circle\"><group name=\"circle\"/><group name=\"all\"/></group>",
    );
    assert!(warnings.is_empty(), "{warnings:?}");
    let robot = parse_urdf("r.urdf", &urdf(), &UrdfOptions::default()).unwrap().value;
    let motors = |group: &str| -> Vec<&str> {
        srdf.motors_of(group, &tree(), &robot).iter().map(|m| robot.motors[*m].name.as_str()).collect()
    };
    assert_eq!(motors("chain"), ["shoulder", "elbow"]);
    assert_eq!(motors("middle"), ["elbow", "finger"]);
    assert_eq!(motors("links"), ["neck"]);
    assert_eq!(motors("joints"), ["elbow"]);
    assert_eq!(motors("all"), ["shoulder", "neck", "elbow"]);
    assert_eq!(motors("circle"), motors("all"));
    assert!(motors("none").is_empty());
}

#[test]
fn a_named_pose_is_put_into_home_within_the_limits() {
    let (srdf, _) = read(
        "<group name=\"arm\"><joint name=\"elbow\"/></group><group name=\"rest\"><joint name=\"neck\"/></group>\
         <group_state name=\"ready\" group=\"arm\"><joint name=\"elbow\" value=\"1\"/></group_state>\
         <group_state name=\"Home\" group=\"arm\"><joint name=\"elbow\" value=\"0.5\"/></group_state>\
         <group_state name=\"Home\" group=\"rest\"><joint name=\"neck\" value=\"3\"/><joint name=\"elbow\" value=\"1 2\"/></group_state>",
    );
    let robot = parse_urdf("r.urdf", &urdf(), &UrdfOptions::default()).unwrap().value;
    assert_eq!(srdf.home(), Some("Home"));
    assert_eq!(srdf.pose("Home", &robot), Some(vec![0.0, 2.0, 0.5, 0.0]));
    assert_eq!(srdf.pose("none", &robot), None);
}

#[test]
fn a_pair_is_left_out_for_its_reason_whichever_comes_first() {
    let (srdf, _) = read(
        "<disable_collisions link1=\"tip\" link2=\"head\" reason=\"Never\"/>\
         <disable_collisions link1=\"base\" link2=\"upper\" reason=\"Adjacent\"/>",
    );
    assert_eq!(srdf.disabled_reason("head", "tip"), Some("Never"));
    assert_eq!(srdf.disabled_reason("upper", "base"), Some("Adjacent"));
    assert_eq!(srdf.disabled_reason("tip", "base"), None);
}

#[test]
fn names_that_the_urdf_does_not_have_are_warned_of_at_their_place() {
    let (_, warnings) = read(
        "<virtual_joint name=\"root\" type=\"floating\" parent_frame=\"world\" child_link=\"base\"/>\n\
         <group name=\"g\"><joint name=\"root\"/><joint name=\"knee\"/></group>\n\
         <disable_collisions link1=\"foot\" link2=\"base\"/>\n\
         <group_state name=\"s\" group=\"legs\"/>\n\
         <disable_default_collisions link=\"base\"/>\n\
         <gripper name=\"for another program\"/>",
    );
    let expected = [
        "r.srdf:3:37: the URDF has no joint `knee`",
        "r.srdf:4:1: the URDF has no link `foot`",
        "r.srdf:6:1: <disable_default_collisions> has no effect",
        "r.srdf:5:1: there is no group `legs`",
        "r.srdf:7:1: not used, as no SRDF has these words: <gripper> in <robot>",
    ];
    assert_eq!(warnings, expected);
}

#[test]
fn a_chain_that_leads_nowhere_is_refused_with_its_place() {
    let chain = |base: &str, tip: &str| {
        let text = format!(
            "<robot name=\"r\">\n<group name=\"g\"><chain base_link=\"{base}\" tip_link=\"{tip}\"/></group></robot>"
        );
        parse_srdf("r.srdf", &text, &tree())
    };
    for (base, tip, message, remedy) in [
        ("head", "tip", "`tip` does not hang on `head`", "between the root and the tip"),
        ("tip", "base", "runs towards the root", "base_link=\"base\" tip_link=\"tip\""),
        ("hand", "hand", "has no joint", "tip_link"),
    ] {
        let error = chain(base, tip).expect_err(message);
        assert!(error.message().contains("group `g`") && error.message().contains(message), "{error}");
        assert!(error.remedy().contains(remedy) && error.line() == 2, "{error:?}");
    }
    for (base, tip) in [("nobody", "tip"), ("base", "nobody"), ("nobody", "noone")] {
        let loaded = chain(base, tip).unwrap();
        assert!(
            loaded.warnings.iter().any(|w| w.message().contains("group `g` is without its chain")),
            "{:?}",
            loaded.warnings
        );
        assert!(loaded.value.joints_of("g", &tree()).is_empty(), "{base} {tip}: no chain is made up");
    }
}

#[test]
fn poses_that_can_not_be_taken_as_they_are_say_so() {
    let state = |name: &str, joint: &str, value: &str| {
        format!("<group_state name=\"{name}\" group=\"g\"><joint name=\"{joint}\" value=\"{value}\"/></group_state>")
    };
    let group = "<group name=\"g\"><joint name=\"elbow\"/></group>\n";
    let read = |states: &str| read(&format!("{group}{states}"));
    let (srdf, warnings) = read(&(state("home", "elbow", "2.5") + &state("low", "elbow", "-1.00001")));
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(
        warnings[0].contains("r.srdf:3:1: pose `home`") && warnings[0].contains("`elbow` at 114.6 deg, not 143.2 deg"),
        "{warnings:?}"
    );
    let robot = parse_urdf("r.urdf", &urdf(), &UrdfOptions::default()).unwrap().value;
    let elbow = robot.motors.iter().position(|m| m.name == "elbow").unwrap();
    assert_eq!((srdf.beyond("home", &robot), srdf.beyond("low", &robot)), (vec![(elbow, 2.5)], vec![]));
    let (_, warnings) = read(&(state("home", "elbow", "1") + &state("home", "elbow", "0.5")));
    assert!(warnings.len() == 1 && warnings[0].contains("an earlier pose `home`"), "{warnings:?}");
    let (srdf, warnings) = read(&(state("home", "elbow", "1 2") + &state("home", "mount", "0")));
    assert!(warnings.len() == 1 && warnings[0].contains("`1 2`"), "{warnings:?}");
    assert!(srdf.notes.iter().any(|n| n.contains("without a motor: `mount`")), "{:?}", srdf.notes);
    let twice = "<robot><group_state name=\"a\" group=\"b\"><joint name=\"elbow\" value=\"1\"/><joint name=\"elbow\" value=\"2\"/></group_state></robot>";
    assert!(parse_srdf("r.srdf", twice, &tree()).unwrap_err().message().contains("two positions of `elbow`"));
}

#[test]
fn a_passive_joint_stands_where_home_has_it() {
    let (srdf, warnings) = read(
        "<group_state name=\"home\" group=\"g\"><joint name=\"finger\" value=\"0.5\"/><joint name=\"neck\" value=\"7\"/></group_state>\
         <passive_joint name=\"finger\"/><passive_joint name=\"neck\"/><passive_joint name=\"elbow\"/><passive_joint name=\"mount\"/>",
    );
    assert!(warnings.len() == 1 && warnings[0].contains("there is no group `g`"), "{warnings:?}");
    let held = srdf.held(&tree());
    assert_eq!(held, [("finger", 0.5), ("neck", 2.0), ("elbow", 0.0)].map(|(n, q)| (n.to_owned(), q)).into());
    let robot = parse_urdf("r.urdf", &urdf(), &UrdfOptions { held, ..UrdfOptions::default() }).unwrap().value;
    let motors: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(motors, ["shoulder"]);
}

#[test]
fn words_of_an_srdf_that_are_not_used_are_named() {
    let (srdf, warnings) = read(
        "<virtual_joint name=\"root\" type=\"fixed\" parent_frame=\"w\" child_link=\"base\"/>\
         <group name=\"g\" tips=\"a\"><joint name=\"elbow\"/><jiont name=\"neck\"/></group>\
         <end_effector name=\"e\" parent_link=\"hand\" group=\"g\"/><disable_colisions/>",
    );
    assert!(
        srdf.notes.iter().any(|n| n.contains("<end_effector>") && n.contains("<virtual_joint>")),
        "{:?}",
        srdf.notes
    );
    for word in ["`tips` of <group>", "<jiont> in <group>", "<disable_colisions> in <robot>"] {
        assert!(warnings.iter().any(|w| w.contains(word)), "{word}: {warnings:?}");
    }
}

#[test]
fn what_is_wrong_in_an_srdf_is_told_with_its_place() {
    let cases = [
        ("", "no element"),
        ("<sdf/>", "does not begin an SRDF"),
        ("<robot><link name=\"a\"/></robot>", "this is no SRDF"),
        ("<robot><xacro:include/></robot>", "this is no SRDF"),
        ("<robot><group/></robot>", "<group> without `name`"),
        ("<robot><group name=\"a\"/><group name=\"a\"/></robot>", "already"),
        ("<robot><group name=\"a\"><chain base_link=\"base\"/></group></robot>", "without `tip_link`"),
        ("<robot><disable_collisions link1=\"base\"/></robot>", "without `link2`"),
        ("<robot><group_state group=\"a\"/></robot>", "without `name`"),
        (
            "<robot><group_state name=\"a\" group=\"b\"><joint name=\"elbow\" value=\"nan\"/></group_state></robot>",
            "`nan`",
        ),
        (
            "<robot><group_state name=\"a\" group=\"b\"><joint name=\"elbow\" value=\"\"/></group_state></robot>",
            "without `value`",
        ),
        ("<!DOCTYPE robot [<!ENTITY a \"b\">]><robot/>", "document type"),
        ("<robot><group name=\"a&#x9b;31m\"/></robot>", "hidden character"),
        ("<robot>", "never closed"),
    ];
    for (text, expected) in cases {
        let error = parse_srdf("r.srdf", text, &tree()).expect_err(text);
        assert!(error.message().contains(expected) && !error.remedy().is_empty(), "{text}: {error:?}");
    }
    let many = format!("<robot>{}</robot>", "<passive_joint name=\"x\"/>".repeat(30_000));
    assert_eq!(parse_srdf("r.srdf", &many, &tree()).unwrap().warnings.len(), 100);
}

/// SRDF files in use are read, and match the links and joints of the robot beside them.
#[test]
fn the_srdf_files_of_other_people_are_read() {
    let Some(share) = installed() else { return };
    let all = files(&share, "srdf");
    assert_eq!(all.len(), 38);
    for path in all {
        let srdf = load_srdf(&path, &LinkTree::default()).unwrap().value;
        assert!(!srdf.groups.is_empty() || !srdf.states.is_empty() || !srdf.disabled.is_empty(), "{}", path.display());
    }
    let robots = share.join("example-robot-data/robots");
    let (urdf, srdf) = (robots.join("talos_data/robots/talos_reduced.urdf"), robots.join("talos_data/srdf/talos.srdf"));
    let tree = load_link_tree(&urdf).unwrap();
    let loaded = load_srdf(srdf, &tree).unwrap();
    let robot = load_urdf(urdf, &UrdfOptions { drop_meshes: true, ..UrdfOptions::default() }).unwrap().value;
    let motors = |group: &str| loaded.value.motors_of(group, &tree, &robot).len();
    assert_eq!(["l_leg", "l_arm", "head", "torso", "all_legs"].map(motors), [6, 7, 2, 2, 12], "{:?}", loaded.warnings);
    assert!(loaded.value.pose("half_sitting", &robot).unwrap().iter().any(|q| *q != 0.0));
}

#[test]
fn groups_become_parts_of_which_each_motor_has_one() {
    let (srdf, _) = read(
        "<group name=\"all\"><group name=\"arm\"/><group name=\"hand\"/></group>\
         <group name=\"arm\"><chain base_link=\"base\" tip_link=\"hand\"/></group>\
         <group name=\"fixed\"><joint name=\"mount\"/></group>\
         <group name=\"forearm\"><joint name=\"elbow\"/></group>\
         <group name=\"hand\"><joint name=\"finger\"/></group>",
    );
    let mut robot = parse_urdf("r.urdf", &urdf(), &UrdfOptions::default()).unwrap().value;
    let before = robot.clone();
    let parts = srdf.parts(&tree(), &robot);
    assert_eq!(parts.passed_over, ["all", "forearm"]);
    robot.divide(&parts.parts);
    let named =
        |r: &Robot, p: &Part| -> Vec<String> { r.motors[p.motors.clone()].iter().map(|m| m.name.clone()).collect() };
    let all: Vec<_> = robot.parts.iter().map(|p| (p.name.as_str(), named(&robot, p))).collect();
    let motors = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<String>>();
    assert_eq!(all, [("arm", motors(&["shoulder", "elbow"])), ("hand", motors(&["finger"])), ("r", motors(&["neck"]))]);
    // The same robot except for the order of its motors, also when it is read again.
    let again = parse_robot("r.xml", &write_robot(&robot)).unwrap();
    assert!(again.warnings.is_empty(), "{:?}", again.warnings);
    let again = again.value;
    let parts = |r: &Robot| -> Vec<_> { r.parts.iter().map(|p| (p.name.clone(), p.motors.clone())).collect() };
    assert_eq!(parts(&again), parts(&robot));
    let motors = |r: &Robot| -> Vec<_> { r.motors.iter().map(|m| (m.name.clone(), m.part, m.is_part_root)).collect() };
    assert_eq!(motors(&again), motors(&robot));
    let pose = |r: &Robot| -> Vec<f64> { r.motors.iter().map(|m| 0.1 * m.name.len() as f64).collect() };
    for other in [&robot, &again] {
        for (marker, place) in before.markers.iter().zip(before.markers_at(&pose(&before))) {
            let at = other.markers.iter().position(|m| m.name == marker.name).unwrap();
            let there = &other.markers_at(&pose(other))[at];
            assert!((place.position() - there.position()).norm() < 1e-12, "{}: {place:?} {there:?}", marker.name);
        }
    }
}

#[test]
fn a_division_that_is_none_changes_nothing() {
    let mut robot = parse_urdf("r.urdf", &urdf(), &UrdfOptions::default()).unwrap().value;
    let before = robot.clone();
    for motors in [vec![], vec![0, 1, 2], vec![0, 1, 2, 2], vec![0, 1, 2, 4]] {
        robot.divide(&[("arm".into(), motors)]);
        assert_eq!(robot, before);
    }
}
