//! Continuous joints are planned for and driven the short way round, without a discontinuity half a
//! turn from home.

use crate::world::*;
use mobee_agents::{Explorer, ExplorerSettings, RoadmapAgent};
use mobee_contract::*;
use mobee_model::ObjectClass;
use mobee_planning::roadmap::verdict::judge;
use mobee_planning::short_way::JointMetric;
use proptest::prelude::*;
use serde_json::json;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

const DEG: f64 = PI / 180.0;

/// Returns the targets of the first joint's motions, whole degrees.
fn ends(run: &Run) -> Vec<i64> {
    run.motions.iter().map(|(_, to, _)| (to[0] / DEG).round() as i64).collect()
}

fn tour(start: f64, board: f64) -> Vec<i64> {
    let robot = endless_arm(2);
    let settings = json!({
        "poses": [
            { "name": "a", "q_deg": { "joint0": 170, "joint1": 0 } },
            { "name": "b", "q_deg": { "joint0": -170, "joint1": 0 } },
            { "name": "half_way", "q_deg": { "joint0": 0, "joint1": 0 } },
        ],
        "edges": [["a", "b"], ["b", "half_way"], ["half_way", "a"]],
        "goals": ["a", "b", "a"],
    });
    let mut agent = RoadmapAgent::new(serde_json::from_value(settings).unwrap(), &context(&robot, 1)).unwrap();
    let mut view = view(&scene(&robot, vec![]), &[start * DEG, 0.0]);
    for axis in Arc::make_mut(&mut view.axes) {
        (axis.min, axis.max) = (-board * DEG, board * DEG);
    }
    let run = drive(&mut agent, &mut view, 100, |_, _, _| true);
    assert_eq!(run.done.as_ref().unwrap().text, "the tour is done");
    ends(&run)
}

#[test]
fn a_roadmap_is_driven_from_170_to_minus_170_by_20_degrees_in_whatever_turn() {
    assert_eq!(tour(170.0, 36_000.0), [190, 170]);
    assert_eq!(tour(170.0 + 720.0, 36_000.0), [190 + 720, 170 + 720]);
    assert_eq!(tour(175.0, 36_000.0), [170, 190, 170], "connected by 5 degrees");
    assert_eq!(tour(186.0, 36_000.0), [190, 170, 190, 170], "connected over the seam");
}

#[test]
fn a_board_that_counts_no_farther_is_not_asked_to() {
    assert_eq!(tour(170.0, 180.0), [-170, 170]);
}

#[test]
fn an_explorer_goes_round_and_never_farther_than_half_a_turn() {
    let robot = endless_arm(1);
    let settings = json!({ "motors": ["arm"], "vertices": 12, "neighbors": 6 });
    let settings: ExplorerSettings = serde_json::from_value(settings).unwrap();
    let mut agent = Explorer::new(settings, &context(&robot, 3)).unwrap();
    let run = drive(&mut agent, &mut view(&scene(&robot, vec![]), &[0.0]), 1000, |_, _, _| true);
    assert!(run.done.is_some());
    assert!(run.motions.iter().all(|(from, to, _)| (from[0] - to[0]).abs() <= PI));
    let over = |(from, to, _): &(Vec<f64>, Vec<f64>, bool)| (from[0].abs() < PI) != (to[0].abs() < PI);
    assert!(run.motions.iter().any(over), "the seam is passed: {:?}", ends(&run));
    // The last pose before the discontinuity and the first one behind it.
    let mut along: Vec<(f64, u32)> = agent.map().vertices().map(|(id, v)| (v.q[0], id)).collect();
    along.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (first, last) = (along[0].1, along[11].1);
    let (there, back) = (agent.map().edge(last, first), agent.map().edge(first, last));
    assert_eq!([there, back].map(|e| e.map(|e| e.state)), [Some(EdgeState::Feasible); 2]);
}

#[test]
fn what_an_explorer_learns_over_the_seam_agrees_with_the_offline_check() {
    let robot = endless_arm(2);
    let scene = scene(&robot, vec![ball("ball", -0.55, 0.0, 0.15, ObjectClass::Obstacle)]);
    let settings = json!({ "motors": ["arm"], "vertices": 40, "neighbors": 8 });
    let settings: ExplorerSettings = serde_json::from_value(settings).unwrap();
    let mut agent = Explorer::new(settings, &context(&robot, 5)).unwrap();
    let run = drive(&mut agent, &mut view(&scene, &[0.0, 0.0]), 10_000, by_scene);
    assert!(run.done.is_some());
    assert!(run.motions.iter().any(|(from, to, _)| from[0].abs() < PI && to[0].abs() > PI));
    assert!(run.motions.iter().any(|(.., ok)| !ok), "the world is too easy for this test");
    let report = judge(agent.map(), &scene, 0, &scene.home(), 0.012);
    assert!(report.agree > 10 && report.disagree.is_empty(), "{report:?}");
}

#[test]
fn the_short_agents_take_the_short_way() {
    let robot = endless_arm(2);
    let scene = scene(&robot, vec![]);
    let script = json!({ "poses": [{ "q_deg": { "joint0": 170 } }, { "q_deg": { "joint0": -170 } }] });
    let mut agent = kind("scripted", &robot, 1, script);
    let run = drive(agent.as_mut(), &mut view(&scene, &[0.0, 0.0]), 9, |_, _, _| true);
    assert_eq!(ends(&run), [170, 190]);
    for (name, settings) in [
        ("random", json!({ "motors": ["joint0"], "count": 50 })),
        ("jog", json!({ "motors": ["joint0"], "count": 50, "by": ["move"] })),
    ] {
        let mut agent = kind(name, &robot, 1, settings);
        let run = drive(agent.as_mut(), &mut view(&scene, &[7.0 * TAU, 0.0]), 100, |_, _, _| true);
        assert_eq!(run.motions.len(), 50);
        assert!(
            run.motions.iter().all(|(from, to, _)| (from[0] - to[0]).abs() <= PI + 1e-9),
            "{name}: {:?}",
            ends(&run)
        );
    }
}

#[test]
fn a_stream_stays_in_its_range_in_the_turn_that_the_motor_is_in() {
    let robot = endless_arm(1);
    let settings = json!({ "motors": ["joint0"], "by": ["velocity"], "range_deg": { "joint0": [-20, 20] }, "lasts_s": [60, 60], "speed": 1.0 });
    let mut agent = kind("jog", &robot, 1, settings);
    let mut view = view(&scene(&robot, vec![]), &[3.0 * TAU]);
    let mut intent = Some(agent.next(None, &view));
    let mut farthest = 0f64;
    while let Some(Intent::Stream(Setpoints { values: Values::Velocity(speed), .. })) = intent {
        let q = view.pose()[0] + speed[0] * 0.02;
        farthest = farthest.max((q - 3.0 * TAU).abs() / DEG);
        view.at = view.at + std::time::Duration::from_millis(20);
        view.poses = vec![[q].as_slice().into()];
        intent = agent.revise(&view);
    }
    assert!((20.0..23.0).contains(&farthest), "{farthest} deg");
}

proptest! {
    #[test]
    fn distance_is_symmetric_forgets_turns_and_is_at_most_half_a_turn_per_motor(
        a in prop::collection::vec(-60.0..60.0f64, 3), b in prop::collection::vec(-60.0..60.0f64, 3),
        c in prop::collection::vec(-60.0..60.0f64, 3), turns in -5i8..5,
    ) {
        let metric = JointMetric::of(&[0, 1, 2], &endless_arm(3));
        let far = metric.distance(&a, &b);
        prop_assert_eq!(far, metric.distance(&b, &a));
        prop_assert!(far <= PI * 3f64.sqrt() + 1e-9);
        prop_assert!(metric.distance(&a, &c) <= far + metric.distance(&b, &c) + 1e-9);
        let turned = [a[0], a[1] + f64::from(turns) * TAU, a[2]];
        prop_assert!((metric.distance(&turned, &b) - far).abs() < 1e-9);
        prop_assert!(metric.is_within(&turned, &a, 1e-9));
        let way = (0..3).map(|i| endless_arm(3).motors[i].way(a[i], b[i]).powi(2)).sum::<f64>().sqrt();
        prop_assert!((way - far).abs() < 1e-9, "as far as it is driven");
        let ended = JointMetric::of(&[0, 1, 2], &arm(3));
        let plain = a.iter().zip(&b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt();
        prop_assert!(ended.is_plain() && ended.distance(&a, &b) == plain);
    }
}
