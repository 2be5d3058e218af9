//! The explorer determines the feasible part of its roadmap, whatever the outcomes of its motions,
//! and then ends.

use crate::world::*;
use mobee_agents::{Explorer, ExplorerSettings};
use mobee_contract::*;
use mobee_model::ObjectClass;
use mobee_planning::roadmap::Roadmap;
use mobee_planning::roadmap::verdict::judge;
use nalgebra::Isometry3;
use proptest::prelude::*;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

fn explorer(joints: usize, seed: u64, vertices: usize, neighbors: usize) -> Explorer {
    let settings = json!({ "motors": ["arm"], "vertices": vertices, "neighbors": neighbors });
    let settings: ExplorerSettings = serde_json::from_value(settings).unwrap();
    Explorer::new(settings, &context(&arm(joints), seed)).unwrap()
}

/// Returns an outcome for an undirected line that depends only on its ends and a seed.
fn coin(a: &[f64], b: &[f64], seed: u64, share: f64) -> bool {
    let sum: f64 = a.iter().zip(b).enumerate().map(|(i, (x, y))| (x + y) * (i + 1) as f64 + x * y).sum();
    let bits = sum.to_bits().wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ seed;
    (bits.wrapping_mul(0xd134_2543_de82_ef95) >> 40) as f64 / (1u64 << 24) as f64 >= share
}

/// Returns the undirected edges as sorted pairs.
fn undirected(map: &Roadmap, keep: impl Fn(u32, u32, EdgeState) -> bool) -> BTreeSet<(u32, u32)> {
    map.edges().into_iter().filter(|(a, b, e)| keep(*a, *b, e.state)).map(|(a, b, _)| (a.min(b), a.max(b))).collect()
}

/// Returns the vertices connected to `start` by undirected edges.
fn component(edges: &BTreeSet<(u32, u32)>, start: u32) -> BTreeSet<u32> {
    let mut found = BTreeSet::from([start]);
    loop {
        let before = found.len();
        for (a, b) in edges {
            if found.contains(a) || found.contains(b) {
                found.extend([*a, *b]);
            }
        }
        if found.len() == before {
            return found;
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn finds_exactly_the_feasible_edges_that_can_be_reached(
        seed in any::<u64>(), joints in 2usize..4, vertices in 3usize..22, neighbors in 2usize..10, share in 0.0..0.8f64,
    ) {
        let mut agent = explorer(joints, seed, vertices, neighbors);
        let scene = scene(&arm(joints), vec![]);
        let home = vec![0.0; joints];
        let mut view = view(&scene, &home);
        // CONNECT from home always succeeds; edges have random outcomes.
        let oracle = |_: &View, a: &[f64], b: &[f64]| a == home.as_slice() || coin(a, b, seed, share);
        let run = drive(&mut agent, &mut view, 100_000, oracle);
        prop_assert!(run.done.is_some(), "did not end");

        let map = agent.map();
        let truth = |a: u32, b: u32| {
            let (a, b) = (&map.vertex(a).unwrap().q, &map.vertex(b).unwrap().q);
            coin(a, b, seed, share)
        };
        let start = map.at(&run.motions[0].1, 1e-9).unwrap();
        let truly = undirected(map, |a, b, _| truth(a, b));
        let reachable = component(&truly, start);
        let truly_reachable: BTreeSet<_> = truly.into_iter().filter(|(a, _)| reachable.contains(a)).collect();
        let found = undirected(map, |_, _, s| s == EdgeState::Feasible);
        prop_assert_eq!(found, truly_reachable);
        // Everything that starts at reachable vertices is determined: nothing is left to try.
        for (a, _, edge) in map.edges() {
            let open = matches!(edge.state, EdgeState::Optimistic | EdgeState::Doubtful);
            prop_assert!(!open || !reachable.contains(&a));
        }
        prop_assert!(run.motions.len() <= 4 * map.edges().len() + 1, "{} motions", run.motions.len());
    }

    #[test]
    fn a_removed_edge_is_never_driven_again_and_it_always_ends(
        seed in any::<u64>(), answers in prop::collection::vec(any::<bool>(), 1..200),
    ) {
        // An adversary: outcomes are unrelated to the geometry, and change between attempts.
        let mut agent = explorer(2, seed, 12, 4);
        let scene = scene(&arm(2), vec![]);
        let mut view = view(&scene, &[0.0, 0.0]);
        let mut removed: BTreeMap<Vec<u64>, ()> = BTreeMap::new();
        let mut n = 0;
        let mut again = false;
        let run = drive(&mut agent, &mut view, 20_000, |_, a, b| {
            n += 1;
            let ok = answers[n % answers.len()];
            let key: Vec<u64> = a.iter().chain(b).map(|v| v.to_bits()).collect();
            again |= removed.contains_key(&key);
            if !ok && a != [0.0, 0.0] {
                removed.insert(key, ());
            }
            ok
        });
        prop_assert!(!again, "a removed edge was driven again");
        prop_assert!(run.done.is_some(), "did not end");
    }

    #[test]
    fn one_seed_one_run_and_a_successor_goes_on_alike(seed in any::<u64>(), at in 0usize..80) {
        let scene = scene(&arm(3), vec![]);
        let oracle = |_: &View, a: &[f64], b: &[f64]| a == [0.0; 3] || coin(a, b, seed, 0.3);
        let mut whole = explorer(3, seed, 12, 5);
        let expected = drive(&mut whole, &mut view(&scene, &[0.0; 3]), 10_000, oracle).motions;

        let mut v = view(&scene, &[0.0; 3]);
        let mut agent = explorer(3, seed, 12, 5);
        let mut motions = Vec::new();
        let mut last = None;
        // By hand, so that the swap happens between a commit and its end.
        for step in 0..10_000 {
            let Intent::MoveTo(target) = agent.next(last.take(), &v) else { break };
            if step == at {
                let mut second = explorer(3, seed ^ 1, 12, 5);
                second.import(agent.export()).unwrap();
                prop_assert_eq!(second.export(), agent.export());
                agent = second;
            }
            let (from, to) = (v.pose().to_vec(), target.pose(v.pose()).to_vec());
            let ok = oracle(&v, &from, &to);
            if ok {
                v.poses = vec![to.as_slice().into()];
            }
            motions.push((from, to, ok));
            last = Some(if ok { MotionEnd::Reached } else { MotionEnd::Failed });
        }
        prop_assert_eq!(motions, expected);
    }
}

#[test]
fn in_a_real_scene_every_verdict_agrees_with_the_offline_check() {
    let robot = arm(3);
    let posts = vec![
        ball("post", 0.5, 0.4, 0.15, ObjectClass::Obstacle),
        ball("other", -0.4, -0.5, 0.12, ObjectClass::Obstacle),
        ball("ghost", 0.6, 0.0, 0.3, ObjectClass::Ghost),
    ];
    let scene = scene(&robot, posts);
    let mut v = view(&scene, &[0.0; 3]);
    let mut agent = explorer(3, 7, 20, 10);
    let run = drive(&mut agent, &mut v, 10_000, by_scene);
    let summary = run.done.expect("an end");
    let report = judge(agent.map(), &scene, 0, &v.poses, v.clearance);
    assert_eq!(report.disagree, []);
    assert!(report.agree > 50, "{report:?}");
    let removed = summary.figures.iter().find(|(n, _)| n == "edges_removed").unwrap().1;
    assert!(removed > 5.0, "the scene is too easy for this test: {summary:?}");
    for (_, vertex) in agent.map().vertices() {
        assert!(scene.free(&[&vertex.q], v.clearance), "a vertex is not free");
    }
    // A judge with a false outcome detects it.
    let mut lied: Value = agent.map().export(&robot);
    let edges = lied["edges"].as_array_mut().unwrap();
    let edge = edges.iter_mut().find(|e| e["driven"] == true && e["state"] == "feasible").unwrap();
    edge["state"] = "removed".into();
    let lied = Roadmap::import(&lied, &robot).unwrap();
    let found = judge(&lied, &scene, 0, &v.poses, v.clearance);
    assert_eq!(found.disagree.len() + found.borderline.len(), report.borderline.len() + 1);
}

#[test]
fn what_another_robot_touches_is_no_matter_of_the_explorer() {
    let mut other = mobee_model::Robot::clone(&arm(2));
    other.name = "other".into();
    let robots =
        vec![(arm(2), Isometry3::identity()), (std::sync::Arc::new(other), Isometry3::translation(5.0, 0.0, 0.0))];
    let on_the_other = ball("ball", 5.3, 0.0, 0.1, ObjectClass::Obstacle);
    let scene = std::sync::Arc::new(mobee_model::Scene::new(robots, vec![on_the_other]).unwrap());
    let mut v = view(&scene, &[0.0, 0.0]);
    v.poses.push(vec![0.0, 0.0].into());
    let mut agent = explorer(2, 3, 6, 3);
    assert!(matches!(agent.next(None, &v), Intent::MoveTo(_)));
    assert_eq!(agent.map().len(), 6);
}

#[test]
fn a_world_without_free_poses_may_be_cleared_in_time() {
    let wall = ball("wall", 0.3, 0.0, 2.0, ObjectClass::Obstacle);
    let (covered, clear) = (scene(&arm(2), vec![wall]), scene(&arm(2), vec![]));
    let mut agent = explorer(2, 3, 6, 3);
    let v = view(&covered, &[0.0, 0.0]);
    for _ in 0..20 {
        assert!(matches!(agent.next(None, &v), Intent::Wait(_)));
    }
    // A successor continues to wait.
    let mut second = explorer(2, 4, 6, 3);
    second.import(agent.export()).unwrap();
    assert_eq!(second.export(), agent.export());
    assert!(matches!(second.next(None, &view(&clear, &[0.0, 0.0])), Intent::MoveTo(_)));
    assert_eq!(second.map().len(), 6);
    // It does not wait forever.
    let run = drive(&mut agent, &mut view(&covered, &[0.0, 0.0]), 100, |_, _, _| true);
    assert!(run.done.unwrap().text.contains("fewer than two") && run.waits < 60);
}

#[test]
fn every_vertex_is_told_with_the_hand_s_place_and_every_edge_before_it_is_driven() {
    let scene = scene(&arm(2), vec![]);
    let run = drive(&mut explorer(2, 3, 6, 3), &mut view(&scene, &[0.0, 0.0]), 1000, |_, _, _| true);
    let mut vertices = 0;
    for note in &run.notes {
        if let Note::Vertex { id, q, at } = note {
            assert_eq!(*id, vertices);
            vertices += 1;
            let (a, b) = (q[0], q[0] + q[1]);
            // Two links of 0.3 m, and the marker 1 cm beyond the second joint's link.
            let (x, y) = (0.3 * a.cos() + 0.3 * b.cos(), 0.3 * a.sin() + 0.3 * b.sin());
            assert!((at[0] - x).hypot(at[1] - y) < 0.0101 && at[2].abs() < 1e-9, "{at:?} for {q:?}");
        }
    }
    assert_eq!(vertices, 6);
    assert!(run.notes.iter().any(|n| matches!(n, Note::Plan { path } if path.len() > 1)));
}

#[test]
fn settings_that_can_t_be_used_say_where_and_what_to_do() {
    let robot = arm(3);
    let cases = [
        (json!({ "motors": ["joint7x"] }), "motors[0]", "did you mean"),
        (json!({ "motors": ["arm", "joint1"] }), "motors[1]", "once"),
        (json!({ "motors": [] }), "motors", "arm"),
        (json!({ "motors": ["arm"], "speed": 1.5 }), "speed", "0.1"),
        (json!({ "motors": ["arm"], "vertices": 1 }), "vertices", "20"),
        (json!({ "motors": ["arm"], "range_deg": { "joint0": [10, -10] } }), "range_deg.joint0", "[-10, 10]"),
        (json!({ "motors": ["arm"], "range_deg": { "joint0": [-200, 10] } }), "range_deg.joint0[0]", "degrees from"),
        (
            json!({ "motors": ["arm"], "range_deg": { "joint_0": [0, 10] } }),
            "range_deg.joint_0",
            "did you mean `joint0`",
        ),
        (json!({ "motors": ["joint1"], "range_deg": { "joint0": [0, 10] } }), "range_deg.joint0", "`motors`"),
    ];
    for (settings, path, help) in cases {
        let error =
            try_kind("explorer", &robot, 1, settings.clone()).err().unwrap_or_else(|| panic!("{settings} passed"));
        assert_eq!(error.path, path, "{error:?}");
        assert!(error.help.contains(help), "{error:?}");
    }
    let typo = try_kind("explorer", &robot, 1, json!({ "motors": ["arm"], "speeed": 0.1 })).err().unwrap();
    assert!(typo.what.contains("speeed") && typo.what.contains("speed"), "{typo:?}");
}
