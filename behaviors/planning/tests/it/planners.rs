//! Planners: every path is free by the scalar engine, ends at its goal, and depends only on its
//! problem.

use crate::world::*;
use mobee_contract::Axis;
use mobee_fast::EdgeVerdict;
use mobee_model::{Clause, HalfSpace, Object, ObjectClass, PairRule, Robot, Scene};
use mobee_planning::planners::{
    AoRrtConnect, JointPath, JointSpace, NoPath, PathEnd, PlanProgress, Planner, PlanningProblem, RrtConnect, shorten,
};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};
use std::ops::ControlFlow;
use std::sync::Arc;

const CLEARANCE: f64 = 0.012;

fn space(scene: &Scene, robot: &Robot) -> JointSpace {
    let motors: Vec<usize> = (0..robot.motors.len()).collect();
    JointSpace::new(scene, 0, &scene.home(), &motors, &[], CLEARANCE).unwrap()
}

fn problem(start: &[f64], goal: &[f64], seed: u64) -> PlanningProblem {
    PlanningProblem { start: start.to_vec(), goals: vec![goal.to_vec()], seed, budget: 4000 }
}

fn plan(space: &mut JointSpace, problem: &PlanningProblem) -> Result<JointPath, NoPath> {
    RrtConnect::default().plan(space, problem, &mut |_| ControlFlow::Continue(()))
}

fn line_free(scene: &Scene, a: &[f64], b: &[f64]) -> bool {
    scene.line_free(0, &scene.home(), a, b, 0.001, CLEARANCE)
}

/// Creates a wall of balls from the base outward at this angle (rad), with a gap that the folded
/// arm can pass.
fn wall(angle: f64) -> Vec<Object> {
    let at = |i: usize| {
        let r = 0.55 + 0.07 * i as f64;
        ball(&format!("wall{i}"), r * angle.cos(), r * angle.sin(), 0.05, ObjectClass::Obstacle)
    };
    (0..6).map(at).collect()
}

/// Continuous joints or not, number of joints; balls as distance, angle and radius; start, goal,
/// seed.
type World = (bool, usize, Vec<(f64, f64, f64)>, Vec<f64>, Vec<f64>, u64);

/// Creates an arm of some joints, continuous or not, a few balls as obstacles, and start and goal.
fn worlds() -> impl Strategy<Value = World> {
    (any::<bool>(), 2usize..4).prop_flat_map(|(endless, joints)| {
        let balls = prop::collection::vec((0.15..0.9f64, -PI..PI, 0.02..0.09f64), 0..5);
        let pose = move || prop::collection::vec(-3.0..3.0f64, joints);
        (Just(endless), Just(joints), balls, pose(), pose(), any::<u64>())
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_path_is_free_by_the_scalar_engine_and_ends_where_it_was_asked_to(
        (endless, joints, balls, start, goal, seed) in worlds(),
    ) {
        let robot = if endless { endless_arm(joints) } else { arm(joints) };
        let obstacle = |(i, (r, a, size)): (usize, &(f64, f64, f64))| {
            ball(&format!("ball{i}"), r * a.cos(), r * a.sin(), *size, ObjectClass::Obstacle)
        };
        let scene = scene(&robot, balls.iter().enumerate().map(obstacle).collect());
        let mut space = space(&scene, &robot);
        let problem = problem(&start, &goal, seed);
        let found = plan(&mut space, &problem);
        for (end, q) in [(PathEnd::Start, &start), (PathEnd::Goal, &goal)] {
            let told = matches!(&found, Err(NoPath::Blocked { end: e, pair: Some(_) }) if *e == end);
            let blocked = |within| !scene.robot_free(0, &[q], within);
            prop_assert!(!told || blocked(CLEARANCE + 1e-4), "{end:?} is free");
            let other = matches!(&found, Err(NoPath::Blocked { .. }));
            prop_assert!(told || other || !blocked(CLEARANCE - 1e-4), "{end:?} is not free, and that is not told: {found:?}");
        }
        // The same problem has the same result, whatever was checked before.
        prop_assert_eq!(&plan(&mut space, &problem), &found);
        let Ok(path) = found else { return Ok(()) };
        let short = shorten(&mut space, path.clone(), seed, 2000);
        prop_assert_eq!(&shorten(&mut space, path.clone(), seed, 2000), &short);
        prop_assert!(short.length() <= path.length() + 1e-9);
        for path in [&path, &short] {
            prop_assert_eq!(&path.poses[0], &start);
            let last = path.poses.last().unwrap();
            let turns = last.iter().zip(&goal).map(|(a, b)| (a - b) / if endless { TAU } else { f64::INFINITY });
            prop_assert!(turns.clone().all(|t| (t - t.round()).abs() < 1e-9), "ends at {last:?}, not at {goal:?}");
            prop_assert!(endless || *last == goal);
            for (a, b) in path.edges() {
                prop_assert!(line_free(&scene, a, b), "{a:?} to {b:?} is not free");
                prop_assert!(!endless || a.iter().zip(b).all(|(a, b)| (a - b).abs() <= PI), "the long way round");
            }
        }
    }

    #[test]
    fn verdicts_do_not_depend_on_what_is_judged_together(
        (_, joints, balls, start, goal, _) in worlds(), more in prop::collection::vec(prop::collection::vec(-3.0..3.0f64, 3), 1..40),
    ) {
        let robot = arm(joints);
        let obstacle = |(i, (r, a, size)): (usize, &(f64, f64, f64))| {
            ball(&format!("ball{i}"), r * a.cos(), r * a.sin(), *size, ObjectClass::Obstacle)
        };
        let scene = scene(&robot, balls.iter().enumerate().map(obstacle).collect());
        let mut space = space(&scene, &robot);
        space.avoid(start.clone(), 0.3);
        let poses: Vec<Vec<f64>> = more.iter().map(|q| q[..joints].to_vec()).chain([goal]).collect();
        let edges: Vec<_> = poses.windows(2).map(|w| (w[0].as_slice(), w[1].as_slice())).collect();
        let together = space.certify(edges.clone()).to_vec();
        let alone: Vec<_> = edges.iter().map(|edge| space.certify([*edge])[0]).collect();
        prop_assert_eq!(&together, &alone);
        let quick = space.free_lines(edges.clone());
        prop_assert_eq!(quick, together.iter().map(|v| *v == EdgeVerdict::Free).collect::<Vec<_>>());
        let together = space.free(poses.iter().map(Vec::as_slice)).to_vec();
        let alone: Vec<_> = poses.iter().map(|q| space.free([q.as_slice()])[0]).collect();
        prop_assert_eq!(together, alone);
    }
}

/// The length that a path costs the planners, rad.
fn cost(space: &JointSpace, path: &JointPath) -> f64 {
    path.edges().map(|(a, b)| space.weighted(a, b)).sum()
}

/// A planar arm of two links before a ball between start and goal: the cheapest way is found from the grid of all configurations.
#[test]
fn aorrtc_comes_near_the_shortest_path_and_never_ends_with_a_longer_one() {
    let robot = arm(2);
    let scene = scene(&robot, vec![ball("ball", 0.75, 0.0, 0.1, ObjectClass::Obstacle)]);
    let mut space = space(&scene, &robot);
    let (start, goal) = ([-0.9, 0.0], [0.9, 0.0]);
    let mut before = f64::INFINITY;
    for iterations in [0, 200, 2000, 20000] {
        let planner = AoRrtConnect { iterations, ..AoRrtConnect::default() };
        let problem = PlanningProblem { budget: u64::MAX, ..problem(&start, &goal, 7) };
        let path = planner.plan(&mut space, &problem, &mut |_| ControlFlow::Continue(())).unwrap();
        assert!(path.edges().all(|(a, b)| line_free(&scene, a, b)), "{path:?}");
        assert_eq!(
            (path.poses.first().map(Vec::as_slice), path.poses.last().map(Vec::as_slice)),
            (Some(&start[..]), Some(&goal[..]))
        );
        let length = cost(&space, &path);
        assert!(length <= before + 1e-12, "{iterations}: {length} after {before}");
        before = length;
    }
    let shortest = shortest_on_grid(&mut space, &start, &goal);
    assert!(before < 1.02 * shortest, "{before} rad, where the grid has {shortest} rad");
}

/// Length of the shortest path over a grid of the joint space with edges to cells up to three away (Dijkstra), rad.
fn shortest_on_grid(space: &mut JointSpace, start: &[f64; 2], goal: &[f64; 2]) -> f64 {
    const CELL: f64 = 0.06;
    let range = -40_i32..=40;
    let at = |(x, y): (i32, i32)| [f64::from(x) * CELL, f64::from(y) * CELL];
    let cell = |q: &[f64; 2]| ((q[0] / CELL).round() as i32, (q[1] / CELL).round() as i32);
    let mut far = std::collections::BTreeMap::from([(cell(start), 0.0_f64)]);
    let mut open = vec![cell(start)];
    while let Some(next) = (0..open.len()).min_by(|a, b| far[&open[*a]].total_cmp(&far[&open[*b]])) {
        let here = open.swap_remove(next);
        if here == cell(goal) {
            return far[&here];
        }
        for (dx, dy) in (-3..=3).flat_map(|x| (-3..=3).map(move |y| (x, y))).filter(|step| *step != (0, 0)) {
            let there = (here.0 + dx, here.1 + dy);
            let [a, b] = [at(here), at(there)];
            let length = far[&here] + space.weighted(&a, &b);
            let known = far.get(&there).is_some_and(|known| *known <= length);
            if !known && range.contains(&there.0) && range.contains(&there.1) && space.samples_free(&a, &b) {
                far.insert(there, length);
                open.retain(|cell| *cell != there);
                open.push(there);
            }
        }
    }
    f64::INFINITY
}

#[test]
fn aorrtc_ends_with_its_best_path_when_the_watch_or_the_budget_ends_it() {
    let robot = arm(3);
    let scene = scene(&robot, wall(0.0));
    let mut space = space(&scene, &robot);
    let problem = problem(&[-0.9, 0.0, 0.0], &[0.9, 0.0, 0.0], 3);
    let first = plan(&mut space, &problem).unwrap();
    let planner = AoRrtConnect { iterations: u64::MAX, ..AoRrtConnect::default() };
    let best = planner.plan(&mut space, &problem, &mut |_| ControlFlow::Continue(())).unwrap();
    assert!(best.evaluations <= problem.budget + 100, "{} lines of {}", best.evaluations, problem.budget);
    assert!(cost(&space, &best) < cost(&space, &first));
    let mut calls = 0;
    let cut = planner.plan(&mut space, &problem, &mut |progress| {
        calls += u32::from(progress.evaluations > 2000);
        if calls > 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert!(cut.unwrap().edges().all(|(a, b)| line_free(&scene, a, b)));
    // the same problem has the same answer
    assert_eq!(planner.plan(&mut space, &problem, &mut |_| ControlFlow::Continue(())).unwrap(), best);
}

#[test]
fn a_wall_is_gone_round_and_the_way_is_made_shorter() {
    let robot = arm(3);
    let scene = scene(&robot, wall(0.0));
    let mut space = space(&scene, &robot);
    let (start, goal) = ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]);
    assert!(!line_free(&scene, &start, &goal));
    let mut shorter = 0;
    for seed in 0..20 {
        let path = plan(&mut space, &problem(&start, &goal, seed)).expect("a way");
        let short = shorten(&mut space, path.clone(), seed, 2000);
        assert!(short.edges().all(|(a, b)| line_free(&scene, a, b)), "seed {seed}");
        shorter += usize::from(short.length() < 0.9 * path.length());
        assert!(short.length() < 3.0 * 2.0 * 3.0, "seed {seed}: {} rad", short.length());
    }
    assert!(shorter >= 10, "only {shorter} of 20 were shortened by a tenth");
}

#[test]
fn a_budget_and_a_cancel_end_it_and_the_progress_is_told() {
    let robot = arm(2);
    // Closed all round: the folded arm can't get out.
    let ring = (0..40).map(|i| {
        let a = f64::from(i) * TAU / 40.0;
        ball(&format!("ring{i}"), 0.44 * a.cos(), 0.44 * a.sin(), 0.03, ObjectClass::Obstacle)
    });
    let scene = scene(&robot, ring.collect());
    let mut space = space(&scene, &robot);
    let (start, goal) = ([0.0, 2.9], [2.0, -2.9]);
    assert!(scene.robot_free(0, &[&start], CLEARANCE) && scene.robot_free(0, &[&goal], CLEARANCE));
    for budget in [0, 1, 50, 1000] {
        let problem = PlanningProblem { start: start.to_vec(), goals: vec![goal.to_vec()], seed: 3, budget };
        let mut told = Vec::new();
        let found = RrtConnect::default().plan(&mut space, &problem, &mut |p: PlanProgress| {
            told.push(p.evaluations);
            ControlFlow::Continue(())
        });
        match found {
            Err(NoPath::Exhausted { evaluations }) => assert!(evaluations <= budget, "{evaluations} of {budget}"),
            Ok(path) => assert!(path.evaluations <= budget && path.edges().all(|(a, b)| line_free(&scene, a, b))),
            other => panic!("{other:?}"),
        }
        assert!(!told.is_empty() && told.is_sorted());
        let stopped = RrtConnect::default().plan(&mut space, &problem, &mut |_| ControlFlow::Break(()));
        assert_eq!(stopped, Err(NoPath::Cancelled));
    }
}

#[test]
fn ends_that_can_t_be_are_told_with_the_reason() {
    let robot = arm(2);
    let scene = scene(&robot, vec![ball("ball", 0.6, 0.0, 0.05, ObjectClass::Obstacle)]);
    let mut space = space(&scene, &robot);
    let (good, bad) = ([1.5, 0.0], [0.0, 0.0]);
    let told = |found: Result<JointPath, NoPath>| found.unwrap_err().text(&scene, 0);
    assert_eq!(
        told(plan(&mut space, &problem(&bad, &good, 1))),
        "where the robot is is not free: arm:arm/3#0 is too near to ball#0"
    );
    assert!(told(plan(&mut space, &problem(&good, &bad, 1))).starts_with("the goal is not free"));
    assert_eq!(plan(&mut space, &problem(&good, &[4.0, 0.0], 1)), Err(NoPath::Limits { end: PathEnd::Goal, motor: 0 }));
    assert_eq!(
        told(plan(&mut space, &problem(&[0.0, -4.0], &good, 1))),
        "where the robot is is outside the limits of joint1"
    );
    for (start, goal, end) in
        [(vec![0.0], good.to_vec(), PathEnd::Start), (good.to_vec(), vec![f64::NAN, 0.0], PathEnd::Goal)]
    {
        assert_eq!(plan(&mut space, &problem(&start, &goal, 1)), Err(NoPath::Malformed(end)));
    }
    // A board may have narrower limits than the model.
    let axis = |name: &str| Axis {
        name: name.into(),
        min: -1.0,
        max: 1.0,
        max_speed: 1.0,
        max_acceleration: 1.0,
        ..Default::default()
    };
    let mut narrow =
        JointSpace::new(&scene, 0, &scene.home(), &[0, 1], &[axis("joint0"), axis("joint1")], CLEARANCE).unwrap();
    assert_eq!(
        plan(&mut narrow, &problem(&[0.9, 0.0], &good, 1)),
        Err(NoPath::Limits { end: PathEnd::Goal, motor: 0 })
    );
}

#[test]
fn a_constraint_is_kept_all_the_way() {
    let mut robot = arm(2);
    // joint1 may be below 60 degrees only if joint0 is below -20: the straight line from one side
    // to the other is outside.
    let half = |motor: usize, a: f64, b: f64| HalfSpace { terms: vec![(motor, a)], b };
    Arc::make_mut(&mut robot).parts[0].clauses = vec![Clause(vec![half(1, 1.0, -60.0), half(0, -1.0, -20.0)])];
    let scene = scene(&robot, vec![]);
    let mut space = space(&scene, &robot);
    let (start, goal) = ([1.2, 1.3], [-1.2, -0.5]);
    assert!(!line_free(&scene, &start, &goal) && scene.robot_free(0, &[start], CLEARANCE));
    let path = plan(&mut space, &problem(&start, &goal, 5)).expect("a way");
    let path = shorten(&mut space, path, 5, 2000);
    for (a, b) in path.edges() {
        assert!(line_free(&scene, a, b));
    }
    let found = plan(&mut space, &problem(&start, &[1.0, 0.0], 5));
    assert_eq!(found, Err(NoPath::Blocked { end: PathEnd::Goal, pair: None }));
}

#[test]
fn a_place_that_is_avoided_is_gone_round() {
    let robot = arm(2);
    let scene = scene(&robot, vec![]);
    let mut space = space(&scene, &robot);
    let (start, goal) = ([-1.0, 0.0], [1.0, 0.0]);
    let straight = plan(&mut space, &problem(&start, &goal, 1)).expect("a way");
    assert!((straight.length() - 2.0).abs() < 1e-9, "the straight line comes first");
    space.avoid(vec![0.0, 0.0], 0.5);
    let round = plan(&mut space, &problem(&start, &goal, 1)).expect("a way round");
    let round = shorten(&mut space, round, 1, 2000);
    for (a, b) in round.edges() {
        for i in 0..=100 {
            let q: Vec<f64> = a.iter().zip(b).map(|(a, b)| a + (b - a) * f64::from(i) / 100.0).collect();
            assert!(q[0].hypot(q[1]) > 0.499, "{q:?}");
        }
    }
    space.forgive();
    assert_eq!(plan(&mut space, &problem(&start, &goal, 1)).expect("a way").poses, straight.poses);
}

#[test]
fn what_is_held_does_not_move() {
    let robot = arm(3);
    let scene = scene(&robot, vec![]);
    let mut space = space(&scene, &robot);
    space.avoid(vec![0.0, 0.0, 0.3], 0.5);
    space.hold(&[(2, 0.3)]);
    for seed in 0..10 {
        let path = plan(&mut space, &problem(&[-1.0, 0.0, 0.3], &[1.0, 0.0, 0.3], seed)).expect("a way round");
        let path = shorten(&mut space, path, seed, 2000);
        assert!(path.poses.len() > 2 && path.poses.iter().all(|q| (q[2] - 0.3).abs() < 1e-9), "{path:?}");
    }
    space.hold(&[]);
    let path = plan(&mut space, &problem(&[-1.0, 0.0, 0.3], &[1.0, 0.0, 0.3], 1)).expect("a way round");
    assert!(path.poses.iter().any(|q| (q[2] - 0.3).abs() > 0.01), "free again");
}

#[test]
fn a_motor_without_end_goes_over_the_seam_unless_its_board_counts_no_farther() {
    let robot = endless_arm(2);
    let scene = scene(&robot, vec![]);
    let (start, goal) = ([170f64.to_radians(), 0.0], [-170f64.to_radians(), 0.0]);
    let mut free = space(&scene, &robot);
    let path = plan(&mut free, &problem(&start, &goal, 1)).expect("a way");
    assert!((path.length() - 20f64.to_radians()).abs() < 1e-9);
    let axis = |name: &str| Axis {
        name: name.into(),
        min: -PI,
        max: PI,
        max_speed: 1.0,
        max_acceleration: 1.0,
        ..Default::default()
    };
    let axes = [axis("joint0"), axis("joint1")];
    let mut narrow = JointSpace::new(&scene, 0, &scene.home(), &[0, 1], &axes, CLEARANCE).unwrap();
    let path = plan(&mut narrow, &problem(&start, &goal, 1)).expect("a way");
    assert!((path.length() - 340f64.to_radians()).abs() < 1e-9, "{} deg", path.length().to_degrees());
}

/// Encoders are noisy: a motor at rest at its limit may read slightly more, and it can't be driven
/// back.
#[test]
fn a_motor_that_rests_beyond_its_limit_blocks_nothing() {
    let robot = arm(2);
    let scene = scene(&robot, Vec::new());
    let rest = robot.motors[1].max + 2e-4;
    let mut space = JointSpace::new(&scene, 0, &[[0.0, rest]], &[0], &[], CLEARANCE).unwrap();
    assert_eq!(plan(&mut space, &problem(&[0.0], &[0.3], 1)).map(|path| path.poses.len()), Ok(2));
}

/// Of several goals any one will do: the path ends at the one that it names, unusable ones are ignored, and only if there
/// are no others is the first one's reason returned.
#[test]
fn a_plan_to_a_set_of_goals_ends_at_the_one_that_it_names() {
    let robot = arm(3);
    let scene = scene(&robot, wall(0.0));
    let mut space = space(&scene, &robot);
    let start = [1.0, 0.0, 0.0];
    let (beyond, blocked, outside) = (vec![-1.0, 0.0, 0.0], vec![0.0, 0.0, 0.0], vec![9.0, 0.0, 0.0]);
    let near = vec![1.3, 0.2, 0.0];
    let to = |goals: &[&Vec<f64>]| PlanningProblem {
        goals: goals.iter().map(|goal| goal.to_vec()).collect(),
        budget: 40_000,
        ..problem(&start, &[], 3)
    };
    for planner in
        [&RrtConnect::default() as &dyn Planner, &AoRrtConnect { iterations: 100, ..AoRrtConnect::default() }]
    {
        let mut plan = |goals: &[&Vec<f64>]| planner.plan(&mut space, &to(goals), &mut |_| ControlFlow::Continue(()));
        let path = plan(&[&beyond, &near]).expect("a straight line");
        assert_eq!((path.goal, path.poses.last()), (1, Some(&near)));
        let path = plan(&[&blocked, &outside, &beyond]).expect("a way around the wall");
        assert_eq!((path.goal, path.poses.last()), (2, Some(&beyond)));
        assert!(path.edges().all(|(a, b)| line_free(&scene, a, b)));
        assert!(matches!(plan(&[&blocked, &outside]), Err(NoPath::Blocked { end: PathEnd::Goal, .. })));
        assert!(matches!(plan(&[&outside, &blocked]), Err(NoPath::Limits { end: PathEnd::Goal, motor: 0 })));
        assert_eq!(plan(&[]), Err(NoPath::Malformed(PathEnd::Goal)));
        assert_eq!(plan(&[&vec![0.0]]), Err(NoPath::Malformed(PathEnd::Goal)));
    }
    // Both goals lie beyond the wall, so the path is found by the trees.
    let folded = vec![-1.4, 0.5, 0.5];
    let mut reached: Vec<usize> = (0..12)
        .map(|seed| {
            let problem = PlanningProblem { seed, ..to(&[&beyond, &folded]) };
            let path = plan(&mut space, &problem).expect("a way around the wall");
            assert_eq!(path.poses.last(), Some(&problem.goals[path.goal]));
            assert!(path.edges().all(|(a, b)| line_free(&scene, a, b)));
            path.goal
        })
        .collect();
    reached.sort_unstable();
    reached.dedup();
    assert_eq!(reached, [0, 1], "trees grow from all goals");
}

/// A pick: the goal is in contact with the object to be picked, and the path with nothing else.
#[test]
fn a_pick_ends_in_contact_with_what_may_be_touched_and_with_nothing_else() {
    let robot = arm(3);
    // the end of the arm, stretched along x, is within the cup; the post is between start and goal
    let objects = |robot: &Arc<Robot>| {
        let cup = ball("cup", 0.93, 0.0, 0.04, ObjectClass::Obstacle);
        scene(robot, vec![cup, ball("post", 0.75, 0.45, 0.05, ObjectClass::Obstacle)])
    };
    let plain = objects(&robot);
    let problem = problem(&[1.2, 0.0, 0.0], &[0.0, 0.0, 0.0], 5);
    let mut space = space(&plain, &robot);
    let Err(NoPath::Blocked { end: PathEnd::Goal, pair: Some((_, cup)) }) = plan(&mut space, &problem) else {
        panic!("the goal is in contact");
    };
    assert_eq!(plain.shape_name(cup), "cup#0");
    let pick = plain.with_pair_rules(0, &[PairRule::may_touch("tip:cup").unwrap()]).unwrap();
    // the marker's body is the last link alone
    let mut space = JointSpace::new(&pick, 0, &pick.home(), &[0, 1, 2], &[], CLEARANCE).unwrap();
    let path = plan(&mut space, &problem).expect("a pick");
    assert!(path.poses.len() > 2, "the post is in the way");
    assert!(path.edges().all(|(a, b)| line_free(&pick, a, b)) && !path.edges().all(|(a, b)| line_free(&plain, a, b)));
    // the same start and goal, seen from the pick: away with the cup
    let back = PlanningProblem { start: problem.goals[0].clone(), goals: vec![problem.start.clone()], ..problem };
    assert!(plan(&mut space, &back).is_ok());
    // a space that is used again among other obstacles takes the rules of the new scene
    let mut again = space.among(&plain, &plain.home()).unwrap();
    assert!(matches!(plan(&mut again, &back), Err(NoPath::Blocked { end: PathEnd::Start, .. })));
}
