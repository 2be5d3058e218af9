//! Simulated eyes see what is there: where a pinhole says, as far away as the shapes are, one before the other; bent by the lens as
//! OpenCV has it; the same for the same seed; and settings that make no sense are refused with place and remedy.

use mobee_contract::{Camera, CameraContext, Intrinsics, Kind, Time, Truth, kinds};
use mobee_model::{Object, ObjectClass, Primitive, Robot, Scene, Shape, distance, load_robot, load_world};
use mobee_sim::eyes::{
    DistractorSettings, LensSettings, Owner, ScenerySettings, Shot, SimulatedCameraSettings, SimulatedEye, project,
    unproject,
};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

fn icub() -> Arc<Robot> {
    Arc::new(load_robot(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml")).unwrap().value)
}

fn object(name: &str, shape: Shape, pose: Isometry3<f64>) -> Object {
    let shapes = vec![Primitive { shape, pose: Isometry3::identity() }];
    Object {
        name: name.into(),
        class: ObjectClass::Target,
        persistent: false,
        pose,
        shapes,
        color: Some([200, 40, 30]),
    }
}

fn truth(robot: &Arc<Robot>, objects: Vec<Object>, pose_deg: &[(&str, f64)]) -> Truth {
    let mut q = robot.home();
    for (name, deg) in pose_deg {
        q[robot.motor_index(name).unwrap()] = deg.to_radians();
    }
    let scene = Scene::new(vec![(Arc::clone(robot), Isometry3::identity())], objects).unwrap();
    Truth { scene: Arc::new(scene), poses: vec![q.into()] }
}

fn ideal() -> SimulatedCameraSettings {
    SimulatedCameraSettings::at("l_eye").ideal()
}

fn shoot(settings: &SimulatedCameraSettings, truth: &Truth) -> Shot {
    let mut eye = SimulatedEye::new(settings, &truth.scene.robots()[0], 0, 7).unwrap();
    eye.shoot(truth, None, Time::from_secs(1.0)).unwrap()
}

/// The mean place of what an object owns, and its pixels.
fn centroid(shot: &Shot, owner: Owner) -> ([f64; 2], usize) {
    let width = shot.frame.intrinsics.size[0] as usize;
    let mine: Vec<usize> = (0..shot.owner.len()).filter(|k| shot.owner[*k] == owner).collect();
    let mean = |at: &dyn Fn(usize) -> usize| mine.iter().map(|k| at(*k) as f64 + 0.5).sum::<f64>() / mine.len() as f64;
    ([mean(&|k| k % width), mean(&|k| k / width)], mine.len())
}

/// `l_eye` and `r_eye` look as the reference table of the iCub's eyes says, in all of its poses.
#[test]
fn eyes_of_the_icub_are_where_its_reference_has_them() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/reference/icub-urdf-oracle.csv");
    let Ok(table) = std::fs::read_to_string(&file) else {
        eprintln!("skipped: there is no {}", file.display());
        return;
    };
    let robot = icub();
    let mut rows = table.lines().map(|l| l.split(',').collect::<Vec<_>>());
    let names = rows.next().unwrap();
    let eyes =
        ["l_eye", "r_eye"].map(|m| (m, SimulatedEye::new(&SimulatedCameraSettings::at(m), &robot, 0, 0).unwrap()));
    let mut count = 0;
    for row in rows {
        let number = |name: &str| row[names.iter().position(|n| *n == name).unwrap()].parse::<f64>().unwrap();
        let motors = ["torso_yaw", "torso_roll", "torso_pitch", "neck_pitch", "neck_roll", "neck_yaw", "eyes_tilt"];
        let mut pose: Vec<(&str, f64)> = motors.iter().map(|m| (*m, number(m))).collect();
        pose.extend([("eyes_vers", number("eyes_vers")), ("eyes_verg", number("eyes_verg"))]);
        let truth = truth(&robot, Vec::new(), &pose);
        for (name, eye) in &eyes {
            let of = |what: &str| number(&format!("{name}_{what}"));
            let q = Quaternion::new(of("qw"), of("qx"), of("qy"), of("qz"));
            let there =
                Isometry3::from_parts(Translation3::new(of("x"), of("y"), of("z")), UnitQuaternion::from_quaternion(q));
            let off = eye.at(&truth).unwrap().inverse() * there;
            assert!(off.translation.vector.norm() < 1e-5 && off.rotation.angle() < 1e-5, "{name}: {off}");
            count += 1;
        }
    }
    assert_eq!(count, 400);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// The middle of a ball's image is where a pinhole has it; its outline is an ellipse, somewhat farther out than the ball's center.
    #[test]
    fn a_ball_is_seen_where_a_pinhole_has_it(x in -0.3..0.3f64, y in -0.2..0.2f64, z in 0.3..1.0f64, radius in 0.02..0.05f64) {
        let robot = icub();
        let eye = SimulatedEye::new(&ideal(), &robot, 0, 0).unwrap().at(&truth(&robot, Vec::new(), &[])).unwrap();
        let center = Point3::new(x * z, y * z, z);
        let ball = object("ball", Shape::Sphere { radius }, Isometry3::from(Vector3::from((eye * center).coords)));
        let shot = shoot(&ideal(), &truth(&robot, vec![ball], &[("l_elbow", 15.0), ("r_elbow", 15.0)]));
        let ([u, v], pixels) = centroid(&shot, Owner::Object(0));
        // the cone of rays that touch the ball, cut by the picture's plane
        let cone = z * z / (z * z - radius * radius);
        let lens = shot.frame.intrinsics;
        let place = project(&lens, [x * cone, y * cone]);
        prop_assert!((u - place[0]).abs() < 0.35 && (v - place[1]).abs() < 0.35, "{u} {v} {place:?}, {pixels} pixels");
    }

    /// What is seen in a pixel is on the surface of what it is said to be, and on the pixel's ray.
    #[test]
    fn depth_is_that_of_the_shapes(kind in 0..4usize, angle in prop::array::uniform3(-3.0..3.0f64), z in 0.25..0.8f64, bent in any::<bool>()) {
        let robot = icub();
        let shape = [
            Shape::Sphere { radius: 0.04 },
            Shape::Capsule { radius: 0.03, height: 0.08 },
            Shape::Cylinder { radius: 0.03, height: 0.09 },
            Shape::Box { size: Vector3::new(0.05, 0.08, 0.03) },
        ][kind];
        let eye = SimulatedEye::new(&ideal(), &robot, 0, 0).unwrap().at(&truth(&robot, Vec::new(), &[])).unwrap();
        let pose = eye * Isometry3::new(Vector3::new(0.03, -0.02, z), Vector3::from(angle));
        let distortion = if bent { [-0.3742, 0.2054, 0.00282, 0.00271] } else { [0.0; 4] };
        let settings = SimulatedCameraSettings { lens: LensSettings { distortion, ..LensSettings::default() }, ..ideal() };
        let shot = shoot(&settings, &truth(&robot, vec![object("thing", shape, pose)], &[]));
        let lens = shot.frame.intrinsics;
        let mut seen = 0;
        for (k, depth) in shot.depth.iter().enumerate().filter(|(k, _)| shot.owner[*k] == Owner::Object(0)) {
            let pixel = [(k % 320) as f64 + 0.5, (k / 320) as f64 + 0.5];
            let [x, y] = unproject(&lens, pixel).unwrap();
            let at = Isometry3::from((eye * (Point3::new(x, y, 1.0) * f64::from(*depth))).coords);
            let off = distance(&Shape::Sphere { radius: 0.0 }, &at, &shape, &pose).distance;
            prop_assert!(off.abs() < 1e-4, "{off} at {pixel:?}");
            // nothing of the shape is before it
            let before = Isometry3::from((eye * (Point3::new(x, y, 1.0) * f64::from(*depth - 0.001))).coords);
            let outside = distance(&Shape::Sphere { radius: 0.0 }, &before, &shape, &pose).distance > 0.0;
            prop_assert!(outside, "the far side, at {:?}", pixel);
            seen += 1;
        }
        prop_assert!(seen > 100, "{seen} pixels");
    }

    /// Whatever the lens bends is unbent.
    #[test]
    fn a_direction_comes_back_from_its_pixel(x in -0.6..0.6f64, y in -0.45..0.45f64) {
        let lens = Intrinsics { size: [320, 240], focal: [219.0, 219.0], center: [174.7, 102.9], distortion: [-0.3742, 0.2054, 0.00282, 0.00271] };
        let back = unproject(&lens, project(&lens, [x, y])).unwrap();
        prop_assert!((back[0] - x).abs() < 1e-9 && (back[1] - y).abs() < 1e-9);
    }
}

/// The numbers of OpenCV's formulas, worked out by hand for one direction: x = 0.5, y = -0.25, r^2 = 0.3125.
#[test]
fn distortion_is_that_of_opencv() {
    let lens = Intrinsics {
        size: [320, 240],
        focal: [200.0, 210.0],
        center: [160.0, 120.0],
        distortion: [-0.3, 0.1, 0.01, -0.02],
    };
    // 1 - 0.3 * 0.3125 + 0.1 * 0.3125^2 = 0.916015625; x: 0.4580078125 + 2 * 0.01 * -0.125 - 0.02 * (0.3125 + 0.5) = 0.4392578125
    // y: -0.22900390625 + 0.01 * (0.3125 + 0.125) + 2 * -0.02 * -0.125 = -0.21962890625
    let [u, v] = project(&lens, [0.5, -0.25]);
    assert!((u - (200.0 * 0.4392578125 + 160.0)).abs() < 1e-9, "{u}");
    assert!((v - (210.0 * -0.21962890625 + 120.0)).abs() < 1e-9, "{v}");
}

#[test]
fn what_is_nearer_hides_what_is_behind_it_and_ghosts_are_not_seen() {
    let robot = icub();
    let eye = SimulatedEye::new(&ideal(), &robot, 0, 0).unwrap().at(&truth(&robot, Vec::new(), &[])).unwrap();
    let ball = |name: &str, z: f64, radius: f64| {
        object(name, Shape::Sphere { radius }, eye * Isometry3::translation(0.0, 0.0, z))
    };
    let mut ghost = ball("ghost", 0.3, 0.02);
    ghost.class = ObjectClass::Ghost;
    let shot = shoot(&ideal(), &truth(&robot, vec![ball("far", 0.8, 0.06), ball("near", 0.5, 0.02), ghost], &[]));
    assert_eq!(shot.owner[120 * 320 + 160], Owner::Object(1));
    let (at, ring) = centroid(&shot, Owner::Object(0));
    assert!((at[0] - 160.0).abs() < 1.0 && (at[1] - 120.0).abs() < 1.0 && ring > 500, "{at:?} {ring}");
    assert_eq!(centroid(&shot, Owner::Object(2)).1, 0);
}

/// Without noise, the lamp alone decides how light a color is, and not which.
#[test]
fn a_link_with_a_color_is_seen_in_it() {
    let block = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/katana-block.xml");
    let (robot, katana) = (icub(), Arc::new(load_robot(block).unwrap().value));
    let base = Isometry3::translation(-0.85, 0.0, 0.05);
    let robots = vec![(Arc::clone(&robot), Isometry3::identity()), (Arc::clone(&katana), base)];
    let scene = Scene::new(robots, Vec::new()).unwrap();
    let mut poses: Vec<Vec<f64>> = scene.home().iter().map(|q| q.to_vec()).collect();
    for (motor, deg) in [("motor2_lift", 60.0f64), ("motor3_lift", -90.0), ("motor4_lift", -30.0)] {
        poses[1][katana.motor_index(motor).unwrap()] = deg.to_radians();
    }
    poses[0][robot.motor_index("neck_pitch").unwrap()] = -0.3;
    let truth = Truth { scene: Arc::new(scene), poses: poses.into_iter().map(Into::into).collect() };
    let shot = shoot(&ideal(), &truth);
    let pixels = shot.frame.pixels.chunks(3).zip(&shot.owner).filter(|(_, owner)| **owner == Owner::Robot(1));
    let red = |p: &[u8]| p[0] > 60 && u32::from(p[0]) > 2 * u32::from(p[1].max(p[2]));
    let (block, arm): (Vec<_>, Vec<_>) = pixels.map(|(p, _)| p).partition(|p| red(p));
    assert!(block.len() > 200 && arm.len() > 200, "{} {}", block.len(), arm.len());
}

#[test]
fn the_robot_sees_its_own_hand_and_not_what_houses_its_eyes() {
    let robot = icub();
    let away = shoot(&ideal(), &truth(&robot, Vec::new(), &[("l_elbow", 15.0), ("r_elbow", 15.0)]));
    assert_eq!(centroid(&away, Owner::Robot(0)).1, 0, "eyes that look ahead see nothing of the robot");
    let raised = [("r_shoulder_pitch", -60.0), ("r_elbow", 60.0), ("r_shoulder_yaw", 30.0), ("neck_yaw", -20.0)];
    let raised = shoot(&ideal(), &truth(&robot, Vec::new(), &raised));
    let (_, pixels) = centroid(&raised, Owner::Robot(0));
    assert!(pixels > 300, "{pixels} pixels of an arm");
    let nearest = raised.depth.iter().copied().fold(f32::INFINITY, f32::min);
    assert!(nearest > 0.1, "{nearest} m");
}

#[test]
fn equal_seeds_and_times_give_equal_pictures_and_others_do_not() {
    let robot = icub();
    let world = load_world(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/worlds/cup.xml")).unwrap().value;
    let mut settings = SimulatedCameraSettings::at("l_eye");
    let (like, hue_deg) = (Some("cup".into()), [15.0, 40.0]);
    let distractors = DistractorSettings { count: 9, on: "table".into(), like, hue_deg, area_m: None };
    settings.scenery.distractors = Some(distractors);
    let truth = truth(&robot, world, &[("neck_pitch", -30.0)]);
    let shot = |settings: &SimulatedCameraSettings, seed: u64, secs: f64| {
        let mut eye = SimulatedEye::new(settings, &robot, 0, seed).unwrap();
        // what it saw before does not matter
        eye.shoot(&truth, None, Time::from_secs(0.5)).unwrap();
        eye.shoot(&truth, None, Time::from_secs(secs)).unwrap()
    };
    let first = shot(&settings, 1, 1.0);
    assert_eq!(first.frame.pixels, shot(&settings, 1, 1.0).frame.pixels);
    for (seed, secs) in [(2, 1.0), (1, 1.1)] {
        let other = shot(&settings, seed, secs);
        assert_ne!(first.frame.pixels, other.frame.pixels);
        assert_eq!(first.owner, other.owner, "the noise is another, the things are the same");
    }
    settings.scenery.seed = 5;
    assert_ne!(first.owner, shot(&settings, 1, 1.0).owner);
    assert!(first.owner.contains(&Owner::Scenery) && first.owner.contains(&Owner::Object(1)));
}

/// The mean of a picture's row, and how sharp it is: the sum of what neighbors differ by.
fn sharpness(shot: &Shot) -> f64 {
    shot.frame.pixels.windows(4).map(|w| f64::from(w[0].abs_diff(w[3]))).sum()
}

#[test]
fn a_head_that_turns_blurs_and_noise_is_as_strong_as_told() {
    let robot = icub();
    let settings = SimulatedCameraSettings { exposure_ms: 20.0, ..ideal() };
    let mut eye = SimulatedEye::new(&settings, &robot, 0, 0).unwrap();
    let at = |yaw: f64| truth(&robot, Vec::new(), &[("neck_yaw", yaw), ("l_elbow", 15.0), ("r_elbow", 15.0)]);
    let before = |yaw: f64| {
        Some((SimulatedEye::new(&settings, &robot, 0, 0).unwrap().at(&at(yaw)).unwrap(), Time::from_secs(0.9)))
    };
    let (here, now) = (at(10.0), Time::from_secs(1.0));
    let still = eye.shoot(&here, before(10.0), now).unwrap();
    let turning = eye.shoot(&here, before(0.0), now).unwrap();
    assert_eq!(still.frame.pixels, shoot(&settings, &here).frame.pixels);
    assert!(sharpness(&turning) < 0.8 * sharpness(&still), "{} {}", sharpness(&turning), sharpness(&still));
    assert_eq!(still.owner, turning.owner, "the truth is that of the middle of the exposure");

    let noisy = shoot(&SimulatedCameraSettings { noise: 6.0, ..ideal() }, &here);
    let clean = shoot(&ideal(), &here);
    let squares =
        noisy.frame.pixels.iter().zip(clean.frame.pixels.iter()).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    let deviation = (squares.sum::<f64>() / noisy.frame.pixels.len() as f64).sqrt();
    assert!((5.5..6.5).contains(&deviation), "{deviation}");
}

fn camera(kind: &str) -> &'static Kind<dyn Camera> {
    kinds::<dyn Camera>().into_iter().find(|k| k.name == kind).expect("a kind of camera")
}

fn context(truth: Option<Truth>) -> CameraContext {
    CameraContext { robot: icub(), index: 0, seed: 3, truth: Arc::new(move || truth.clone()) }
}

#[test]
fn a_camera_made_by_its_kind_gives_frames_once_there_is_a_truth() {
    let kind = camera("simulated");
    let settings = (kind.example)(&icub()).unwrap();
    let mut blind = (kind.build)(&settings, &context(None)).unwrap();
    assert!(blind.frame(Time::from_secs(1.0)).unwrap().is_none());
    let mut seeing =
        (kind.build)(&json!({ "marker": "r_eye", "fps": 20 }), &context(Some(truth(&icub(), vec![], &[])))).unwrap();
    let frame = seeing.frame(Time::from_secs(1.0)).unwrap().unwrap();
    assert_eq!((frame.exposed, frame.pixels.len()), (Time::from_secs(1.0), 320 * 240 * 3));
    assert_eq!(seeing.period().as_millis(), 50);
    assert!((frame.intrinsics.focal[0] - 257.34).abs() < 0.01);
    // the world lacks what the scenery needs
    let on = json!({ "marker": "r_eye", "scenery": { "distractors": { "count": 3, "on": "table" } } });
    let mut lacking = (kind.build)(&on, &context(Some(truth(&icub(), vec![], &[])))).unwrap();
    assert!(lacking.frame(Time::from_secs(1.0)).unwrap_err().contains("no object table"));
}

#[test]
fn settings_that_make_no_sense_are_refused_with_place_and_remedy() {
    let refused = |settings: Value| match (camera("simulated").build)(&settings, &context(None)) {
        Ok(_) => panic!("{settings} is accepted"),
        Err(e) => e,
    };
    let cases = [
        (json!({ "marker": "l_ey" }), "marker", "no marker l_ey", "l_eye"),
        (json!({ "marker": "l_eye", "size": [0, 240] }), "size[0]", "0 is not", "from 8 to 4096"),
        (json!({ "marker": "l_eye", "size": [320, 100_000] }), "size[1]", "100000 is not", "from 8 to 4096"),
        (json!({ "marker": "l_eye", "fps": 0 }), "fps", "0 is not", "from 0.01"),
        (json!({ "marker": "l_eye", "noise": -1 }), "noise", "-1 is not", "from 0 to 100"),
        (
            json!({ "marker": "l_eye", "lens": { "distortion": [-2.0, 0, 0, 0] } }),
            "lens.distortion",
            "shows nothing at pixel",
            "calibration",
        ),
        (json!({ "marker": "l_eye", "scenery": { "texture": 2 } }), "scenery.texture", "2 is not", "from 0 to 1"),
        (
            json!({ "marker": "l_eye", "scenery": { "pictures": "/none.png" } }),
            "scenery.pictures",
            "/none.png",
            "JPEG or PNG",
        ),
        (
            json!({ "marker": "l_eye", "scenery": { "distractors": { "count": 1000, "on": "t" } } }),
            "scenery.distractors.count",
            "1000",
            "to 100",
        ),
        (json!({ "marker": "l_eye", "focus": 1 }), "focus", "unknown field", "mobee kinds"),
    ];
    for (settings, path, what, help) in cases {
        let e = refused(settings.clone());
        assert!(e.path == path && e.what.contains(what) && e.help.contains(help), "{settings}: {e:?}");
    }
    assert_eq!(ScenerySettings::default().seed, 0);
}
