//! The layout that a recording opens with: everything is visible, over the whole run, and named.

use mobee_contract::{EdgeState, Entry, Event, Note, Sink, Time};
use mobee_model::{Object, ObjectClass, Primitive, Robot, Scene, Shape, parse_robot};
use mobee_recorder::{MapView, PoseName, Recorder, Settings, view_map};
use nalgebra::{Isometry3, Vector3};
use rerun::StoreKind;
use rerun::external::arrow::array::{
    Array as _, ArrayRef, FixedSizeListArray, Float32Array, ListArray, StringArray, UInt8Array, UInt32Array,
};
use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

/// Tangent of half of Rerun's vertical field of view, which is 55 degrees.
const HALF_FIELD: f64 = 0.5206;
/// Width by height of the narrowest view that must show everything.
const ASPECT: f64 = 1.2;

/// A column with two arms: the left one and the right one are parts of two motors each.
fn robot() -> Arc<Robot> {
    let arm = |side: &str, y: f64| {
        format!(
            r#"<bodypart name="{side}_arm"><link z="0.3" y="{y}" radius="0.03" capsule="true">
            <motor name="{side}_shoulder" minPos="-90" maxPos="90"><joint y="1" minPos="-90" maxPos="90">
            <link x="0.2" radius="0.03" capsule="true">
            <motor name="{side}_elbow" minPos="-90" maxPos="90"><joint y="1" minPos="-90" maxPos="90">
            <link x="0.2" radius="0.03" capsule="true"><link x="0.001"><marker name="{side}_hand" nx="1"/></link></link>
            </joint></motor></link>
            </joint></motor></link></bodypart>"#
        )
    };
    let text = format!(
        r#"<ZeroPositionKinematicTree version="1.0" robotName="arms">{}{}</ZeroPositionKinematicTree>"#,
        arm("left", 0.2),
        arm("right", -0.2)
    );
    Arc::new(parse_robot("arms.xml", &text).unwrap().value)
}

fn block(at: [f64; 3]) -> Object {
    Object {
        name: "block".into(),
        class: ObjectClass::Obstacle,
        persistent: false,
        pose: Isometry3::translation(at[0], at[1], at[2]),
        shapes: vec![Primitive { shape: Shape::Box { size: Vector3::repeat(0.1) }, pose: Isometry3::identity() }],
        color: None,
    }
}

fn scene() -> Arc<Scene> {
    Arc::new(Scene::new(vec![(robot(), Isometry3::identity())], vec![block([0.3, 0.4, 0.3])]).unwrap())
}

fn settings(path: &Path) -> Settings {
    let left = PoseName { robot: "arms".into(), name: "left".into(), q_deg: [("left_elbow".into(), 30.0)].into() };
    let other = PoseName { robot: "other".into(), name: "never".into(), q_deg: [("left_elbow".into(), 45.0)].into() };
    Settings { path: path.to_owned(), name: "test".into(), names: vec![other, left], ..Settings::default() }
}

fn note(note: Note) -> Entry {
    Entry::Event(Arc::new(Event::Note { robot: "arms".into(), note }))
}

fn vertex(id: u32, left_elbow_deg: f64, at: [f64; 3]) -> Entry {
    note(Note::Vertex { id, q: vec![0.0, left_elbow_deg.to_radians(), 0.0, 0.0], at })
}

/// A run: its scene, then these entries a second apart, the first at one second.
fn record(path: &Path, entries: impl IntoIterator<Item = Entry>) {
    let mut recorder = Recorder::new(&settings(path)).unwrap();
    recorder.write(Time::ZERO, &Entry::Scene(scene())).unwrap();
    for (i, entry) in entries.into_iter().enumerate() {
        recorder.write(Time((i as u64 + 1) * 1_000_000_000), &entry).unwrap();
    }
}

/// A value of a component: its entity, its name and its content.
type Value = (String, String, ArrayRef);

/// All values in a file, in order.
fn values(path: &Path, kind: StoreKind) -> Vec<Value> {
    let file = BufReader::new(File::open(path).unwrap());
    let mut all = Vec::new();
    for message in DecoderApp::decode_eager(file).unwrap().map_while(Result::ok) {
        let LogMsg::ArrowMsg(store, rows) = message else { continue };
        if store.kind() != kind {
            continue;
        }
        let chunk = Chunk::from_arrow_msg(&rows).unwrap();
        for (component, column) in chunk.components().iter() {
            let list: &ListArray = &column.list_array;
            for row in (0..list.len()).filter(|row| list.is_valid(*row)) {
                all.push((chunk.entity_path().to_string(), component.to_string(), list.value(row)));
            }
        }
    }
    all
}

/// The newest value of a component of an entity with this ending.
fn newest(values: &[Value], entity: &str, component: &str) -> ArrayRef {
    let found = values.iter().rev().find(|(e, c, _)| e.ends_with(entity) && c == component);
    found.unwrap_or_else(|| panic!("{component} of {entity} is missing")).2.clone()
}

fn points(array: &ArrayRef) -> Vec<[f64; 3]> {
    let list = array.as_any().downcast_ref::<FixedSizeListArray>().unwrap();
    let flat = list.values().as_any().downcast_ref::<Float32Array>().unwrap();
    flat.values().chunks(3).map(|p| [p[0].into(), p[1].into(), p[2].into()]).collect()
}

fn words(array: &ArrayRef) -> Vec<String> {
    array.as_any().downcast_ref::<StringArray>().unwrap().iter().flatten().map(str::to_owned).collect()
}

/// Position of a point on the screen: 1 is the edge.
fn on_screen(layout: &[Value], at: [f64; 3]) -> [f64; 2] {
    let of = |component: &str| Vector3::from(points(&newest(layout, "/EyeControls3D", component))[0]);
    let (eye, target) = (of("EyeControls3D:position"), of("EyeControls3D:look_target"));
    let forward = (target - eye).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let to = Vector3::from(at) - eye;
    let depth = to.dot(&forward);
    assert!(depth > 0.0, "{at:?} is behind the eye");
    [to.dot(&right) / (depth * HALF_FIELD * ASPECT), to.dot(&right.cross(&forward)) / (depth * HALF_FIELD)]
}

fn is_in_picture(layout: &[Value], at: [f64; 3]) -> bool {
    on_screen(layout, at).iter().all(|x| x.abs() < 0.97)
}

/// Corners of the block, the column's foot, and the hands straight ahead and straight up.
fn landmarks() -> Vec<[f64; 3]> {
    let corner = |n: usize| std::array::from_fn(|axis| [0.3, 0.4, 0.3][axis] + [-0.05, 0.05][n >> axis & 1]);
    let mut all: Vec<[f64; 3]> = (0..8).map(corner).collect();
    all.extend([[0.0, 0.0, 0.0], [0.4, 0.2, 0.3], [0.4, -0.2, 0.3], [0.0, 0.2, 0.69], [0.0, -0.2, 0.69]]);
    all
}

#[test]
fn robot_reach_objects_and_map_are_in_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let far = [0.3, -0.9, 1.4];
    record(&path, []);
    let before = values(&path, StoreKind::Blueprint);
    for at in landmarks() {
        assert!(is_in_picture(&before, at), "{at:?} is at {:?}", on_screen(&before, at));
    }
    assert!(!is_in_picture(&before, far), "else it proves nothing");
    record(&path, [vertex(0, 0.0, [0.4, 0.2, 0.3]), vertex(1, 30.0, far), vertex(2, 60.0, [0.1, 0.0, 0.5])]);
    let layout = values(&path, StoreKind::Blueprint);
    for at in landmarks().into_iter().chain([far]) {
        assert!(is_in_picture(&layout, at), "{at:?} is at {:?}", on_screen(&layout, at));
    }
}

#[test]
fn a_whole_map_is_in_the_picture_with_the_names_of_its_vertices() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.rrd");
    let scene = scene();
    let vertices = [[0.4, 0.2, 0.3], [0.3, -0.9, 1.4]];
    let q = [[0.0; 4], [0.1; 4]];
    let poses: Vec<&[f64]> = q.iter().map(<[f64; 4]>::as_slice).collect();
    let view = MapView { scene: &scene, vertices: &vertices, poses: &poses, names: &[None, Some("up")], lines: &[] };
    view_map(&settings(&path), &view).unwrap();
    let layout = values(&path, StoreKind::Blueprint);
    for at in landmarks().into_iter().chain(vertices) {
        assert!(is_in_picture(&layout, at), "{at:?} is at {:?}", on_screen(&layout, at));
    }
    let data = values(&path, StoreKind::Recording);
    assert_eq!(words(&newest(&data, "/world/map/names", "Points3D:labels")), ["0", "up"]);
}

#[test]
fn the_lanes_open_on_the_whole_run_and_follow_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    record(&path, []);
    let layout = values(&path, StoreKind::Blueprint);
    let (view, ..) = layout
        .iter()
        .find(|(_, c, v)| c == "ViewBlueprint:class_identifier" && words(v) == ["StateTimeline"])
        .expect("there are lanes");
    let axis = format!("{view}/TimeAxis");
    // 2: the axis that views share, which alone has a range without an end
    let link = newest(&layout, &axis, "TimeAxis:link");
    assert_eq!(link.as_any().downcast_ref::<UInt8Array>().unwrap().values(), &[2]);
    let ranges = layout.iter().filter(|(e, c, _)| *e == axis && c == "TimeAxis:view_range");
    assert_eq!(ranges.count(), 0);
}

/// The name of the view that the joints open at.
fn open_plot(layout: &[Value]) -> String {
    let named =
        |(e, c, v): &&Value| e.starts_with("/container/") && c.ends_with(":display_name") && words(v) == ["Joints"];
    let (joints, ..) = layout.iter().rev().find(named).expect("there are joints");
    let open = words(&newest(layout, joints, "ContainerBlueprint:active_tab")).remove(0);
    words(&newest(layout, &open, "ViewBlueprint:display_name")).remove(0)
}

#[test]
fn the_joints_open_at_the_part_that_moves() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let pose = |q: [f64; 4]| Entry::Pose { robot: 0, q: q.into(), contacts: [].into() };
    // The readings of the left arm are noisy.
    record(&path, [pose([0.0; 4]), pose([0.002, 0.0, 0.0, 0.0])]);
    assert_eq!(open_plot(&values(&path, StoreKind::Blueprint)), "left_arm");
    record(&path, [pose([0.0; 4]), pose([0.002, 0.0, 0.0, 0.0]), pose([0.0, 0.0, 0.1, 0.0])]);
    assert_eq!(open_plot(&values(&path, StoreKind::Blueprint)), "right_arm");
}

#[test]
fn each_motor_of_a_part_has_a_color_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    record(&path, []);
    let colors = newest(&values(&path, StoreKind::Recording), "/joints/arms/left_arm", "SeriesLines:colors");
    let colors: Vec<u32> = colors.as_any().downcast_ref::<UInt32Array>().unwrap().values().to_vec();
    assert_eq!(colors.len(), 2);
    assert_eq!(colors.iter().collect::<BTreeSet<_>>().len(), 2, "{colors:x?}");
}

#[test]
fn vertices_are_called_by_the_names_of_their_poses() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let edge = |from, to| note(Note::Edge { from, to, state: EdgeState::Feasible, cause: None });
    let plan = note(Note::Plan { path: vec![1, 0, 2] });
    let map = [vertex(0, 0.0, [0.4, 0.2, 0.3]), vertex(1, 30.0, [0.3, 0.2, 0.2]), vertex(2, 45.0, [0.2, 0.2, 0.2])];
    record(&path, map.into_iter().chain([edge(1, 0), plan]));
    let data = values(&path, StoreKind::Recording);
    let labels = ["home", "left", "2"];
    assert_eq!(words(&newest(&data, "/roadmap/arms/vertices", "Points2D:labels")), labels);
    let world = data.iter().rev().find(|(e, c, _)| e == "/world/roadmap/arms/vertices" && c == "Points3D:labels");
    assert_eq!(words(&world.expect("labels in the world").2), labels);
    assert_eq!(words(&newest(&data, "/graph/arms/map", "GraphNodes:labels")), labels);
    let log: Vec<String> =
        data.iter().filter(|(e, c, _)| e == "/log/arms" && c == "TextLog:text").flat_map(|v| words(&v.2)).collect();
    assert_eq!(log, ["edge left -> home is feasible", "plan: left -> home -> 2"]);
}

#[test]
fn a_run_without_a_map_has_no_empty_view_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let views = |path: &Path| -> BTreeSet<String> {
        let layout = values(path, StoreKind::Blueprint);
        let shown = layout.iter().filter(|(e, c, _)| e.starts_with("/view/") && c == "ViewBlueprint:display_name");
        shown.flat_map(|(_, _, v)| words(v)).collect()
    };
    record(&path, []);
    assert!(!views(&path).contains("Roadmap") && views(&path).contains("Log"), "{:?}", views(&path));
    record(&path, [vertex(0, 0.0, [0.4, 0.2, 0.3]), vertex(1, 30.0, [0.3, 0.2, 0.2])]);
    assert!(views(&path).contains("Roadmap") && views(&path).contains("Roadmap as graph"), "{:?}", views(&path));
}
