//! Promises: the watch returns the same as a full query, with noise, jumps and edits; the result for a line equals that
//! of its samples; the prepared frames agree with the robot's kinematics.

use crate::engines::{UnderTest, for_every_engine};
use crate::oracle;
use mobee_model::{
    Contact, Edit, Engine, Object, ObjectClass, Primitive, Robot, Scene, Shape, ShapeId, Watch, load_robot, load_world,
};
use nalgebra::{Isometry3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

for_every_engine!(
    the_watch_returns_what_a_full_check_would,
    the_watch_follows_edits_and_looks_at_nothing_while_nothing_moves,
    a_line_is_judged_as_its_samples_are,
    no_point_moves_farther_in_a_step_than_asked,
    prepared_frames_are_the_robots_kinematics,
    edits_make_new_snapshots_or_nothing,
    targets_and_ghosts_never_collide,
);

fn edge() -> Arc<Robot> {
    Arc::new(load_robot(oracle::own_data("edge").join("edge_a.xml")).expect("the robot loads").value)
}

fn ball(name: &str, at: [f64; 3], radius: f64) -> Object {
    let shapes = vec![Primitive { shape: Shape::Sphere { radius }, pose: Isometry3::identity() }];
    let pose = Isometry3::translation(at[0], at[1], at[2]);
    Object { name: name.into(), class: ObjectClass::Obstacle, persistent: false, pose, shapes, color: None }
}

/// The edge robot among balls, alone and as a pair, the shipped iCub, and, if it exists here, the original iCub in its
/// crowded world.
fn scenes<E: Engine>() -> Vec<Scene<E>> {
    let balls = vec![ball("one", [0.15, 0.1, 0.2], 0.06), ball("two", [-0.1, 0.25, 0.1], 0.08)];
    let mut all = vec![Scene::<E>::with_engine(vec![(edge(), Isometry3::identity())], balls.clone()).expect("a scene")];
    let mut other = Robot::clone(&edge());
    other.name = "other".into();
    let two = vec![(edge(), Isometry3::identity()), (Arc::new(other), Isometry3::translation(0.25, 0.0, 0.0))];
    all.push(Scene::<E>::with_engine(two, balls).expect("a scene"));
    let own = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/icub.xml");
    let icub = Arc::new(load_robot(own).expect("the robot loads").value);
    let far = vec![ball("ball", [-0.3, 0.2, 0.1], 0.05)];
    all.push(Scene::<E>::with_engine(vec![(icub, Isometry3::identity())], far).expect("a scene"));
    if let Some(shared) = oracle::shared() {
        let icub = load_robot(shared.join("reference/mobee-original-data/icub.xml")).expect("the robot loads").value;
        let world = load_world(shared.join("reference/mobee-oracle/icub/world20.xml")).expect("the world loads").value;
        all.push(Scene::<E>::with_engine(vec![(Arc::new(icub), Isometry3::identity())], world).expect("a scene"));
    }
    all
}

fn within_limits(scene: &Scene<impl Engine>, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let any = |r: &Arc<Robot>, rng: &mut ChaCha8Rng| -> Vec<f64> {
        r.motors.iter().map(|m| m.min + (m.max - m.min) * rng.random::<f64>()).collect()
    };
    scene.robots().iter().map(|r| any(r, rng)).collect()
}

fn same(watched: &[Contact], full: &[Contact]) {
    let pairs = |list: &[Contact]| list.iter().map(|c| (c.pair, c.distance)).collect::<Vec<_>>();
    let (watched, full) = (pairs(watched), pairs(full));
    assert_eq!(watched.iter().map(|p| p.0).collect::<Vec<_>>(), full.iter().map(|p| p.0).collect::<Vec<_>>());
    for (w, f) in watched.iter().zip(&full) {
        assert!((w.1 - f.1).abs() < 1e-7, "{w:?} {f:?}");
    }
}

fn the_watch_returns_what_a_full_check_would<E: UnderTest>() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for scene in scenes::<E>() {
        let mut watch = Watch::new(Arc::new(scene.clone()), 0.012);
        let mut at = scene.home().iter().map(|q| q.to_vec()).collect::<Vec<_>>();
        let mut goal = at.clone();
        let mut contacts = 0;
        for tick in 0..E::POSES {
            // Straight moves of varying speed, rests with encoder noise, and sometimes a jump.
            if tick % 150 == 0 {
                goal = within_limits(&scene, &mut rng);
            }
            if tick % 997 == 0 {
                at = within_limits(&scene, &mut rng);
            }
            let speed = if tick % 150 < 100 { 0.03 } else { 0.0 };
            for (q, g) in at.iter_mut().flatten().zip(goal.iter().flatten()) {
                *q += (g - *q) * speed;
            }
            let noisy: Vec<Vec<f64>> =
                at.iter().map(|q| q.iter().map(|x| x + 3e-4 * (rng.random::<f64>() - 0.5)).collect()).collect();
            let full = scene.contacts(&noisy, 0.012);
            contacts += full.len();
            same(watch.update(&noisy), &full);
        }
        assert!(contacts > 0, "the walk must meet something");
        println!("{contacts} contacts; {:?}", watch.counters());
    }
}

fn the_watch_follows_edits_and_looks_at_nothing_while_nothing_moves<E: Engine>() {
    for scene in scenes::<E>() {
        let mut watch = Watch::new(Arc::new(scene.clone()), 0.012);
        let home = scene.home();
        same(watch.update(&home), &scene.contacts(&home, 0.012));
        let looked = watch.counters().looked;
        watch.update(&home);
        assert_eq!(watch.counters().looked, looked);
        // Places a ball onto a moving shape.
        let nodes = scene.node_transforms(&home);
        let robot = &scene.robots()[0];
        let moves =
            |n: &usize| robot.body(*n).is_some() && !robot.nodes[*n].near_root && !robot.nodes[*n].solids.is_empty();
        let node = (0..nodes[0].len()).rfind(moves).expect("a solid");
        let at = (nodes[0][node] * robot.nodes[node].solids[0].pose).translation.vector;
        let next = Arc::new(scene.edit(&Edit::Add(ball("new", at.into(), 0.1))).expect("an edit"));
        watch.set_scene(next.clone());
        let full = next.contacts(&home, 0.012);
        assert!(full.iter().any(
            |c| matches!(c.pair.1, ShapeId::Object { object, .. } if next.object("new").expect("it").0 == object)
        ));
        same(watch.update(&home), &full);
    }
}

fn a_line_is_judged_as_its_samples_are<E: Engine>() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut free, mut hit) = (0, 0);
    for scene in scenes::<E>() {
        for k in 0..12 {
            // A short distance from home, and sometimes far.
            let share = if k % 3 == 0 { 1.0 } else { 0.06 };
            let toward = |mut q: Vec<Vec<f64>>| {
                for (q, home) in q.iter_mut().flatten().zip(scene.home().iter().flat_map(|h| h.iter())) {
                    *q = home + (*q - home) * share;
                }
                q
            };
            let (from, to) = (toward(within_limits(&scene, &mut rng)), toward(within_limits(&scene, &mut rng)));
            let (step, clearance) = (0.02, 0.005);
            let verdict = scene.line(0, &from, &from[0], &to[0], step, clearance);
            let mut least = f64::INFINITY;
            let mut first = None;
            for k in 0..=verdict.steps {
                let t = f64::from(k) / f64::from(verdict.steps);
                let mut at = from.clone();
                at[0] = from[0].iter().zip(&to[0]).map(|(a, b)| a + (b - a) * t).collect();
                let own = |s: ShapeId| matches!(s, ShapeId::Robot { robot: 0, .. });
                let near =
                    scene.contacts(&at, clearance + 0.005).into_iter().filter(|c| own(c.pair.0) || own(c.pair.1));
                let near = near.map(|c| c.distance).fold(clearance + 0.005, f64::min);
                least = least.min(near);
                if near <= clearance && first.is_none() {
                    first = Some(t);
                }
            }
            assert!((least - verdict.min_distance).abs() < 1e-7, "{least} {verdict:?}");
            if verdict.constraint.is_none() {
                assert_eq!(verdict.at, first);
                assert_eq!(verdict.free, first.is_none());
            }
            assert_eq!(scene.line_free(0, &from, &from[0], &to[0], step, clearance), verdict.free);
            if verdict.free { free += 1 } else { hit += 1 }
        }
    }
    println!("{free} lines free, {hit} not");
    assert!(free > 0 && hit > 0);
}

fn no_point_moves_farther_in_a_step_than_asked<E: Engine>() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for scene in scenes::<E>() {
        let (from, to) = (within_limits(&scene, &mut rng), within_limits(&scene, &mut rng));
        let steps = scene.line(0, &from, &from[0], &to[0], 0.01, 0.0).steps;
        let place = |k: u32| {
            let t = f64::from(k) / f64::from(steps);
            let mut at = from.clone();
            at[0] = from[0].iter().zip(&to[0]).map(|(a, b)| a + (b - a) * t).collect();
            scene.node_transforms(&at).swap_remove(0)
        };
        for k in 0..steps {
            let (here, there) = (place(k), place(k + 1));
            for (a, b) in here.iter().zip(&there) {
                assert!((a.translation.vector - b.translation.vector).norm() <= 0.01 + 1e-12);
            }
        }
    }
}

fn prepared_frames_are_the_robots_kinematics<E: Engine>() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for scene in scenes::<E>() {
        for _ in 0..50 {
            let q = within_limits(&scene, &mut rng);
            for (r, nodes) in scene.node_transforms(&q).iter().enumerate() {
                let mut expected = Vec::new();
                scene.robots()[r].forward_from(&scene.base(r), &q[r], &mut expected);
                for (a, b) in nodes.iter().zip(&expected) {
                    assert!((a.to_homogeneous() - b.to_homogeneous()).amax() < 1e-12);
                }
            }
        }
    }
}

fn edits_make_new_snapshots_or_nothing<E: Engine>() {
    let scene = Scene::<E>::with_engine(vec![(edge(), Isometry3::identity())], vec![ball("one", [1.0, 0.0, 0.0], 0.1)])
        .expect("a scene");
    let moved =
        scene.edit(&Edit::Move { name: "one".into(), pose: Isometry3::translation(2.0, 0.0, 0.0) }).expect("an edit");
    assert_eq!((scene.epoch(), moved.epoch()), (0, 1));
    assert_eq!(scene.object("one").expect("one").1.pose.translation.vector, Vector3::x());
    let gone = moved.edit(&Edit::Remove { name: "one".into() }).expect("an edit");
    let back = gone.edit(&Edit::Add(ball("one", [0.0; 3], 0.1))).expect("an edit");
    assert_ne!(scene.object("one").expect("one").0, back.object("one").expect("one").0, "ids are never used again");
    for wrong in [
        Edit::Add(ball("one", [0.0; 3], 0.1)),
        Edit::Add(ball("bad", [f64::NAN, 0.0, 0.0], 0.1)),
        Edit::Add(ball("bad", [0.0; 3], f64::INFINITY)),
        Edit::Add(ball("bad", [0.0; 3], 0.0)),
        Edit::Remove { name: "two".into() },
    ] {
        assert!(back.edit(&wrong).is_err(), "{wrong:?}");
    }
    let mut fast = ball("fast", [0.0; 3], 0.1);
    fast.persistent = true;
    let both = back.edit(&Edit::Add(fast)).expect("an edit");
    assert!(both.edit(&Edit::Remove { name: "fast".into() }).is_err());
    assert_eq!(both.edit(&Edit::Clear).expect("an edit").objects().count(), 1);
    assert!(
        Scene::<E>::with_engine(vec![(edge(), Isometry3::identity()), (edge(), Isometry3::identity())], Vec::new())
            .is_err()
    );
}

fn targets_and_ghosts_never_collide<E: Engine>() {
    let at_robot = ball("thing", [0.0, 0.2, 0.1], 0.5);
    let scene = Scene::<E>::with_engine(vec![(edge(), Isometry3::identity())], vec![at_robot]).expect("a scene");
    let home = scene.home();
    let with_object = |s: &Scene<E>| s.contacts(&home, 0.1).iter().any(|c| matches!(c.pair.1, ShapeId::Object { .. }));
    assert!(with_object(&scene));
    for class in [ObjectClass::Target, ObjectClass::Ghost] {
        let next = scene.edit(&Edit::Class { name: "thing".into(), class }).expect("an edit");
        assert!(!with_object(&next));
    }
}
