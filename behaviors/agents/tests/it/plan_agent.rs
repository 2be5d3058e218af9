//! The planning agent: reaches its goals without a map, around obstacles, also around those that
//! only show when driven into.

use crate::world::*;
use mobee_agents::{PlanAgent, PlanSettings};
use mobee_contract::*;
use mobee_model::{Contact, Edit, ObjectClass, ShapeId};
use mobee_planning::hand_goal::HandGoals;
use serde_json::json;
use std::sync::Arc;

fn settings(extra: serde_json::Value) -> PlanSettings {
    let mut all = json!({
        "poses": [
            { "name": "left", "q_deg": { "joint0": 60, "joint1": 0, "joint2": 0 } },
            { "name": "right", "q_deg": { "joint0": -60, "joint1": 0, "joint2": 0 } },
        ],
        "goals": ["right", "left"],
    });
    all.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    serde_json::from_value(all).unwrap()
}

fn agent(extra: serde_json::Value) -> PlanAgent {
    PlanAgent::new(settings(extra), &context(&arm(3), 1)).unwrap()
}

fn start() -> Vec<f64> {
    vec![60f64.to_radians(), 0.0, 0.0]
}

fn figure(run: &Run, name: &str) -> f64 {
    run.done.as_ref().unwrap().figures.iter().find(|(n, _)| n == name).unwrap().1
}

#[test]
fn every_goal_is_reached_without_a_failure_and_known_ways_are_driven_again() {
    let scene = scene(&arm(3), vec![ball("ball", 0.8, 0.0, 0.06, ObjectClass::Obstacle)]);
    let mut view = view(&scene, &start());
    let mut agent = agent(json!({ "repeat": 6 }));
    let run = drive(&mut agent, &mut view, 1000, by_scene);
    assert_eq!(run.done.as_ref().unwrap().text, "the tour is done");
    assert!(run.motions.iter().all(|(.., reached)| *reached), "a certified edge failed");
    assert_eq!((figure(&run, "goals_reached"), figure(&run, "goals_missed")), (12.0, 0.0));
    assert!(run.motions.len() > 12, "no way leads straight there");
    assert!(agent.map().len() < 40, "the map grows at every leg: {}", agent.map().len());
    // The notes contain the map: every plan leads over noted vertices, from the robot's vertex.
    let plans = run.notes.iter().filter(|n| matches!(n, Note::Plan { path } if path.len() > 1)).count();
    assert!(plans >= 12);
}

#[test]
fn the_planner_aorrtc_drives_shorter_paths() {
    let scene = scene(&arm(3), vec![ball("ball", 0.8, 0.0, 0.06, ObjectClass::Obstacle)]);
    let driven = |planner: &str| {
        let length = |(a, b, _): &(Vec<f64>, Vec<f64>, bool)| {
            a.iter().zip(b).map(|(a, b)| (b - a) * (b - a)).sum::<f64>().sqrt()
        };
        let of_seed = |seed: u64| {
            let mut agent = agent(json!({ "planner": planner, "seed": seed }));
            let run = drive(&mut agent, &mut view(&scene, &start()), 1000, by_scene);
            assert_eq!(figure(&run, "goals_reached"), 2.0, "{planner}");
            run.motions.iter().map(length).sum::<f64>()
        };
        (0..8).map(of_seed).sum::<f64>()
    };
    let [first, short] = ["rrt_connect", "aorrtc"].map(driven);
    assert!(short < 0.98 * first, "{short} rad, {first} rad by RRT-Connect");
}

#[test]
fn a_motion_that_failed_leads_to_another_way_and_never_again_to_the_same() {
    let scene = scene(&arm(3), vec![]);
    let mut view = view(&scene, &start());
    let mut agent = agent(json!({ "goals": ["right", "left"], "repeat": 3 }));
    // An obstacle that the scene does not contain stands half way: a motion close to it is rolled
    // back.
    let mut failed: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
    let run = drive(&mut agent, &mut view, 2000, |_, a, b| {
        let near = (0..=50).any(|i| {
            let q: Vec<f64> = a.iter().zip(b).map(|(a, b)| a + (b - a) * f64::from(i) / 50.0).collect();
            q.iter().map(|q| q * q).sum::<f64>().sqrt() < 0.15
        });
        if near {
            assert!(!failed.contains(&(a.to_vec(), b.to_vec())), "tried again");
            failed.push((a.to_vec(), b.to_vec()));
        }
        !near
    });
    assert!((1..=10).contains(&failed.len()), "{} failures", failed.len());
    assert_eq!(figure(&run, "goals_missed"), 0.0, "{:?}", run.done);
    assert_eq!(run.done.unwrap().text, "the tour is done");
}

/// Creates objects that are not obstacles, at positions far from the arm.
fn ghosts() -> Vec<mobee_model::Object> {
    ["cause", "other"].map(|name| ball(name, 0.0, 0.0, 0.05, ObjectClass::Ghost)).to_vec()
}

fn moved(view: &mut View, name: &str, x: f64) {
    let edit = Edit::Move { name: name.into(), pose: nalgebra::Isometry3::translation(x, 0.0, 3.0) };
    view.scene = Arc::new(view.scene.edit(&edit).unwrap());
}

fn removed(agent: &PlanAgent) -> usize {
    agent.map().edges().iter().filter(|(.., e)| e.state == EdgeState::Removed).count()
}

#[test]
fn only_an_edge_whose_cause_has_changed_is_forgiven() {
    let robot = arm(3);
    let scene = scene(&robot, ghosts());
    let cause = scene.objects().next().unwrap().0;
    let contact = Contact {
        pair: (ShapeId::Robot { robot: 0, node: 5, shape: 0 }, ShapeId::Object { object: cause, shape: 0 }),
        distance: 0.0,
        points: [nalgebra::Point3::origin(); 2],
    };
    for (contacts, successor) in [(vec![contact], false), (vec![contact], true), (vec![], false)] {
        let known = !contacts.is_empty();
        let mut v = view(&scene, &start());
        let mut agent = agent(json!({ "goals": ["right", "left"], "repeat": 0 }));
        assert!(matches!(agent.next(None, &v), Intent::MoveTo(_)));
        v.contacts = contacts.into();
        agent.next(Some(MotionEnd::Failed), &v);
        v.contacts = Arc::new([]);
        assert_eq!(removed(&agent), 1);
        if successor {
            let state = agent.export();
            agent = PlanAgent::new(settings(json!({ "repeat": 0 })), &context(&robot, 1)).unwrap();
            agent.import(state).unwrap();
            agent.next(None, &v);
        }
        moved(&mut v, "other", 1.0);
        agent.next(None, &v);
        assert_eq!(removed(&agent), 1, "something else has moved");
        moved(&mut v, "cause", 1.0);
        agent.next(None, &v);
        assert_eq!(removed(&agent), usize::from(!known), "successor: {successor}");
    }
}

#[test]
fn what_comes_into_a_known_way_is_driven_round_at_once() {
    let mut v = view(&scene(&arm(3), vec![]), &start());
    let mut agent = agent(json!({ "repeat": 0 }));
    drive(&mut agent, &mut v, 4, by_scene);
    v.scene = Arc::new(v.scene.edit(&Edit::Add(ball("ball", 0.85, 0.0, 0.05, ObjectClass::Obstacle))).unwrap());
    let run = drive(&mut agent, &mut v, 40, by_scene);
    assert!(run.motions.len() > 10 && run.motions.iter().all(|(.., reached)| *reached));
}

#[test]
fn in_a_world_that_never_rests_the_map_is_bounded_and_what_is_told_is_the_map() {
    let posts = |i: u32| {
        let (radius, turn) = (0.7 + 0.02 * f64::from(i % 9), 0.05 * f64::from(i * 7 % 13) - 0.3);
        nalgebra::Isometry3::translation(radius * turn.cos(), radius * turn.sin(), 0.0)
    };
    let grown = |vertices: usize| {
        let scene = scene(&arm(3), vec![ball("post", 0.8, 0.0, 0.06, ObjectClass::Obstacle)]);
        let mut v = view(&scene, &start());
        let mut agent = agent(json!({ "repeat": 0, "vertices": vertices }));
        let mut told: std::collections::BTreeMap<u32, Vec<f64>> = Default::default();
        let mut plan = Vec::new();
        for i in 0..150 {
            v.scene = Arc::new(v.scene.edit(&Edit::Move { name: "post".into(), pose: posts(i) }).unwrap());
            if mobee_planning::planners::escape::caught(&v) {
                continue;
            }
            // As if through the journal: motion by motion, the plan first.
            for _ in 0..6 {
                let run = drive(&mut agent, &mut v, 1, by_scene);
                for note in &run.notes {
                    match note {
                        Note::Vertex { id, q, .. } => drop(told.insert(*id, q.clone())),
                        Note::Plan { path } => plan.clone_from(path),
                        _ => {}
                    }
                }
                // The post came closer than the plans' clearance, but not so close that the robot
                // is in contact.
                let escapes =
                    |n: &Note| matches!(n, Note::Log { text } if text.starts_with("no plan: where the robot is"));
                let escaped = run.notes.iter().any(escapes);
                for (_, to, reached) in &run.motions {
                    assert!(reached, "a certified edge failed");
                    let is_there = |id: &u32| told[id].iter().zip(to).all(|(a, b)| (a - b).abs() < 1e-9);
                    let known = escaped || plan.iter().any(is_there);
                    assert!(known, "no vertex of the plan is driven to: {:?}", run.notes);
                }
                assert!(agent.map().len() <= vertices);
            }
        }
        for (id, q) in &told {
            assert_eq!(&agent.map().vertex(*id).unwrap().q, q, "what was told of vertex {id} is not the map");
        }
        let names = ["left", "right"].map(|name| agent.map().find(name));
        assert_eq!(names, [Some(0), Some(1)]);
        (agent.map().len(), agent.map().edge_count())
    };
    let (free, bounded) = (grown(100_000), grown(52));
    assert!(free.0 > 100, "the bound is never met: {free:?}");
    assert!(bounded.0 == 52 && bounded.1 < free.1, "{bounded:?} of {free:?}");
}

#[test]
fn a_goal_that_is_blocked_is_told_and_the_other_one_is_gone_to() {
    let q = [-60f64.to_radians(), 0.0, 0.0];
    let (x, y) = (0.9 * q[0].cos(), 0.9 * q[0].sin());
    let scene = scene(&arm(3), vec![ball("ball", x, y, 0.05, ObjectClass::Obstacle)]);
    let mut view = view(&scene, &[0.0, 1.0, 1.0]);
    let run = drive(&mut agent(json!({})), &mut view, 100, by_scene);
    assert_eq!((figure(&run, "goals_reached"), figure(&run, "goals_missed")), (1.0, 1.0));
    let told = run
        .notes
        .iter()
        .any(|n| matches!(n, Note::Log { text } if text.contains("the goal is not free") && text.contains("ball#0")));
    assert!(told, "{:?}", run.notes);
    let run = drive(&mut agent(json!({ "goals": ["right"], "repeat": 0 })), &mut view, 100, by_scene);
    assert_eq!(run.done.unwrap().text, "no goal can be reached any more");
}

#[test]
fn a_robot_too_near_for_a_plan_moves_away_first() {
    // Closer than plans may come, but not so close that the reflex acts.
    let scene = scene(&arm(3), vec![ball("ball", 0.9, 0.101, 0.05, ObjectClass::Obstacle)]);
    let here = [0.0, 0.0, 0.0];
    let mut view = view(&scene, &here);
    assert!(!mobee_planning::planners::escape::caught(&view) && !mobee_planning::group::free(&view, &here));
    let run = drive(&mut agent(json!({ "goals": ["right"] })), &mut view, 100, |_, _, _| true);
    assert_eq!(run.done.unwrap().text, "the tour is done");
    assert!(run.motions.iter().skip(1).all(|(a, b, _)| by_scene(&view, a, b)));
}

#[test]
fn a_successor_goes_on_in_mid_motion_and_equal_seeds_make_equal_plans() {
    let scene = scene(&arm(3), vec![ball("ball", 0.8, 0.0, 0.06, ObjectClass::Obstacle)]);
    let run = |stop: usize| {
        let mut v = view(&scene, &start());
        let mut first = agent(json!({ "repeat": 2 }));
        let before = drive(&mut first, &mut v, stop, by_scene);
        let mut second = agent(json!({ "repeat": 2 }));
        second.import(first.export()).unwrap();
        let text = serde_json::to_string(&second.export()).unwrap();
        assert_eq!(text, serde_json::to_string(&first.export()).unwrap());
        let after = drive(&mut second, &mut v, 1000, by_scene);
        (before.motions, after)
    };
    let (none, whole) = run(0);
    let (_, again) = run(0);
    assert_eq!(whole.motions, again.motions);
    assert!(none.is_empty());
    for stop in 1..whole.motions.len() {
        let (before, after) = run(stop);
        assert_eq!(after.done.as_ref().unwrap().text, "the tour is done");
        assert!(before.iter().chain(&after.motions).all(|(.., reached)| *reached));
    }
    let other = agent(json!({})).import(Snapshot { kind: "roadmap".into(), version: 1, state: json!({}) });
    assert!(matches!(other, Err(Refusal::State { .. })));
}

#[test]
fn a_commit_that_is_put_off_is_given_again_and_a_tolerance_that_can_t_be_met_is_told() {
    let scene = scene(&arm(3), vec![]);
    let v = view(&scene, &start());
    let mut a = agent(json!({}));
    let first = a.next(None, &v);
    assert!(matches!(first, Intent::MoveTo(_)));
    a.notes();
    for _ in 0..50 {
        assert_eq!(a.next(None, &v), first);
        assert_eq!(a.notes(), []);
    }
    let mut v = view(&scene, &start());
    let mut a = agent(json!({ "tolerance_deg": 0.1, "repeat": 0 }));
    let mut last = None;
    for _ in 0..500 {
        match a.next(last.take(), &v) {
            Intent::MoveTo(target) => {
                let q: Vec<f64> = target.pose(v.pose()).iter().map(|q| q + 0.01).collect();
                v.poses = vec![q.into()];
                last = Some(MotionEnd::Reached);
            }
            Intent::Wait(_) => {}
            Intent::Done(summary) => return assert!(summary.text.contains("tolerance_deg"), "{summary:?}"),
            other => panic!("unexpected intent {other:?}"),
        }
    }
    panic!("did not end");
}

#[test]
fn bad_settings_are_told_with_their_place() {
    let robot = arm(3);
    let pose = |name: &str| json!({ "name": name, "q_deg": { "joint0": 10 } });
    for (bad, place) in [
        (json!({ "poses": [pose("a")], "goals": ["b"] }), "goals[0]"),
        (json!({ "poses": [pose("a")], "goals": [] }), "goals"),
        (json!({ "poses": [pose("a"), pose("a")], "goals": ["a"] }), "poses[1].name"),
        (json!({ "poses": [pose("a")], "goals": ["a"], "budget": 0 }), "budget"),
        (json!({ "poses": [pose("a")], "goals": ["a"], "vertices": 50 }), "vertices"),
        (json!({ "poses": [pose("a")], "goals": ["a"], "motors": ["joint1"] }), "poses"),
        (json!({ "poses": [pose("a")], "goals": ["a"], "speed": 2 }), "speed"),
        (json!({ "poses": [{ "name": "a", "q_deg": { "joint0": 999 } }], "goals": ["a"] }), "poses[0].q_deg.joint0"),
    ] {
        let error = try_kind("plan", &robot, 1, bad).err().expect("an error");
        let found = if error.more.is_empty() { error.path.clone() } else { format!("{error:?}") };
        assert!(found.contains(place), "{error:?}");
    }
}

#[test]
fn the_agent_plans_into_contact_with_what_may_be_touched() {
    // The goal is in contact with the cup; the ball is an obstacle as always.
    let cup = ball("cup", 0.47, -0.8, 0.03, ObjectClass::Obstacle);
    let scene = scene(&arm(3), vec![cup, ball("ball", 0.8, 0.0, 0.06, ObjectClass::Obstacle)]);
    let goals = json!({ "goals": ["right"] });
    let reached = |extra: serde_json::Value| {
        let mut all = goals.clone();
        all.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
        let run = drive(&mut agent(all), &mut view(&scene, &start()), 200, |_, _, _| true);
        let pick = scene.with_pair_rules(0, &[mobee_model::PairRule::may_touch("arm:cup").unwrap()]).unwrap();
        assert!(run.done.is_some(), "{run:?}");
        assert!(run.motions.iter().all(|(a, b, _)| pick.line_free(0, &[a], a, b, 0.001, 0.012)));
        figure(&run, "goals_reached")
    };
    assert_eq!(reached(json!({})), 0.0);
    assert_eq!(reached(json!({ "may_touch": ["arm:cup"] })), 1.0);
    assert_eq!(reached(json!({ "may_touch": ["arm:ball"] })), 0.0);
    for (extra, path) in [
        (json!({ "may_touch": ["arm"] }), "may_touch[0]"),
        (json!({ "pair_clearance_mm": { "arm:cup": -1 } }), "pair_clearance_mm.arm:cup"),
    ] {
        let wrong = PlanAgent::new(settings(extra), &context(&arm(3), 1)).err().expect("refused");
        assert_eq!(wrong.path, path);
    }
    // Names are checked with the scene, and apply to the search of joint values.
    let goals = |pair: &str| {
        let mut value = json!({ "poses": [], "goals": [], "may_touch": [pair] });
        HandGoals { scene: &scene, robot: 0, clearance: 0.012, seed: 1 }.resolve(&mut value)
    };
    assert!(goals("arm:cup").is_ok());
    let wrong = goals("arm:cpu").expect_err("refused");
    assert!(wrong.what.contains("`cpu`") && wrong.help.contains("cup"), "{wrong:?}");
}
