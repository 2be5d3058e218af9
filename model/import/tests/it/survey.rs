//! Random poses determine disabled pairs of links, false contacts of shapes, and a home for the robot.

use mobee_import::{
    Comparison, FitOptions, PairSurvey, RefitLimits, Refitted, Surfaces, UrdfOptions, UrdfRobot, compare,
    find_disabled_pairs, find_home, fit_closer, load_urdf_with_surfaces,
};

use mobee_model::{Robot, Scene};
use nalgebra::Isometry3;
use std::sync::Arc;

/// A slider that moves in the hollow of an angle iron: the meshes never intersect, but single shapes around each do.
fn hollow() -> (Robot, Surfaces) {
    let loaded = iron_and_slider(0.01);
    let surfaces = Surfaces::new(&loaded.robot, &loaded.surfaces).unwrap();
    (loaded.robot, surfaces)
}

/// The slider also rotates in the hollow, by this many rad to either side.
fn iron_and_slider(turn: f64) -> UrdfRobot {
    let iron = "v 0 0 0\nv 0.2 0 0\nv 0.2 0.2 0\nv 0 0.2 0\nv 0 0 0.2\nv 0 0.2 0.2\nf 1 2 3 4\nf 1 4 6 5\n";
    beside_slider(iron, "0.05 0.02 0.05", turn)
}

/// A mesh, and the slider at a position beside it, which rotates about the y axis.
fn beside_slider(iron: &str, at: &str, turn: f64) -> UrdfRobot {
    let folder = tempfile::tempdir().unwrap();
    let slider = "v 0 0 0\nv 0.03 0 0\nv 0 0.03 0\nv 0 0 0.03\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n";
    std::fs::write(folder.path().join("iron.obj"), iron).unwrap();
    std::fs::write(folder.path().join("slider.obj"), slider).unwrap();
    let mesh = |file: &str, xyz: &str| {
        format!("<collision><origin xyz=\"{xyz}\"/><geometry><mesh filename=\"{file}\"/></geometry></collision>")
    };
    let text = format!(
        "<robot name=\"r\"><link name=\"base\">{}</link><link name=\"stem\"/><link name=\"slider\">{}</link>\
         <joint name=\"turn\" type=\"revolute\"><parent link=\"base\"/><child link=\"stem\"/><axis xyz=\"0 1 0\"/>\
         <limit lower=\"-{turn}\" upper=\"{turn}\" effort=\"1\" velocity=\"1\"/></joint>\
         <joint name=\"slide\" type=\"prismatic\"><parent link=\"stem\"/><child link=\"slider\"/><axis xyz=\"0 1 0\"/>\
         <limit lower=\"0\" upper=\"0.1\" effort=\"1\" velocity=\"1\"/></joint></robot>",
        mesh("iron.obj", "0 0 0"),
        mesh("slider.obj", at),
    );
    let path = folder.path().join("r.urdf");
    std::fs::write(&path, text).unwrap();
    let fit = FitOptions { overshoot: 1.0, primitives: 1 };
    load_urdf_with_surfaces(path, &UrdfOptions { fit, ..UrdfOptions::default() }).unwrap().value
}

#[test]
fn what_never_meets_and_few_motors_move_is_spared_with_its_reason() {
    let (mut robot, surfaces) = hollow();
    // Links without shapes are skipped when neighbors are determined, so this pair is tested again only without its
    // line.
    robot.left_out = None;
    robot.leave_out([]);
    let found = find_disabled_pairs(&robot, &surfaces, (300, 1), &mut |_| ()).unwrap();
    assert_eq!((found.left_out.len(), found.near.len()), (1, 0), "{found:?}");
    assert!(found.left_out[0].reason.contains("300 poses"), "{found:?}");
    assert_eq!(
        found,
        find_disabled_pairs(&robot, &surfaces, (300, 1), &mut |_| ()).unwrap(),
        "equal seeds, equal answers"
    );
    let none = find_disabled_pairs(&robot, &surfaces, (0, 1), &mut |_| ()).unwrap();
    assert_eq!(none, PairSurvey::default(), "no pose shows nothing");
}

/// A pin that rotates about z, beside a block that begins `gap` meters from it; at the end of its range a cam on the
/// pin comes `nearer` by this distance.
fn beside_cam(gap: f64, nearer: f64) -> PairSurvey {
    let text = format!(
        r#"<ZeroPositionKinematicTree robotName="r"><bodypart name="p">
<link name="block" z="0.1"><box width="0.1" height="0.4" depth="0.1" px="{}"/>
<motor name="turn" minPos="-90" maxPos="30"><joint z="1" minPos="-90" maxPos="30">
<link name="pin" z="0.01"><sphere radius="0.05" pz="-0.1"/><sphere radius="0.01" py="{}" pz="-0.1"/></link></joint></motor></link>
</bodypart><pairs/></ZeroPositionKinematicTree>"#,
        0.1 + gap,
        -(0.04 + nearer) / 30f64.to_radians().sin(),
    );
    let robot = mobee_model::parse_robot("r.xml", &text).unwrap().value;
    let surfaces = Surfaces::new(&robot, &[]).unwrap();
    find_disabled_pairs(&robot, &surfaces, (2000, 1), &mut |_| ()).unwrap()
}

#[test]
fn a_pair_that_is_always_near_and_meets_at_times_gets_a_clearance_of_its_own() {
    // 7 mm apart, and in contact at the end of the range
    let found = beside_cam(0.007, 0.0075);
    assert_eq!((found.left_out.len(), found.near.len()), (0, 1), "{found:?}");
    assert!(found.near[0].reason.contains("2000 poses"), "{found:?}");
    let closest = beside_cam(0.0005, 0.001).near;
    assert!(closest.len() == 1 && closest[0].clearance < found.near[0].clearance, "{closest:?} {found:?}");
    // what touches at every pose, or never, needs no test
    let touching = beside_cam(-0.001, 0.001);
    assert!(touching.near.is_empty() && touching.left_out[0].reason.starts_with("in contact at each"), "{touching:?}");
    let apart = beside_cam(0.007, 0.001);
    assert!(apart.near.is_empty() && apart.left_out[0].reason.starts_with("near, but never"), "{apart:?}");
}

#[test]
fn false_contacts_are_counted_and_none_is_missed() {
    let (mut robot, surfaces) = hollow();
    robot.left_out = None;
    robot.leave_out([]);
    let seen = compare(&robot, &surfaces, (300, 2), &mut |_| ()).unwrap();
    assert_eq!((seen.poses, seen.by_meshes, seen.missed), (300, 0, 0), "{seen:?}");
    assert_eq!(
        (seen.falsely, seen.falsely_apart),
        (seen.by_shapes, seen.by_shapes),
        "the meshes are centimeters apart"
    );
    assert!(seen.falsely > 100 && seen.blocked_share() > 0.3, "{seen:?}");
    let pair = ("base".to_owned(), "slider".to_owned());
    assert_eq!(seen.pairs[&pair].falsely, seen.falsely, "{seen:?}");
}

/// Refits a robot's shapes; returns its contacts before and after, at other poses.
struct Closed {
    robot: Robot,
    told: Vec<Refitted>,
    before: Comparison,
    after: Comparison,
}

fn closed(UrdfRobot { mut robot, surfaces: links, mut fits, .. }: UrdfRobot, shapes: usize, hulls: f64) -> Closed {
    // Links without shapes are skipped when neighbors are determined, so the pair is tested only without its line.
    robot.left_out = None;
    robot.leave_out([]);
    let surfaces = Surfaces::new(&robot, &links).unwrap();
    let seen = |robot: &Robot| compare(robot, &surfaces, (1000, 3), &mut |_| ()).unwrap();
    let before = seen(&robot);
    let (goal, all) = (RefitLimits { falsely: 0.0, shapes, hulls }, (links.as_slice(), &mut fits));
    let told = fit_closer(&mut robot, all, &surfaces, &goal, (600, 1), &mut |_| ()).unwrap();
    let after = seen(&robot);
    assert_eq!((before.missed, after.missed, after.by_meshes), (0, 0, before.by_meshes), "shapes hold the meshes");
    assert!(before.by_meshes > 20, "the pair needs a test: {before:?}");
    Closed { robot, told, before, after }
}

#[test]
fn shapes_that_touch_falsely_are_fitted_closer_and_still_hold_the_meshes() {
    let closer = || closed(iron_and_slider(0.9), 8, 1.0);
    let Closed { robot, told, before, after } = closer();
    assert!(told.iter().all(|n| n.shapes.0 == 1 && n.shapes.1 <= 8), "{told:?}");
    assert!(told.iter().any(|n| n.link == "base"), "{told:?}");
    assert!(before.blocked_share() > 0.3 && after.blocked_share() < 0.1, "{before:?} {after:?}");
    assert_eq!(robot, closer().robot, "equal seeds, equal robots");
}

#[test]
fn hulls_take_over_where_one_shape_each_is_not_close_enough() {
    // No box is a tight fit of a wedge, but the hull equals it.
    let wedge = "v 0 0 0\nv 0.2 0 0\nv 0 0 0.2\nv 0 0.2 0\nv 0.2 0.2 0\nv 0 0.2 0.2\nf 1 2 3\nf 4 5 6\nf 1 2 5 4\nf 2 3 6 5\nf 3 1 4 6\n";
    let with = |hulls: f64| {
        let closed = closed(beside_slider(wedge, "0.11 0.02 0.11", 0.9), 1, hulls);
        let hulls: usize = closed.robot.nodes.iter().map(|n| n.hulls.len()).sum();
        assert_eq!(hulls, closed.told.iter().map(|n| n.hulls).sum::<usize>(), "{:?}", closed.told);
        assert!(hulls == 0 || closed.after.falsely_apart == 0, "hulls are nearer than that: {:?}", closed.after);
        (closed.robot, hulls, closed.after.blocked_share())
    };
    let (without, none, blocked) = with(1.0);
    assert!(none == 0 && blocked > 0.1, "{blocked}");
    let (robot, hulls, less) = with(0.0);
    assert!(hulls == 2 && less < 0.1 * blocked, "{hulls} {less} {blocked}");
    assert_eq!(robot, with(0.0).0, "equal seeds, equal robots");
    assert_ne!(robot, without);
}

/// A frame of four bars around the y axis, open by a hand's width inside.
const FRAME: &str = "v -0.1 0 -0.1\nv 0.1 0 -0.1\nv 0.1 0 0.1\nv -0.1 0 0.1\nv -0.09 0 -0.09\nv 0.09 0 -0.09\nv 0.09 0 0.09\nv -0.09 0 0.09\n\
    v -0.1 0.1 -0.1\nv 0.1 0.1 -0.1\nv 0.1 0.1 0.1\nv -0.1 0.1 0.1\nv -0.09 0.1 -0.09\nv 0.09 0.1 -0.09\nv 0.09 0.1 0.09\nv -0.09 0.1 0.09\n\
    f 1 2 10 9\nf 2 3 11 10\nf 3 4 12 11\nf 4 1 9 12\nf 5 6 14 13\nf 6 7 15 14\nf 7 8 16 15\nf 8 5 13 16\n";
/// A plate across its end.
const PLATE: &str = "v -0.1 0.13 -0.1\nv 0.1 0.13 -0.1\nv 0.1 0.13 0.1\nv -0.1 0.13 0.1\nf 17 18 19 20\n";

#[test]
fn a_hull_around_a_hollow_that_no_plane_opens_is_parted_all_the_same() {
    // The halves of a frame contain as much of its middle as the frame, at any split.
    let mesh = format!("{FRAME}{PLATE}");
    let Closed { told, before, after, .. } = closed(beside_slider(&mesh, "-0.01 0.02 -0.01", 0.9), 16, 0.0);
    assert!(before.blocked_share() > 0.9 && after.blocked_share() < 0.05, "{before:?} {after:?}");
    assert!(told.iter().any(|n| n.link == "base" && n.hulls == n.shapes.1 && n.shapes.1 >= 4), "{told:?}");
}

#[test]
fn what_its_meshes_keep_near_always_is_not_fitted_closer_for_nothing() {
    let Closed { told, before, .. } = closed(beside_slider(FRAME, "0.06 -0.025 0.06", 0.9), 8, 0.0);
    assert!(before.blocked_share() > 0.9 && told.is_empty(), "{before:?} {told:?}");
}

#[test]
fn home_is_where_it_is_wanted_or_the_nearest_pose_that_is_free() {
    let robot = mobee_model::parse_robot("r.xml", ARM).unwrap().value;
    let scene = Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new()).unwrap();
    let free = [1.0];
    let as_wanted = find_home(&robot, &free, 0.02, 7).unwrap();
    assert!(as_wanted.moved.is_empty() && as_wanted.q == free, "{as_wanted:?}");
    let moved = find_home(&robot, &[0.0], 0.02, 7).unwrap();
    assert!(moved.moved == [(0, moved.q[0])] && scene.free(&[&moved.q], 0.0199), "{moved:?}");
    // Slightly nearer to the desired pose it is not free any more.
    assert!(!scene.free(&[&[moved.q[0] * 0.95]], 0.02), "{moved:?}");
    // A motor that obstructs nothing stays at its desired position.
    let motor = r#"<motor name="nod" minPos="-90" maxPos="90" home="0"/><link name="base"#;
    let nod = r#"<motor name="nod"><joint x="1" length="0.01" minPos="-90" maxPos="90"/></motor></link>
    </joint>"#;
    let two = ARM.replacen("<link name=\"base", motor, 1).replacen("</link>\n    </joint>", nod, 1);
    let two = mobee_model::parse_robot("r.xml", &two).unwrap().value;
    let home = find_home(&two, &[0.0, 0.3], 0.02, 7).unwrap();
    assert_eq!((home.q[1], home.moved.len(), home.moved[0].0), (0.3, 1, 0), "{home:?}");
    assert!((home.q[0].abs() - moved.q[0].abs()).abs() < 0.02, "{home:?} {moved:?}");
    let nowhere = find_home(&robot, &[0.0], 5.0, 7).unwrap();
    assert!(nowhere.clearance < 5.0 && nowhere.clearance > 0.0, "the freest there is: {nowhere:?}");
}

/// A hand that touches the base at zero and swings away from it.
const ARM: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="r"><bodypart name="arm">
  <motor name="swing" minPos="-90" maxPos="90" home="0"/>
  <link name="base" x="0.4"><box width="0.1" height="0.1" depth="0.1"/>
    <motor name="swing"><joint z="1" length="0.01" minPos="-90" maxPos="90">
      <link name="hand" x="0.1"><box width="0.1" height="0.1" depth="0.1" px="-0.4"/></link>
    </joint></motor></link>
</bodypart><pairs/></ZeroPositionKinematicTree>
"#;
