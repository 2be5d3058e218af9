//! Nearest neighbors compared with kiddo, A* with petgraph, and RRT-Connect on certified edges:
//! `cargo bench -p mobee-planning --bench planning`.
//!
//! Rounds are interleaved, and ratios are printed first. Tasks of milliseconds are measured in
//! processor time, shorter ones by the least of three wall-clock times, because other load can only
//! lengthen them. `-- knn`, `-- search` or `-- rrt` runs one part; `MOBEE_QUERIES` sets the number
//! of RRT-Connect queries (1,000), and `MOBEE_PEER` is the command of another planner that solves
//! the same queries: see `benches/peers/README.md`.
#![allow(clippy::disallowed_methods)] // a measurement of the processor

#[path = "../../../model/fast/benches/measure/mod.rs"]
mod measure;
#[path = "../../../benches/peers/peer.rs"]
mod peer;

use kiddo::{MutableKdTree, SquaredEuclidean};
use measure::{processor_time, sorted};
use mobee_model::{Object, ObjectClass, Primitive, Robot, Scene, Shape, load_robot, load_world};
use mobee_planning::planners::{JointSpace, PlanningProblem, RrtConnect, shorten};
use mobee_planning::planners::{NoPath, Planner};
use mobee_planning::roadmap::neighbors::{Flat, Neighbors};
use mobee_planning::roadmap::{Roadmap, Vertex};
use mobee_planning::short_way::JointMetric;
use nalgebra::{Isometry3, Vector3};
use peer::{Folder, Peer, described};
use petgraph::graph::{DiGraph, NodeIndex};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use std::f64::consts::{FRAC_PI_2, PI};
use std::num::NonZero;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Numbers of vertices of the maps, and of neighbors of each.
const POINTS: usize = 5000;
const K: usize = 8;
/// Number of rounds; the median is reported.
const ROUNDS: usize = 5;
/// Clearance of the planners, meters.
const CLEARANCE: f64 = 0.012;

fn main() {
    let parts: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let wanted = |part: &str| parts.is_empty() || parts.iter().any(|p| p == part);
    if wanted("knn") {
        println!(
            "nearest neighbors: k = {K} of all of {POINTS} uniform points, ms of processor time, median of {ROUNDS}"
        );
        println!("{:>4}  {:>14}  {:>8}  {:>10}  {:>8}", "dim", "kiddo / all", "all", "one by one", "kiddo");
        knn::<7>();
        knn::<10>();
        knn::<20>();
        knn::<41>();
    }
    if wanted("search") {
        println!("A* on {POINTS} uniform vertices, k = {K}, 200 pairs, us");
        println!("{:>4}  {:>16}  {:>8} {:>8}  {:>14}", "dim", "petgraph / ours", "median", "p99", "petgraph median");
        [7, 10, 20, 41].into_iter().for_each(search);
    }
    if wanted("rrt") {
        println!("RRT-Connect between free poses, and with shortcuts");
        rrt("icub, torso and right arm, 20 things on a table", icub());
        rrt("panda among 20 spheres", panda());
    }
}

fn uniform(count: usize, dimension: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| (0..dimension).map(|_| rng.random_range(-1.5..1.5)).collect()).collect()
}

fn knn<const N: usize>() {
    let points = uniform(POINTS, N, 7);
    let mut flat = Flat::new(N, &JointMetric::default());
    points.iter().enumerate().for_each(|(id, q)| flat.add(id as u32, q));
    let mut times = [const { Vec::new() }; 3];
    let (mut all, mut each, mut theirs) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        times[0].push(seconds(|| all = flat.knn_all(K)));
        times[1].push(seconds(|| each = points.iter().map(|q| flat.knn(q, K + 1)).collect()));
        times[2].push(seconds(|| {
            let mut tree = MutableKdTree::<f64, N>::default();
            for (id, q) in points.iter().enumerate() {
                let q: &[f64; N] = q.as_slice().try_into().expect("N coordinates");
                tree.add(q, id as u32).expect("no two are alike");
            }
            let k = NonZero::new(K + 1).expect("not zero");
            theirs = points
                .iter()
                .map(|q| {
                    let q: &[f64; N] = q.as_slice().try_into().expect("N coordinates");
                    let mut near = tree.query(q).nearest_n::<SquaredEuclidean<f64>>(k).execute();
                    near.sort_by(|a, b| a.distance.total_cmp(&b.distance));
                    near.iter().map(|n| n.item).collect::<Vec<u32>>()
                })
                .collect();
        }));
    }
    for (((id, all), each), theirs) in all.iter().zip(&each).zip(&theirs) {
        let others: Vec<(f64, u32)> = each.iter().copied().filter(|(_, other)| other != id).collect();
        assert_eq!(all, &others);
        assert_eq!(others.iter().map(|n| n.1).collect::<Vec<_>>(), theirs[1..], "kiddo has other neighbors");
    }
    let [all, each, kiddo] = times.map(median).map(|s| 1e3 * s);
    println!("{N:>4}  {:>13.1}x  {all:>8.1}  {each:>10.1}  {kiddo:>8.1}", kiddo / all);
}

/// Creates a robot with this number of motors and nothing else.
fn motors(count: usize) -> Robot {
    let mut robot = load_robot(root().join("configs/robots/icub.xml")).expect("a robot").value;
    let motor = robot.motors[0].clone();
    robot.motors = (0..count).map(|i| mobee_model::Motor { name: format!("m{i}"), ..motor.clone() }).collect();
    robot
}

fn search(dimension: usize) {
    let points = uniform(POINTS, dimension, 7);
    let mut map = Roadmap::new((0..dimension).collect(), &motors(dimension));
    for q in &points {
        map.add(Vertex { name: None, q: q.clone(), at: [0.0; 3] });
    }
    map.join_nearest(K);
    let metric = JointMetric::default();
    let mut graph = DiGraph::<(), f64>::new();
    for _ in &points {
        graph.add_node(());
    }
    for (a, b, _) in map.edges() {
        let length = metric.distance(&points[a as usize], &points[b as usize]);
        graph.add_edge(NodeIndex::new(a as usize), NodeIndex::new(b as usize), length);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..200 {
        let (from, to) = (rng.random_range(0..POINTS), rng.random_range(0..POINTS));
        let (mut way, mut other) = (None, None);
        ours.push(least(|| way = map.plan(from as u32, to as u32)));
        theirs.push(least(|| {
            let (start, goal) = (NodeIndex::new(from), NodeIndex::new(to));
            let left = |n: NodeIndex| metric.distance(&points[n.index()], &points[to]);
            other = petgraph::algo::astar(&graph, start, |n| n == goal, |e| *e.weight(), left);
        }));
        let length = |way: Vec<u32>| -> f64 {
            way.windows(2).map(|w| metric.distance(&points[w[0] as usize], &points[w[1] as usize])).sum()
        };
        match (way.map(length), other) {
            (Some(a), Some((b, _))) => assert!((a - b).abs() < 1e-9, "{a} rad, and {b} rad by petgraph"),
            (a, b) => assert!(a.is_none() && b.is_none()),
        }
    }
    let (p99, half) = (percentile(&ours, 0.99), median(ours));
    let petgraph = median(theirs);
    println!(
        "{dimension:>4}  {:>15.1}x  {:>8.0} {:>8.0}  {:>14.0}",
        petgraph / half,
        1e6 * half,
        1e6 * p99,
        1e6 * petgraph
    );
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn robot(file: &str) -> Arc<Robot> {
    Arc::new(load_robot(root().join("configs/robots").join(file)).expect("a robot").value)
}

fn object(name: String, shape: Shape, at: Vector3<f64>) -> Object {
    // The posts are upright: cylinders are aligned with the y axis.
    let upright = Isometry3::rotation(Vector3::x() * FRAC_PI_2);
    let shapes = vec![Primitive { shape, pose: upright }];
    let pose = Isometry3::translation(at.x, at.y, at.z);
    Object { name, class: ObjectClass::Obstacle, persistent: false, pose, shapes, color: None }
}

/// A scene, and the motors of the planner.
type Setting = (Scene, Vec<usize>);

/// Creates the table of the ball experiment with twenty balls and posts on it.
fn icub() -> Setting {
    let robot = robot("icub.xml");
    let world = load_world(root().join("configs/worlds/ball.xml")).expect("a world").value;
    let mut objects: Vec<Object> = world.into_iter().filter(|o| o.name == "table").collect();
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for i in 0..20 {
        let (x, y) = (rng.random_range(-0.60..-0.28), rng.random_range(-0.30..0.50));
        let radius = rng.random_range(0.015..0.035);
        let (shape, z) = if i % 2 == 0 {
            (Shape::Sphere { radius }, -0.18 + radius)
        } else {
            let length = rng.random_range(0.08..0.16);
            (Shape::Cylinder { radius, height: length }, -0.18 + length / 2.0)
        };
        objects.push(object(format!("thing{i}"), shape, Vector3::new(x, y, z)));
    }
    let names = ["torso", "r_shoulder_pitch", "r_shoulder_roll", "r_shoulder_yaw", "r_elbow"].map(String::from);
    let wrist = ["r_wrist_prosup", "r_wrist_pitch", "r_wrist_yaw"].map(String::from);
    let names: Vec<String> = names.into_iter().chain(wrist).collect();
    let motors = mobee_planning::group::motors("motors", &names, &robot).expect("motors");
    (Scene::new(vec![(robot, Isometry3::identity())], objects).expect("a scene"), motors)
}

fn panda() -> Setting {
    let robot = robot("panda.xml");
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let mut objects = Vec::new();
    for i in 0..20 {
        let (angle, far) = (rng.random_range(-PI..PI), rng.random_range(0.35..0.75));
        let at = Vector3::new(far * angle.cos(), far * angle.sin(), rng.random_range(0.05..0.9));
        objects.push(object(format!("ball{i}"), Shape::Sphere { radius: rng.random_range(0.04..0.08) }, at));
    }
    let motors = (0..robot.motors.len().min(7)).collect();
    (Scene::new(vec![(robot, Isometry3::identity())], objects).expect("a scene"), motors)
}

fn rrt(name: &str, (scene, motors): Setting) {
    let mut space = JointSpace::new(&scene, 0, &scene.home(), &motors, &[], CLEARANCE).expect("a space");
    let count = std::env::var("MOBEE_QUERIES").ok().and_then(|n| n.parse().ok()).unwrap_or(1000);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut free = || loop {
        let q = space.sample(&mut rng);
        if space.free([q.as_slice()]) == [true] {
            return q;
        }
    };
    let queries: Vec<_> = (0..count).map(|_| (free(), free())).collect();
    let (mut search, mut whole, mut lines, mut direct, mut found) = (Vec::new(), Vec::new(), Vec::new(), 0, 0);
    let mut gains = Vec::new();
    let theirs = peers_times(&scene, &motors, &queries);
    for (seed, (start, goal)) in queries.into_iter().enumerate() {
        let problem = PlanningProblem { start, goals: vec![goal], seed: seed as u64, budget: 50_000 };
        let mut path = Err(NoPath::Cancelled);
        search.push(least(|| {
            path = RrtConnect::default().plan(&mut space, &problem, &mut |_| ControlFlow::Continue(()));
        }));
        let Ok(path) = path else {
            whole.push(search[seed]);
            continue;
        };
        found += 1;
        lines.push(path.evaluations as f64);
        let long = path.length();
        let mut short = None;
        whole.push(search[seed] + least(|| short = Some(shorten(&mut space, path.clone(), seed as u64, 5000))));
        let short = short.expect("a path");
        direct += usize::from(short.poses.len() == 2);
        gains.push(short.length() / long);
    }
    let ms = |times: &[f64], share| 1e3 * percentile(times, share);
    println!("{name}: {found} of {count} found, {direct} of them straight");
    if !theirs.is_empty() {
        let ratio = |share| percentile(&theirs, share) / ms(&search, share);
        println!(
            "  the peer      median {:.1} ms, p90 {:.1}, p99 {:.1}, of {} found: {:.0}x, {:.0}x, {:.0}x as long",
            percentile(&theirs, 0.5),
            percentile(&theirs, 0.9),
            percentile(&theirs, 0.99),
            theirs.len(),
            ratio(0.5),
            ratio(0.9),
            ratio(0.99)
        );
    }
    println!(
        "  search        median {:.3} ms, p90 {:.3}, p99 {:.2}, most {:.1}",
        ms(&search, 0.5),
        ms(&search, 0.9),
        ms(&search, 0.99),
        ms(&search, 1.0)
    );
    println!(
        "  with shortcuts median {:.3} ms, p90 {:.3}, p99 {:.2}, most {:.1}",
        ms(&whole, 0.5),
        ms(&whole, 0.9),
        ms(&whole, 0.99),
        ms(&whole, 1.0)
    );
    println!(
        "  lines judged  median {:.0}, p99 {:.0}; length left {:.2}",
        percentile(&lines, 0.5),
        percentile(&lines, 0.99),
        median(gains)
    );
}

/// Returns the peer's processor time, ms, for each query that it solves; empty without a peer.
fn peers_times(scene: &Scene, motors: &[usize], queries: &[(Vec<f64>, Vec<f64>)]) -> Vec<f64> {
    let Ok(command) = std::env::var("MOBEE_PEER") else { return Vec::new() };
    let robot = &scene.robots()[0];
    let limits = motors.iter().map(|m| [robot.motors[*m].min, robot.motors[*m].max]).collect::<Vec<_>>();
    let asked = json!({
        "motors": motors, "pose": &*scene.home()[0], "limits": limits, "queries": queries, "seconds": 10.0,
    });
    let folder = Folder::new();
    folder.write("scene.json", described(scene).to_string().into_bytes());
    folder.write("queries.json", asked.to_string().into_bytes());
    let words: Vec<String> = command.split_whitespace().map(str::to_owned).collect();
    Peer::start(&words, &folder).ask().into_iter().filter(|ms| *ms >= 0.0).collect()
}

/// Returns the least wall-clock time of three runs, seconds: processor time is counted in
/// milliseconds only.
fn least(mut run: impl FnMut()) -> f64 {
    let once = |_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    };
    (0..3).map(once).fold(f64::INFINITY, f64::min)
}

/// Returns the processor time of a task, seconds.
fn seconds(run: impl FnOnce()) -> f64 {
    let start = Instant::now();
    let begin = processor_time(start);
    run();
    processor_time(start) - begin
}

fn percentile(values: &[f64], share: f64) -> f64 {
    let sorted = sorted(values.to_vec());
    let last = sorted.len().saturating_sub(1);
    sorted.get((share * last as f64).round() as usize).copied().unwrap_or(f64::NAN)
}

fn median(values: Vec<f64>) -> f64 {
    percentile(&values, 0.5)
}
