//! Poses given by the hand: joint values are found wherever a free pose exists, they are free and
//! within the limits, and equal settings give equal values.

use crate::world::*;
use mobee_contract::KindError;
use mobee_model::*;
use mobee_planning::hand_goal::{HandGoals, ResolvedGoal};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

const CLEARANCE: f64 = 0.012;

fn load(robot: &str, world: Option<&str>, base: Isometry3<f64>) -> Scene {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let robot = Arc::new(load_robot(configs.join("robots").join(robot)).unwrap().value);
    let objects = world.map(|world| load_world(configs.join("worlds").join(world)).unwrap().value);
    Scene::new(vec![(robot, base)], objects.unwrap_or_default()).unwrap()
}

fn resolve(scene: &Scene, seed: u64, agent: &mut Value) -> Result<Vec<ResolvedGoal>, KindError> {
    HandGoals { scene, robot: 0, clearance: CLEARANCE, seed }.resolve(agent)
}

/// Returns the whole configuration of resolved settings, with all other motors at home.
fn whole(scene: &Scene, pose: &Value) -> Vec<f64> {
    let robot = &scene.robots()[0];
    let at = |m: &Motor| pose["q_deg"][&m.name].as_f64().map_or(m.home, f64::to_radians);
    robot.motors.iter().map(at).collect()
}

fn marker(scene: &Scene, name: &str, q: &[f64]) -> Isometry3<f64> {
    let node = scene.robots()[0].markers.iter().find(|m| m.name == name).unwrap().node;
    scene.node_transforms(&[q])[0][node]
}

/// Returns the error of a marker's pose, mm and degrees.
fn off(at: &Isometry3<f64>, goal: &Isometry3<f64>) -> (f64, f64) {
    let mm = (at.translation.vector - goal.translation.vector).norm() * 1e3;
    (mm, at.rotation.angle_to(&goal.rotation).to_degrees())
}

fn goal_of(frame: &Isometry3<f64>, hand: &str) -> Value {
    let (roll, pitch, yaw) = frame.rotation.euler_angles();
    let rpy = [roll, pitch, yaw].map(f64::to_degrees);
    let at: [f64; 3] = frame.translation.vector.into();
    json!({ "poses": [{ "name": "there", "hand_at": { "hand": hand, "position_m": at, "rpy_deg": rpy } }] })
}

/// Draws free configurations and resolves their hand poses: position and orientation.
fn found_again(scene: &Scene, hand: &str, motors: &[&str], count: usize) -> usize {
    let robot = scene.robots()[0].clone();
    let moved: Vec<usize> =
        motors.iter().map(|name| robot.motors.iter().position(|m| m.name == *name).unwrap()).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut drawn, mut found) = (0, 0);
    while drawn < count {
        let mut q = robot.home();
        for m in &moved {
            let (min, max) = robot.motors[*m].range();
            q[*m] = rng.random_range(min..=max);
        }
        if !scene.robot_free(0, &[q.as_slice()], CLEARANCE) {
            continue;
        }
        drawn += 1;
        let frame = marker(scene, hand, &q);
        let mut agent = goal_of(&frame, hand);
        let Ok(told) = resolve(scene, 1, &mut agent) else { continue };
        found += 1;
        let q = whole(scene, &agent["poses"][0]);
        let (mm, deg) = off(&marker(scene, hand, &q), &frame);
        assert!(mm < 0.2 && deg < 0.2, "{mm} mm, {deg} deg");
        assert!(told[0].off_m < 1e-4 && told[0].off_rad < 2e-3, "{told:?}");
        assert!(scene.robot_free(0, &[q.as_slice()], CLEARANCE), "it is not free");
        assert!(robot.motors.iter().zip(&q).all(|(m, q)| (m.min - 1e-9..=m.max + 1e-9).contains(q)), "{q:?}");
        assert!(agent["poses"][0].get("hand_at").is_none());
    }
    found
}

#[test]
fn where_a_free_pose_has_its_hand_a_free_pose_is_found_again() {
    let base = Isometry3::from_parts(
        Translation3::new(0.4, -0.2, 0.1),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7),
    );
    let icub = load("icub.xml", Some("table.xml"), Isometry3::identity());
    let arm = [
        "torso_yaw",
        "torso_roll",
        "torso_pitch",
        "r_shoulder_pitch",
        "r_shoulder_roll",
        "r_shoulder_yaw",
        "r_elbow",
        "r_wrist_prosup",
        "r_wrist_pitch",
        "r_wrist_yaw",
    ];
    let ur5 = load("ur5.xml", None, base);
    let names: Vec<String> = ur5.robots()[0].motors.iter().map(|m| m.name.clone()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let (of_icub, of_ur5) = (found_again(&icub, "r_hand", &arm, 100), found_again(&ur5, "wrist_3_link", &names, 100));
    println!("found again: icub {of_icub}, ur5 {of_ur5} of 100 each");
    assert!(of_icub >= 98 && of_ur5 >= 98, "icub {of_icub}, ur5 {of_ur5} of 100 each");
}

#[test]
fn equal_settings_give_equal_joint_values_whatever_stands_beside_them() {
    let scene = load("icub.xml", Some("table.xml"), Isometry3::identity());
    let pose = json!({ "name": "there", "hand_at": { "hand": "r_hand", "position_m": [-0.25, 0.25, 0.15] } });
    let other = json!({ "name": "up", "hand_at": { "hand": "r_hand", "position_m": [-0.2, 0.2, 0.3] } });
    let by_joints = json!({ "name": "rest", "q_deg": { "r_elbow": 60 } });
    let mut first = json!({ "poses": [pose] });
    let mut second = json!({ "poses": [by_joints, other, pose] });
    resolve(&scene, 5, &mut first).unwrap();
    assert_eq!(resolve(&scene, 5, &mut second).unwrap().len(), 2);
    assert_eq!(first["poses"][0], second["poses"][2]);
    assert_eq!(second["poses"][0], by_joints);
}

#[test]
fn only_the_agents_motors_move_and_none_but_those_of_the_hand() {
    let scene = load("icub.xml", None, Isometry3::identity());
    let goal = json!({ "position_m": [-0.25, 0.25, 0.15] });
    let mut all = json!({ "hand": "r_hand", "poses": [{ "name": "there", "hand_at": goal }] });
    let mut arm = json!({ "motors": ["right_arm"], "poses": [{ "name": "there", "hand_at": goal }] });
    let named = |agent: &Value| agent["poses"][0]["q_deg"].as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    resolve(&scene, 1, &mut all).unwrap();
    // Without a name, the hand is the marker that the agent's motors move.
    assert_eq!(resolve(&scene, 1, &mut arm).unwrap()[0].hand, "r_hand");
    let of_arm = named(&arm);
    assert!(named(&all).iter().any(|m| m.starts_with("torso_")));
    assert!(of_arm.iter().all(|m| m.starts_with("r_")) && of_arm.len() == 7, "{of_arm:?}");
}

#[test]
fn a_goal_in_the_base_frame_moves_with_the_robot() {
    let base = Isometry3::from_parts(
        Translation3::new(1.0, -0.5, 0.3),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 1.1),
    );
    let (here, there) = (load("katana.xml", None, Isometry3::identity()), load("katana.xml", None, base));
    // The hand's position a quarter of the way from home to the upper limits: reachable, but not at
    // home.
    let robot = here.robots()[0].clone();
    let q: Vec<f64> = robot.motors.iter().map(|m| m.home + 0.25 * (m.max - m.home)).collect();
    let wanted = marker(&here, "tool", &q);
    let (place, palm) = (wanted.translation.vector, wanted.rotation * Vector3::z());
    let [position, palm_toward]: [[f64; 3]; 2] = [place, palm].map(Into::into);
    let goal = json!({ "position_m": position, "palm_toward": palm_toward, "frame": "base" });
    let [mut a, mut b] = [(); 2].map(|()| json!({ "poses": [{ "hand_at": goal }] }));
    resolve(&here, 1, &mut a).unwrap();
    resolve(&there, 1, &mut b).unwrap();
    let at = |scene: &Scene, agent: &Value| marker(scene, "tool", &whole(scene, &agent["poses"][0]));
    let (at_a, at_b) = (at(&here, &a), at(&there, &b));
    assert!((at_a.translation.vector - place).norm() < 2e-4);
    assert!((at_b.translation.vector - (base * at_a).translation.vector).norm() < 4e-4);
    // Its normal is z of its frame.
    assert!((at_a.rotation * Vector3::z() - palm).norm() < 4e-3);
}

#[test]
fn an_obstacle_leaves_another_posture_or_none_and_the_contact_is_named() {
    let free = scene(&arm(3), vec![]);
    let there = || json!({ "poses": [{ "hand_at": { "position_m": [0.55, 0.3, 0.0] } }] });
    let mut agent = there();
    resolve(&free, 1, &mut agent).unwrap();
    let q = whole(&free, &agent["poses"][0]);
    // A ball at the elbow's position in this posture.
    let elbow = free.node_transforms(&[q.as_slice()])[0][3].translation.vector;
    let blocked = scene(&arm(3), vec![ball("ball", elbow.x, elbow.y, 0.03, ObjectClass::Obstacle)]);
    let mut other = there();
    resolve(&blocked, 1, &mut other).unwrap();
    let other = whole(&blocked, &other["poses"][0]);
    assert!(blocked.robot_free(0, &[other.as_slice()], CLEARANCE) && other != q);
    // A ball at the hand's goal.
    let blocked = scene(&arm(3), vec![ball("ball", 0.55, 0.3, 0.05, ObjectClass::Obstacle)]);
    let why = resolve(&blocked, 1, &mut there()).unwrap_err();
    assert!(why.path == "poses[0].hand_at.position_m" && why.what.contains(" ball, and poses keep 12.0 mm"), "{why:?}");
}

#[test]
fn what_is_out_of_reach_is_refused_with_how_far_it_is() {
    let scene = scene(&arm(3), vec![]);
    let refused = |goal: Value| resolve(&scene, 1, &mut json!({ "poses": [{ "hand_at": goal }] })).unwrap_err();
    // The tip reaches 0.90 m.
    let why = refused(json!({ "position_m": [1.91, 0.0, 0.0] }));
    assert_eq!(why.path, "poses[0].hand_at.position_m");
    assert!(why.what.ends_with("misses it by 1010.0 mm"), "{}", why.what);
    // A planar arm has no pitch.
    let why = refused(json!({ "position_m": [0.5, 0.3, 0.0], "rpy_deg": [0, 30, 0] }));
    assert_eq!(why.path, "poses[0].hand_at.rpy_deg");
    assert!(why.help.contains("the position alone can be reached"), "{}", why.help);
}

#[test]
fn a_file_cannot_keep_the_search_busy_for_hours() {
    let goal = json!({ "hand_at": { "position_m": [5.0, 0.0, 0.0] } });
    let why = resolve(&scene(&arm(3), vec![]), 1, &mut json!({ "poses": vec![goal; 201] })).unwrap_err();
    assert!(why.path == "poses" && why.what.contains("201 poses"), "{why:?}");
}

#[test]
fn agents_refuse_what_was_not_resolved() {
    let pose = json!({ "name": "there", "hand_at": { "position_m": [0.5, 0.3, 0.0] } });
    let why = try_kind("plan", &arm(3), 1, json!({ "poses": [pose], "goals": ["there"] })).err().unwrap();
    assert!(why.path == "poses[0]" && why.help.contains("HandGoals::resolve"), "{why:?}");
}
