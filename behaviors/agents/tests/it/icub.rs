//! The explorer on the supplied iCub in the world of the exploration experiment, without time and
//! motors: an edge fails if its straight line comes closer than the reflex's margin.

use crate::world::*;
use mobee_agents::{Explorer, ExplorerSettings};
use mobee_contract::Note;
use mobee_model::{load_robot, load_world};
use mobee_planning::planners::escape::{caught, escape};
use mobee_planning::roadmap::verdict::judge;
use nalgebra::Isometry3;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

#[test]
fn the_icub_finds_out_which_ways_are_blocked() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let robot = Arc::new(load_robot(configs.join("robots/icub.xml")).unwrap().value);
    let objects = load_world(configs.join("worlds/explore.xml")).unwrap().value;
    let scene = Arc::new(mobee_model::Scene::new(vec![(robot.clone(), Isometry3::identity())], objects).unwrap());
    let motors = [
        "torso",
        "r_shoulder_pitch",
        "r_shoulder_roll",
        "r_shoulder_yaw",
        "r_elbow",
        "r_wrist_prosup",
        "r_wrist_pitch",
        "r_wrist_yaw",
    ];
    let settings: ExplorerSettings = serde_json::from_value(json!({ "motors": motors, "neighbors": 10 })).unwrap();
    let mut agent = Explorer::new(settings, &context(&robot, 1)).unwrap();
    let mut view = view(&scene, &scene.home()[0]);
    let run = drive(&mut agent, &mut view, 2000, by_scene);
    let summary = run.done.expect("an end");
    println!("{summary:?}, {} motions", run.motions.len());
    let figure = |name: &str| summary.figures.iter().find(|(n, _)| n == name).unwrap().1;
    assert_eq!(figure("vertices"), 20.0);
    assert!(figure("edges_removed") >= 20.0, "too little stands in the way: {summary:?}");
    assert!(run.motions.len() as f64 <= 2.0 * figure("edges"), "{} motions", run.motions.len());
    let report = judge(agent.map(), &scene, 0, &view.poses, view.clearance);
    println!("agree {}, borderline {}", report.agree, report.borderline.len());
    assert_eq!(report.disagree, []);
    let marker =
        |q: &[f64]| mobee_planning::group::marker_at(&view, robot.markers.iter().position(|m| m.name == "r_hand"), q);
    for (_, vertex) in agent.map().vertices() {
        assert_eq!(vertex.at, marker(&vertex.q), "the hand stands for the group");
    }
}

#[test]
fn the_marker_that_is_named_stands_for_the_poses() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let robot = Arc::new(load_robot(configs.join("robots/icub.xml")).unwrap().value);
    let scene = scene(&robot, vec![]);
    let mut view = view(&scene, &scene.home()[0]);
    let eye = robot.markers.iter().position(|m| m.name == "l_eye");
    let pose = |name: &str, deg: f64| json!({ "name": name, "q_deg": { "torso_yaw": deg } });
    for (kind, settings) in [
        ("explorer", json!({ "motors": ["torso"], "vertices": 3, "hand": "l_eye" })),
        (
            "roadmap",
            json!({ "poses": [pose("a", 0.0), pose("b", 20.0)], "goals": ["b"], "neighbors": 1, "hand": "l_eye" }),
        ),
    ] {
        let mut agent = try_kind(kind, &robot, 1, settings).unwrap();
        let run = drive(agent.as_mut(), &mut view, 1, |_, _, _| true);
        let placed = run.notes.iter().filter_map(|n| match n {
            Note::Vertex { q, at, .. } => Some((q, *at)),
            _ => None,
        });
        let placed: Vec<_> = placed.collect();
        assert!(placed.len() >= 2, "{kind}");
        assert!(placed.iter().all(|(q, at)| *at == mobee_planning::group::marker_at(&view, eye, q)), "{kind}");
    }
}

#[test]
fn the_icub_gets_away_from_a_ball_put_onto_its_hand() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let robot = Arc::new(load_robot(configs.join("robots/icub.xml")).unwrap().value);
    let empty = scene(&robot, vec![]);
    let home = empty.home()[0].clone();
    let hand = robot.markers.iter().position(|m| m.name == "r_hand");
    let [x, y, z] = mobee_planning::group::marker_at(&view(&empty, &home), hand, &home);
    let names: Vec<String> =
        vec!["torso".into(), "r_shoulder_pitch".into(), "r_shoulder_roll".into(), "r_elbow".into()];
    let group = mobee_planning::group::motors("motors", &names, &robot).unwrap();
    for (dx, dy, dz) in [(-0.06, 0.0, 0.05), (0.0, 0.0, 0.075), (0.0, 0.05, 0.06)] {
        let mut object = ball("ball", x + dx, y + dy, 0.05, mobee_model::ObjectClass::Obstacle);
        object.pose = Isometry3::translation(x + dx, y + dy, z + dz);
        let scene = scene(&robot, vec![object]);
        let view = view(&scene, &home);
        assert!(caught(&view));
        let target = escape(&view, &group, &[], 0.1, 1).expect("a way out");
        assert!(scene.free(&[target.pose(&home)], view.clearance), "not free at the end");
    }
}
