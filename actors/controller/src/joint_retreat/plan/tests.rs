//! A leg of a plan, the collisions of two legs, their ends, and the path of a robot that retreats alone.

use super::*;
use crate::joint_retreat::CHECKS_PER_REQUEST;
use crate::joint_retreat::tests::{A, B, recorded, rules, scene};
use crate::look_ahead::tests::ball;
use mobee_model::{Robot, Watch};
use nalgebra::Isometry3;
use std::time::Duration;

/// A robot that rested at the first of these angles (radians), moved, and rests at the second; its path ends at the
/// first rest.
fn farther(then: f64, safe: f64, place: Option<f64>) -> RetreatLeg {
    let (a, b) = (then.to_degrees(), safe.to_degrees());
    let participant = recorded(0, true, &[(0.0, a), (1.0, a), (2.0, b), (3.0, b)], 2.5);
    let participant = Participant { named: [].into(), places: vec![place].into(), ..participant };
    RetreatLeg { end: 50, rested: Time::ZERO, blocked: false, end_unchecked: false, participant }
}

/// A motor that the motion did not name is included only if it was sent elsewhere since then.
#[test]
fn a_farther_retreat_includes_the_motors_sent_since_then() {
    let tolerance = rules(true).tolerance;
    for (then, safe, along) in
        [(0.2, 0.2 + 0.4 * tolerance, false), (0.2, 0.2 + 0.6 * tolerance, true), (0.2, -0.2, true)]
    {
        let motors = farther(then, safe, Some(safe)).motors();
        assert_eq!(motors.to_vec(), vec![0; usize::from(along)], "from {then} to {safe}");
    }
    let mut half = farther(0.0, 0.2, Some(0.2));
    half.participant.safe = vec![0.5 * tolerance].into();
    assert!(half.motors().is_empty(), "half of the tolerance is where it counts as being");
    assert!(farther(0.2, -0.2, None).motors().is_empty(), "nobody knows where that was sent");
}

/// Between two readings, the share of the distance equals the share of the time.
#[test]
fn between_two_readings_a_robot_moved_evenly() {
    let leg = farther(0.0, 0.5, Some(0.0));
    for (ms, q) in [(1250, 0.125), (1252, 0.126), (1509, 0.2545)] {
        let (pose, moved) = leg.at(Time(ms * 1_000_000));
        assert!((pose[0] - q).abs() < 1e-9 && moved, "{pose:?} at {ms} ms, not {q}");
    }
    // a robot that stops in mid-motion was moving there
    let mut stopped = leg.clone();
    stopped.stop_at(Time(1_500_000_000));
    assert_eq!(stopped.at(Time(1_500_000_000)), (vec![0.25].into(), true));
    let before_its_end = leg.at(Time(400_000_000));
    assert_eq!(before_its_end, (vec![0.0].into(), false));
}

/// A distance at which a contact would just end still counts as a contact.
#[test]
fn two_meet_until_they_are_released() {
    let margin = rules(true).margin;
    // the angle (degrees) from which on one robot stays clear of any motion of the other, for a contact at this
    // distance
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
    let colliding = |b: f64| {
        let other = recorded(1, true, &[(0.0, b), (3.0, b)], 0.0);
        let mut plan =
            JointRetreatPlan::new(vec![recorded(0, true, &[(0.0, -90.0), (3.0, 90.0)], 0.0), other]).unwrap();
        (0..300).any(|k| !plan.colliding(Time(k * 10_000_000)).is_empty())
    };
    assert!(colliding(near) && !colliding(far + 0.1), "{near} {far}");
}

/// A robot just above the rest speed does not rest: a plan uses the same threshold as all other components.
#[test]
fn a_rest_is_slower_than_the_speed_of_rest() {
    let mut leg = farther(0.0, 0.5, None);
    let most = leg.participant.rules.rest_speed;
    let rests = [0.99 * most, most, 1.01 * most].map(|speed| {
        leg.participant.past[20].speed = speed;
        leg.rests(20)
    });
    assert_eq!(rests, [true, false, false]);
}

/// The same two arms, and a distant one that comes first.
fn three() -> Arc<Scene> {
    let scene = scene();
    let mut arms: Vec<_> = (0..2).map(|robot| (scene.robots()[robot].clone(), scene.base(robot))).collect();
    let mut far = arms[0].clone();
    far.0 = Arc::new(Robot { name: "far".into(), ..(*far.0).clone() });
    far.1.translation.vector.x += 50.0;
    arms.insert(0, far);
    Arc::new(Scene::new(arms, Vec::new()).unwrap())
}

/// Of three robots the two that come close to each other collide, regardless of the third.
#[test]
fn two_of_three_meet() {
    let of = |robot, turns: &[(f64, f64)]| Participant { scene: three(), ..recorded(robot, true, turns, 0.0) };
    let turns = [(0.0, -90.0), (3.0, 90.0)];
    let still = [(0.0, 0.0), (3.0, 0.0)];
    let mut plan = JointRetreatPlan::new(vec![of(0, &turns), of(1, &still), of(2, &turns)]).unwrap();
    let met: std::collections::BTreeSet<_> = (0..300).flat_map(|k| plan.colliding(Time(k * 10_000_000))).collect();
    assert_eq!(met.into_iter().collect::<Vec<_>>(), [(1, 2)]);
}

/// Two robots that touched as they came to rest do so again, and rest as they did: that is no reason to stop either.
#[test]
fn recorded_encounters_block_no_robot() {
    let of = |robot, turns: &[(f64, f64)], safe| Participant { scene: three(), ..recorded(robot, true, turns, safe) };
    let ([left, right], first) = ([[(0.0, 90.0), (3.0, 0.0), (5.0, 0.0)]; 2], [(0.0, 0.0), (1.0, 0.0), (5.0, 90.0)]);
    let mut plan = JointRetreatPlan::new(vec![of(0, &first, 0.5), of(1, &left, 4.0), of(2, &right, 4.0)]).unwrap();
    assert!(!plan.colliding(Time(2_000_000_000)).is_empty(), "where both end they touch");
    while !plan.check(CHECKS_PER_REQUEST) {}
    let paths = plan.paths();
    assert!(paths.iter().all(|path| !path.blocked && !path.farther));
}

/// Two robots that touch on the retreat as they did on the way there don't retreat farther, whichever ended before.
#[test]
fn a_recorded_encounter_needs_no_change_when_a_third_robot_is_back() {
    let of = |robot, turns: &[(f64, f64)], safe| Participant { scene: three(), ..recorded(robot, true, turns, safe) };
    let touching = [(0.0, 95.0), (0.2, 95.0), (0.4, 90.0), (0.8, 90.0), (1.4, 0.0), (3.0, 0.0)];
    let third = [(0.0, -90.0), (2.0, 0.0), (2.3, 0.0), (3.0, 60.0)];
    let mut plan =
        JointRetreatPlan::new(vec![of(0, &third, 2.2), of(1, &touching, 0.6), of(2, &touching, 0.6)]).unwrap();
    while !plan.check(CHECKS_PER_REQUEST) {}
    let paths = plan.paths();
    assert!(paths.iter().all(|path| !path.blocked && !path.farther));
}

/// A path that is stopped in mid-motion has its last configuration once.
#[test]
fn a_way_goes_on_with_each_of_its_points() {
    let mut plan =
        JointRetreatPlan::new(vec![recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (2.0, 30.0), (2.5, 30.0)], 0.5)])
            .unwrap();
    plan.legs[0].stop_at(Time(1_500_000_000));
    let path = plan.paths().remove(0);
    assert!(path.blocked && (path.points.last().unwrap().1[0].to_degrees() - 15.0).abs() < 1e-6);
    let tail = &path.points[path.points.len() - 10..];
    assert!(tail.windows(2).all(|w| w[0].0 < w[1].0 && w[0].1 != w[1].1), "{tail:?}");
}

/// The check goes on in slices of a limited number of configurations, with the same result.
#[test]
fn a_plan_is_checked_in_slices() {
    let participants = || {
        let (there, back) = ([(0.0, -90.0), (3.0, 90.0)], [(0.0, 90.0), (1.0, 90.0), (2.0, 70.0), (3.0, 70.0)]);
        vec![recorded(0, true, &there, 0.0), recorded(1, true, &back, 2.5)]
    };
    let mut whole = JointRetreatPlan::new(participants()).unwrap();
    assert!(whole.check(1000));
    let mut plan = JointRetreatPlan::new(participants()).unwrap();
    let slices = (1..100).find(|_| plan.check(10));
    // not checked: both moving as recorded, or one passing the other at rest; the check begins where the other came
    // to rest, at 2.1 s
    assert!(slices.is_some_and(|n| (20..=22).contains(&n)), "{slices:?}");
    assert_eq!(plan.paths(), whole.paths());
}

/// The nearest configuration between two readings is on the line through all motors.
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

/// A resting motor is sent to its commanded position again: the path ends there, unless it was recorded elsewhere. A
/// motor that the motion did not name is not on the path.
#[test]
fn a_way_ends_where_its_motors_had_been_sent() {
    let end = |place: Option<f64>, named: &[usize]| {
        let participant = Participant { places: vec![place].into(), named: named.into(), ..recorded(0, true, &A, 0.3) };
        let safe = participant.safe.clone();
        let path = alone(participant);
        assert_eq!(path.end.q, safe, "it is judged by what was recorded");
        (path.of(&path.points.last().unwrap().1), path.motors.to_vec(), safe[0])
    };
    let tolerance = rules(true).tolerance;
    let (q, motors, safe) = end(None, &[0]);
    assert_eq!((q, motors), (vec![safe], vec![0]));
    assert_eq!(end(Some(safe + 0.4 * tolerance), &[0]).0, [safe + 0.4 * tolerance]);
    assert_eq!(end(Some(safe + 0.6 * tolerance), &[0]).0, [safe], "it was moved by somebody else");
    assert_eq!(end(Some(safe), &[]), (vec![], vec![], safe));
}

/// The path of a robot that retreats alone.
fn alone(participant: Participant) -> RetreatPath {
    let mut plan = JointRetreatPlan::new(vec![participant]).unwrap();
    assert!(plan.check(CHECKS_PER_REQUEST));
    plan.paths().remove(0)
}

/// Between two recorded configurations of one robot, another one is interpolated: half of the distance at half of the
/// time.
#[test]
fn a_path_leads_through_the_configurations_recorded_then() {
    let path = alone(recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (2.0, 30.0), (2.5, 30.0)], 0.5));
    assert_eq!((path.direct, path.farther, path.blocked), (true, false, false));
    // speeds are estimated a few readings late: rest is left, and entered, a little later than it was
    assert!((path.end() - 1.0).abs() < 0.08, "rests are skipped: {} s", path.end());
    let there = |t: f64| {
        let next = path.points.iter().position(|(at, _)| *at >= t).unwrap();
        let ((t0, a), (t1, b)) = (&path.points[next - 1], &path.points[next]);
        (a[0] + (b[0] - a[0]) * (t - t0) / (t1 - t0)).to_degrees()
    };
    for t in [0.2, 0.5, 0.8] {
        let exact = 30.0 * (1.0 - t);
        assert!((there(t) - exact).abs() < 2.0, "{} after {t} s, not {exact}", there(t));
    }
    assert!(path.points.windows(2).all(|w| w[0].0 <= w[1].0 && w[0].1[0] >= w[1].1[0]));
    assert!((100..120).contains(&path.points.len()), "one point for each rest: {}", path.points.len());
}

/// A recording faster than a board may move is driven at the greatest speed: a jump takes the time that its motor
/// needs, at the slowest rate of a path.
#[test]
fn no_motor_is_commanded_beyond_its_limits() {
    let path = alone(recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (1.01, 60.0), (2.0, 60.0)], 0.5));
    let needs = 60_f64.to_radians() / (3.0 * 0.95);
    assert!(path.end() >= needs - 1e-9 && path.end() < 1.6 * needs + 0.1, "{} of {needs} s", path.end());
    assert!(path.points.windows(2).all(|w| (w[0].1[0] - w[1].1[0]).abs() <= 2.85 * (w[1].0 - w[0].0) + 1e-9));
}

/// Where the path begins or ends faster than motors can follow, it is slower; in between it has the recorded rate.
#[test]
fn no_motor_must_set_out_or_stop_at_once() {
    let path = alone(recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (2.0, 150.0), (3.0, 150.0)], 0.5));
    assert!((1.1..1.25).contains(&path.end()), "{} s", path.end());
    let speed = |w: &[(f64, Pose)]| ((w[0].1[0] - w[1].1[0]) / (w[1].0 - w[0].0)).to_degrees();
    let speeds: Vec<f64> = path.points.windows(2).map(speed).collect();
    let (first, middle) = (speeds[2], speeds[speeds.len() / 2]);
    assert!(first < 120.0 && (middle - 150.0).abs() < 1.0, "{first} and {middle} deg/s");
}

/// A board without position-direct gets only the corners of the path.
#[test]
fn way_points_are_the_corners() {
    let turns = [(0.0, 0.0), (1.0, 0.0), (2.0, 40.0), (3.0, 20.0), (4.0, 60.0), (5.0, 60.0)];
    let path = alone(recorded(0, false, &turns, 0.5));
    let q: Vec<f64> = path.points.iter().map(|(_, q)| q[0].to_degrees().round()).collect();
    assert_eq!((q.first(), q.last()), (Some(&60.0), Some(&0.0)));
    assert_eq!(path.end(), (q.len() - 1) as f64);
    assert!(q.len() <= 10, "few are left of 500: {q:?}");
    let turn = |deg: f64| q.iter().any(|q| (q - deg).abs() <= 1.0);
    assert!(turn(20.0) && turn(40.0), "{q:?}");
}

/// A retry leaves out the recording after the robot first was close to its present configuration.
#[test]
fn a_detour_is_cut_off() {
    let mut participant = recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (2.0, 30.0), (3.0, 60.0), (4.0, 30.0)], 0.5);
    let whole = participant.past.len();
    participant.without_detour();
    let end = participant.past.last().unwrap();
    assert!((end.q[0].to_degrees() - 30.0).abs() <= 2.0 * rules(true).tolerance.to_degrees() + 1e-9);
    assert!((198..=201).contains(&participant.past.len()), "{} of {whole}", participant.past.len());
    let mut short = recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (2.0, 30.0)], 0.5);
    let whole = short.past.len();
    short.without_detour();
    assert!(whole - short.past.len() <= 2, "nothing but the last readings, which are near each other");
    // it came at 150 deg/s, and rests half way between two readings
    let mut fast = recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (2.0, 150.0), (3.0, 74.25), (4.0, 74.25)], 0.5);
    fast.without_detour();
    let end = fast.past.last().unwrap();
    assert!((end.q[0].to_degrees() - 74.25).abs() < 0.3 && (end.at.secs() - 1.495).abs() < 0.003, "{end:?}");
    // it returned to its start: nothing is left of the path
    let mut back = recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (2.0, 30.0), (3.0, 0.0), (4.0, 0.0)], 0.5);
    back.without_detour();
    assert_eq!(back.past.len(), back.start + 1);
    for kept in [&participant.past, &short.past, &fast.past] {
        let steps: Vec<Duration> = kept.windows(2).map(|w| w[1].at.since(w[0].at)).collect();
        assert!(
            steps.iter().all(|step| (1..=10_000_000).contains(&step.as_nanos())),
            "nothing twice, and nothing left out"
        );
    }
}

/// The ends of both, degrees; whether these are beyond their safe poses; and whether they are blocked on the path.
fn ends(a: &[(f64, f64)], b: &[(f64, f64)], safe: [f64; 2]) -> [(f64, bool, bool); 2] {
    let participants = vec![recorded(0, true, a, safe[0]), recorded(1, true, b, safe[1])];
    let mut plan = JointRetreatPlan::new(participants).unwrap();
    while !plan.check(CHECKS_PER_REQUEST) {}
    let paths = plan.paths();
    assert_eq!(paths[0].end(), paths[1].end());
    [0, 1].map(|i| (paths[i].end.q[0].to_degrees().round(), paths[i].farther, paths[i].blocked))
}

#[test]
fn each_ends_at_its_safe_pose_if_the_others_passed_it_there() {
    // both set out at 4 s; or one earlier, but past the resting position of the other
    assert_eq!(ends(&A, &B, [4.0, 4.0]), [(90.0, false, false), (10.0, false, false)]);
    assert_eq!(ends(&A, &B, [3.0, 4.0]), [(90.0, false, false), (10.0, false, false)]);
    // one rested there all the time that the other was moving
    let still = [(0.0, 30.0), (4.0, 30.0), (5.0, 42.0)];
    assert_eq!(ends(&[(0.0, -90.0), (0.5, -90.0), (5.0, -20.0)], &still, [0.3, 4.0])[1], (30.0, false, false));
}

#[test]
fn a_blocking_robot_retreats_to_its_previous_rest() {
    // the older one passed the place where the younger one rests now before the younger one came there
    assert_eq!(ends(&A, &B, [0.3, 4.0]), [(-90.0, false, false), (90.0, true, false)]);
}

#[test]
fn a_robot_that_cannot_pass_stops_where_the_common_past_ends() {
    let short: Vec<(f64, f64)> = B.iter().filter(|(t, _)| *t >= 3.0).copied().collect();
    assert_eq!(ends(&A, &short, [0.3, 4.0]), [(90.0, false, true), (10.0, false, false)]);
}

#[test]
fn dwells_of_all_are_skipped_and_no_motor_is_hurried() {
    let mut plan = JointRetreatPlan::new(vec![recorded(0, true, &A, 0.3), recorded(1, true, &B, 4.0)]).unwrap();
    while !plan.check(CHECKS_PER_REQUEST) {}
    let paths = plan.paths();
    // both rest from 3 s to 4 s; speeds are estimated a few readings late
    assert!((paths[0].end() - 3.5).abs() < 0.2, "{} s", paths[0].end());
    for pair in paths.iter().flat_map(|w| w.points.windows(2)) {
        assert!((pair[0].1[0] - pair[1].1[0]).abs() <= 3.0 * (pair[1].0 - pair[0].0) + 1e-9, "{pair:?}");
    }
}

/// A stream that led into another robot is undone to a configuration without contact, and no farther than necessary.
#[test]
fn a_stream_ends_where_nothing_touches() {
    let turns = [(0.0, 90.0), (3.0, 0.0)];
    let end = |undo: usize, other: f64| {
        let participant = recorded(0, true, &turns, 0.0);
        let last = participant.past.len() - 1;
        let poses = vec![participant.past[last].q.clone(), vec![other.to_radians()].into()];
        let mut plan =
            JointRetreatPlan::new(vec![Participant { end: last - undo, poses, ..participant.clone() }]).unwrap();
        while !plan.check(32) {}
        let path = plan.paths().remove(0);
        assert!(!path.farther && !path.blocked);
        (participant, path.end)
    };
    let near = |q: &Pose, other: f64| {
        let poses = [q.clone(), vec![other.to_radians()].into()];
        !scene().contacts(&poses, rules(true).margin + RELEASE).is_empty()
    };
    let (participant, away) = end(0, 90.0);
    assert_eq!(away, SafePose { since: participant.past[300].at, q: participant.past[300].q.clone() });
    let (participant, met) = end(0, 0.0);
    let at = participant.past.iter().position(|r| r.at == met.since).unwrap();
    assert!(at < 300 && !near(&met.q, 0.0) && near(&participant.past[at + 1].q, 0.0), "{met:?}");
    // if it is free there already, the path ends there
    let (participant, met) = end(300 - at + 20, 0.0);
    assert_eq!(met.since, participant.past[at - 20].at);
}

/// A robot that was alone, came to 30 degrees within a second, and was held there for this time while an obstacle
/// bent and shook it.
fn held(secs: f64, swings: f64) -> Participant {
    let mut turns = vec![(0.0, 0.0), (1.0, 0.0), (2.0, 30.0)];
    let swing = |k: u32| (2.0 + 0.1 * f64::from(k), 30.0 + if k.is_multiple_of(2) { swings } else { -swings });
    turns.extend((1..=(secs * 10.0) as u32).map(swing));
    let scene = Arc::new(Scene::new(vec![(scene().robots()[0].clone(), Isometry3::identity())], Vec::new()).unwrap());
    let participant = recorded(0, true, &turns, 0.5);
    let axes = participant.rules.axes.iter().map(|axis| Axis { deflection: 0.05, ..axis.clone() }).collect();
    let rules = Arc::new(Rules { axes, ..(*participant.rules).clone() });
    Participant { poses: scene.home(), scene, rules, ..participant }
}

/// The recording of the hold is not retraced: the robot leaves the area within 3 degrees of it on the straight line,
/// as fast as it came.
#[test]
fn a_robot_held_by_an_unknown_obstacle_leaves_it_straight() {
    for (secs, swings) in [(0.5, 1.0), (2.0, 1.0), (2.0, 0.1)] {
        let mut participant = held(secs, swings);
        let (stop, recorded) = (participant.past.last().unwrap().q[0].to_degrees(), alone(participant.clone()).end());
        participant.leave_straight();
        let path = alone(participant);
        assert!((path.points[0].1[0].to_degrees() - stop).abs() < 1e-9, "it begins where the robot is");
        let left = path.points.iter().find(|(_, q)| q[0].to_degrees() < stop - 3.0).unwrap().0;
        assert!(left < 0.25, "{left} s for 3 degrees at 30 degrees a second");
        assert!(path.points.windows(2).all(|w| w[0].1[0] >= w[1].1[0]), "straight back");
        assert!(path.end() < 1.4 && path.end() < recorded + 0.1, "{} s, {recorded} s as recorded", path.end());
        assert!(path.takes_off(&[(stop - 2.0).to_radians()]) && !path.takes_off(&[(stop - 4.0).to_radians()]));
    }
}

/// Beside another robot, near a modeled object, or with joints that don't deflect, the recorded path is used.
#[test]
fn a_recorded_path_beside_others_stands() {
    let beside = Participant { scene: scene(), poses: scene().home(), ..held(1.0, 1.0) };
    let near = {
        let (participant, post) = (held(1.0, 1.0), ball(29_f64.to_radians()));
        let robot = (scene().robots()[0].clone(), Isometry3::identity());
        Participant { scene: Arc::new(Scene::new(vec![robot], vec![post]).unwrap()), ..participant }
    };
    let stiff = Participant { rules: rules(true), ..held(1.0, 1.0) };
    for participant in [beside, near, stiff] {
        let before = participant.past.clone();
        let mut participant = participant;
        participant.leave_straight();
        assert!(participant.past == before && !participant.pressed);
    }
}
