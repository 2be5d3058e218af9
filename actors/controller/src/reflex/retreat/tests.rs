//! Set-points of a retreat, its waits, and a robot that is delayed on it.

use super::*;
use crate::joint_retreat::RetreatReply;
use crate::joint_retreat::tests::{PERIOD, recorded, rules};
use std::sync::Arc;

/// A path of 90 degrees at 30 deg/s, backwards.
fn retreat(rules: &Arc<Rules>) -> (JointRetreat, Retreat) {
    let (joint_retreat, now) = (JointRetreat::default(), Time::from_secs(5.0));
    joint_retreat.enroll(recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (4.0, 90.0), (5.0, 90.0)], 0.5), now);
    let RetreatReply::Go(path) = joint_retreat.request(0, now) else { panic!("there is a way") };
    (joint_retreat, Retreat::new(0, path, rules, now))
}

/// Greatest distance between set-point and robot, degrees, until it is back, and the longest wait for it; the robot
/// does not move between these times, s.
fn apart(stands: (f64, f64)) -> (f64, f64) {
    let rules = rules(true);
    let (joint_retreat, mut retreat) = retreat(&rules);
    let (mut now, mut q, mut apart, mut waited) = (Time::from_secs(5.0), 90_f64.to_radians(), 0.0_f64, 0.0_f64);
    for seq in 0..1000 {
        now = now + PERIOD;
        let held = (stands.0..stands.1).contains(&now.secs());
        let sample = Sample { seq, at: now, q: vec![q].into(), done: vec![false], ..Sample::default() };
        let Ok(command) = retreat.step(&joint_retreat, &sample, now, &rules) else { panic!("nobody was lost") };
        if let Some(Command::Direct { q: to, .. }) = command {
            apart = apart.max((to[0] - q).abs().to_degrees());
            q = if held { q } else { to[0] };
        }
        waited = waited.max(retreat.lag_time(now).as_secs_f64());
        if retreat.is_over() {
            assert!(q.abs() < 1e-9, "it is back");
            return (apart, waited);
        }
    }
    (apart, waited)
}

#[test]
fn a_robot_that_is_held_up_is_waited_for_and_never_gone_after_straight() {
    assert!(apart((0.0, 0.0)).0 < 0.5);
    let (far, waited) = apart((6.0, 7.0));
    assert!(far < 2.5, "it was sent {far:.1} degrees in one step");
    assert!((0.8..1.0).contains(&waited), "it was waited for {waited} s");
    let (far, waited) = apart((6.0, 100.0));
    assert!(far < 2.5 && waited > 5.0, "{far:.1} degrees, {waited} s");
}

/// A path of one motor through these points: seconds, degrees.
fn path(direct: bool, points: &[(f64, f64)]) -> (JointRetreat, Retreat, Arc<Rules>) {
    let rules = rules(direct);
    let (joint_retreat, now) = (JointRetreat::default(), Time::from_secs(5.0));
    joint_retreat.enroll(recorded(0, direct, &[(0.0, 0.0), (1.0, 0.0), (4.0, 90.0), (5.0, 90.0)], 0.5), now);
    let RetreatReply::Go(asked) = joint_retreat.request(0, now) else { panic!("there is a way") };
    let points = points.iter().map(|(t, deg)| (*t, vec![deg.to_radians()].into())).collect();
    let retreat = Retreat::new(0, RetreatPath { points, ..asked }, &rules, now);
    (joint_retreat, retreat, rules)
}

/// Command at a reading at this time on the path, for a motor at this angle (degrees): position, degrees, and speed,
/// degrees per second.
fn written(back: &mut (JointRetreat, Retreat, Arc<Rules>), reading: (f64, f64, bool)) -> Option<(f64, Option<f64>)> {
    written_late(back, reading, Duration::ZERO)
}

/// The same for a delayed reading.
fn written_late(
    (joint_retreat, retreat, rules): &mut (JointRetreat, Retreat, Arc<Rules>),
    (secs, deg, done): (f64, f64, bool),
    late: Duration,
) -> Option<(f64, Option<f64>)> {
    let at = Time::from_secs(5.0) + rules.reaction() + Duration::from_secs_f64(secs);
    let sample =
        Sample { seq: 1, at: at - late, q: vec![deg.to_radians()].into(), done: vec![done], ..Sample::default() };
    let round = |rad: f64| (rad.to_degrees() * 1e6).round() / 1e6;
    match retreat.step(joint_retreat, &sample, at, rules).unwrap_or_else(|_| panic!("nobody was lost")) {
        Some(Command::Direct { q, .. }) => Some((round(q[0]), None)),
        Some(Command::Move(m)) => Some((round(m.q[0]), m.speed.map(|v| round(v[0])))),
        None => None,
        other => panic!("{other:?}"),
    }
}

#[test]
fn set_points_are_those_of_the_clock() {
    let mut back = path(true, &[(0.0, 90.0), (0.02, 89.0), (0.06, 88.6), (0.07, 87.6)]);
    assert_eq!((back.1.length(), back.1.is_over()), ((4, 0.07), false));
    assert_eq!(back.1.written(), [90_f64.to_radians()]);
    assert_eq!(back.1.begin(), Command::Mode { motors: vec![0], mode: ControlMode::PositionDirect });
    assert_eq!(written(&mut back, (0.007, 90.0, false)), None, "not three quarters of a period");
    assert_eq!(written(&mut back, (0.008, 90.0, false)), Some((89.6, None)));
    assert_eq!(written(&mut back, (0.018, 89.9, false)), Some((89.1, None)));
    assert_eq!(written(&mut back, (0.018, 89.9, false)), None);
    assert_eq!(written(&mut back, (0.030, 89.5, false)), Some((88.9, None)));
    assert_eq!(written(&mut back, (0.050, 89.2, false)), Some((88.75, None)), "late: a period and a half, and no more");
    assert!(!back.1.is_over());
    assert_eq!(written(&mut back, (0.065, 88.9, false)), Some((88.6, None)));
    assert_eq!(written(&mut back, (0.080, 88.7, false)), Some((87.6, None)));
    assert!(back.1.is_over());
    assert_eq!(written(&mut back, (0.090, 88.0, false)), None);
    let now = Time::from_secs(9.0);
    assert_eq!(back.1.arrival(now), now, "a set-point is followed at once");
}

/// A robot that looks ahead halts on its path, over its braking distance, instead of braking beyond its last
/// set-point and returning to it. Under Algorithm 6 nothing more is written.
#[test]
fn a_halt_is_on_the_path() {
    let halt = |reserve: Option<f64>| {
        let rules = Arc::new(Rules { reserve, ..(*rules(true)).clone() });
        let (joint_retreat, mut retreat) = retreat(&rules);
        let (mut now, mut q, mut sent) = (Time::from_secs(5.0), 90_f64.to_radians(), Vec::new());
        for seq in 0..300 {
            now = now + PERIOD;
            let sample = Sample { seq, at: now, q: vec![q].into(), done: vec![false], ..Sample::default() };
            let done = match seq < 200 {
                true => retreat.step(&joint_retreat, &sample, now, &rules),
                false => retreat.halt(&joint_retreat, &sample, now, &rules),
            };
            let Ok(command) = done else { panic!("nobody was lost") };
            if let Some(Command::Direct { q: to, .. }) = command {
                q = to[0];
                if seq >= 199 {
                    sent.push((seq, q.to_degrees()));
                }
            }
        }
        sent
    };
    let (first, last) = (halt(Some(0.005)), halt(None));
    assert_eq!(last.len(), 1, "Algorithm 6: {last:?}");
    let path = first[0].1 - first.last().unwrap().1;
    // v^2 / 2a at 30 deg/s and nine tenths of 30 rad/s^2, in steps of a period
    let brakes = 30.0 * 30.0 / (2.0 * 0.9 * 30_f64.to_degrees());
    assert!((0.4 * brakes..1.1 * brakes + 0.01).contains(&path), "{path} degrees for {brakes}");
    assert!(first.windows(2).all(|w| w[1].1 <= w[0].1), "backwards: {first:?}");
    assert!(first.last().unwrap().0 < 210, "it goes on: {first:?}");
}

/// A motor follows while it is within a degree of its latest set-points: neither behind them nor ahead.
#[test]
fn the_clock_waits_for_a_robot_that_does_not_follow() {
    // it rests for 0.2 s, and then moves at 20 deg/s
    let sent_late = |off: f64, late: f64| {
        let points: Vec<(f64, f64)> =
            (0..=120).map(|k| 0.01 * f64::from(k)).map(|t| (t, 90.0 - 20.0 * (t - 0.2).clamp(0.0, 0.5))).collect();
        let mut back = path(true, &points);
        let lag = back.2.reaction().as_secs_f64();
        let here = |t: f64| 90.0 - 20.0 * (t - 0.2 - lag).clamp(0.0, 0.5);
        let mut last = 90.0;
        for k in 1..=40 {
            let t = 0.01 * f64::from(k);
            let from = if k < 30 { 0.0 } else { off };
            let reading = (t, here(t - late) + from, false);
            last = written_late(&mut back, reading, Duration::from_secs_f64(late)).map_or(last, |(q, _)| q);
        }
        last
    };
    let sent = |off: f64| sent_late(off, 0.0);
    assert_eq!(sent(0.0), 86.0);
    assert_eq!([sent(0.9), sent(-0.9)], [86.0; 2]);
    assert_eq!(sent_late(0.0, 0.1), 86.0, "a tenth of a second ago it was two degrees behind, and rightly so");
    assert!(sent(1.5) > 86.3, "behind: {}", sent(1.5));
    assert!(sent(-3.5) > 86.3, "far ahead: {}", sent(-3.5));
}

/// The last set-point is repeated for a robot that rests beside it: not within the tolerance, nor farther off than a
/// degree, and not more often than its effect can show. A board that moves by itself needs no repetition.
#[test]
fn the_last_set_point_is_repeated_for_a_robot_beside_it() {
    let tolerance = rules(true).tolerance;
    // the safe pose is this far beside the last set-point: its motor had been sent there, and rested beside it
    let beside = |direct: bool, off: f64, early: u64, safe: f64| {
        let (_, mut retreat, rules) = path(direct, &[(0.0, 90.0), (1.0, 60.0)]);
        retreat.path.end.q = vec![90_f64.to_radians() + safe].into();
        let now = Time::from_secs(5.0) + rules.reaction() * 2 - Duration::from_nanos(early);
        let sample = Sample {
            seq: 1,
            at: now,
            q: vec![90_f64.to_radians() + off].into(),
            done: vec![true],
            ..Sample::default()
        };
        let mut repeated = |now: Time| match retreat.resend(&sample, now, &rules) {
            Some(Command::Direct { motors, q }) => motors == [0] && q == [90_f64.to_radians()],
            None => false,
            other => panic!("{other:?}"),
        };
        (repeated(now), repeated(now + rules.reaction() - Duration::from_nanos(1)), repeated(now + rules.reaction()))
    };
    let again = |direct: bool, off: f64, early: u64| beside(direct, off, early, 0.0);
    for off in [1.1 * tolerance, -1.1 * tolerance, 0.99 * FROZEN_TRAVEL, -0.99 * FROZEN_TRAVEL] {
        assert_eq!(again(true, off, 0), (true, false, true), "{off} rad off");
        assert!(!again(true, off, 1).0, "too soon");
        assert_eq!(again(false, off, 0), (false, false, false), "it moves by itself");
    }
    for off in [0.0, 0.9 * tolerance, -0.9 * tolerance, 1.01 * FROZEN_TRAVEL, -1.01 * FROZEN_TRAVEL] {
        assert_eq!(again(true, off, 0), (false, false, false), "{off} rad off");
    }
    let (off, safe) = (0.9 * tolerance, -0.2 * tolerance);
    assert_eq!(beside(true, off, 0, safe), (true, false, true), "where it was sent, and not at the safe pose");
}

/// The next way-point is commanded once the previous one was reached: the board reports "done", and the motor is
/// there; the speed is the recorded one.
#[test]
fn way_points_are_left_when_they_are_reached() {
    let mut back = path(false, &[(0.0, 90.0), (1.0, 60.0), (3.0, 60.0), (3.4, 50.0)]);
    let tolerance = back.2.tolerance.to_degrees();
    assert_eq!(back.1.begin(), Command::Mode { motors: vec![0], mode: ControlMode::Position });
    let reaction = back.2.reaction().as_secs_f64();
    assert_eq!(written(&mut back, (reaction - 0.001, 90.0, true)), None, "the mode is not set yet");
    assert_eq!(written(&mut back, (reaction, 90.0, false)), None, "it is not done");
    assert_eq!(written(&mut back, (reaction, 90.0 - 3.1 * tolerance, true)), None, "it is not there");
    let near = 90.0 - 2.9 * tolerance;
    let (to, speed) = written(&mut back, (reaction, near, true)).unwrap();
    assert_eq!(to, 60.0);
    assert!((speed.unwrap() - (near - 60.0)).abs() < 1e-3, "in a second: {speed:?}");
    assert_eq!(written(&mut back, (2.0 * reaction - 0.001, 60.0, true)), None, "the board can't have heard of it");
    let (to, speed) = written(&mut back, (2.0 * reaction, 60.0, true)).unwrap();
    let slowest = (0.01 * 3_f64).to_degrees();
    assert!(to == 60.0 && (speed.unwrap() - slowest).abs() < 1e-3, "a rest is a slow move: {speed:?}");
    assert_eq!(written(&mut back, (3.0 * reaction, 60.0, true)).unwrap(), (50.0, Some(25.0)));
    assert!(back.1.is_over());
    assert_eq!(written(&mut back, (4.0 * reaction, 50.0, true)), None);
    let now = Time::from_secs(20.0);
    assert!(back.1.arrival(now).since(now).abs_diff(Duration::from_millis(400)) < Duration::from_micros(1));
}
