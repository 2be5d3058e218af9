use super::*;
use mobee_model::{JointMotion, Motor, NodePairs, Part, Robot};
use proptest::prelude::*;
use serde_json::{Value, json};

/// Creates a robot with motors and nothing else.
pub(super) fn robot(motors: usize) -> Robot {
    let motor = |i| Motor {
        name: format!("m{i}"),
        part: 0,
        min: -3.0,
        max: 3.0,
        home: 0.0,
        motion: JointMotion::Turn,
        max_speed: None,
        continuous: false,
        joints: Vec::new(),
        is_part_root: i == 0,
    };
    Robot {
        name: "r".into(),
        parts: vec![Part { name: "p".into(), motors: 0..motors, root_node: None, clauses: Vec::new() }],
        motors: (0..motors).map(motor).collect(),
        nodes: Vec::new(),
        markers: Vec::new(),
        pairs: NodePairs::default(),
        left_out: None,
        near: Vec::new(),
        bare: Vec::new(),
    }
}

fn map(points: &[Vec<f64>], k: usize) -> Roadmap {
    let motors = points[0].len();
    let mut map = Roadmap::new((0..motors).collect(), &robot(motors));
    for q in points {
        map.add(Vertex { name: None, q: q.clone(), at: [0.0; 3] });
    }
    map.join_nearest(k);
    map
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    JointMetric::default().distance(a, b)
}

fn points() -> impl Strategy<Value = Vec<Vec<f64>>> {
    prop::collection::vec(prop::collection::vec(-3.0..3.0f64, 3), 3..20)
}

/// Computes costs by Bellman-Ford over the public listing, as a reference for A* and Dijkstra.
fn reference(map: &Roadmap, from: u32) -> BTreeMap<u32, Cost> {
    let length = |a, b| distance(&map.vertex(a).unwrap().q, &map.vertex(b).unwrap().q);
    let mut best = BTreeMap::from([(from, Cost::default())]);
    for _ in 0..map.len() {
        for (a, b, e) in map.edges().into_iter().filter(|(.., e)| e.state != EdgeState::Removed) {
            let Some(here) = best.get(&a).copied() else { continue };
            let there = here + Cost { doubtful: u32::from(e.state == EdgeState::Doubtful), length: length(a, b) };
            if best.get(&b).is_none_or(|old| there < *old) {
                best.insert(b, there);
            }
        }
    }
    best
}

fn close(a: Cost, b: Cost) -> bool {
    a.doubtful == b.doubtful && (a.length - b.length).abs() < 1e-9
}

/// Records failures and successes for a list of edge choices.
fn exercise(map: &mut Roadmap, deeds: &[(usize, bool)]) {
    for (i, ok) in deeds {
        let edges: Vec<_> = map.edges().iter().map(|(a, b, _)| (*a, *b)).collect();
        let (a, b) = edges[i % edges.len()];
        if *ok { map.succeeded(a, b) } else { map.failed(a, b, Some("a wall".into())) }
    }
}

fn deeds() -> impl Strategy<Value = Vec<(usize, bool)>> {
    prop::collection::vec((any::<usize>(), any::<bool>()), 0..60)
}

/// Plans by petgraph's A* on the map's graph.
fn by_petgraph(map: &Roadmap, from: u32, to: u32) -> Option<Vec<u32>> {
    let start = NodeIndex::new(from as usize);
    let goal = NodeIndex::new(to as usize);
    let aim = map.group(&map.graph.node_weight(goal)?.q);
    let left = |n: NodeIndex| Cost { doubtful: 0, length: map.metric.distance(&map.group(&map.graph[n].q), &aim) };
    let cost = |e: petgraph::stable_graph::EdgeReference<'_, Edge>| map.cost(e.source(), e.target(), e.weight());
    let (_, path) = petgraph::algo::astar(&map.graph, start, |n| n == goal, cost, left)?;
    Some(path.into_iter().map(|n| n.index() as u32).collect())
}

proptest! {
    #[test]
    fn of_ways_of_equal_cost_the_one_of_petgraph_is_chosen(
        grid in prop::collection::vec(prop::collection::vec((0..4).prop_map(f64::from), 2), 3..30),
        free in points(), on_grid in any::<bool>(), k in 1usize..6, deeds in deeds(),
    ) {
        let mut map = map(if on_grid { &grid } else { &free }, k);
        exercise(&mut map, &deeds);
        let removed: Vec<_> = map.ledger.keys().copied().collect();
        removed.iter().step_by(2).for_each(|(a, b)| { map.readmit(*a, *b); });
        let mut recalled = map.clone();
        recalled.recall(&map.notes());
        for map in [&map, &map.clone(), &recalled] {
            for (from, to) in (0..map.len() as u32).flat_map(|a| (0..map.len() as u32).map(move |b| (a, b))) {
                prop_assert_eq!(map.plan(from, to), by_petgraph(map, from, to));
            }
            prop_assert_eq!(map.plan(0, map.len() as u32), None);
        }
    }

    #[test]
    fn plans_are_shortest_and_never_use_a_removed_edge(points in points(), k in 1usize..6, deeds in deeds()) {
        let mut map = map(&points, k);
        exercise(&mut map, &deeds);
        let truth = reference(&map, 0);
        let reach = map.reach(0);
        prop_assert_eq!(reach.keys().collect::<Vec<_>>(), truth.keys().collect::<Vec<_>>());
        for to in 0..map.len() as u32 {
            let plan = map.plan(0, to);
            prop_assert_eq!(plan.is_some(), truth.contains_key(&to));
            let Some(plan) = plan else { continue };
            let mut cost = Cost::default();
            for step in plan.windows(2) {
                let edge = map.edge(step[0], step[1]).unwrap();
                prop_assert_ne!(edge.state, EdgeState::Removed);
                let length = distance(&points[step[0] as usize], &points[step[1] as usize]);
                cost = cost + Cost { doubtful: u32::from(edge.state == EdgeState::Doubtful), length };
            }
            prop_assert!(close(cost, truth[&to]) && close(reach[&to], truth[&to]));
            prop_assert_eq!((plan.first(), plan.last()), (Some(&0), Some(&to)));
        }
    }

    #[test]
    fn a_file_gives_the_same_map_and_the_same_plans(points in points(), k in 1usize..6, deeds in deeds()) {
        let mut map = map(&points, k);
        exercise(&mut map, &deeds);
        let file = map.export(&robot(3));
        let text: Value = serde_json::from_str(&serde_json::to_string(&file).unwrap()).unwrap();
        let read = Roadmap::import(&text, &robot(3)).unwrap();
        prop_assert_eq!(read.edges(), map.edges());
        prop_assert!(read.vertices().zip(map.vertices()).all(|((_, a), (_, b))| distance(&a.q, &b.q) < 1e-12));
        let copy = Roadmap::import(&file, &robot(3)).unwrap();
        prop_assert_eq!(copy.edges(), map.edges());
        prop_assert!(copy.vertices().eq(map.vertices()));
        prop_assert_eq!(copy.export(&robot(3)), file);
        for to in 0..map.len() as u32 {
            prop_assert_eq!(copy.plan(0, to), map.plan(0, to));
        }
    }

    #[test]
    fn a_damaged_file_is_refused_or_read_whole_but_never_a_panic(points in points(), cut in any::<usize>(), with in any::<u8>()) {
        let mut bytes = serde_json::to_vec(&map(&points, 2).export(&robot(3))).unwrap();
        let at = cut % bytes.len();
        bytes[at] = with;
        let read = serde_json::from_slice::<Value>(&bytes).ok().map(|value| Roadmap::import(&value, &robot(3)));
        if let Some(Ok(map)) = read {
            prop_assert_eq!(map.len(), points.len());
        }
    }
}

#[test]
fn exactly_the_driven_edge_is_removed_and_its_opposite_becomes_doubtful() {
    let mut map = map(&[vec![0.0], vec![1.0], vec![3.0]], 2);
    map.failed(0, 1, Some("a wall".into()));
    let state = |m: &Roadmap, a, b| m.edge(a, b).unwrap().state;
    assert_eq!(state(&map, 0, 1), EdgeState::Removed);
    assert_eq!(state(&map, 1, 0), EdgeState::Doubtful);
    assert_eq!(state(&map, 0, 2), EdgeState::Optimistic);
    assert_eq!(map.edge(0, 1).unwrap().cause.as_deref(), Some("a wall"));
    assert_eq!(map.plan(0, 1), Some(vec![0, 2, 1]), "round, as the opposite is no way");
    assert_eq!(map.plan(1, 0), Some(vec![1, 2, 0]), "round, as the straight way is doubtful");
    // Joining again does not restore it, re-admitting does.
    map.join(0, 1);
    assert_eq!(state(&map, 0, 1), EdgeState::Removed);
    assert!(map.readmit(0, 1) && !map.readmit(0, 1));
    assert_eq!(map.plan(0, 1), Some(vec![0, 1]));
}

#[test]
fn an_edge_driven_to_its_end_stays_feasible_when_its_opposite_fails() {
    let mut map = map(&[vec![0.0], vec![1.0]], 1);
    map.succeeded(0, 1);
    assert_eq!(map.edge(1, 0).map(|e| (e.state, e.driven)), Some((EdgeState::Feasible, false)));
    map.failed(1, 0, None);
    assert_eq!(map.edge(0, 1).unwrap().state, EdgeState::Feasible);
    let mut other = self::map(&[vec![0.0], vec![1.0]], 1);
    other.succeeded(0, 1);
    other.failed(0, 1, None);
    assert_eq!(other.edge(1, 0).unwrap().state, EdgeState::Doubtful, "known only from its opposite, which failed");
}

#[test]
fn hostile_files_are_refused_with_the_place() {
    let good = map(&[vec![0.0], vec![1.0]], 1).export(&robot(1));
    let cases: [(&str, Value, &str); 11] = [
        ("/version", json!(3), "version"),
        ("/version", json!("1"), "version"),
        ("/motors/0", json!("m9"), "motors[0]"),
        ("/motors", json!(["m0", "m0"]), "motors[1]"),
        ("/vertices/1/id", json!(7), "vertices[1].id"),
        ("/vertices/1/q_rad", json!([]), "vertices[1].q_rad"),
        ("/vertices/0/q_rad", json!([99.0]), "vertices[0].q_rad[0]"),
        ("/vertices/0/q_rad", json!([null]), "vertices[0].q_rad[0]"),
        ("/edges/0/to", json!(5), "edges[0].to"),
        ("/edges/1", json!({ "from": 0, "to": 0, "state": "feasible" }), "edges[1].to"),
        ("/edges/0/state", json!("fine"), "edges[0].state"),
    ];
    assert!(Roadmap::import(&good, &robot(1)).is_ok());
    for (at, with, place) in cases {
        let mut bad = good.clone();
        *bad.pointer_mut(at).unwrap() = with;
        let error = Roadmap::import(&bad, &robot(1)).err().unwrap_or_else(|| panic!("{bad} was taken"));
        assert_eq!(error.path, place, "{error:?}");
    }
}

#[test]
fn neighbors_places_and_plans_know_no_seam_where_a_motor_has_no_end() {
    let mut robot = robot(1);
    (robot.motors[0].continuous, robot.motors[0].min, robot.motors[0].max) = (true, -600.0, 600.0);
    let deg = |deg: f64| vec![deg.to_radians()];
    let joined = |robot: &Robot| {
        let mut map = Roadmap::new(vec![0], robot);
        for q in [170.0, -170.0, 100.0, 0.0] {
            map.add(Vertex { name: None, q: deg(q), at: [0.0; 3] });
        }
        map.join_nearest(1);
        map
    };
    for map in [joined(&robot), joined(&robot).clone()] {
        assert_eq!(map.plan(0, 1), Some(vec![0, 1]));
        assert!((map.reach(0)[&1].length - 20f64.to_radians()).abs() < 1e-12);
        assert_eq!(map.by_distance(&deg(-179.0)), [1, 0, 2, 3]);
        assert_eq!([190.0, -190.0, 530.0].map(|q| map.at(&deg(q), 1e-6)), [Some(1), Some(0), Some(0)]);
    }
    // A single turn has two ends.
    (robot.motors[0].min, robot.motors[0].max) = (-std::f64::consts::PI, std::f64::consts::PI);
    assert_eq!(joined(&robot).edge(0, 1), None);
}

#[test]
fn what_was_tried_is_recalled_in_order() {
    let points = [vec![0.0], vec![1.0], vec![2.0]];
    let mut before = map(&points, 2);
    before.succeeded(0, 1);
    before.failed(1, 2, Some("a wall".into()));
    before.succeeded(0, 1);
    let mut after = map(&points, 2);
    after.recall(&before.notes());
    after.succeeded(1, 0);
    let wall = Some("a wall".to_string());
    let tried = |(from, to, reached, cause)| TriedMotion { run: None, from, to, reached, cause };
    let expected = [(0, 1, true, None), (1, 2, false, wall), (0, 1, true, None), (1, 0, true, None)].map(tried);
    assert_eq!(after.tried, expected);
    let told = |note: &Note| matches!(note, Note::Tried { .. });
    assert_eq!(after.notes().iter().filter(|note| told(note)).count(), 1, "what was told is not told again");
}

/// An endless run stores the newest motions of its own log, and all motions of earlier runs from
/// its map's file.
#[test]
fn a_log_is_bounded_and_earlier_ones_are_kept() {
    let robot = robot(1);
    let mut map = map(&[vec![0.0], vec![1.0]], 1);
    map.succeeded(0, 1);
    let mut file = map.export(&robot);
    let mut earlier = file["tried"][0].clone();
    earlier["run"] = json!("yesterday");
    file["tried"] = Value::Array(vec![earlier; MAX_TRIED + 200]);
    let mut map = Roadmap::import(&file, &robot).unwrap();
    for i in 0..MAX_TRIED + 100 {
        map.succeeded((i % 2) as u32, 1 - (i % 2) as u32);
    }
    let tried = map.export(&robot)["tried"].as_array().unwrap().clone();
    let own: Vec<&Value> = tried.iter().filter(|t| t["run"].is_null()).collect();
    assert_eq!((tried.len() - own.len(), own.len()), (MAX_TRIED + 200, MAX_TRIED));
    // The last two, in order.
    assert_eq!(own[own.len() - 2..].iter().map(|t| t["from"].as_u64()).collect::<Vec<_>>(), [Some(0), Some(1)]);
}
