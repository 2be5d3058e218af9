//! Promises: for a robot that lists disabled pairs all other pairs are tested; the list is preserved in a file; an
//! unknown name is reported with its location and a suggestion.

use mobee_model::{LeftOut, NearPair, Robot, Scene, Watch, parse_robot, write_robot};
use nalgebra::Isometry3;
use std::sync::Arc;

/// Three links in a row, the last with a bump that is fixed to it.
fn robot(pairs: &str) -> String {
    format!(
        r#"<ZeroPositionKinematicTree robotName="r"><bodypart name="p">
<link name="base" z="0.3" radius="0.05"><motor name="a" minPos="-90" maxPos="90"><joint y="1">
<link name="upper" z="0.3" radius="0.05"><motor name="b" minPos="-90" maxPos="90"><joint y="1">
<link name="fore" z="0.3" radius="0.05"><link name="hand" z="0.1" radius="0.05"/></link>
</joint></motor></link></joint></motor></link>
</bodypart>
{pairs}
</ZeroPositionKinematicTree>"#
    )
}

fn names(robot: &Robot) -> Vec<(&str, &str)> {
    let name = |n: usize| robot.nodes[n].name.as_deref().unwrap_or("?");
    robot.pairs.reflex.iter().map(|(a, b)| (name(*a), name(*b))).collect()
}

#[test]
fn everything_that_can_move_is_tested_but_what_is_left_out() {
    let listed = "<pairs><leaveOut a=\"upper\" b=\"base\" reason=\"neighbors\"/></pairs>";
    let robot = parse_robot("r.xml", &robot(listed)).unwrap().value;
    let expected = [("base", "fore"), ("base", "hand"), ("upper", "fore"), ("upper", "hand")];
    assert_eq!(names(&robot), expected, "and nothing within the rigid body of fore and hand");
    let left_out = robot.left_out.as_deref().unwrap();
    assert_eq!((left_out.len(), left_out[0].reason.as_str()), (1, "neighbors"));
    let near: Vec<bool> = robot.nodes.iter().map(|n| n.near_root).collect();
    let base = near.iter().take_while(|n| **n).count();
    assert_eq!(base, 2, "the base is what no joint moves: its link and the first joint's own shapes");
    assert!(near[base..].iter().all(|n| !n));
}

#[test]
fn without_a_list_the_formats_own_filter_decides() {
    let robot = parse_robot("r.xml", &robot("")).unwrap().value;
    assert_eq!(robot.left_out, None);
    assert!(names(&robot).len() < 4);
}

#[test]
fn a_list_survives_a_file_and_can_be_extended() {
    let mut robot = parse_robot("r.xml", &robot("<pairs/>")).unwrap().value;
    assert_eq!(names(&robot).len(), 5);
    let named = |robot: &Robot, name: &str| robot.node_named(name).unwrap();
    let nodes = (named(&robot, "hand"), named(&robot, "base"));
    let pair = |reason: &str| LeftOut { nodes, reason: reason.into() };
    robot.leave_out([pair("never \"meet\" <in 10,000 poses>"), pair("again")]);
    let again = parse_robot("again.xml", &write_robot(&robot)).unwrap();
    assert!(again.warnings.is_empty(), "{:?}", again.warnings);
    assert_eq!((&again.value.pairs, &again.value.left_out), (&robot.pairs, &robot.left_out));
    assert_eq!(names(&robot).len(), 4);
    assert_eq!(robot.left_out.as_ref().map(Vec::len), Some(1), "the first reason stays");
    let scene = Scene::new(vec![(Arc::new(robot), Isometry3::identity())], vec![]).unwrap();
    let met = scene.contacts(&scene.home(), 1.0);
    assert!(met.iter().any(|c| scene.shape_name(c.pair.1) == "r:fore#0"), "{met:?}");
}

#[test]
fn a_mistake_in_the_list_is_told_at_its_place() {
    let cases = [
        ("<pairs><leaveOut a=\"upper\" b=\"bsae\"/></pairs>", "`bsae`", "did you mean `base`"),
        ("<pairs><leaveOut a=\"upper\"/></pairs>", "no `b`", "name both"),
        ("<pairs><leaveOut a=\"upper\" b=\"upper\"/></pairs>", "twice", "remove"),
        ("<leaveOut a=\"upper\" b=\"base\"/>", "outside <pairs>", "put it into"),
        ("<near a=\"upper\" b=\"base\" clearance=\"0.001\"/>", "<near> is outside <pairs>", "put it into"),
        ("<pairs><near a=\"upper\" b=\"base\"/></pairs>", "no `clearance`", "in meters"),
        ("<pairs><near a=\"upper\" b=\"base\" clearance=\"3\"/></pairs>", "outside 0 to 1 m", "in meters"),
        ("<pairs><near a=\"upper\" b=\"bsae\" clearance=\"0\"/></pairs>", "`bsae`", "did you mean `base`"),
        ("<bodypart name=\"p\"><pairs/></bodypart>", "within another", "directly into"),
        ("<bodypart name=\"p\"><link name=\"base\" z=\"1\"/></bodypart>", "already", "its own name"),
    ];
    for (pairs, message, remedy) in cases {
        let error = parse_robot("r.xml", &robot(pairs)).expect_err(pairs);
        assert!(error.message().contains(message) && error.remedy().contains(remedy), "{error}\n{}", error.remedy());
        assert_eq!(error.line(), 7, "{error}");
    }
}

/// Two fingers, 4 mm apart where the slide is at 0; it moves up to 1 mm nearer and 20 mm away.
const FINGERS: &str = r#"<ZeroPositionKinematicTree robotName="r"><bodypart name="p">
<link name="left" z="0.1"><sphere radius="0.01"/>
<motor name="grip" minPos="-3.5" maxPos="20"><joint x="1" type="prismatic" minPos="-0.0035" maxPos="0.02">
<link name="right" z="0.01"><sphere radius="0.01" px="0.024" pz="-0.1"/></link></joint></motor></link>
</bodypart><pairs><near a="left" b="right" clearance="0.003" reason="fingers"/></pairs></ZeroPositionKinematicTree>"#;

#[test]
fn a_pair_with_a_clearance_of_its_own_is_tested_at_that_by_every_query() {
    let robot = parse_robot("r.xml", FINGERS).unwrap().value;
    let again = parse_robot("again.xml", &write_robot(&robot)).unwrap();
    assert!(again.warnings.is_empty() && again.value == robot, "{:?} {:?}", again.warnings, again.value.near);
    assert_eq!((robot.near.len(), robot.near[0].reason.as_str()), (1, "fingers"));
    for (more, what) in [
        (r#"<near a="right" b="left" clearance="0.002"/>"#, "the lower one applies"),
        (r#"<leaveOut a="left" b="right"/>"#, "is not tested"),
    ] {
        let file = FINGERS.replace("</pairs>", &format!("{more}</pairs>"));
        let warnings = parse_robot("r.xml", &file).unwrap().warnings;
        assert!(warnings.iter().any(|w| w.to_string().contains(what)), "{more}: {warnings:?}");
    }
    let mut lower = robot.clone();
    let near = |clearance| NearPair { clearance, ..robot.near[0].clone() };
    lower.bring_near([near(0.001), near(0.002)]);
    assert_eq!(lower.near, [NearPair { reason: "fingers".into(), ..near(0.001) }], "the lower one counts");

    let scene = Arc::new(Scene::new(vec![(Arc::new(robot), Isometry3::identity())], vec![]).unwrap());
    let at = |mm: f64| [[mm.to_radians()]];
    let mut watch = Watch::new(scene.clone(), 0.01);
    // (the slide, mm; free at 10 mm; free at 1 mm)
    for (mm, wide, close) in
        [(0.0, true, true), (-0.9, true, true), (-1.1, false, true), (-3.2, false, false), (9.0, true, true)]
    {
        let q = at(mm);
        assert_eq!([scene.free(&q, 0.01), scene.free(&q, 0.001)], [wide, close], "{mm}");
        assert_eq!(scene.robot_free(0, &q, 0.01), wide, "{mm}");
        assert_eq!(scene.contacts(&q, 0.01).is_empty(), wide, "{mm}");
        assert_eq!(scene.clearance(&q, 0.01).is_none(), wide, "{mm}");
        assert_eq!(watch.update(&q).is_empty(), wide, "{mm}");
    }
    let line = |to: f64, clearance| scene.line(0, &at(0.0), &at(9.0)[0], &at(to)[0], 1e-4, clearance);
    let stops = line(-2.0, 0.01);
    // 3 mm are left where the slide is at -1 mm: 10 of 11 mm along the line
    assert!(!stops.free && stops.at.is_some_and(|at| (at - 10.0 / 11.0).abs() < 0.02), "{stops:?}");
    assert!(line(-0.9, 0.01).free && line(-2.0, 0.001).free, "{:?}", line(-0.9, 0.01));
    assert!(scene.line_free(0, &at(0.0), &at(9.0)[0], &at(-0.9)[0], 1e-4, 0.01));
}
