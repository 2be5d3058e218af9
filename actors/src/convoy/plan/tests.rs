//! One leg of a plan, and when two of them meet.

use super::*;
use crate::convoy::tests::{recorded, rules, scene};

/// A robot that rested at the first of these angles (radians), moved, and rests at the second; its way ends at the first rest.
fn farther(then: f64, safe: f64, place: Option<f64>) -> Leg {
    let (a, b) = (then.to_degrees(), safe.to_degrees());
    let who = recorded(0, true, &[(0.0, a), (1.0, a), (2.0, b), (3.0, b)], 2.5);
    let who = Traveller { named: [].into(), places: vec![place].into(), ..who };
    Leg { end: 50, rested: Time::ZERO, blocked: false, who }
}

/// A motor that the motion did not name goes along only if it was sent elsewhere since then.
#[test]
fn who_goes_farther_takes_along_what_was_sent_since_then() {
    let tolerance = rules(true).tolerance;
    for (then, safe, along) in
        [(0.2, 0.2 + 0.4 * tolerance, false), (0.2, 0.2 + 0.6 * tolerance, true), (0.2, -0.2, true)]
    {
        let motors = farther(then, safe, Some(safe)).motors();
        assert_eq!(motors.to_vec(), vec![0; usize::from(along)], "from {then} to {safe}");
    }
    assert!(farther(0.2, -0.2, None).motors().is_empty(), "nobody knows where that was sent");
}

/// Between two readings, as much of the way as of the time.
#[test]
fn between_two_readings_a_robot_moved_evenly() {
    let leg = farther(0.0, 0.5, Some(0.0));
    for (ms, q) in [(1250, 0.125), (1252, 0.126), (1509, 0.2545)] {
        let (pose, moved) = leg.at(Time(ms * 1_000_000));
        assert!((pose[0] - q).abs() < 1e-9 && moved, "{pose:?} at {ms} ms, not {q}");
    }
    let before_its_end = leg.at(Time(400_000_000));
    assert_eq!(before_its_end, (vec![0.0].into(), false));
}

/// A contact that would be told as released only at this distance is one already.
#[test]
fn two_meet_until_they_are_released() {
    let margin = rules(true).margin;
    // the angle (degrees) from which on one stays clear of whatever the other does, for a contact at this distance
    let clear = |margin: f64| {
        let mut watch = Watch::new(scene(), margin);
        let mut meets = |b: f64| {
            let poses = |a: i32| [f64::from(a) * 0.1, b].map(|q| vec![q.to_radians()]);
            (-900..=900).any(|a| !watch.update(&poses(a)).is_empty())
        };
        let halve = |(low, high): (f64, f64), _| {
            let middle = 0.5 * (low + high);
            if meets(middle) { (middle, high) } else { (low, middle) }
        };
        (0..14).fold((0.0, 90.0), halve).1
    };
    let (near, far) = (clear(margin - RELEASE), clear(margin + RELEASE));
    assert!(near < far, "{near} {far}");
    let meet = |b: f64| {
        let other = recorded(1, true, &[(0.0, b), (3.0, b)], 0.0);
        let mut plan = Plan::new(vec![recorded(0, true, &[(0.0, -90.0), (3.0, 90.0)], 0.0), other]).unwrap();
        (0..300).any(|k| plan.meet(Time(k * 10_000_000)).is_some())
    };
    assert!(meet(near) && !meet(far + 0.1), "{near} {far}");
}

/// Checking goes on in slices, each of no more than so many poses, and comes to the same end.
#[test]
fn a_plan_is_checked_in_slices() {
    let travellers = || {
        let (there, back) = ([(0.0, -90.0), (3.0, 90.0)], [(0.0, 90.0), (1.0, 90.0), (2.0, 70.0), (3.0, 70.0)]);
        vec![recorded(0, true, &there, 0.0), recorded(1, true, &back, 2.5)]
    };
    let mut whole = Plan::new(travellers()).unwrap();
    assert!(whole.check(1000));
    let mut plan = Plan::new(travellers()).unwrap();
    let slices = (1..100).find(|_| plan.check(10));
    // what was while both moved, or one passed the other at rest, is not checked: it begins where the other came to rest, at 2.1 s
    assert!(slices.is_some_and(|n| (20..=22).contains(&n)), "{slices:?}");
    assert_eq!(plan.ways(), whole.ways());
}

/// The nearest pose between two readings is that of the line through all motors.
#[test]
fn a_pose_is_passed_on_the_line_between_two_readings() {
    let past = recorded(0, true, &[(0.0, 0.0), (1.0, 0.0)], 0.0).past;
    let at = |k: usize, q: [f64; 2]| {
        let mut at = past[k].clone();
        at.q = q.to_vec().into();
        at
    };
    let (a, b) = (at(10, [0.5, 1.0]), at(11, [1.5, 1.0]));
    for (pose, q, ms) in [([0.75, 3.0], 0.75, 102.5), ([0.0, 1.0], 0.5, 100.0), ([2.0, 0.5], 1.5, 110.0)] {
        let passed = passing(&a, &b, &pose);
        assert!((passed.q[0] - q).abs() < 1e-12 && passed.q[1] == 1.0, "{passed:?}");
        assert!((passed.at.secs() * 1e3 - ms).abs() < 1e-6, "{passed:?}");
    }
    let still = passing(&a, &at(11, [0.5, 1.0]), &[0.0, 0.0]);
    assert_eq!((still.q, still.at), (a.q, a.at));
}
