//! The two short agents, and properties of every registered kind.

use crate::world::*;
use mobee_contract::*;
use mobee_model::ObjectClass;
use serde_json::json;

#[test]
fn scripted_goes_through_its_poses_rests_and_repeats() {
    let robot = arm(2);
    let script = json!({
        "poses": [{ "q_deg": { "joint0": 30 }, "wait_s": 1.5 }, { "q_deg": { "joint1": -90 } }],
        "repeat": 2, "speed": 0.5,
    });
    let mut agent = kind("scripted", &robot, 1, script);
    let mut view = view(&scene(&robot, vec![]), &[0.0, 0.0]);
    let run = drive(agent.as_mut(), &mut view, 100, |_, _, _| true);
    let ends: Vec<Vec<f64>> =
        run.motions.iter().map(|(_, to, _)| to.iter().map(|q| q.to_degrees().round()).collect()).collect();
    assert_eq!(ends, [[30.0, 0.0], [30.0, -90.0], [30.0, -90.0], [30.0, -90.0]]);
    assert_eq!(run.waits, 2);
    assert_eq!(run.done.unwrap().figures, [("reached".into(), 4.0), ("missed".into(), 0.0)]);
}

#[test]
fn scripted_goes_on_after_a_failure() {
    let robot = arm(2);
    let mut agent = kind(
        "scripted",
        &robot,
        1,
        json!({ "poses": [{ "q_deg": { "joint0": 30 }, "wait_s": 9 }, { "q_deg": { "joint0": 0 } }] }),
    );
    let mut fail_first = [false, true].into_iter();
    let run =
        drive(agent.as_mut(), &mut view(&scene(&robot, vec![]), &[0.0, 0.0]), 9, |_, _, _| fail_first.next().unwrap());
    assert_eq!((run.motions.len(), run.waits), (2, 0));
    assert_eq!(run.done.unwrap().figures, [("reached".into(), 1.0), ("missed".into(), 1.0)]);
}

#[test]
fn random_stays_within_limits_counts_its_moves_and_looks_first_if_asked_to() {
    let robot = arm(3);
    let scene = scene(&robot, vec![ball("ball", 0.5, 0.5, 0.35, ObjectClass::Obstacle)]);
    let run = |checked: bool, seed: u64| {
        let mut agent =
            kind("random", &robot, seed, json!({ "motors": ["joint0", "joint2"], "count": 40, "checked": checked }));
        drive(agent.as_mut(), &mut view(&scene, &[-1.0, 0.0, 0.0]), 100, |_, _, _| true)
    };
    let free = |r: &Run| r.motions.iter().filter(|(_, to, _)| scene.free(&[to], 0.012)).count();
    let (checked, unchecked) = (run(true, 4), run(false, 4));
    assert_eq!((checked.motions.len(), free(&checked)), (40, 40));
    assert!(free(&unchecked) < 40, "the world is too easy for this test");
    assert!(
        checked.motions.iter().all(|(_, to, _)| to[1] == 0.0 && to.iter().all(|q| q.abs() <= std::f64::consts::PI))
    );
    assert_eq!(run(true, 4).motions, checked.motions);
    assert_ne!(run(true, 5).motions, checked.motions);
}

#[test]
fn random_rests_at_poses_that_it_reached_if_asked_to() {
    let robot = arm(3);
    let mut agent = kind("random", &robot, 4, json!({ "motors": ["joint0"], "count": 3, "wait_s": 2 }));
    let mut fails = [true, false, true].into_iter();
    let run = drive(agent.as_mut(), &mut view(&scene(&robot, vec![]), &[0.0; 3]), 9, |_, _, _| fails.next().unwrap());
    // After the last one it is done.
    assert_eq!((run.motions.len(), run.waits), (3, 1));
}

/// A board may have narrower limits than the model: positions beyond them would be rejected.
#[test]
fn poses_are_drawn_within_what_the_board_allows() {
    let robot = arm(3);
    let scene = scene(&robot, vec![]);
    let mut view = view(&scene, &[0.0; 3]);
    view.axes = view.axes.iter().map(|axis| Axis { min: -0.3, max: 0.2, ..axis.clone() }).collect();
    for (name, settings) in [
        ("random", json!({ "motors": ["joint0", "joint2"], "count": 40 })),
        ("explorer", json!({ "motors": ["joint0", "joint1", "joint2"], "vertices": 8 })),
        ("jog", json!({ "motors": ["joint0", "joint2"], "count": 40, "by": ["move"] })),
    ] {
        let mut agent = kind(name, &robot, 4, settings);
        let run = drive(agent.as_mut(), &mut view.clone(), 60, |_, _, _| true);
        assert!(run.motions.len() > 5, "{name}: {}", run.motions.len());
        assert!(run.motions.iter().all(|(_, to, _)| to.iter().all(|q| (-0.3..=0.2).contains(q))), "{name}");
    }
}

/// Returns the intents of a jog in this number of steps of 20 ms, on motors without delay.
fn jogged(settings: serde_json::Value, steps: u64) -> Vec<Intent> {
    let robot = arm(4);
    let mut agent = kind("jog", &robot, 7, settings);
    let mut view = view(&scene(&robot, vec![]), &[0.0; 4]);
    let (mut said, mut streams) = (Vec::new(), false);
    for k in 0..steps {
        view.at = Time(k * 20_000_000);
        let revised = if streams { agent.revise(&view) } else { None };
        let intent = revised.unwrap_or_else(|| agent.next(None, &view));
        let mut q = view.pose().to_vec();
        if let Intent::Stream(Setpoints { motors, values: Values::Velocity(v) }) = &intent {
            motors.iter().zip(v).for_each(|(m, v)| q[*m] += 0.02 * v);
        }
        view.poses = vec![q.into()];
        streams = matches!(intent, Intent::Stream(_));
        said.push(intent);
    }
    said
}

#[test]
fn jog_leads_a_few_motors_within_their_ranges_and_leaves_the_others_alone() {
    let ranges = json!({ "joint0": [-10, 10], "joint2": [-10, 10] });
    let settings = |by: &str| json!({ "motors": ["joint0", "joint2", "joint3"], "by": [by], "speed": 0.5, "count": 0, "range_deg": ranges });
    let most = 10f64.to_radians();
    let (mut seen, mut turned) = (std::collections::BTreeSet::new(), false);
    for intent in jogged(settings("position"), 3000) {
        let Intent::Stream(Setpoints { motors, values: Values::Position(q) }) = intent else { panic!("{intent:?}") };
        assert!(motors.iter().zip(&q).all(|(m, q)| *m == 3 || q.abs() < most + 0.1), "{q:?}");
        turned |= motors.iter().zip(&q).any(|(m, q)| *m != 3 && q.abs() > 0.9 * most);
        seen.insert(motors);
    }
    assert!(turned && seen.len() > 3 && seen.iter().all(|motors| !motors.contains(&1)), "{seen:?}");
    for intent in jogged(settings("velocity"), 3000) {
        let Intent::Stream(Setpoints { values: Values::Velocity(v), .. }) = intent else { panic!("{intent:?}") };
        assert!(v.iter().all(|v| v.abs() > 0.0));
    }
    let mut own = 0;
    for intent in jogged(settings("move"), 100) {
        let Intent::MoveEach(target, speeds) = intent else { panic!("{intent:?}") };
        assert!(target.motors.len() <= 2 && target.motors.len() == speeds.len());
        own += usize::from(speeds.len() == 2 && speeds[0] != speeds[1]);
    }
    assert!(own > 10);
}

/// A stream ends after its time, continues in another mode, and is not continued by a successor.
#[test]
fn jog_lets_go_and_hands_over() {
    let robot = arm(2);
    let settings = json!({ "motors": ["arm"], "count": 0, "lasts_s": [0.5, 0.5] });
    let mut agent = kind("jog", &robot, 1, settings.clone());
    let mut view = view(&scene(&robot, vec![]), &[0.0, 0.0]);
    assert!(matches!(agent.next(None, &view), Intent::Stream(_)));
    view.at = Time::from_secs(0.4);
    assert!(matches!(agent.revise(&view), Some(Intent::Stream(_))));
    let mut second = kind("jog", &robot, 2, settings);
    second.import(agent.export()).unwrap();
    assert_eq!(second.revise(&view), None);
    assert_eq!(second.next(None, &view), agent.next(None, &view));
    view.at = Time::from_secs(1.0);
    assert_eq!(agent.revise(&view), None);
    let bad = json!({ "motors": ["arm"], "by": [], "at_once": 0, "lasts_s": [2, 1] });
    let complaints = try_kind("jog", &robot, 1, bad).map(drop).unwrap_err().all();
    assert_eq!(complaints.iter().map(|c| c.path.as_str()).collect::<Vec<_>>(), ["by", "at_once", "lasts_s"]);
}

#[test]
fn every_kind_has_a_paragraph_and_documents_every_setting() {
    use mobee_agents as _;
    let kinds = kinds::<dyn Agent>();
    assert!(kinds.len() >= 5, "agents that ship are not registered");
    for kind in kinds {
        assert!(kind.doc.len() > 60, "{}", kind.name);
        let schema = (kind.schema)().to_value();
        assert_eq!(schema["additionalProperties"], false, "{}", kind.name);
        for (setting, doc) in schema["properties"].as_object().unwrap() {
            assert!(doc["description"].is_string(), "{}.{setting} has no description: {doc}", kind.name);
        }
    }
}

#[test]
fn a_state_of_another_kind_is_refused() {
    let robot = arm(1);
    let mut scripted = kind("scripted", &robot, 1, json!({ "poses": [{ "q_deg": { "joint0": 1 } }] }));
    let random = kind("random", &robot, 1, json!({ "motors": ["arm"] }));
    let before = scripted.export();
    assert_eq!(scripted.import(random.export()).unwrap_err().code(), "state");
    assert_eq!(scripted.export(), before);
}
