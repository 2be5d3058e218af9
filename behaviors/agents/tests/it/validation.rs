//! Validation modes of the agents: certified edges never collide, and edges leave and return with
//! the objects that block them.

use crate::world::*;
use mobee_contract::*;
use mobee_model::{Edit, ObjectClass, Scene};
use mobee_planning::roadmap::Roadmap;
use nalgebra::Isometry3;
use serde_json::{Value, json};
use std::sync::Arc;

fn tour(extra: Value) -> Value {
    let mut all = two_ways(json!({ "goals": ["b", "a"] }));
    all.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    all
}

fn start() -> Vec<f64> {
    vec![60f64.to_radians(), 0.0]
}

fn with_ball(class: ObjectClass) -> Arc<Scene> {
    scene(&arm(2), vec![ball("ball", 0.6, 0.0, 0.05, class)])
}

fn notes(run: &Run, wanted: EdgeState) -> Vec<(u32, u32)> {
    let edges = run.notes.iter().filter_map(|note| match note {
        Note::Edge { from, to, state, .. } if *state == wanted => Some((*from, *to)),
        _ => None,
    });
    edges.collect()
}

#[test]
fn what_is_certified_never_fails_where_the_paper_s_way_does() {
    for (mode, failures) in [("optimistic", 1), ("lazy", 0), ("verified", 0)] {
        let mut agent = kind("roadmap", &arm(2), 1, tour(json!({ "validation": mode, "repeat": 2 })));
        let run = drive(agent.as_mut(), &mut view(&with_ball(ObjectClass::Obstacle), &start()), 100, by_scene);
        assert_eq!(run.motions.iter().filter(|(.., ok)| !ok).count(), failures, "{mode}");
        let done = run.done.as_ref().expect("an end");
        assert_eq!(done.figures[0], ("goals_reached".into(), 4.0), "{mode}");
        let blocked = notes(&run, EdgeState::Blocked);
        assert_eq!(blocked, if failures == 0 { vec![(0, 1), (1, 0)] } else { vec![] }, "{mode}");
        let told = done.figures.iter().any(|(name, n)| name == "edges_blocked" && *n == 2.0);
        assert_eq!(told, failures == 0, "{mode}: {done:?}");
    }
}

#[test]
fn an_explorer_commits_no_blocked_edge_and_determines_the_rest() {
    let posts = vec![
        ball("post", 0.5, 0.4, 0.15, ObjectClass::Obstacle),
        ball("other", -0.4, -0.5, 0.12, ObjectClass::Obstacle),
    ];
    let scene = scene(&arm(3), posts);
    for seed in 0..4 {
        let mut feasible = Vec::new();
        for mode in ["optimistic", "lazy", "verified"] {
            let settings = json!({ "motors": ["arm"], "vertices": 14, "neighbors": 5, "validation": mode });
            let mut agent = kind("explorer", &arm(3), seed, settings);
            let mut v = view(&scene, &[0.0; 3]);
            let run = drive(agent.as_mut(), &mut v, 10_000, by_scene);
            let done = run.done.expect("an end");
            let figure = |name: &str| done.figures.iter().find(|(n, _)| n == name).map(|(_, n)| *n);
            let map = Roadmap::import(&agent.export().state["map"], &arm(3)).unwrap();
            let of = |q: &[f64]| map.at(q, 1e-9);
            for (from, to, ok) in &run.motions {
                // The path to the map is not an edge.
                if mode != "optimistic" && of(from).is_some() && of(to).is_some() {
                    assert!(ok, "{mode}: a blocked edge was driven");
                    assert!(scene.line_free(0, &v.poses, from, to, 0.001, v.clearance), "{mode}: not free");
                }
            }
            assert_eq!(figure("edges_blocked").is_some_and(|n| n > 0.0), mode != "optimistic", "{mode}: {done:?}");
            feasible.push(figure("edges_feasible").unwrap());
        }
        // Closer than a plan's clearance, but not so close that the reflex acts: feasible for the
        // first mode only.
        assert!(feasible[0] >= feasible[1] && feasible[1] > 0.0, "{feasible:?}");
        assert_eq!(feasible[1], feasible[2]);
    }
}

#[test]
fn a_moved_object_turns_edges_off_and_on_again() {
    for mode in ["lazy", "verified"] {
        let mut agent = kind("roadmap", &arm(2), 1, tour(json!({ "validation": mode, "repeat": 0 })));
        let ghost = with_ball(ObjectClass::Ghost);
        let mut v = view(&ghost, &start());
        let run = drive(agent.as_mut(), &mut v, 2, by_scene);
        assert_eq!(run.motions.len(), 2, "there and back");
        assert!(notes(&run, EdgeState::Blocked).is_empty());

        let solid = Edit::Class { name: "ball".into(), class: ObjectClass::Obstacle };
        let solid = Arc::new(ghost.edit(&solid).unwrap());
        v.scene = solid.clone();
        let run = drive(agent.as_mut(), &mut v, 6, by_scene);
        assert!(run.motions.iter().all(|(.., ok)| *ok), "{mode}: driven into the ball");
        assert_eq!(run.motions.len(), 6, "{mode}: three motions each way");
        assert_eq!(notes(&run, EdgeState::Blocked), [(0, 1), (1, 0)], "{mode}");
        let cause = run.notes.iter().find_map(|n| match n {
            Note::Edge { state: EdgeState::Blocked, cause, .. } => cause.clone(),
            _ => None,
        });
        assert!(cause.is_some_and(|c| c.contains("ball#0")), "{mode}");

        let away = Edit::Move { name: "ball".into(), pose: Isometry3::translation(0.0, 0.0, 1.0) };
        v.scene = Arc::new(solid.edit(&away).unwrap());
        let run = drive(agent.as_mut(), &mut v, 2, by_scene);
        assert_eq!(run.motions.len(), 2, "{mode}: straight again");
        // Known from before the ball came: it was driven.
        assert_eq!(notes(&run, EdgeState::Feasible), [(0, 1), (1, 0)], "{mode}");
    }
}

#[test]
fn an_object_that_comes_into_the_way_in_mid_motion_stops_it_and_one_behind_does_not() {
    let ghost = with_ball(ObjectClass::Ghost);
    let solid = Arc::new(ghost.edit(&Edit::Class { name: "ball".into(), class: ObjectClass::Obstacle }).unwrap());
    for (mode, q, stops) in
        [("lazy", 0.5, true), ("verified", 0.5, true), ("lazy", -0.5, false), ("optimistic", 0.5, false)]
    {
        let mut agent = kind("roadmap", &arm(2), 1, tour(json!({ "validation": mode, "repeat": 0 })));
        let mut v = view(&ghost, &start());
        assert!(matches!(agent.next(None, &v), Intent::MoveTo(_)));
        assert_eq!(agent.revise(&v), None, "nothing has changed");
        (v.scene, v.poses) = (solid.clone(), vec![[q, 0.0].into()]);
        assert_eq!(agent.revise(&v), stops.then_some(Intent::Stop), "{mode} at {q}");
        if stops {
            // The motion was rolled back: its edge failed, and is removed until the ball has gone.
            agent.notes();
            v.poses = vec![start().as_slice().into()];
            let Intent::MoveTo(round) = agent.next(Some(MotionEnd::Failed), &v) else { panic!("no way round") };
            assert!(round.q[1] > 1.0, "{round:?}");
            let removed = agent.notes().into_iter().find_map(|n| match n {
                Note::Edge { from: 0, to: 1, state: EdgeState::Removed, cause } => cause,
                _ => None,
            });
            assert!(removed.is_some_and(|cause| cause.contains("ball#0")), "{mode}");
            v.scene = Arc::new(solid.edit(&Edit::Remove { name: "ball".into() }).unwrap());
            let Intent::MoveTo(straight) = agent.next(None, &v) else { panic!("no way") };
            assert!(straight.q[1].abs() < 1e-9, "{mode}: the edge is not back: {straight:?}");
        }
    }
}

#[test]
fn an_edge_that_failed_for_an_unknown_reason_stays_removed_whatever_moves() {
    let ghost = with_ball(ObjectClass::Ghost);
    let mut agent = kind("roadmap", &arm(2), 1, tour(json!({ "validation": "lazy", "repeat": 0 })));
    let mut v = view(&ghost, &start());
    assert!(matches!(agent.next(None, &v), Intent::MoveTo(_)));
    agent.next(Some(MotionEnd::Failed), &v);
    for z in [1.0, 2.0] {
        let away = Edit::Move { name: "ball".into(), pose: Isometry3::translation(0.0, 0.0, z) };
        v.scene = Arc::new(v.scene.edit(&away).unwrap());
        let Intent::MoveTo(round) = agent.next(None, &v) else { panic!("no way round") };
        assert!(round.q[1] > 1.0, "{round:?}");
    }
}

#[test]
fn a_successor_finds_out_anew_what_is_blocked_and_the_map_itself_does_not_tell() {
    let scene = with_ball(ObjectClass::Obstacle);
    let mut v = view(&scene, &start());
    let settings = || tour(json!({ "validation": "verified", "repeat": 0 }));
    let mut first = kind("roadmap", &arm(2), 1, settings());
    drive(first.as_mut(), &mut v, 4, by_scene);
    assert!(!first.export().state["map"].to_string().contains("blocked"));
    let mut second = kind("roadmap", &arm(2), 1, settings());
    second.import(first.export()).unwrap();
    assert_eq!(second.export(), first.export());
    let mut w = v.clone();
    let run = drive(second.as_mut(), &mut w, 20, by_scene);
    assert!(run.motions.iter().all(|(.., ok)| *ok));
    assert_eq!(run.motions, drive(first.as_mut(), &mut v, 20, by_scene).motions);
}

#[test]
fn a_mode_that_does_not_exist_is_told() {
    for (name, settings) in [
        ("roadmap", tour(json!({ "validation": "sometimes" }))),
        ("explorer", json!({ "motors": ["arm"], "validation": "sometimes" })),
    ] {
        let error = try_kind(name, &arm(2), 1, settings).err().expect("an error");
        assert!(error.path == "validation" && error.what.contains("lazy"), "{error:?}");
    }
}
