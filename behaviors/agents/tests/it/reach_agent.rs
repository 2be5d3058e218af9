//! The reaching agent alone: its search, its targets, its reaction to a moving object, and its
//! misses.

use super::world::{arm, ball, by_scene, drive, kind, scene, try_kind, view};
use mobee_contract::*;
use mobee_model::{Edit, Object, ObjectClass, Scene};
use nalgebra::Isometry3;
use serde_json::{Value, json};
use std::sync::Arc;

/// Positions of the hand before and at the cup, meters: settings below.
const BEFORE: [f64; 2] = [-0.12, 0.0];
const AT: [f64; 2] = [-0.06, 0.0];

fn settings(extra: Value) -> Value {
    let mut all = json!({
        "object": "cup", "motors": ["arm"], "palm_toward": [1, 0, 0], "repeat": 1,
        "pre_grasp_mm": [-120, 0, 0], "grasp_mm": [-60, 0, 0], "rest_deg": { "joint0": 90, "joint1": 10 },
    });
    all.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    all
}

fn cup(x: f64, y: f64) -> Object {
    ball("cup", x, y, 0.03, ObjectClass::Target)
}

fn rest() -> [f64; 3] {
    [90f64.to_radians(), 10f64.to_radians(), 0.0]
}

/// Returns the position of the arm's tip.
fn tip(q: &[f64]) -> [f64; 2] {
    let (mut angle, mut at) = (0.0, [0.0, 0.0]);
    for q in q {
        angle += q;
        at = [at[0] + 0.3 * angle.cos(), at[1] + 0.3 * angle.sin()];
    }
    at
}

fn is_near(q: &[f64], cup: [f64; 2], off: [f64; 2]) -> bool {
    let at = tip(q);
    (at[0] - cup[0] - off[0]).hypot(at[1] - cup[1] - off[1]) < 0.003
}

fn figure(summary: &Option<Summary>, name: &str) -> f64 {
    let summary = summary.as_ref().expect("it is done");
    summary.figures.iter().find(|(n, _)| n == name).unwrap_or_else(|| panic!("no figure {name}")).1
}

#[test]
fn it_goes_before_the_cup_to_it_and_back() {
    let robot = arm(3);
    let mut view = view(&scene(&robot, vec![cup(0.5, 0.3)]), &rest());
    let mut agent = kind("reach", &robot, 1, settings(json!({})));
    let run = drive(&mut *agent, &mut view, 50, by_scene);
    let ends: Vec<&Vec<f64>> = run.motions.iter().map(|(_, to, _)| to).collect();
    let before = ends.iter().position(|q| is_near(q, [0.5, 0.3], BEFORE)).expect("before the cup");
    assert!(is_near(ends[before + 1], [0.5, 0.3], AT), "then to it");
    assert!(is_near(ends[before + 2], [0.5, 0.3], BEFORE), "and back");
    assert!(run.q.iter().zip(rest()).all(|(a, b)| (a - b).abs() < 0.01), "home: {:?}", run.q);
    assert_eq!(figure(&run.done, "reached"), 1.0);
}

#[test]
fn it_waits_until_a_cup_that_a_sensor_keeps_is_seen() {
    let robot = arm(3);
    let mut view = view(&scene(&robot, vec![cup(0.5, 0.3)]), &rest());
    let unseen = SeenObject { object: "cup".into(), at: None, place: None, is_stale: false };
    view.seen = Arc::new([unseen.clone()]);
    let mut agent = kind("reach", &robot, 1, settings(json!({})));
    let run = drive(&mut *agent, &mut view, 10, by_scene);
    assert!(run.motions.is_empty() && run.waits == 10, "{run:?}");
    // A sensor's position takes precedence over the scene's.
    let place = Some([0.4, 0.4, 0.0]);
    view.at = Time::from_secs(1.0);
    view.seen = Arc::new([SeenObject { at: Some(Time::from_secs(0.9)), place, ..unseen.clone() }]);
    let run = drive(&mut *agent, &mut view, 1, by_scene);
    assert!(is_near(&run.q, [0.4, 0.4], BEFORE), "{:?}", tip(&run.q));
    // A stale one is not used.
    let mut agent = kind("reach", &robot, 1, settings(json!({})));
    view.seen = Arc::new([SeenObject { at: Some(Time::from_secs(0.9)), place, is_stale: true, ..unseen }]);
    assert!(matches!(agent.next(None, &view), Intent::Wait(_)));
}

#[test]
fn eyes_that_see_nothing_are_turned() {
    let robot = arm(3);
    let mut view = view(&scene(&robot, Vec::new()), &rest());
    let sweep = json!([{ "joint0": 80 }, { "joint0": 100 }]);
    let gaze = json!({ "motors": ["joint0"], "sweep_deg": sweep, "dwell_s": 0 });
    let mut agent = kind("reach", &robot, 1, settings(json!({ "gaze": gaze })));
    let run = drive(&mut *agent, &mut view, 4, by_scene);
    let looked: Vec<f64> = run.motions.iter().map(|(_, to, _)| to[0].to_degrees().round()).collect();
    assert_eq!(looked, [80.0, 100.0, 80.0, 100.0]);
}

fn moved(scene: &Scene, x: f64, y: f64) -> Arc<Scene> {
    let pose = Isometry3::translation(x, y, 0.0);
    Arc::new(scene.edit(&Edit::Move { name: "cup".into(), pose }).unwrap())
}

#[test]
fn a_cup_that_moves_on_the_way_is_followed_and_a_small_move_is_not() {
    let robot = arm(3);
    let mut view = view(&scene(&robot, vec![cup(0.5, 0.3)]), &rest());
    let mut agent = kind("reach", &robot, 1, settings(json!({})));
    assert!(matches!(agent.next(None, &view), Intent::MoveTo(_)));
    view.scene = moved(&view.scene, 0.51, 0.3);
    assert_eq!(agent.revise(&view), None, "a centimeter");
    view.scene = moved(&view.scene, 0.45, 0.4);
    let Some(Intent::MoveTo(target)) = agent.revise(&view) else { panic!("it is followed") };
    assert!(is_near(&target.q, [0.45, 0.4], BEFORE), "{:?}", tip(&target.q));
    view.poses = vec![target.pose(view.pose())];
    let Intent::MoveTo(target) = agent.next(Some(MotionEnd::Reached), &view) else { panic!("to it") };
    assert!(is_near(&target.q, [0.45, 0.4], AT), "{:?}", tip(&target.q));
    // Moved away while the hand comes down: the motion is rolled back, and the hand goes to the new
    // position.
    view.scene = moved(&view.scene, 0.5, 0.2);
    assert_eq!(agent.revise(&view), Some(Intent::Stop));
    let Intent::MoveTo(target) = agent.next(Some(MotionEnd::Failed), &view) else { panic!("there") };
    assert!(is_near(&target.q, [0.5, 0.2], BEFORE), "{:?}", tip(&target.q));
}

#[test]
fn a_hand_never_goes_down_where_the_cup_is_known_not_to_be() {
    let robot = arm(3);
    for is_late in [false, true] {
        let mut view = view(&scene(&robot, vec![cup(0.5, 0.3)]), &rest());
        let mut agent = kind("reach", &robot, 1, settings(json!({})));
        let Intent::MoveTo(target) = agent.next(None, &view) else { panic!("it sets out") };
        // To where no posture exists: the hand stops, or, if that is detected too late, arrives.
        view.scene = moved(&view.scene, 1.5, 0.3);
        if is_late {
            view.poses = vec![target.pose(view.pose())];
        } else {
            assert_eq!(agent.revise(&view), Some(Intent::Stop));
        }
        let run = drive(&mut *agent, &mut view, 50, by_scene);
        assert!(run.motions.iter().all(|(_, to, _)| !is_near(to, [0.5, 0.3], AT)), "{run:?}");
        assert!(run.q.iter().zip(rest()).all(|(a, b)| (a - b).abs() < 0.01), "it is home: {:?}", run.q);
        assert_eq!((figure(&run.done, "reached"), figure(&run.done, "missed_out_of_reach")), (0.0, 1.0));
    }
}

/// Returns a configuration of three joints with the tip there, pointing along x.
fn pointing_at(x: f64, y: f64) -> Vec<f64> {
    let (wrist, link) = ((x - 0.3, y), 0.3);
    let far = wrist.0.hypot(wrist.1);
    let bend = 2.0 * (far / (2.0 * link)).acos();
    let first = wrist.1.atan2(wrist.0) - bend / 2.0;
    vec![first, bend, -first - bend]
}

#[test]
fn what_eyes_face_and_do_not_see_is_looked_for_anew() {
    let robot = arm(3);
    let wall = ball("wall", 0.3, 0.3, 0.03, ObjectClass::Obstacle);
    let gaze = json!({ "motors": ["joint2"], "eyes": ["tip"], "sweep_deg": [{ "joint2": 0 }] });
    let seen = |is_stale: bool| {
        let (at, place) = (Some(Time::from_secs(1.0)), Some([0.5, 0.3, 0.0]));
        Arc::new([SeenObject { object: "cup".into(), at, place, is_stale }])
    };
    let revised = |objects: Vec<Object>, is_stale: bool, q: Vec<f64>| {
        let mut view = view(&scene(&robot, vec![cup(0.5, 0.3)]), &rest());
        (view.at, view.seen) = (Time::from_secs(1.0), seen(false));
        let mut agent = kind("reach", &robot, 1, settings(json!({ "gaze": gaze.clone() })));
        assert!(matches!(agent.next(None, &view), Intent::MoveTo(_)), "it sets out");
        let all = objects.into_iter().chain([cup(0.5, 0.3)]).collect();
        (view.scene, view.seen) = (scene(&robot, all), seen(is_stale));
        (view.at, view.poses) = (Time::from_secs(4.0), vec![q.into()]);
        agent.revise(&view)
    };
    let facing = pointing_at(0.12, 0.3);
    assert_eq!(revised(Vec::new(), false, facing.clone()), None, "it is seen");
    assert_eq!(revised(Vec::new(), true, rest().to_vec()), None, "the eyes look elsewhere");
    assert_eq!(revised(vec![wall], true, facing.clone()), None, "something is between");
    assert_eq!(revised(Vec::new(), true, facing), Some(Intent::Stop), "it is gone: the motion is taken back");
}

#[test]
fn a_cup_that_is_not_to_be_followed_is_reached_for_where_it_was() {
    let robot = arm(3);
    let mut view = view(&scene(&robot, vec![cup(0.5, 0.3)]), &rest());
    let mut agent = kind("reach", &robot, 1, settings(json!({ "follow": false })));
    assert!(matches!(agent.next(None, &view), Intent::MoveTo(_)));
    view.scene = moved(&view.scene, 0.45, 0.4);
    assert_eq!(agent.revise(&view), None);
    let run = drive(&mut *agent, &mut view, 50, by_scene);
    assert!(run.motions.iter().any(|(_, to, _)| is_near(to, [0.5, 0.3], AT)), "{run:?}");
}

#[test]
fn what_was_in_the_way_once_is_gone_round_from_then_on() {
    let robot = arm(3);
    let wall = ball("wall", 0.25, 0.75, 0.12, ObjectClass::Obstacle);
    let mut view = view(&scene(&robot, vec![cup(0.6, 0.15), wall]), &rest());
    let several = json!({ "validation": "optimistic", "repeat": 6 });
    let mut agent = kind("reach", &robot, 1, settings(several));
    let run = drive(&mut *agent, &mut view, 400, by_scene);
    assert_eq!(figure(&run.done, "reached"), 6.0, "{:?}", run.done);
    let failed = run.motions.iter().filter(|(.., ok)| !ok).count();
    assert!(failed <= 2, "{failed} motions failed, of {}", run.motions.len());
}

#[test]
fn a_way_that_fails_is_gone_round_in_every_mode() {
    let robot = arm(3);
    for mode in ["optimistic", "lazy", "verified"] {
        // In the way of the straight line from rest.
        let wall = ball("wall", 0.25, 0.75, 0.12, ObjectClass::Obstacle);
        let mut view = view(&scene(&robot, vec![cup(0.6, 0.15), wall]), &rest());
        let mut agent = kind("reach", &robot, 1, settings(json!({ "validation": mode })));
        let run = drive(&mut *agent, &mut view, 80, by_scene);
        assert_eq!(figure(&run.done, "reached"), 1.0, "{mode}: {:?}", run.done);
        let failed = run.motions.iter().filter(|(.., ok)| !ok).count();
        assert!(mode == "optimistic" || failed == 0, "{mode}: {failed} motions failed");
    }
}

#[test]
fn a_miss_has_a_cause() {
    let robot = arm(3);
    let miss = |objects: Vec<Object>, cause: &str| {
        let mut view = view(&scene(&robot, objects), &rest());
        let mut agent = kind("reach", &robot, 1, settings(json!({ "budget": 500 })));
        let run = drive(&mut *agent, &mut view, 300, by_scene);
        assert_eq!((figure(&run.done, cause), figure(&run.done, "reached")), (1.0, 0.0), "{cause}: {:?}", run.done);
    };
    miss(vec![cup(2.0, 0.0)], "missed_out_of_reach");
    let lid = ball("lid", 0.42, 0.3, 0.06, ObjectClass::Obstacle);
    miss(vec![cup(0.5, 0.3), lid], "missed_not_free");
    // Tracked by a sensor that never detects it, wherever the eyes look.
    let mut view = view(&scene(&robot, vec![cup(0.5, 0.3)]), &rest());
    view.seen = Arc::new([SeenObject { object: "cup".into(), at: None, place: None, is_stale: false }]);
    let gaze = json!({ "motors": ["joint0"], "sweep_deg": [{ "joint0": 80 }, { "joint0": 100 }], "dwell_s": 0 });
    let mut agent = kind("reach", &robot, 1, settings(json!({ "gaze": gaze })));
    let run = drive(&mut *agent, &mut view, 60, by_scene);
    assert_eq!(figure(&run.done, "missed_unseen"), 1.0, "{:?}", run.done);
}

#[test]
fn a_successor_goes_on_where_it_was() {
    let robot = arm(3);
    let mut view = view(&scene(&robot, vec![cup(0.5, 0.3)]), &rest());
    let mut agent = kind("reach", &robot, 1, settings(json!({})));
    let Intent::MoveTo(target) = agent.next(None, &view) else { panic!("it sets out") };
    let mut next = kind("reach", &robot, 2, settings(json!({})));
    next.import(agent.export()).expect("a state of its kind");
    view.poses = vec![target.pose(view.pose())];
    let Intent::MoveTo(target) = next.next(Some(MotionEnd::Reached), &view) else { panic!("to the cup") };
    assert!(is_near(&target.q, [0.5, 0.3], AT));
    assert!(next.import(Snapshot { kind: "plan".into(), version: 1, state: json!({}) }).is_err());
}

#[test]
fn settings_that_make_no_sense_are_refused_with_their_place() {
    let robot = arm(3);
    let refused = |extra: Value, place: &str| {
        let error = try_kind("reach", &robot, 1, settings(extra)).err().unwrap_or_else(|| panic!("{place} is refused"));
        assert!(error.clone().all().iter().any(|e| e.path == place), "{place}: {error:?}");
    };
    refused(json!({ "motors": ["leg"] }), "motors[0]");
    refused(json!({ "hand": "foot" }), "hand");
    refused(json!({ "palm_toward": [0, 0, 0] }), "palm_toward");
    refused(json!({ "pre_grasp_mm": [0, 0, 3000] }), "pre_grasp_mm");
    refused(json!({ "moved_mm": 0 }), "moved_mm");
    refused(json!({ "budget": 0 }), "budget");
    refused(json!({ "speed": 2 }), "speed");
    refused(json!({ "rest_deg": { "joint9": 1 } }), "rest_deg.joint9");
    refused(json!({ "gaze": { "motors": ["arm"], "eyes": ["third"] } }), "gaze.eyes[0]");
    refused(json!({ "gaze": { "motors": ["joint0"], "sweep_deg": [{ "joint1": 5 }] } }), "gaze.sweep_deg[0]");
}
