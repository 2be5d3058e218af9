//! The roadmap agent: the ball of figure 5, CONNECT, tours, escapes, and the state passed to a
//! successor.

use crate::world::*;
use mobee_agents::{RoadmapAgent, RoadmapSettings};
use mobee_contract::*;
use mobee_model::ObjectClass;
use mobee_planning::planners::escape::{caught, escape};
use serde_json::json;
use std::sync::Arc;

fn settings(extra: serde_json::Value) -> RoadmapSettings {
    serde_json::from_value(two_ways(extra)).unwrap()
}

fn agent(extra: serde_json::Value) -> RoadmapAgent {
    RoadmapAgent::new(settings(extra), &context(&arm(2), 1)).unwrap()
}

fn start() -> Vec<f64> {
    vec![60f64.to_radians(), 0.0]
}

#[test]
fn a_ball_on_the_short_way_fails_once_and_then_the_other_way_is_taken_there_and_back() {
    let scene = scene(&arm(2), vec![ball("ball", 0.6, 0.0, 0.05, ObjectClass::Obstacle)]);
    let mut view = view(&scene, &start());
    let mut agent = agent(json!({ "goals": ["b", "a", "b"], "repeat": 3 }));
    let run = drive(&mut agent, &mut view, 1000, by_scene);
    assert_eq!(run.done.unwrap().text, "the tour is done");
    assert_eq!(run.motions.iter().filter(|(.., ok)| !ok).count(), 1);
    let map = agent.map();
    let (a, b) = (map.find("a").unwrap(), map.find("b").unwrap());
    assert_eq!(map.edge(a, b).unwrap().state, EdgeState::Removed, "the driven edge");
    assert_eq!(map.edge(b, a).unwrap().state, EdgeState::Doubtful, "its opposite");
    assert!(run.notes.iter().any(|n| matches!(n, Note::Plan { path } if path.len() == 4)));
}

#[test]
fn the_cause_is_remembered_in_words() {
    let scene = scene(&arm(2), vec![ball("ball", 0.6, 0.0, 0.05, ObjectClass::Obstacle)]);
    let mut view = view(&scene, &start());
    view.contacts = scene.contacts(&[[0.14, 0.0]], 0.02).into();
    assert_eq!(view.contacts.len(), 1);
    let mut agent = agent(json!({}));
    let run = drive(&mut agent, &mut view, 3, |_, _, _| false);
    let (a, b) = (agent.map().find("a").unwrap(), agent.map().find("b").unwrap());
    let cause = agent.map().edge(a, b).unwrap().cause.clone().unwrap();
    assert!(cause.contains("arm:arm/3#0") && cause.contains("ball#0"), "{cause}");
    assert!(run.notes.iter().any(|n| matches!(n, Note::Edge { state: EdgeState::Removed, cause: Some(_), .. })));
}

#[test]
fn a_doubtful_edge_is_driven_if_there_is_no_other_way() {
    let scene = scene(&arm(2), vec![]);
    let mut view = view(&scene, &start());
    // Only the direction a -> b of the short path fails, and the detour fails on the return.
    let (a, b) = (60f64.to_radians(), -60f64.to_radians());
    let mut agent = agent(json!({ "goals": ["b", "a"] }));
    let run = drive(&mut agent, &mut view, 100, |_, from, to| {
        let short_there = from[0] == a && to[0] == b && from[1] == 0.0;
        let round_back = from[0] == b && from[1] == 0.0 && to[1] > 1.0;
        !short_there && !round_back
    });
    assert_eq!(run.done.unwrap().figures[..2], [("goals_reached".into(), 2.0), ("goals_missed".into(), 0.0)]);
    assert!(run.motions.iter().any(|(from, to, ok)| *ok && from[0] == b && to[0] == a && from[1] == 0.0));
}

#[test]
fn connect_takes_the_nearest_pose_whose_line_is_free_and_goes_on_if_it_fails() {
    // The robot is between b and the folded poses; the line to the nearest pose, b, is blocked.
    let scene = scene(&arm(2), vec![ball("ball", 0.48, -0.36, 0.06, ObjectClass::Obstacle)]);
    let here = [0.0, 0.35];
    let mut view = view(&scene, &here);
    let near = |agent: &RoadmapAgent| agent.map().by_distance(&here);
    let mut agent = agent(json!({ "goals": ["a"] }));
    let nearest = near(&agent)[0];
    let run = drive(&mut agent, &mut view, 100, by_scene);
    assert!(run.motions[0].2, "the first motion of CONNECT was checked and so succeeds");
    assert_ne!(agent.map().at(&run.motions[0].1, 1e-9), None);
    let first = agent.map().at(&run.motions[0].1, 1e-9).unwrap();
    let blocked = !by_scene(&view, &here, &agent.map().vertex(nearest).unwrap().q);
    assert_eq!(first != nearest, blocked);

    // Independent of the scene: each pose is tried once, then CONNECT ends.
    let mut view = crate::world::view(&scene, &here);
    let mut stubborn = RoadmapAgent::new(settings(json!({})), &context(&arm(2), 1)).unwrap();
    let run = drive(&mut stubborn, &mut view, 100, |_, _, _| false);
    assert_eq!(run.motions.len(), 4);
    assert!(run.done.unwrap().text.contains("no vertex"));
    assert!(stubborn.map().edges().iter().all(|(.., e)| e.state == EdgeState::Optimistic), "no edge was driven");
}

#[test]
fn a_tolerance_that_the_robot_can_t_meet_is_told_instead_of_connecting_for_ever() {
    let scene = scene(&arm(2), vec![]);
    let mut v = view(&scene, &[0.4, 0.0]);
    let mut agent = agent(json!({ "tolerance_deg": 0.1 }));
    let mut last = None;
    for _ in 0..100 {
        match agent.next(last.take(), &v) {
            Intent::MoveTo(target) => {
                let q: Vec<f64> = target.pose(v.pose()).iter().map(|q| q + 0.01).collect();
                v.poses = vec![q.into()];
                last = Some(MotionEnd::Reached);
            }
            Intent::Done(summary) => return assert!(summary.text.contains("tolerance_deg"), "{summary:?}"),
            other => panic!("unexpected intent {other:?}"),
        }
    }
    panic!("did not end");
}

#[test]
fn a_commit_that_is_put_off_blames_nothing_and_is_given_again() {
    let scene = scene(&arm(2), vec![]);
    for start in [start(), vec![0.4, 0.0]] {
        let v = view(&scene, &start);
        let mut agent = agent(json!({ "goals": ["b"] }));
        let first = agent.next(None, &v);
        assert!(matches!(first, Intent::MoveTo(_)));
        let said = agent.notes().len();
        for _ in 0..200 {
            assert_eq!(agent.next(None, &v), first);
        }
        assert!(said > 0 && agent.notes().is_empty(), "told again and again");
        assert!(agent.map().edges().iter().all(|(.., e)| e.state == EdgeState::Optimistic));
    }
}

#[test]
fn goals_are_rested_at_and_a_goal_out_of_reach_is_reported() {
    let scene = scene(&arm(2), vec![]);
    let run = drive(
        &mut agent(json!({ "goals": ["a", "b"], "wait_s": 2.0, "repeat": 2 })),
        &mut view(&scene, &start()),
        100,
        |_, _, _| true,
    );
    assert_eq!(run.waits, 4);
    let run = drive(&mut agent(json!({ "goals": ["b"] })), &mut view(&scene, &start()), 100, |_, _, _| false);
    let done = run.done.unwrap();
    assert_eq!(done.text, "no goal can be reached any more");
    assert!(run.notes.iter().any(|n| matches!(n, Note::Log { text } if text.contains("no way leads"))));
    // A tour without motion never spins: it waits.
    let run =
        drive(&mut agent(json!({ "goals": ["a"], "repeat": 0 })), &mut view(&scene, &start()), 50, |_, _, _| true);
    assert_eq!((run.waits, run.motions.len()), (50, 0));
}

#[test]
fn an_escape_only_widens_every_contact_and_ends_free() {
    let robot = arm(3);
    let q = [0.2, 0.4, -0.3];
    let tip = {
        let angles = [0.2, 0.6, 0.3];
        angles.iter().fold((0.0, 0.0), |(x, y), a: &f64| (x + 0.3 * a.cos(), y + 0.3 * a.sin()))
    };
    for (dx, dy) in [(0.0, 0.07), (0.0, -0.07), (0.06, 0.03), (-0.06, 0.05)] {
        let scene = scene(&robot, vec![ball("ball", tip.0 + dx, tip.1 + dy, 0.035, ObjectClass::Obstacle)]);
        let view = view(&scene, &q);
        assert!(caught(&view), "the ball at {dx} {dy} does not touch");
        let target = escape(&view, &[0, 1, 2], &[], 0.1, 5).expect("a way out");
        let end = target.pose(&q);
        assert!(scene.free(&[&end], view.clearance), "not free at the end");
        let mut before = f64::NEG_INFINITY;
        for i in 0..=50 {
            let at: Vec<f64> = q.iter().zip(end.iter()).map(|(a, b)| a + (b - a) * f64::from(i) / 50.0).collect();
            let now = scene.clearance(&[&at], 1.0).unwrap().distance;
            assert!(now >= before - 2e-4, "the contact got worse on the way");
            before = now;
        }
        assert_eq!(escape(&view, &[0, 1, 2], &[], 0.1, 5), Some(target), "not deterministic");
    }
}

#[test]
fn an_obstacle_on_the_resting_arm_is_escaped_from_and_no_edge_is_blamed() {
    let free = scene(&arm(2), vec![]);
    let mut v = view(&free, &start());
    let mut agent = agent(json!({ "goals": ["a", "b"] }));
    let tip = (0.6 * 60f64.to_radians().cos(), 0.6 * 60f64.to_radians().sin());
    v.scene = scene(&arm(2), vec![ball("ball", tip.0 + 0.05, tip.1 + 0.05, 0.03, ObjectClass::Obstacle)]);
    // An escape is accepted under its own rule; everything else by the scene.
    let run = drive(&mut agent, &mut v, 100, |v, from, to| caught(v) || by_scene(v, from, to));
    assert!(run.notes.iter().any(|n| matches!(n, Note::Log { text } if text.contains("escaping"))));
    assert_eq!(agent.map().at(&run.q, 1e-9), agent.map().find("b"));
    let (way, _) = (run.motions[0].1[0] - start()[0], run.motions[0].1[1]);
    assert!(way.abs() < 0.5, "an escape is short");
}

#[test]
fn buried_without_a_way_out_it_waits_and_then_gives_up() {
    let q = start();
    let tip = (0.6 * q[0].cos(), 0.6 * q[0].sin());
    let mid = (0.3 * q[0].cos(), 0.3 * q[0].sin());
    // A cage of balls around both ends of the last link: every motion brings something closer.
    let mut cage = Vec::new();
    for (i, (x, y)) in [tip, mid].into_iter().enumerate() {
        for k in 0..8 {
            let angle = f64::from(k) * std::f64::consts::FRAC_PI_4;
            let name = format!("ball{i}_{k}");
            cage.push(ball(&name, x + 0.07 * angle.cos(), y + 0.07 * angle.sin(), 0.025, ObjectClass::Obstacle));
        }
    }
    let scene = scene(&arm(2), cage);
    let run = drive(&mut agent(json!({})), &mut view(&scene, &q), 1000, |_, _, _| true);
    assert!(run.motions.is_empty());
    assert_eq!(run.waits, 60);
    assert!(run.done.unwrap().text.contains("every way out"));
}

#[test]
fn a_successor_with_the_state_plans_alike_and_a_stranger_s_state_changes_nothing() {
    let scene = scene(&arm(2), vec![ball("ball", 0.6, 0.0, 0.05, ObjectClass::Obstacle)]);
    let mut v = view(&scene, &start());
    let mut first = agent(json!({ "goals": ["b", "a"], "repeat": 2 }));
    drive(&mut first, &mut v, 4, by_scene);
    let mut second = agent(json!({ "goals": ["b", "a"], "repeat": 2 }));
    second.import(first.export()).unwrap();
    let mut w = v.clone();
    let rest = drive(&mut first, &mut v, 100, by_scene);
    assert_eq!(drive(&mut second, &mut w, 100, by_scene).motions, rest.motions);

    let mut third = agent(json!({}));
    let before = third.export();
    let mut strange = first.export();
    strange.version = 99;
    assert_eq!(third.import(strange).unwrap_err().code(), "state");
    let mut broken = first.export();
    broken.state["map"]["edges"][0]["to"] = 77.into();
    let refusal = third.import(broken).unwrap_err();
    assert_eq!(refusal.code(), "state");
    assert!(refusal.to_string().contains("edges[0].to: there is no vertex 77"), "{refusal}");
    assert_eq!(third.export(), before);
}

#[test]
fn settings_that_can_t_be_used_say_where() {
    let robot: Arc<_> = arm(2);
    let poses = json!([{ "name": "left", "q_deg": { "joint0": 10 } }, { "name": "right", "q_deg": { "joint0": 20 } }]);
    let cases = [
        (json!({ "poses": poses, "goals": ["rihgt"] }), "goals[0]", "did you mean `right`"),
        (json!({ "poses": poses, "goals": [] }), "goals", "at least one"),
        (json!({ "poses": poses, "goals": ["left"], "edges": [["left", "up"]] }), "edges[0][1]", "left, right"),
        (
            json!({ "poses": [{ "name": "a", "q_deg": { "joint0": 999 } }], "goals": ["a"] }),
            "poses[0].q_deg.joint0",
            "180",
        ),
        (
            json!({ "poses": [{ "name": "a", "q_deg": { "jiont0": 9 } }], "goals": ["a"] }),
            "poses[0].q_deg.jiont0",
            "joint0",
        ),
        (json!({ "poses": poses, "goals": ["left"], "wait_s": -1 }), "wait_s", "0 or more"),
        (json!({ "poses": poses, "goals": ["left"], "motors": ["joint1"] }), "poses", "`motors`"),
        (json!({ "map": { "version": 7 }, "goals": ["0"] }), "map.version", "mobee run"),
    ];
    for (settings, path, help) in cases {
        let error =
            try_kind("roadmap", &robot, 1, settings.clone()).err().unwrap_or_else(|| panic!("{settings} passed"));
        assert_eq!(error.path, path, "{error:?}");
        assert!(error.help.contains(help), "{error:?}");
    }
}

/// A run recalls the notes of earlier ones before its agent begins; most agents have nothing to
/// recall.
#[test]
fn what_nobody_noted_yet_is_told_and_what_was_noted_is_not_told_again() {
    let told = |past: &[Note]| {
        let mut agent = agent(json!({}));
        agent.recall(past);
        let view = view(&scene(&arm(2), vec![]), &start());
        agent.next(None, &view);
        let mut notes = agent.notes();
        notes.retain(|n| matches!(n, Note::Vertex { .. } | Note::Edge { .. }));
        (notes, agent.map().len())
    };
    let (all, vertices) = told(&[]);
    let count = |notes: &[Note]| notes.iter().filter(|n| matches!(n, Note::Vertex { .. })).count();
    assert_eq!(count(&all), vertices, "a map is told from its first vertex on");
    assert!(told(&all).0.is_empty());
    let rest = told(&all[1..]).0;
    assert_eq!(rest, all[..1], "only what was not noted");
}
