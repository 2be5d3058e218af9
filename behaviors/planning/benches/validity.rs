//! Updates of a map in a changing world: 5,000 poses of torso and right arm over a table, each
//! joined to its eight nearest, among 20 obstacles, of which one at a time is moved. Processor time
//! of one core, in interleaved rounds:
//!
//! * *from nothing*: an empty layer certifies every edge (the cost of a new world without memory),
//! * *one object moved*: the layer is updated to the new world; for comparison, the same object is
//!   certified against all edges without the index; and the part of it spent on compiling,
//! * *the map*: the same through the validator, with the roadmap's edges removed and restored, and
//!   their notes,
//! * *lazy*: a path between two random vertices, replanned until all its edges are certified
//!   (`validation = "lazy"`), by wall clock, which has a finer resolution: in a world at rest, at
//!   first without certificates, and then with an object moved before each.
//!
//! ```text
//! cargo bench -p mobee-planning --bench validity
//! ```
#![allow(clippy::disallowed_methods)] // a measurement of the processor

#[allow(dead_code)] // shared with another benchmark
#[path = "../../../model/fast/benches/map/mod.rs"]
mod map;
#[path = "../../../model/fast/benches/measure/mod.rs"]
mod measure;

use map::{Dice, Map, is_object};
use measure::{processor_time, sorted};
use mobee_contract::{Time, View};
use mobee_fast::{EdgeVerdict, FastScene};
use mobee_model::{Edit, Scene, load_robot};
use mobee_planning::roadmap::validation::{Validation, Validator};
use mobee_planning::roadmap::validity::{Validity, edge_between};
use mobee_planning::roadmap::{Roadmap, Vertex};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Number of moves of one object.
const MOVES: usize = 200;
/// Number of planned paths.
const QUERIES: usize = 500;
/// Number of rounds of long tasks.
const ROUNDS: usize = 5;
/// Clearance of a run with the usual margin, meters.
const CLEARANCE: f64 = 0.012;

fn main() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/icub.xml");
    let robot = Arc::new(load_robot(file).expect("the robot loads").value);
    let count = std::env::var("MOBEE_POSES").ok().and_then(|n| n.parse().ok()).unwrap_or(5_000);
    let poses = Map::new(robot.clone(), count);
    let mut map = roadmap(&poses);
    let mut scene = Arc::new(poses.scene(poses.obstacles()));
    let clock = Instant::now();

    let nothing = (0..ROUNDS).map(|_| timed(clock, || drop(from_nothing(&map, &scene))).1).collect();
    let nothing = report("from nothing", nothing);
    let mut layer = from_nothing(&map, &scene);
    let figures = layer.figures();
    let blocked = poses.edges.iter().filter(|(a, b)| !is_free(&layer, *a, *b)).count();
    println!(
        "{} vertices, {} edges, {blocked} of them not free; {} boxes each, {:.1} MB of boxes, {:.1} MB of poses and verdicts",
        map.len(),
        figures.edges,
        figures.limbs,
        figures.index_bytes as f64 / 1e6,
        figures.edge_bytes as f64 / 1e6
    );

    let mut validator = Validator::new(Validation::Verified, map.motors());
    let (_, first) = timed(clock, || validator.look(&mut map, &view(&scene)));
    println!("the map verified for the first time, edges taken out and noted: {:.0} ms", 1e3 * first);

    let mut dice = Dice(15);
    let (mut moved, mut mapped, mut plain, mut compiled) = (vec![], vec![], vec![], vec![]);
    let (mut changed, mut asked) = (vec![], vec![]);
    for step in 0..MOVES {
        scene = Arc::new(jump(&mut dice, &poses, &scene));
        let (seen, before) = (view(&scene), layer.figures().asked);
        let (news, time) = timed(clock, || layer.look(&seen));
        moved.push(time);
        changed.push(news.edges.len() as f64);
        asked.push((layer.figures().asked - before) as f64);
        mapped.push(timed(clock, || (validator.look(&mut map, &seen), map.notes())).1);
        if step % (MOVES / 20) == 0 {
            let object = *news.objects.first().expect("an object moved");
            let keep = |_, b| is_object(&scene, b, object);
            let (fast, time) = timed(clock, || FastScene::of_pairs(&scene, CLEARANCE, keep));
            compiled.push(time);
            let (mut fast, mut verdicts) = (fast.expect("it compiles"), Vec::new());
            let lines = poses.lines();
            plain.push(time + timed(clock, || fast.certify(&lines, &mut verdicts).expect("whole edges")).1);
        }
    }
    let fresh = from_nothing(&map, &scene);
    let differing = poses.edges.iter().filter(|(a, b)| is_free(&layer, *a, *b) != is_free(&fresh, *a, *b)).count();
    assert_eq!(differing, 0, "after all moves the layer is what a fresh one is");

    let compiled = report("  of it compiling", compiled);
    let moved = report("one object moved", moved);
    let mapped = report("  and the map with it", mapped);
    let plain = report("one object, all edges asked", plain);
    let [changed, asked] = [changed, asked].map(|numbers| sorted(numbers)[MOVES / 2]);
    println!("edges that a move turns off or on: {changed:.0} in the median; that are certified for it: {asked:.0}");
    println!("\nfrom nothing / one object moved         {:8.1}", nothing / moved);
    println!("all edges asked / one object moved      {:8.1}", plain / moved);
    println!("compiling's share of one object moved   {:8.2}", compiled / moved);
    println!("the map's share of the whole            {:8.2}\n", (mapped - moved) / mapped);
    lazy(&poses, &mut dice, scene);
}

fn roadmap(poses: &Map) -> Roadmap {
    let mut map = Roadmap::new(poses.motors.clone(), &poses.robot);
    for (q, at) in poses.poses.iter().zip(&poses.hands) {
        map.add(Vertex { name: None, q: q.clone(), at: [at.x, at.y, at.z] });
    }
    for (a, b) in &poses.edges {
        map.join(*a as u32, *b as u32);
    }
    map.notes();
    map
}

/// Plans paths with edges that are certified during planning.
fn lazy(poses: &Map, dice: &mut Dice, mut scene: Arc<Scene>) {
    let mut map = roadmap(poses);
    let mut validator = Validator::new(Validation::Lazy, map.motors());
    for (moves, what) in [(false, "lazy, at first"), (false, "lazy, later"), (true, "lazy, an object moved")] {
        let (mut all, mut looks, mut plans, mut found) = (vec![], vec![], vec![], 0);
        for _ in 0..QUERIES {
            if moves {
                scene = Arc::new(jump(dice, poses, &scene));
            }
            let seen = view(&scene);
            let [from, to] = [(); 2].map(|()| (dice.roll() * map.len() as f64) as u32);
            let start = Instant::now();
            validator.look(&mut map, &seen);
            looks.push(start.elapsed().as_secs_f64());
            let mut planned = 0;
            let free = std::iter::from_fn(|| {
                planned += 1;
                map.plan(from, to).map(|path| validator.admits(&mut map, &path, &seen))
            });
            found += usize::from(free.into_iter().any(|admitted| admitted));
            all.push(start.elapsed().as_secs_f64());
            plans.push(f64::from(planned));
            map.notes();
        }
        let again = all.iter().zip(&looks).map(|(all, look)| all - look).collect();
        report(what, all);
        report("  of it looking at the world", looks);
        report("  and planning, certifying", again);
        let plans = sorted(plans);
        println!(
            "  {found} of {QUERIES} found, by {:.0} plans in the median, {:.0} at most",
            plans[QUERIES / 2],
            plans[QUERIES - 1]
        );
    }
}

fn from_nothing(map: &Roadmap, scene: &Arc<Scene>) -> Validity {
    let mut layer = Validity::new(map.motors());
    layer.look(&view(scene));
    layer.certify(map, map.edges().into_iter().map(|(a, b, _)| edge_between(a, b)));
    layer
}

fn is_free(layer: &Validity, a: usize, b: usize) -> bool {
    layer.verdict(edge_between(a as u32, b as u32)) == Some(&EdgeVerdict::Free)
}

/// Moves one of the obstacles to a position at which it touches some poses, but at most a
/// twenty-fifth of them, as on the map's creation.
fn jump(dice: &mut Dice, poses: &Map, scene: &Scene) -> Scene {
    let number = (20.0 * dice.roll()) as u32;
    let all: Vec<f64> = poses.poses.iter().flatten().copied().collect();
    loop {
        let turn = UnitQuaternion::from_euler_angles(dice.between(-3.0, 3.0), dice.between(-3.0, 3.0), 0.0);
        let at = Vector3::new(dice.between(-0.55, -0.05), dice.between(-0.35, 0.65), dice.between(0.0, 0.4));
        let pose = Isometry3::from_parts(at.into(), turn);
        let moved = scene.edit(&Edit::Move { name: format!("o{number}"), pose }).expect("an edit");
        let mut free = Vec::new();
        let fast = FastScene::of_pairs(&moved, 0.0, |_, b| is_object(&moved, b, number));
        fast.expect("it compiles").free(&all, &mut free).expect("whole poses");
        if (1..=free.len() / 25).contains(&free.iter().filter(|free| !**free).count()) {
            return moved;
        }
    }
}

fn view(scene: &Arc<Scene>) -> View {
    View {
        at: Time::default(),
        robot: 0,
        axes: Arc::new([]),
        poses: scene.home(),
        scene: scene.clone(),
        contacts: Arc::new([]),
        clearance: CLEARANCE,
        seen: Arc::new([]),
    }
}

/// Returns the result of a task, and its processor time in seconds.
fn timed<T>(clock: Instant, run: impl FnOnce() -> T) -> (T, f64) {
    let begin = processor_time(clock);
    let answer = run();
    (answer, processor_time(clock) - begin)
}

/// Prints times; returns the median.
fn report(what: &str, times: Vec<f64>) -> f64 {
    let times = sorted(times);
    let at = |share: f64| 1e3 * times[((times.len() - 1) as f64 * share) as usize];
    let [least, median, late, most] = [0.0, 0.5, 0.99, 1.0].map(at);
    println!("{what:30} least {least:9.3} ms, median {median:9.3}, 99 % {late:9.3}, most {most:9.3}");
    median / 1e3
}
