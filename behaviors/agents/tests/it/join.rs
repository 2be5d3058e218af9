//! Parts of a map that can't be reached or left are joined to the rest where a path exists; parts
//! that stay disconnected are pruned.

use crate::world::*;
use mobee_contract::{EdgeState, Pose};
use mobee_model::{ObjectClass, Robot, Scene};
use mobee_planning::planners::{JointSpace, RrtConnect};
use mobee_planning::roadmap::join::{JoinReport, JoinSettings};
use mobee_planning::roadmap::{Roadmap, Vertex};
use proptest::prelude::*;
use std::collections::BTreeSet;

const CLEARANCE: f64 = 0.012;

fn space(scene: &Scene) -> JointSpace {
    let motors: Vec<usize> = (0..scene.robots()[0].motors.len()).collect();
    JointSpace::new(scene, 0, &scene.home(), &motors, &[], CLEARANCE).unwrap()
}

fn map(robot: &Robot, poses: &[Vec<f64>]) -> Roadmap {
    let mut map = Roadmap::new((0..robot.motors.len()).collect(), robot);
    for q in poses {
        map.add(Vertex { name: None, q: q.clone(), at: [0.0; 3] });
    }
    map
}

fn line_free(scene: &Scene, map: &Roadmap, a: u32, b: u32) -> bool {
    let q = |id| map.vertex(id).unwrap().q.clone();
    scene.line_free(0, &scene.home(), &q(a), &q(b), 0.001, CLEARANCE)
}

fn here(scene: &Scene) -> Pose {
    scene.home()[0].clone()
}

fn join(map: &mut Roadmap, space: &mut JointSpace, settings: JoinSettings, scene: &Scene) -> JoinReport {
    map.join_islands(space, &RrtConnect::default(), settings, &here(scene), &|_| [0.0; 3], &mut |_| {})
}

#[test]
fn two_sides_of_a_ball_become_one_map() {
    let robot = arm(3);
    let scene = scene(&robot, vec![ball("ball", 0.8, 0.0, 0.06, ObjectClass::Obstacle)]);
    let (left, right) = ([1.0, 1.2, 1.4], [-1.0, -1.2, -1.4]);
    let mut map = map(&robot, &left.iter().chain(&right).map(|q| vec![*q, 0.0, 0.0]).collect::<Vec<_>>());
    for (a, b) in [(0, 1), (1, 2), (3, 4), (4, 5)] {
        map.join(a, b);
    }
    // A dead end: there is a path in, and none out.
    map.join(2, 0);
    map.failed(2, 1, None);
    map.failed(2, 0, None);
    assert_eq!(map.islands(), vec![vec![3, 4, 5], vec![0, 1], vec![2]]);
    let mut again = map.clone();
    let mut space = space(&scene);
    let report = join(&mut map, &mut space, JoinSettings::default(), &scene);
    assert_eq!((report.islands, report.in_vain), ((3, 1), 0), "{report:?}");
    assert!(report.vertices > 0 && report.edges >= 2 * report.vertices);
    for (a, b, edge) in map.edges() {
        assert!(edge.state == EdgeState::Removed || line_free(&scene, &map, a, b), "{a} -> {b} is not free");
    }
    assert_eq!(map.edge(2, 1).unwrap().state, EdgeState::Removed, "what failed stays removed");
    assert!(map.plan(2, 5).is_some() && map.plan(5, 2).is_some());
    let same = join(&mut again, &mut space, JoinSettings::default(), &scene);
    assert_eq!((same, again.edges()), (report, map.edges()), "not deterministic");
}

#[test]
fn what_no_way_leads_to_is_told_and_pruned() {
    let robot = arm(2);
    // Vertex 3 is inside the ball.
    let scene = scene(&robot, vec![ball("ball", 0.6, 0.0, 0.06, ObjectClass::Obstacle)]);
    let mut map = map(&robot, &[vec![1.0, 0.0], vec![1.2, 0.0], vec![1.4, 0.0], vec![0.0, 0.0]]);
    map.join_nearest(1);
    map.failed(2, 3, None);
    map.join(3, 0);
    map.failed(0, 3, Some("ball".into()));
    let before = map.islands();
    let settings = JoinSettings { budget: 300, ..JoinSettings::default() };
    let report = join(&mut map, &mut space(&scene), settings, &scene);
    assert_eq!((report.islands, report.vertices, report.in_vain), ((2, 2), 0, 1), "{report:?}");
    assert_eq!(map.islands(), before);
    let pruned = map.pruned();
    assert_eq!(pruned.numbers, [Some(0), Some(1), Some(2), None]);
    assert_eq!((pruned.map.len(), pruned.map.plan(0, 2)), (3, map.plan(0, 2)));
    assert_eq!(pruned.map.islands().len(), 1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn islands_are_what_reaches_each_other_and_a_pruned_map_plans_alike(
        points in prop::collection::vec(prop::collection::vec(-3.0..3.0f64, 2), 3..24), k in 1usize..4,
        deeds in prop::collection::vec((any::<usize>(), any::<bool>()), 0..60), name in any::<bool>(),
    ) {
        let mut map = map(&arm(2), &points);
        if name {
            map.add(Vertex { name: Some("kept".into()), q: vec![0.0, 0.0], at: [0.0; 3] });
        }
        map.join_nearest(k);
        for (i, ok) in deeds {
            let edges: Vec<_> = map.edges().iter().map(|(a, b, _)| (*a, *b)).collect();
            let (a, b) = edges[i % edges.len()];
            if ok { map.succeeded(a, b) } else { map.failed(a, b, None) }
        }
        let islands = map.islands();
        prop_assert!(islands.windows(2).all(|w| w[0].len() >= w[1].len()));
        let reach: Vec<BTreeSet<u32>> = (0..map.len() as u32).map(|id| map.reach(id).into_keys().collect()).collect();
        prop_assert_eq!(islands.iter().map(Vec::len).sum::<usize>(), map.len());
        for island in &islands {
            for a in 0..map.len() as u32 {
                let both = reach[a as usize].contains(&island[0]) && reach[island[0] as usize].contains(&a);
                prop_assert_eq!(both, island.contains(&a));
            }
        }
        let pruned = map.pruned();
        for a in &islands[0] {
            for b in &islands[0] {
                let plan = map.plan(*a, *b).unwrap();
                // Paths within an island stay within it.
                let expected: Vec<_> = plan.iter().map(|id| pruned.numbers[*id as usize].unwrap()).collect();
                prop_assert_eq!(pruned.map.plan(expected[0], *expected.last().unwrap()), Some(expected));
            }
        }
        prop_assert_eq!(name, pruned.map.find("kept").is_some());
    }

    #[test]
    fn it_grows_where_it_is_thin_and_only_by_free_edges(seed in any::<u64>(), count in 1usize..20) {
        let robot = arm(2);
        let scene = scene(&robot, vec![ball("ball", 0.5, 0.2, 0.08, ObjectClass::Obstacle)]);
        // A dense cluster, and one vertex far from it.
        let mut poses: Vec<Vec<f64>> = (0..20).map(|i| vec![1.5 + 0.01 * f64::from(i % 5), 0.01 * f64::from(i / 5)]).collect();
        poses.push(vec![-1.5, 0.5]);
        let mut map = map(&robot, &poses);
        map.join_nearest(3);
        let before = map.edges().len();
        let mut space = space(&scene);
        let grown = map.grow(&mut space, (count, 3, seed), &here(&scene), &|_| [0.0; 3]);
        prop_assert!(grown <= count && map.len() == 21 + grown);
        prop_assert!(grown == 0 || map.edges().len() >= before + 2 * grown);
        for (a, b, _) in map.edges().into_iter().filter(|(a, b, _)| (*a).max(*b) >= 21) {
            prop_assert!(line_free(&scene, &map, a, b));
        }
        let far = map.vertices().skip(21).filter(|(_, v)| v.q[0] < 1.0).count();
        prop_assert!(2 * far >= grown, "{far} of {grown} are where it is thin");
    }
}

#[test]
fn an_agent_that_may_joins_what_no_way_leads_to() {
    let posts = vec![ball("ball", 0.6, 0.0, 0.05, ObjectClass::Obstacle)];
    let settings = |join: bool| {
        serde_json::json!({
            "poses": [{ "name": "a", "q_deg": { "joint0": 60, "joint1": 0 } }, { "name": "b", "q_deg": { "joint0": -60 } }],
            "edges": [["a", "b"]], "goals": ["b", "a"], "join": join, "validation": "lazy",
        })
    };
    for join in [false, true] {
        let scene = scene(&arm(2), posts.clone());
        let mut v = view(&scene, &[60f64.to_radians(), 0.0]);
        let mut agent = kind("roadmap", &arm(2), 1, settings(join));
        let run = drive(agent.as_mut(), &mut v, 200, by_scene);
        assert!(run.motions.iter().all(|(.., reached)| *reached), "a certified edge failed");
        let done = run.done.expect("an end");
        let missed = done.figures.iter().find(|(name, _)| name == "goals_missed").unwrap().1;
        assert_eq!(missed == 0.0, join, "{done:?}");
        let again = agent.export();
        let mut other = kind("roadmap", &arm(2), 1, settings(join));
        other.import(again.clone()).unwrap();
        assert_eq!(other.export(), again);
    }
}
