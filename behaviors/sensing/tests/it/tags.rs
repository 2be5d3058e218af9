//! The kind `tag` without a camera: poses of squares, invalid settings, and invalid images.

use mobee_contract::{Context, Detector, Kind, KindError, kinds};
use mobee_model::load_robot;
use mobee_sensing::detectors::picture::Picture;
use mobee_sensing::detectors::tag::{TagFamilyName, TagSeeker, pose_of_square};
use mobee_sensing::locators::lens::Lens;
use nalgebra::{Isometry3, Matrix6, Quaternion, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::sync::Arc;

/// Draws an approximately normal number with a standard deviation of 1.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random_range(-0.5..0.5)).sum()
}

#[test]
fn a_square_is_where_its_corners_say_and_as_surely_as_they_are_seen() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let [_, lens] = Lens::icub();
    let (size, mut surprises) = (0.08, Vec::new());
    for round in 0..400 {
        let z = rng.random_range(0.25..0.8);
        let at = Translation3::new(rng.random_range(-0.3..0.3) * z, rng.random_range(-0.3..0.3) * z, z);
        let [roll, pitch, yaw] = [0.9, 0.9, 3.1].map(|most: f64| rng.random_range(-most..most));
        let there = Isometry3::from_parts(at, UnitQuaternion::from_euler_angles(roll, pitch, yaw));
        let own =
            [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[x, y]| Vector3::new(x * size, y * size, 0.0));
        let seen = |sigma: f64, rng: &mut ChaCha8Rng| {
            own.map(|p| {
                let at = there.rotation * p + there.translation.vector;
                let pixel = lens.project(&at).expect("before the camera").0;
                [pixel.x + sigma * normal(rng), pixel.y + sigma * normal(rng)]
            })
        };
        let error = |pose: &mobee_contract::SeenPose| {
            let [w, x, y, z] = pose.rotation;
            let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            let way = Vector3::from(pose.position) - there.translation.vector;
            let turned = (turn * there.rotation.inverse()).scaled_axis();
            Vector6::new(way.x, way.y, way.z, turned.x, turned.y, turned.z)
        };
        let exact = pose_of_square(&seen(0.0, &mut rng), size, &lens).expect("a pose");
        assert!(error(&exact).norm() < 1e-5, "round {round}: {exact:?}, {there}");
        let noisy = pose_of_square(&seen(0.12, &mut rng), size, &lens).expect("a pose");
        let covariance = Matrix6::from_fn(|i, j| noisy.covariance[i][j]);
        surprises.push(error(&noisy).dot(&(covariance.try_inverse().expect("a covariance") * error(&noisy))));
    }
    surprises.sort_by(f64::total_cmp);
    let (median, most) = (surprises[200], surprises[380]);
    // Chi-squared with six degrees of freedom: the median is 5.3, the 95th percentile 12.6.
    assert!((4.0..6.5).contains(&median) && most < 16.0, "{median} {most}");
}

#[test]
fn corners_that_are_no_square_before_the_camera_have_no_pose_and_stop_nothing() {
    let [lens, _] = Lens::icub();
    let square = [[10.0, 10.0], [50.0, 10.0], [50.0, 50.0], [10.0, 50.0]];
    assert!(pose_of_square(&square, 0.1, &lens).is_some());
    assert!(pose_of_square(&square, 0.0, &lens).is_none() && pose_of_square(&square, f64::NAN, &lens).is_none());
    assert!(pose_of_square(&[[3.0, 3.0]; 4], 0.1, &lens).is_none());
    let dull = Lens { focal: [0.0; 2], ..lens };
    assert!(pose_of_square(&square, 0.1, &dull).is_none());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..2000 {
        let wild = [0; 4].map(|_| [0; 2].map(|_| rng.random_range(-1e4..1e4)));
        if let Some(pose) = pose_of_square(&wild, 0.1, &lens) {
            assert!(pose.position[2] > 0.0 && pose.position.iter().all(|n| n.is_finite()));
        }
    }
}

#[test]
fn no_picture_stops_the_search() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut seekers = TagFamilyName::ALL.map(TagSeeker::new);
    for round in 0..240 {
        let [width, height] = [0; 2].map(|_| rng.random_range(1..90usize));
        let coarse = rng.random_range(1..12usize);
        let values: Vec<u8> =
            (0..4096).map(|_| if round % 3 == 0 { rng.random() } else { 255 * rng.random_range(0..2) }).collect();
        let rgb = (0..width * height)
            .flat_map(|k| [values[(k / width / coarse * 64 + k % width / coarse) % 4096]; 3])
            .collect();
        let picture = Picture { width, height, rgb };
        for seeker in &mut seekers {
            let first = seeker.seek(&picture);
            assert_eq!(seeker.seek(&picture), first, "the same picture shows the same");
        }
    }
    let broken = Picture { width: 64, height: 64, rgb: vec![0; 7] };
    assert!(seekers[0].seek(&broken).is_empty());
}

fn refused(settings: Value) -> KindError {
    let kind: &Kind<dyn Detector> =
        kinds().into_iter().find(|k: &&Kind<dyn Detector>| k.name == "tag").expect("the kind");
    let robot =
        load_robot(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml")).expect("a robot").value;
    (kind.build)(&settings, &Context { robot: Arc::new(robot), seed: 0 }).err().expect("settings that make no sense")
}

#[test]
fn settings_that_make_no_sense_are_refused_with_place_and_remedy() {
    let one = json!([{ "id": 7, "object": "cup" }]);
    let cases = [
        (json!({ "tags": one }), "size_m"),
        (json!({ "size_m": 0.0, "tags": one }), "size_m"),
        (json!({ "size_m": 60, "tags": one }), "size_m"),
        (json!({ "size_m": 0.06, "tags": [] }), "tags"),
        (json!({ "size_m": 0.06, "tags": [{ "id": 587, "object": "cup" }] }), "tags[0].id"),
        (json!({ "size_m": 0.06, "family": "16h5", "tags": [{ "id": 30, "object": "cup" }] }), "tags[0].id"),
        (json!({ "size_m": 0.06, "family": "36h12", "tags": one }), "family"),
        (json!({ "size_m": 0.06, "tags": [{ "id": 1, "object": "a" }, { "id": 1, "object": "b" }] }), "tags[1].id"),
        (json!({ "size_m": 0.06, "tags": [{ "id": 1, "object": "a", "size_m": -1 }] }), "tags[0].size_m"),
        (json!({ "size_m": 0.06, "errors": 3, "tags": one }), "errors"),
        (json!({ "size_m": 0.06, "margin": -1, "tags": one }), "margin"),
    ];
    for (settings, path) in cases {
        let error = refused(settings.clone());
        let said = format!("{} {}", error.path, error.what);
        assert!(said.contains(path) && !error.help.is_empty(), "{settings}: {error:?}");
    }
}
