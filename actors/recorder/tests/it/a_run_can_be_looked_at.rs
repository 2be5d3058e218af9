//! A recording contains the events of a run, is small, and survives the death of its writer.

use mobee_contract::{CameraMount, Entry, Event, Frame, Intrinsics, SeenMask, SeenPicture, Sink, Status, Time};
use mobee_model::{Object, ObjectClass, Primitive, Robot, Scene, Shape, parse_robot};
use mobee_recorder::{Contents, Recorder, Settings, staged};
use nalgebra::{Isometry3, Vector3};
use std::path::Path;
use std::sync::Arc;

/// A column, an arm of two joints and a finger that no command moves.
fn robot(name: &str) -> Arc<Robot> {
    let text = format!(
        r#"<ZeroPositionKinematicTree version="1.0" robotName="{name}">
        <bodypart name="arm">
          <link z="0.3" radius="0.04" capsule="true">
          <motor name="shoulder" idx="0" minPos="-90" maxPos="90"><joint z="1" minPos="-90" maxPos="90">
          <link x="0.3" radius="0.03" capsule="true">
          <motor name="elbow" idx="1" minPos="-120" maxPos="120"><joint z="1" minPos="-120" maxPos="120">
          <link x="0.25" radius="0.03" capsule="true"><marker name="hand" nx="1"/>
          <motor name="finger" idx="2" minPos="0" maxPos="90"><joint y="1" minPos="0" maxPos="90">
          <link x="0.05" radius="0.01" capsule="true"/>
          </joint></motor></link></joint></motor></link></joint></motor></link>
        </bodypart></ZeroPositionKinematicTree>"#
    );
    Arc::new(parse_robot("test.xml", &text).unwrap().value)
}

fn ball(name: &str, class: ObjectClass, at: [f64; 3]) -> Object {
    Object {
        name: name.to_owned(),
        class,
        persistent: false,
        pose: Isometry3::translation(at[0], at[1], at[2]),
        shapes: vec![Primitive { shape: Shape::Sphere { radius: 0.05 }, pose: Isometry3::identity() }],
        color: None,
    }
}

fn stage() -> staged::Stage {
    staged::Stage {
        robot: robot("arm"),
        objects: vec![
            ball("post", ObjectClass::Obstacle, [0.2, 0.4, 0.3]),
            ball("balloon", ObjectClass::Ghost, [0.2, -0.4, 0.3]),
        ],
        motors: vec![0, 1],
        hand: "hand".into(),
        vertices: 8,
        motions: 30,
        seed: 3,
    }
}

fn recorder(path: &Path) -> Recorder {
    let settings =
        Settings { path: path.to_owned(), name: "test".into(), config: "test.toml".into(), ..Settings::default() };
    Recorder::new(&settings).unwrap()
}

fn record(path: &Path) -> (Time, Contents) {
    let mut recorder = recorder(path);
    let end = staged::play(&stage(), &mut recorder).unwrap();
    drop(recorder);
    (end, Contents::read(path).unwrap())
}

#[test]
fn everything_that_happened_is_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let (end, contents) = record(&folder.path().join("run.rrd"));
    for entity in [
        "/world/arm/capsules",
        "/world/arm/shoulder/turned/elbow/turned/capsules",
        "/world/objects/post_0/spheres",
        "/world/trails/arm/hand",
        "/world/roadmap/arm/vertices",
        "/world/roadmap/arm/feasible",
        "/world/contacts/so_far",
        "/roadmap/arm/plan",
        "/graph/arm/map",
        "/joints/arm/arm",
        "/state/arm/filter",
        "/state/arm/transaction",
        "/progress/arm/map",
        "/progress/arm/rollbacks",
        "/log/arm",
        "/about",
    ] {
        assert!(contents.rows.contains_key(entity), "{entity} is missing in {:#?}", contents.rows.keys());
    }
    assert_eq!(contents.properties.get("seed").map(String::as_str), Some("3"));
    assert_eq!(contents.properties.get("config").map(String::as_str), Some("test.toml"));
    assert!(contents.until.secs() > end.secs() - 1.0, "ends at {} of {end}", contents.until);
}

/// Objects that only the simulated world has are shown beside those of the scene, once.
#[test]
fn objects_that_the_model_does_not_contain_are_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let unknown = vec![ball("post", ObjectClass::Obstacle, [0.4, 0.0, 0.3])];
    let settings = Settings { path: path.clone(), unknown, ..Settings::default() };
    let mut recorder = Recorder::new(&settings).unwrap();
    staged::play(&stage(), &mut recorder).unwrap();
    drop(recorder);
    let rows = Contents::read(&path).unwrap().rows;
    assert_eq!(rows.get("/world/unknown/post_0/name"), Some(&1), "{rows:#?}");
    assert!(rows.contains_key("/world/unknown/post_0/spheres") && rows.contains_key("/world/objects/post_0/spheres"));
}

#[test]
fn a_joint_that_rests_costs_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (_, contents) = record(&folder.path().join("run.rrd"));
    let rows = |entity: &str| contents.rows.get(entity).copied().unwrap_or(0);
    // The origin of the joint is one static row of its entity.
    assert_eq!(rows("/world/arm/shoulder/turned/elbow/turned/finger"), 1);
    // The rotation was written once, its shape and first color once each.
    let finger = "/world/arm/shoulder/turned/elbow/turned/finger/turned";
    assert_eq!(rows(finger), 1);
    assert!(rows("/world/arm/shoulder/turned") > 100, "{:#?}", contents.rows);
}

#[test]
fn a_file_cut_anywhere_gives_what_came_before() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let (_, whole) = record(&path);
    let bytes = std::fs::read(&path).unwrap();
    for tenths in 5..10 {
        let cut = folder.path().join("cut.rrd");
        std::fs::write(&cut, &bytes[..bytes.len() * tenths / 10]).unwrap();
        let part = Contents::read(&cut).unwrap();
        for (entity, rows) in &part.rows {
            assert!(rows <= &whole.rows[entity], "{entity} has more rows than were written");
        }
    }
}

#[test]
fn several_robots_keep_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut recorder = recorder(&path);
    let robots = vec![(robot("left"), Isometry3::identity()), (robot("right"), Isometry3::from(Vector3::y() * 1.5))];
    let scene = Arc::new(Scene::new(robots, vec![]).unwrap());
    recorder.write(Time::ZERO, &Entry::Scene(Arc::clone(&scene))).unwrap();
    for step in 0..100_u64 {
        for robot in 0..2 {
            let angle = step as f64 * 0.007 * (1.0 + robot as f64);
            let pose = Entry::Pose { robot, q: [angle, 0.0, 0.0].into(), contacts: [].into() };
            recorder.write(Time(step * 50_000_000), &pose).unwrap();
        }
    }
    for robot in ["left", "right"] {
        let state = Event::State { robot: robot.into(), status: Status::Moving };
        recorder.write(Time(5_000_000_000), &Entry::Event(Arc::new(state))).unwrap();
    }
    drop(recorder);
    let contents = Contents::read(&path).unwrap();
    for robot in ["left", "right"] {
        assert_eq!(contents.rows.get(&format!("/world/{robot}/shoulder/turned")).copied(), Some(100));
        assert!(contents.rows.contains_key(&format!("/state/{robot}/filter")));
    }
}

#[test]
fn a_pose_of_an_unknown_robot_or_of_wrong_length_harms_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut recorder = recorder(&path);
    let early = Entry::Pose { robot: 0, q: [0.0; 3].into(), contacts: [].into() };
    recorder.write(Time::ZERO, &early).unwrap();
    let scene = Scene::new(vec![(robot("arm"), Isometry3::identity())], vec![]).unwrap();
    recorder.write(Time::ZERO, &Entry::Scene(Arc::new(scene))).unwrap();
    for (robot, q) in [(7, vec![0.0; 3]), (0, vec![]), (0, vec![0.1; 9]), (0, vec![f64::NAN; 3])] {
        recorder.write(Time(1), &Entry::Pose { robot, q: q.into(), contacts: [].into() }).unwrap();
    }
    drop(recorder);
    assert!(Contents::read(&path).is_ok());
}

#[test]
fn a_file_that_can_not_be_written_is_refused_with_a_remedy() {
    let settings = Settings { path: "no/such/folder/run.rrd".into(), ..Settings::default() };
    let refusal = Recorder::new(&settings).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(refusal.contains("no/such/folder/run.rrd") && refusal.contains("--no-record"), "{refusal}");
}

/// An image of two by two pixels from a camera on this node, with a mask of this many pixels.
fn picture(mount: Option<usize>, masked: usize) -> Entry {
    let intrinsics = Intrinsics { size: [2, 2], focal: [2.0; 2], center: [1.0; 2], distortion: [0.0; 4] };
    let frame = Frame { exposed: Time::ZERO, intrinsics, pixels: [7; 12].into() };
    let mask = Some(SeenMask { size: [2, 2], objects: vec![1; masked].into() });
    let mount = mount.map(|node| CameraMount { robot: 0, node, position: [0.0; 3], rotation: [1.0, 0.0, 0.0, 0.0] });
    let seen = Arc::new(SeenPicture { frame, regions: [].into(), mask, mount });
    Entry::Picture { camera: "eyes/left".into(), seen }
}

#[test]
fn what_an_eye_sees_is_in_its_frustum_which_moves_with_the_robot() {
    let folder = tempfile::tempdir().unwrap();
    let rows = |mount, masked| {
        let path = folder.path().join(format!("{mount:?}-{masked}.rrd"));
        let mut recorder = recorder(&path);
        let scene = Arc::new(Scene::new(vec![(robot("arm"), Isometry3::identity())], vec![]).unwrap());
        recorder.write(Time::ZERO, &Entry::Scene(scene)).unwrap();
        for step in 0..10_u64 {
            let q = [step as f64 * 0.1, 0.0, 0.0].into();
            recorder.write(Time(step * 100_000_000), &Entry::Pose { robot: 0, q, contacts: [].into() }).unwrap();
            recorder.write(Time(step * 100_000_000), &picture(mount, masked)).unwrap();
        }
        drop(recorder);
        Contents::read(&path).unwrap().rows
    };
    let node = robot("arm").marker("hand").unwrap().node;
    let eye = rows(Some(node), 4);
    // Ten poses, the lens, and the colors of its masks.
    assert_eq!(eye.get("/world/eyes/eyes/left").copied(), Some(12), "{eye:#?}");
    assert_eq!(["picture", "mask"].map(|what| eye[&format!("/world/eyes/eyes/left/{what}")]), [10, 10]);
    // An incomplete mask is skipped, and so is the frustum of a camera without a known pose.
    assert!(!rows(Some(node), 3).contains_key("/world/eyes/eyes/left/mask"));
    let flat = rows(None, 4);
    assert!(flat.contains_key("/eyes/eyes/left/mask") && !flat.contains_key("/world/eyes/eyes/left"), "{flat:#?}");
    // A node that the robot does not have.
    assert!(rows(Some(999), 4).contains_key("/world/eyes/eyes/left/picture"));
}
