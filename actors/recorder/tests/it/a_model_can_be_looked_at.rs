//! A recording of a robot model contains its shapes, its meshes and the near pairs while one motor moves.

use mobee_import::LinkSurface;

use mobee_model::{Mesh, Robot, parse_robot};
use mobee_recorder::{Contents, ModelView, Settings, view_model};
use nalgebra::{UnitQuaternion, Vector3};
use std::path::Path;
use std::sync::Arc;

/// A column, a lift on it that carries an arm, and a tool that the second joint folds onto the column. The lift is without shapes.
const ROBOT: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="r">
  <pairs><leaveOut a="arm" b="tool" reason="neighbors, joined by | fold"/></pairs>
  <bodypart name="all">
    <link name="column" z="0.4" radius="0.03"><marker name="column"/>
      <motor name="lift" type="prismatic" minPos="0" maxPos="200" home="50"><joint type="prismatic" z="1" minPos="0" maxPos="0.2">
        <link name="arm" x="0.3" radius="0.02"><marker name="arm"/>
          <motor name="fold" minPos="-180" maxPos="180"><joint y="1" minPos="-180" maxPos="180">
            <link x="0.1"><link name="tool" x="0.3" radius="0.02"><marker name="tool"/></link></link>
          </joint></motor>
        </link></joint></motor>
    </link>
  </bodypart>
</ZeroPositionKinematicTree>"#;

fn robot() -> Arc<Robot> {
    Arc::new(parse_robot("r.xml", ROBOT).unwrap().value)
}

fn mesh(link: &str) -> LinkSurface {
    let vertices = vec![Vector3::zeros(), Vector3::x() * 0.1, Vector3::y() * 0.1];
    let meshes = vec![Mesh { vertices, triangles: vec![[0, 1, 2]] }];
    LinkSurface { link: link.into(), turn: UnitQuaternion::identity(), meshes, solids: Vec::new() }
}

fn settings(path: &Path) -> Settings {
    Settings { path: path.to_owned(), name: "r".into(), index: true, ..Settings::default() }
}

#[test]
fn shapes_meshes_motors_and_what_comes_near_are_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.rrd");
    let (robot, meshes) = (robot(), [mesh("arm"), mesh("tool")]);
    let seen = view_model(&settings(&path), &ModelView { robot: &robot, meshes: &meshes, margin: 0.01 }).unwrap();
    let contents = Contents::read(&path).unwrap();
    for entity in [
        "/world/r/cylinders",
        "/world/r/lift/slid/cylinders",
        "/world/r/lift/slid/mesh_arm_0",
        "/world/r/lift/slid/fold/turned/cylinders",
        "/world/r/lift/slid/fold/turned/mesh_tool_0",
        "/world/axis",
        "/world/near/lines",
        "/state/motor",
        "/state/near",
        "/position",
        "/now",
        "/near",
        "/left_out",
        "/about",
    ] {
        assert!(contents.rows.contains_key(entity), "{entity} is missing in {:#?}", contents.rows.keys());
    }
    for moving in ["/world/r/lift/slid", "/world/r/lift/slid/fold/turned"] {
        assert!(contents.rows[moving] > 100, "{moving}: {:?}", contents.rows.get(moving));
    }
    assert_eq!(contents.rows["/world/r/lift/slid/mesh_arm_0"], 1, "a mesh is written once");
    assert!((contents.until.secs() - seen.secs).abs() < 0.1, "{} of {}", contents.until, seen.secs);
    // `lift` lowers the arm onto the column, `fold` moves the tool to it, and home is free.
    let of = |a: &'static str, b: &'static str| seen.near.iter().filter(move |n| n.links.0 == a && n.links.1 == b);
    assert!(of("column", "arm").all(|n| n.motor.is_some_and(|(m, _)| m == 0)), "{:?}", seen.near);
    assert!(of("column", "tool").all(|n| n.motor.is_some_and(|(m, _)| m == 1)), "{:?}", seen.near);
    assert!(of("column", "arm").count() == 1 && of("column", "tool").any(|n| n.distance < 0.0), "{:?}", seen.near);
    assert!(seen.near.windows(2).all(|w| w[0].distance <= w[1].distance));
}

/// The hull is drawn, with the outlines of its shape. A contact colors both.
#[test]
fn the_hull_of_a_shape_is_drawn_and_painted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.rrd");
    let hull = "<sphere radius=\"0.05\" hull=\"0.03 0 0 0 0.03 0 0 0 0.03 -0.03 0 0\" hullRadius=\"0.002\"/>";
    let text = ROBOT.replace("<marker name=\"tool\"/>", &format!("<marker name=\"tool\"/>{hull}"));
    let robot = Arc::new(parse_robot("r.xml", &text).unwrap().value);
    view_model(&settings(&path), &ModelView { robot: &robot, meshes: &[], margin: 0.01 }).unwrap();
    let rows = Contents::read(&path).unwrap().rows;
    let on = "/world/r/lift/slid/fold/turned";
    assert!(rows.contains_key(&format!("{on}/spheres_around_hulls")), "{:#?}", rows.keys());
    let hulls: Vec<_> = rows.iter().filter(|(entity, _)| entity.starts_with(&format!("{on}/hulls/"))).collect();
    assert!(hulls.len() == 1 && *hulls[0].1 >= 2, "the surface, and its color: {hulls:?}");
}

#[test]
fn a_mesh_of_another_robot_is_refused_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.rrd");
    let (robot, meshes) = (robot(), [mesh("wheel")]);
    let refused = view_model(&settings(&path), &ModelView { robot: &robot, meshes: &meshes, margin: 0.01 });
    assert!(refused.unwrap_err().contains("`wheel`") && !path.exists());
}
