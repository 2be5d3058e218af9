use super::*;
use mobee_compose::compose;
use mobee_compose::config::Config;
use mobee_contract::CommitId;
use mobee_model::{Edit, Object, ObjectClass, Primitive, Shape};
use nalgebra::Isometry3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn sets_out(robot: &str, near: Vec<Contact>) -> Event {
    Event::RetreatBegan { robot: robot.into(), id: CommitId(1), poses: 1, secs: 1.0, near }
}

/// I14: the arms come nearer to each other than they were.
#[test]
fn arms_that_meet_on_the_retreat_of_both_break_i14() {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/behaviors/torture.toml");
    let (config, source) = Config::load(&file, &[]).unwrap();
    let scene = Arc::new(compose(config, &source).unwrap().scene);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut draw = || -> Vec<Pose> {
        let any = |m: &mobee_model::Motor, rng: &mut ChaCha8Rng| {
            let (min, max) = m.range();
            rng.random_range(min..=max)
        };
        scene.robots().iter().map(|r| r.motors.iter().map(|m| any(m, &mut rng)).collect()).collect()
    };
    let of = |s: ShapeId| if let ShapeId::Robot { robot, .. } = s { robot } else { 9 };
    let poses = loop {
        let poses = draw();
        let met = |c: &Contact| of(c.pair.0) != of(c.pair.1) && of(c.pair.1) < 2;
        if scene.contacts(&poses, 0.0).iter().any(met) {
            break poses;
        }
    };
    let seen = |before: bool, events: Vec<Event>| {
        let mut witness = Witness::default();
        witness.scene(Time::ZERO, &scene);
        witness.robots =
            ["left", "right"].map(|r| WatchedRobot::new(r, (0.01, Duration::from_millis(20), 0.02), Time::ZERO)).into();
        let truth: Vec<Vec<f64>> = poses.iter().map(|q| q.to_vec()).collect();
        if before {
            witness.true_positions(Time::ZERO, &truth);
        }
        events.iter().for_each(|event| witness.event(Time::ZERO, event));
        witness.true_positions(Time::from_secs(1.0), &truth);
        witness.found.iter().any(|(invariant, _)| *invariant == "I14")
    };
    let both = || vec![sets_out("left", vec![]), sets_out("right", vec![])];
    assert!(seen(false, both()));
    // as near on what is taken back, or alone on the way
    assert!(!seen(true, both()));
    assert!(!seen(false, vec![sets_out("left", vec![])]));
    // one that its reflex has stopped rests, until it sets out again
    let stop = || Event::Command {
        robot: "right".into(),
        token: 2,
        writer: Writer::Reflex,
        kind: CommandKind::Stop,
        motors: vec![],
        q: vec![],
        speed: vec![],
        led: false,
    };
    // a board that was late then, and one that was long before
    let slow = |from: f64, to: f64| {
        let mut witness = Witness::default();
        witness.scene(Time::ZERO, &scene);
        witness.robots =
            ["left", "right"].map(|r| WatchedRobot::new(r, (0.01, Duration::from_millis(20), 0.02), Time::ZERO)).into();
        witness.late_boards(vec![vec![], vec![(Time::from_secs(from), Time::from_secs(to))]]);
        both().iter().for_each(|event| witness.event(Time::from_secs(9.0), event));
        witness.true_positions(Time::from_secs(10.0), &poses.iter().map(|q| q.to_vec()).collect::<Vec<_>>());
        witness.found.iter().any(|(invariant, _)| *invariant == "I14")
    };
    assert_eq!((slow(9.5, 9.7), slow(1.0, 2.0)), (false, true));
    let with = |more: Vec<Event>| both().into_iter().chain(more).collect::<Vec<Event>>();
    assert!(!seen(false, with(vec![stop()])));
    assert!(seen(false, with(vec![stop(), sets_out("right", vec![])])));
}

/// I19: readings that a stalled model passes on late are from before the object that appeared meanwhile.
#[test]
fn a_contact_with_a_new_object_counts_from_its_appearance() {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/behaviors/torture.toml");
    let (config, source) = Config::load(&file, &[]).unwrap();
    let scene = compose(config, &source).unwrap().scene;
    let home: Vec<Pose> = scene.home();
    let shapes = vec![Primitive { shape: Shape::Sphere { radius: 5.0 }, pose: Isometry3::identity() }];
    let (name, class, pose) = ("ball".into(), ObjectClass::Obstacle, Isometry3::identity());
    let ball = Object { name, class, persistent: false, pose, shapes, color: None };
    let edited = Arc::new(scene.edit(&Edit::Add(ball)).unwrap());
    // readings from 1.0 to 1.1 s, passed on after the edit at `appeared`
    let broken = |appeared: f64| {
        let mut witness = Witness::default();
        witness.scene(Time::ZERO, &Arc::new(scene.clone()));
        let rules = (0.01, Duration::from_millis(20), 0.02);
        witness.robots = ["left", "right"].map(|r| WatchedRobot::new(r, rules, Time::ZERO)).into();
        (witness.robots[0].open, witness.robots[0].status) = (true, Status::Moving);
        witness.scene(Time::from_secs(appeared), &edited);
        (0..20).for_each(|k| witness.pose(0, Time::from_secs(1.0 + 0.005 * f64::from(k)), &home[0]));
        witness.found.iter().any(|(invariant, _)| *invariant == "I19")
    };
    assert!(broken(1.0));
    assert!(!broken(1.1));
}

/// I32: a motor that is held and pushed on, with the filter open, for longer than it takes to be noticed.
#[test]
fn a_motor_that_is_held_and_pushed_on_breaks_i32() {
    let broken = |status: Status, deg: f64, secs: f64| {
        let mut witness = Witness::default();
        let mut seen = WatchedRobot::new("arm", (0.01, Duration::from_millis(20), 0.02), Time::ZERO);
        (seen.open, seen.status) = (true, status);
        witness.robots = vec![seen];
        for k in 0..(100.0 * secs) as u32 {
            let at = Time::ZERO + Duration::from_millis(10) * k;
            witness.robots[0].last = at;
            witness.held(0, at, &[None, Some((Time::ZERO, deg.to_radians()))], 0.5_f64.to_radians());
        }
        witness.found.iter().filter(|(invariant, _)| *invariant == "I32").count()
    };
    assert_eq!(broken(Status::Moving, 11.0, 1.5), 1);
    assert_eq!(broken(Status::Moving, 9.0, 1.5), 0, "its threshold may have grown");
    assert_eq!(broken(Status::Moving, 11.0, 0.9), 0, "it is noticed by then");
    assert_eq!(broken(Status::Retreating, 11.0, 1.5), 0, "a retreat is watched otherwise");
}

/// I8 and I17: a robot that moves though closed, or unseen. What it did while the process was suspended is nobody's fault.
#[test]
fn a_robot_moves_unseen_or_closed_only_while_the_process_is_suspended() {
    let broken = |open: bool, asleep: std::ops::Range<u32>| -> Vec<&str> {
        let mut witness = Witness::default();
        let mut seen = WatchedRobot::new("arm", (0.01, Duration::from_millis(20), 0.02), Time::ZERO);
        (seen.open, seen.status) = (open, Status::Stopping);
        witness.robots = vec![seen];
        for step in (0..100).filter(|step| !asleep.contains(step)) {
            witness.speed(0, Time::from_secs(0.02 * f64::from(step)), 1.0);
        }
        witness.found.iter().map(|(invariant, _)| *invariant).collect()
    };
    assert!(broken(true, 0..0).contains(&"I8"));
    assert!(broken(false, 0..0).contains(&"I17"));
    assert!(broken(true, 10..80).is_empty() && broken(false, 10..80).is_empty());
    assert!(broken(true, 1..50).contains(&"I8"), "a second after it woke");
}
