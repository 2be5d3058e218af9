//! An arm of half a meter that rotates about the vertical axis, and a ball in its way.

use super::*;
use crate::ControllerSettings;
use mobee_contract::{Axis, Board, Time};
use mobee_model::{Edit, Object, ObjectClass, Primitive, Shape, parse_robot};
use nalgebra::Isometry3;
use proptest::prelude::*;
use std::time::Duration;

const ARM: &str = include_str!("../../tests/data/pan.xml");
const RESERVE: f64 = 0.005;
/// Greatest distance of the arm's shapes from its axis, meters.
const LENGTH: f64 = 0.53;

/// A ball of 5 cm, 45 cm from the axis, at this angle, rad.
pub(crate) fn ball(at: f64) -> Object {
    Object {
        name: "ball".into(),
        class: ObjectClass::Obstacle,
        persistent: false,
        pose: Isometry3::translation(0.45 * at.cos(), 0.45 * at.sin(), 0.2),
        shapes: vec![Primitive { shape: Shape::Sphere { radius: 0.05 }, pose: Isometry3::identity() }],
        color: None,
    }
}

/// The arm, and the ball straight ahead.
fn scene() -> Arc<Scene> {
    let text = ARM.replace("NAME", "arm").replace("HOME", "0");
    let arm = Arc::new(parse_robot("arm.xml", &text).unwrap().value);
    Arc::new(Scene::new(vec![(arm, Isometry3::identity())], vec![ball(0.0)]).unwrap())
}

fn near(scene: &Scene, q: f64) -> Vec<Contact> {
    scene.contacts(&[vec![q]], 0.012)
}

/// Distance between the arm and the ball; at least 12 mm count as that.
fn left(q: f64) -> f64 {
    near(&scene(), q).iter().map(|c| c.distance).fold(0.012, f64::min)
}

/// A motor that moves towards the ball, and its actual stopping behavior.
#[derive(Clone, Copy, Debug)]
struct Plant {
    /// Start, rad; it moves towards zero.
    from: f64,
    /// Speed, rad/s, and acceleration, rad/s^2.
    speed: f64,
    gain: f64,
    /// Deceleration, rad/s^2, and the delay until it begins, s.
    brakes: f64,
    latency: f64,
    /// Time between two readings, s.
    period: f64,
}

impl Plant {
    fn rules(&self, stopped_at: f64) -> Arc<Rules> {
        let axis = Axis {
            name: "pan".into(),
            min: -3.0,
            max: 3.0,
            max_speed: 3.0,
            max_acceleration: stopped_at,
            ..Default::default()
        };
        let [period, latency] = [self.period, self.latency].map(Duration::from_secs_f64);
        let board = Board { axes: vec![axis], period, latency, position_direct: true };
        let settings = ControllerSettings { reserve_m: Some(RESERVE), ..ControllerSettings::default() };
        Arc::new(Rules::new("arm", vec!["arm".into()], &settings, &board))
    }

    /// Position at a time, with a stop command at another time.
    fn at(&self, t: f64, stopped_at: f64) -> f64 {
        let goes = |t: f64| {
            let gains = (self.speed / self.gain).min(t);
            let speed = self.gain * gains;
            (0.5 * speed * gains + speed * (t - gains), speed)
        };
        let (way, speed) = goes(t.min(stopped_at + self.latency));
        let braking = (t - stopped_at - self.latency).clamp(0.0, speed / self.brakes);
        self.from + way + speed * braking - 0.5 * self.brakes * braking * braking
    }

    /// Drives until it rests, stopped at a foreseen contact; returns its final position, and whether a contact was
    /// foreseen.
    fn drive(&self, ahead: &mut LookAhead, scene: &Scene, clock: &mut u64) -> (f64, bool) {
        let mut stopped_at = f64::INFINITY;
        let start = *clock;
        for k in 0.. {
            let t = k as f64 * self.period;
            let q = self.at(t, stopped_at);
            let rests = t > stopped_at + self.latency + self.speed / self.brakes + 0.2;
            if rests || q > 1.0 {
                *clock += 1_000_000_000 * (t.ceil() as u64 + 1);
                return (q, stopped_at.is_finite());
            }
            let at = Time(start + (t * 1e9) as u64);
            let pose: Pose = vec![q].into();
            let sample = Sample { seq: k, at, q: pose.clone(), done: vec![false], ..Sample::default() };
            let foreseen = ahead.read(0, &sample, &[pose], &near(scene, q), stopped_at.is_infinite());
            if stopped_at.is_infinite() && !foreseen.is_empty() {
                stopped_at = t;
            }
        }
        unreachable!()
    }
}

fn looks(rules: &Arc<Rules>) -> LookAhead {
    LookAhead::new(&scene(), [rules.clone()]).unwrap()
}

proptest! {
    /// At any speed the arm comes to rest before the ball, with the braking clearance left and little more, up to one
    /// reading.
    #[test]
    fn it_comes_to_rest_with_the_reserve_left(
        speed in 0.1..3.0_f64, gain in 2.0..20.0_f64, brakes in 3.0..30.0_f64, latency in 0.0..0.08_f64, ms in 4.0..20.0_f64,
    ) {
        let plant = Plant { from: -2.9, speed, gain: gain.min(brakes), brakes, latency, period: ms * 1e-3 };
        let (rests, foreseen) = plant.drive(&mut looks(&plant.rules(brakes)), &scene(), &mut 0);
        prop_assert!(foreseen);
        prop_assert!(left(rests) > 0.4 * RESERVE, "{plant:?}: {} mm left", left(rests) * 1e3);
        // for a few readings, a motor that has just stopped accelerating is predicted to go on accelerating
        let braking = speed * speed / (2.0 * brakes);
        let more = 2.0 * RESERVE + LENGTH * (speed * 2.0 * plant.period + 0.1 * braking);
        let on = left(rests + more / LENGTH);
        prop_assert!(on < RESERVE, "{plant:?} stops too early: {} mm are left {more} m farther on", on * 1e3);
    }
}

/// Its board states twice its actual deceleration. The first stop may be too late; it is measured for the second.
#[test]
fn how_it_brakes_is_measured() {
    let plant = Plant { from: -2.5, speed: 2.0, gain: 4.0, brakes: 6.0, latency: 0.02, period: 0.01 };
    let rules = plant.rules(12.0);
    let (ahead, clock) = (&mut looks(&rules), &mut 0);
    let stops: Vec<f64> = (0..3).map(|_| left(plant.drive(ahead, &scene(), clock).0)).collect();
    assert!(stops[0] < 0.0, "the board's word: {stops:?}");
    assert!(stops[1] > 0.4 * RESERVE && stops[2] > 0.4 * RESERVE, "as it was measured: {stops:?}");
}

/// A robot within the clearance may move out, at any speed.
#[test]
fn nothing_is_trapped() {
    let plant = Plant { from: -2.5, speed: 2.0, gain: 4.0, brakes: 6.0, latency: 0.02, period: 0.01 };
    let (rules, scene) = (plant.rules(6.0), scene());
    let mut ahead = looks(&rules);
    let inside = (0..1000).map(|k| -1e-3 * f64::from(k)).find(|q| left(*q) > 0.003).unwrap();
    for k in 0..200_u64 {
        let t = 0.01 * k as f64;
        let pose: Pose = vec![inside - (t * t).min(2.0 * t).min(2.0)].into();
        let sample =
            Sample { seq: k, at: Time(k * 10_000_000), q: pose.clone(), done: vec![false], ..Sample::default() };
        let met = ahead.read(0, &sample, std::slice::from_ref(&pose), &near(&scene, pose[0]), true);
        assert_eq!(met, [], "at {}", pose[0]);
    }
}

/// A ball that appears between the robot and its ghost is detected at the next reading, and one beyond it is not.
#[test]
fn an_object_put_in_its_way_is_detected_at_once() {
    let plant = Plant { from: -1.2, speed: 2.0, gain: 4.0, brakes: 6.0, latency: 0.02, period: 0.01 };
    let foreseen_counts = |angle: f64| {
        let far = scene().edit(&Edit::Remove { name: "ball".into() }).unwrap();
        let mut ahead = looks(&plant.rules(6.0));
        ahead.set_scene(&Arc::new(far.clone()));
        (0..61_u64)
            .map(|k| {
                // at 0.6 s it is at -0.7, and would come to rest about 0.4 farther on
                let pose: Pose = vec![plant.at(0.01 * k as f64, f64::INFINITY)].into();
                if k == 60 {
                    ahead.set_scene(&Arc::new(far.edit(&Edit::Add(ball(angle))).unwrap()));
                }
                let sample = Sample {
                    seq: k,
                    at: Time(k * 10_000_000),
                    q: pose.clone(),
                    done: vec![false],
                    ..Sample::default()
                };
                ahead.read(0, &sample, &[pose], &[], true).len()
            })
            .collect::<Vec<usize>>()
    };
    let (between, beyond) = (foreseen_counts(-0.45), foreseen_counts(0.3));
    assert_eq!((between.iter().sum::<usize>(), between.last()), (1, Some(&1)));
    assert_eq!(beyond.iter().sum::<usize>(), 0);
}

#[test]
fn without_a_braking_clearance_there_is_no_look_ahead() {
    let rules = Plant { from: 0.0, speed: 1.0, gain: 1.0, brakes: 1.0, latency: 0.0, period: 0.01 }.rules(1.0);
    let none = Rules { reserve: None, ..(*rules).clone() };
    assert!(LookAhead::new(&scene(), [Arc::new(none)]).is_none());
}

/// Two arms rotate towards each other: the remaining gap if both are stopped at the first foreseen contact, meters.
/// `second`: the speed of the second arm, rad/s.
fn gap_left(second: f64) -> f64 {
    let text = ARM.replace("HOME", "0");
    let arm = |name: &str, y: f64| {
        let robot = parse_robot("arm.xml", &text.replace("NAME", name)).unwrap().value;
        (Arc::new(robot), Isometry3::translation(0.0, y, 0.0))
    };
    let scene = Arc::new(Scene::new(vec![arm("left", 0.0), arm("right", 0.3)], vec![]).unwrap());
    let plant = Plant { from: 0.0, speed: 0.4, gain: 4.0, brakes: 20.0, latency: 0.004, period: 0.002 };
    let mut ahead = LookAhead::new(&scene, [plant.rules(20.0), plant.rules(20.0)]).unwrap();
    for k in 0..2000_u64 {
        let t = 0.002 * k as f64;
        let at = |on: f64| -> [Pose; 2] {
            let stop = |speed: f64| speed * (0.1 + t) + on * speed * (0.004 + speed / 40.0);
            [vec![stop(0.4)].into(), vec![-stop(second)].into()]
        };
        let poses = at(0.0);
        let near = scene.contacts(&poses, 0.02);
        let warned = [0, 1].map(|robot| {
            let sample = Sample {
                seq: k,
                at: Time(k * 2_000_000),
                q: poses[robot].clone(),
                done: vec![false],
                ..Sample::default()
            };
            !ahead.read(robot, &sample, &poses, &near, true).is_empty()
        });
        if warned[0] {
            return scene.contacts(&at(1.0), 0.02).iter().map(|c| c.distance).fold(f64::INFINITY, f64::min);
        }
    }
    unreachable!()
}

#[test]
fn two_robots_that_move_leave_the_reserves_of_both_and_one_that_rests_adds_none() {
    let (both, one) = (gap_left(0.4), gap_left(0.0));
    // a period, and stops may be slower than stated
    let more = 0.5 * RESERVE;
    assert!(one > RESERVE - 0.001 && one < RESERVE + more, "the other rests: {one}");
    assert!(both > 2.0 * RESERVE - 0.001 && both < 2.0 * RESERVE + 2.0 * more, "both move: {both}");
}
