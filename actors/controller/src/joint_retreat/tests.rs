//! Two arms within each other's reach, and their recordings: group and time of each retreat.

use super::*;
use crate::ControllerSettings;
use crate::pulse::Pulse;
use mobee_contract::{Axis, Board, Sample};
use mobee_model::parse_robot;
use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;

const ARM: &str = include_str!("../../tests/data/pan.xml");
pub(crate) const PERIOD: Duration = Duration::from_millis(10);

/// Two of them, 80 cm apart: at zero each points at the other, and they touch if both do.
pub(crate) fn scene() -> Arc<Scene> {
    let arm = |name: &str| {
        let text = ARM.replace("NAME", name).replace("HOME", "0");
        Arc::new(parse_robot("arm.xml", &text).map(|l| l.value).unwrap())
    };
    let turned = Isometry3::new(Vector3::new(0.8, 0.0, 0.0), Vector3::new(0.0, 0.0, std::f64::consts::PI));
    Arc::new(Scene::new(vec![(arm("left"), Isometry3::identity()), (arm("right"), turned)], Vec::new()).unwrap())
}

pub(crate) fn rules(direct: bool) -> Arc<Rules> {
    let axis =
        Axis { name: "pan".into(), min: -3.0, max: 3.0, max_speed: 3.0, max_acceleration: 30.0, ..Default::default() };
    let board = Board { axes: vec![axis], period: PERIOD, latency: Duration::ZERO, position_direct: direct };
    let controller = ControllerSettings { period_s: PERIOD.as_secs_f64(), ..ControllerSettings::default() };
    Arc::new(Rules::new("arm", vec!["arm".into()], &controller, &board))
}

/// A robot that was at these angles (degrees) at these times (seconds), moved evenly in between, and requests its
/// retreat to its position at the time `safe`.
pub(crate) fn recorded(robot: usize, direct: bool, turns: &[(f64, f64)], safe: f64) -> Participant {
    let mut history = HistoryCore::new(10_000);
    let [first, last] = [turns.first(), turns.last()].map(|t| (t.unwrap().0 * 100.0).round() as u64);
    for k in first..=last {
        let at = Time::ZERO + PERIOD * k as u32;
        let leg = turns.windows(2).find(|w| at.secs() <= w[1].0 + 1e-9).unwrap();
        let part = (at.secs() - leg[0].0) / (leg[1].0 - leg[0].0);
        let q = (leg[0].1 + (leg[1].1 - leg[0].1) * part).to_radians();
        let sample = Sample { seq: k, at, q: vec![q].into(), done: vec![true], ..Sample::default() };
        history.push(&mut Pulse::new(sample, &Vec::new().into()), PERIOD * 5);
    }
    let at = Time::ZERO + PERIOD * (safe * 100.0).round() as u32;
    let q = history.recorded_near(at, &[0.0], Duration::ZERO).unwrap().q.clone();
    let request = RetreatRequest {
        robot,
        safe: SafePose { since: at, q },
        again: false,
        named: vec![0].into(),
        places: vec![None].into(),
        extent: Extent::Whole,
        pressed: false,
    };
    request.participant(rules(direct), &history, scene(), scene().home()).unwrap()
}

/// Out of the way until 3 s, at rest in the way until 4 s, and then moved.
pub(crate) const B: [(f64, f64); 6] = [(0.0, 90.0), (2.0, 90.0), (3.0, 10.0), (4.0, 10.0), (4.5, 0.0), (5.0, -5.0)];
/// Out of the way at -90, past the other until 2 s, then beyond it at rest until it comes back into the way.
pub(crate) const A: [(f64, f64); 6] = [(0.0, -90.0), (0.5, -90.0), (2.0, 90.0), (4.0, 90.0), (4.8, 50.0), (5.0, 42.0)];

/// A robot's reading: it requests its path until it has one, then writes set-points. Returns its time on the path, if
/// it wrote one.
fn reading(
    joint_retreat: &JointRetreat,
    t: &Participant,
    path: &mut Option<(f64, Time)>,
    now: Time,
) -> Option<Option<f64>> {
    if let Some((at, last)) = path {
        let elapsed = now.since(*last).as_secs_f64();
        let wrote = joint_retreat.step(t.robot, *at + elapsed.min(1.5 * PERIOD.as_secs_f64()), now);
        (*at, *last) = (wrote.unwrap_or(*at), now);
        return Some(wrote);
    }
    match joint_retreat.request(t.robot, now) {
        RetreatReply::Go(_) => *path = Some((0.0, now)),
        RetreatReply::FetchRecording => joint_retreat.enroll(t.clone(), now),
        RetreatReply::Wait => {}
    }
    None
}

proptest! {
    /// On one clock: whatever readings are delayed, no robot is ahead of what another will have written in its next
    /// step, none retreats faster than time passes, and both arrive.
    #[test]
    fn all_keep_step(phase in 0_u64..10_000_000, stalls in prop::collection::vec((any::<bool>(), 0_u64..300, 1_u64..16), 0..6)) {
        let (joint_retreat, both) = (JointRetreat::default(), [recorded(0, true, &A, 4.0), recorded(1, true, &B, 4.0)]);
        let held = |robot: usize, k: u64| {
            stalls.iter().any(|(one, from, n)| usize::from(*one) == robot && (*from..from + n).contains(&k))
        };
        both.iter().for_each(|t| joint_retreat.announce(t.robot, Time::from_secs(5.0)));
        let mut paths = [None, None];
        for k in 0..800 {
            for robot in 0..2_usize {
                let now = Time(5_000_000_000 + k * 10_000_000 + robot as u64 * phase);
                let before = paths[robot];
                if held(robot, k) {
                    continue;
                }
                let wrote = reading(&joint_retreat, &both[robot], &mut paths[robot], now);
                let (Some(at), Some((was, last))) = (wrote, before) else { continue };
                let at = at.unwrap();
                prop_assert!(at - was <= now.since(last).as_secs_f64() + 1e-9, "{at} after {was}");
                let other = paths[1 - robot].map_or(0.0, |(at, _)| at);
                prop_assert!(at - other <= 1.5 * PERIOD.as_secs_f64() + 1e-9, "{at} with {other}");
            }
        }
        let end = 1.0;
        prop_assert!(paths.iter().all(|w| w.is_some_and(|(at, _)| at >= end)), "{paths:?}");
    }
}

#[test]
fn a_robot_does_not_wait_for_a_dead_one() {
    let joint_retreat = JointRetreat::default();
    let both = [recorded(0, true, &A, 4.0), recorded(1, true, &B, 4.0)];
    let at = |ms: u64| Time(5_000_000_000 + ms * 1_000_000);
    // the other was stopped, and gave no sign of life since
    joint_retreat.announce(1, at(0));
    let mut path = None;
    let set_out = (1..500).find(|k| {
        let _ = reading(&joint_retreat, &both[0], &mut path, at(10 * k));
        path.is_some()
    });
    assert!(set_out.is_some_and(|k| (100..110).contains(&k)), "{set_out:?}");

    // it was in the group, and dies on the way: the other is notified once it is lost, and not before
    let joint_retreat = JointRetreat::default();
    let mut paths = [None, None];
    both.iter().for_each(|t| joint_retreat.announce(t.robot, at(0)));
    let parted = (1..500).find(|k| {
        let time_on_path = reading(&joint_retreat, &both[0], &mut paths[0], at(10 * k));
        if *k < 50 {
            let _ = reading(&joint_retreat, &both[1], &mut paths[1], at(10 * k));
        }
        time_on_path == Some(None)
    });
    assert!(parted.is_some_and(|k| (149..155).contains(&k)), "{parted:?}");
}

#[test]
fn way_points_are_left_by_all_at_once() {
    let both = [recorded(0, false, &A, 4.0), recorded(1, false, &B, 4.0)];
    let mut plan = JointRetreatPlan::new(both.to_vec()).unwrap();
    assert!(plan.check(CHECKS_PER_REQUEST));
    let paths = plan.paths();
    assert!(paths.iter().all(|w| !w.direct && (3..10).contains(&w.points.len())), "{paths:?}");
    assert!(paths[0].points.iter().zip(&paths[1].points).all(|(a, b)| a.0 == b.0), "{paths:?}");

    let (joint_retreat, now) = (JointRetreat::default(), Time::from_secs(6.0));
    both.iter().for_each(|t| joint_retreat.enroll(t.clone(), now));
    assert!((0..2).all(|robot| matches!(joint_retreat.request(robot, now), RetreatReply::Go(_))));
    assert_eq!(joint_retreat.reached(0, 1, now), Some(false));
    assert_eq!(joint_retreat.reached(1, 0, now), Some(true), "it is on its way to the first, as the other was");
    assert_eq!(joint_retreat.reached(0, 1, now), Some(false));
    assert_eq!(joint_retreat.reached(1, 1, now), Some(true));
    assert_eq!(joint_retreat.reached(0, 1, now), Some(true));
    assert_eq!(joint_retreat.reached(0, 2, now), Some(false));
    joint_retreat.leave(1);
    assert_eq!(joint_retreat.reached(0, 2, now), None, "the other one gave up");
}

/// The whole retreat of the reflex of an arm that can't pass the other: it stops where the common past ends, and
/// holds.
#[test]
fn a_blocked_robot_holds_and_does_not_report_that_it_is_back() {
    use crate::ledger::Underway;
    use crate::reflex::tests::Alone;
    use crate::reflex::{ReflexIn, ReflexOut, ReflexReport};
    use mobee_contract::{Command, Hold, Status};
    let short: Vec<(f64, f64)> = B.iter().filter(|(t, _)| *t >= 3.0).copied().collect();
    let both = [recorded(0, true, &A, 0.3), recorded(1, true, &short, 4.0)];
    let mut reflex = Alone::new(rules(true));
    let safe = Some(SafePose { since: both[0].past[both[0].start].at, q: both[0].safe.clone() });
    let motion = Underway::of_one_motor(1, safe);
    let roll_back = ReflexIn::RollBack { token: reflex.gate.close(), motion, again: false };
    reflex.on(roll_back, Time::from_secs(5.0));
    let (mut q, mut words, mut other) = (both[0].past.last().unwrap().q.clone(), Vec::new(), None);
    for k in 1..1000 {
        let now = Time::from_secs(5.0) + PERIOD * k;
        let _ = reading(&reflex.joint_retreat, &both[1], &mut other, now);
        let sample = Sample { seq: u64::from(k), at: now, q: q.clone(), done: vec![true], ..Sample::default() };
        let mut pulse = Pulse::new(sample, &Vec::new().into());
        pulse.speed = 0.0;
        let mut out = reflex.read(&mut pulse, None, Status::Stopping, now);
        while let Some(i) = out.iter().position(|o| matches!(o, ReflexOut::Bring(_))) {
            out.remove(i);
            reflex.joint_retreat.enroll(both[0].clone(), now);
            out.extend(reflex.on(ReflexIn::Brought(Ok(())), now));
        }
        for time_on_path in out {
            match time_on_path {
                ReflexOut::Command(_, Command::Direct { q: written, .. }) => q = written.into(),
                ReflexOut::ReflexReport(word) => words.push(word),
                _ => {}
            }
        }
    }
    assert_eq!(words, [ReflexReport::Retreating, ReflexReport::Settling, ReflexReport::GaveUp(Hold::RetreatBlocked)]);
    assert_eq!(q[0].to_degrees().round(), 90.0);
}

/// Two robots that may retreat at the same time, and a time this number of milliseconds after they came to rest.
fn both() -> [Participant; 2] {
    [recorded(0, true, &A, 4.0), recorded(1, true, &B, 4.0)]
}

fn at(ms: u64) -> Time {
    Time(5_000_000_000 + ms * 1_000_000)
}

fn goes(joint_retreat: &JointRetreat, robot: usize, now: Time) -> bool {
    matches!(joint_retreat.request(robot, now), RetreatReply::Go(_))
}

/// One retreats at a time; a robot that drove into the other's way goes first, while the other waits, and counts as
/// making room until it is back.
#[test]
fn a_blocking_robot_retreats_first() {
    let (joint_retreat, [one, other]) = (JointRetreat::default(), both());
    joint_retreat.enroll(one, at(0));
    assert!(goes(&joint_retreat, 0, at(0)));
    joint_retreat.announce(1, at(10));
    assert!(joint_retreat.makes_room(1, 0, at(10)), "it was stopped");
    assert!(!joint_retreat.makes_room(1, 0, at(1020)), "it died");
    joint_retreat.enroll(other, at(20));
    let both_ask = |ms: u64| (joint_retreat.step(0, 0.0, at(ms)), goes(&joint_retreat, 1, at(ms)));
    assert_eq!(both_ask(20), (Some(0.0), false));
    joint_retreat.set_waiting(0, Some((1, at(20))));
    assert_eq!(both_ask(30), (Some(0.0), true));
    assert!(joint_retreat.makes_room(1, 0, at(40)), "it is on its way");
    assert!(!joint_retreat.makes_room(0, 1, at(40)), "who waits does not");
    assert!(!joint_retreat.waits_longer(0, 1), "the other one goes");
    joint_retreat.set_waiting(1, Some((0, at(40))));
    assert!(joint_retreat.waits_longer(0, 1) && !joint_retreat.waits_longer(1, 0));
    joint_retreat.set_waiting(1, None);
    joint_retreat.leave(1);
    assert!(!joint_retreat.makes_room(1, 0, at(50)), "it is back");
}

/// Both retreat, each alone: the one waits there for the other.
fn one_waits_for_the_other() -> (JointRetreat, [Participant; 2]) {
    let (joint_retreat, [one, other]) = (JointRetreat::default(), both());
    joint_retreat.enroll(one.clone(), at(0));
    assert!(goes(&joint_retreat, 0, at(0)));
    joint_retreat.enroll(other.clone(), at(10));
    joint_retreat.set_waiting(0, Some((1, at(10))));
    assert!(goes(&joint_retreat, 1, at(10)));
    (joint_retreat, [one, other])
}

/// Two crossing paths are replanned together, once both robots have stopped, in either order; a dead robot is not
/// awaited.
#[test]
fn crossing_paths_are_replanned_together() {
    for dies in [false, true] {
        let (joint_retreat, [one, other]) = one_waits_for_the_other();
        assert!(!joint_retreat.resolve_mutual_wait(1, 0), "it is on its way");
        joint_retreat.set_waiting(1, Some((0, at(20))));
        assert!(!joint_retreat.must_replan(0, at(20)));
        assert!(joint_retreat.resolve_mutual_wait(1, 0));
        assert!(joint_retreat.must_replan(0, at(30)) && joint_retreat.must_replan(1, at(30)));
        assert_eq!(joint_retreat.step(0, 1.0, at(30)), None);
        // as a reflex does that stops
        let stops = |robot, ms, participant: &Participant| {
            joint_retreat.leave(robot);
            joint_retreat.announce(robot, at(ms));
            joint_retreat.enroll(participant.clone(), at(ms + 10));
        };
        stops(1, 30, &other);
        assert!(!goes(&joint_retreat, 1, at(40)), "not without the other one");
        if dies {
            assert!(goes(&joint_retreat, 1, at(1040)));
            assert!(!joint_retreat.shares_group(1, 0));
            continue;
        }
        stops(0, 40, &one);
        let both_go = (60..200).any(|ms| goes(&joint_retreat, 0, at(ms)) && goes(&joint_retreat, 1, at(ms)));
        assert!(both_go && joint_retreat.shares_group(0, 1) && !joint_retreat.must_replan(0, at(200)));
    }
}

/// A robot that is back, and blocks one that waits for it, joins its group.
#[test]
fn a_robot_that_blocks_a_retreat_joins_the_group() {
    let (joint_retreat, robots) = one_waits_for_the_other();
    assert!(!joint_retreat.blocks_waiting_robot(0, 1), "nobody waits for that one");
    joint_retreat.set_waiting(0, None);
    assert!(!joint_retreat.blocks_waiting_robot(1, 0), "it goes on by itself");
    joint_retreat.set_waiting(0, Some((1, at(20))));
    assert!(joint_retreat.blocks_waiting_robot(1, 0));
    for (robot, participant) in robots.into_iter().enumerate() {
        assert!(joint_retreat.must_replan(robot, at(30)));
        joint_retreat.leave(robot);
        joint_retreat.enroll(participant, at(30));
    }
    let both_go = (40..200).any(|ms| goes(&joint_retreat, 0, at(ms)) && goes(&joint_retreat, 1, at(ms)));
    assert!(both_go && joint_retreat.shares_group(0, 1));
}

/// The retreat so far was recorded, too: the new path reverses where they were stopped, and is slower there than
/// recorded.
#[test]
fn replanned_paths_are_slow_where_they_reverse() {
    let turns = [(0.0, -90.0), (4.0, -90.0), (4.5, -60.0), (5.0, -90.0)];
    let both = || [0, 1].map(|robot| recorded(robot, true, &turns, 4.0));
    let gather = |joint_retreat: &JointRetreat, ms: u64| {
        both().into_iter().for_each(|participant| joint_retreat.enroll(participant, at(ms)));
        while !goes(joint_retreat, 1, at(ms)) {}
        match joint_retreat.request(0, at(ms)) {
            RetreatReply::Go(path) => path.end(),
            other => panic!("{other:?}"),
        }
    };
    let first = gather(&JointRetreat::default(), 0);
    let joint_retreat = JointRetreat::default();
    for (robot, participant) in both().into_iter().enumerate() {
        joint_retreat.enroll(participant, at(0));
        assert!((0..100).any(|_| goes(&joint_retreat, robot, at(0))));
        joint_retreat.set_waiting(robot, Some((1 - robot, at(0))));
    }
    assert!(joint_retreat.resolve_mutual_wait(1, 0));
    [0, 1].into_iter().for_each(|robot| joint_retreat.leave(robot));
    let replan = gather(&joint_retreat, 10);
    assert!(replan > first + 0.005, "{replan} s, and {first} s before");
    [0, 1].into_iter().for_each(|robot| joint_retreat.leave(robot));
    assert_eq!(gather(&joint_retreat, 20), first, "the next time they don't begin anew");
}

#[test]
fn robots_about_to_rest_are_awaited_while_they_report() {
    let [first, second] = both();
    assert!(matches!(JointRetreat::default().request(0, at(0)), RetreatReply::FetchRecording));
    // the last report of the stopping robot is a second old, and then a little older
    for (late, waits) in [(0, true), (1, false)] {
        let joint_retreat = JointRetreat::default();
        joint_retreat.announce(1, at(0));
        joint_retreat.enroll(first.clone(), at(100));
        assert_eq!(goes(&joint_retreat, 0, Time(at(1000).0 + late)), !waits, "{late}");
    }
    // it is stopping all the time: no robot waits longer than three seconds
    let joint_retreat = JointRetreat::default();
    joint_retreat.enroll(first.clone(), at(0));
    let set_out = (0..5000).find(|ms| {
        joint_retreat.announce(1, at(*ms));
        goes(&joint_retreat, 0, at(*ms))
    });
    assert_eq!(set_out, Some(3000));
    // a resting robot joins the group if it has requested its retreat within the last second
    for (late, along) in [(0, true), (1, false)] {
        let joint_retreat = JointRetreat::default();
        joint_retreat.enroll(second.clone(), at(0));
        joint_retreat.enroll(first.clone(), at(1000));
        let now = Time(at(1000).0 + late);
        assert!(goes(&joint_retreat, 0, now));
        assert_eq!(goes(&joint_retreat, 1, now), along, "{late}");
    }
}

#[test]
fn a_retry_moves_alone_and_the_others_after_it() {
    let [first, second] = both();
    let again = Participant { again: true, ..first };
    let joint_retreat = JointRetreat::default();
    joint_retreat.enroll(second.clone(), at(0));
    joint_retreat.announce(2, at(0));
    joint_retreat.enroll(again.clone(), at(0));
    assert!(goes(&joint_retreat, 0, at(0)), "it waits for nobody");
    assert!(matches!(joint_retreat.request(1, at(0)), RetreatReply::Wait), "one party at a time");
    joint_retreat.leave(0);
    assert!(matches!(joint_retreat.request(1, at(0)), RetreatReply::Wait), "and it waits for the one that is coming");
    joint_retreat.leave(2);
    assert!(goes(&joint_retreat, 1, at(0)));
    // the other way round: a first retreat is not grouped with a retry
    let joint_retreat = JointRetreat::default();
    joint_retreat.enroll(again, at(0));
    joint_retreat.enroll(second, at(0));
    assert!(goes(&joint_retreat, 1, at(0)));
    assert!(matches!(joint_retreat.request(0, at(0)), RetreatReply::Wait));
}

/// The clock begins once all boards are prepared, and a period later if others must be notified; no robot is more
/// than a period and a half ahead of the slowest.
#[test]
fn the_clock_of_a_party() {
    let reaction = rules(true).reaction();
    let [first, second] = both();
    let alone = JointRetreat::default();
    alone.enroll(first.clone(), at(0));
    assert!(goes(&alone, 0, at(0)));
    let ms = |secs: f64| (secs * 1e3 * 1e3).round() / 1e3;
    let gone = |joint_retreat: &JointRetreat, robot, since: Duration| {
        joint_retreat.step(robot, 9.0, at(0) + reaction + since).map(ms)
    };
    assert_eq!(gone(&alone, 0, Duration::ZERO), Some(0.0));
    assert_eq!(gone(&alone, 0, PERIOD), Some(10.0));
    assert_eq!(alone.step(0, 0.013, at(0) + reaction + 2 * PERIOD), Some(0.013), "not farther than it may");
    assert_eq!(alone.step(0, 0.0, at(0) + reaction + 2 * PERIOD), Some(0.013), "nor back");
    assert_eq!(gone(&alone, 0, 9 * PERIOD), Some(28.0), "a period and a half from where it was");

    let joint_retreat = JointRetreat::default();
    [first, second].into_iter().for_each(|t| joint_retreat.enroll(t, at(0)));
    assert!(goes(&joint_retreat, 0, at(0)) && goes(&joint_retreat, 1, at(0)));
    assert_eq!(gone(&joint_retreat, 0, PERIOD), Some(0.0), "the other one has just heard of it");
    assert_eq!(gone(&joint_retreat, 0, 2 * PERIOD), Some(10.0));
    assert_eq!(gone(&joint_retreat, 0, 4 * PERIOD), Some(15.0), "the other is still at its beginning");
    assert_eq!(gone(&joint_retreat, 1, 4 * PERIOD), Some(15.0));
    assert_eq!(gone(&joint_retreat, 1, 5 * PERIOD), Some(25.0));
}

/// A robot that is silent for more than a second is lost to its group, unless it has arrived.
#[test]
fn a_robot_that_has_arrived_is_not_lost() {
    let group = || {
        let joint_retreat = JointRetreat::default();
        both().into_iter().for_each(|t| joint_retreat.enroll(t, at(0)));
        assert!(goes(&joint_retreat, 0, at(0)) && goes(&joint_retreat, 1, at(0)));
        joint_retreat
    };
    let joint_retreat = group();
    assert!(joint_retreat.step(1, 9.0, at(1000)).is_some(), "a second is not too long");
    assert!(joint_retreat.step(1, 9.0, Time(at(1000).0 + 1)).is_none());
    assert!(
        goes(&joint_retreat, 0, at(2500)) || matches!(joint_retreat.request(0, at(2500)), RetreatReply::FetchRecording),
        "all were lost, the party is over"
    );

    let joint_retreat = group();
    let mut now = 0;
    let end = loop {
        now += 10;
        let (a, b) = (joint_retreat.step(0, 9.0, at(now)), joint_retreat.step(1, 9.0, at(now)));
        assert_eq!(a.is_some(), b.is_some());
        if a.is_some_and(|at| at >= 1.5) && a == b {
            break now;
        }
    };
    assert!(joint_retreat.step(1, 9.0, at(end + 5000)).is_some(), "the first is there, and says nothing more");
    assert!(joint_retreat.step(2, 9.0, at(end + 5000)).is_none(), "one that does not belong to it");
    joint_retreat.leave(0);
    assert!(matches!(joint_retreat.request(0, at(end + 5000)), RetreatReply::FetchRecording | RetreatReply::Wait));
}

/// Of four arms the first two reach each other, and so do the last two, a hundred meters away.
#[test]
fn a_distant_robot_does_not_wait_for_a_retreat_group() {
    let arm = |name: &str| {
        let text = ARM.replace("NAME", name).replace("HOME", "0");
        Arc::new(parse_robot("arm.xml", &text).map(|l| l.value).unwrap())
    };
    let stands = |x: f64| Isometry3::translation(x, 0.0, 0.0);
    let all = [("a", 0.0), ("b", 0.8), ("c", 100.0), ("d", 100.8)].map(|(name, x)| (arm(name), stands(x)));
    let scene = Scene::new(all.to_vec(), Vec::new()).unwrap();
    let four = [(0, &A), (1, &B), (2, &A), (3, &B)].map(|(robot, turns)| recorded(robot, true, turns, 4.0));
    let now = Time::from_secs(6.0);
    let goes =
        |joint_retreat: &JointRetreat, robot: usize| matches!(joint_retreat.request(robot, now), RetreatReply::Go(_));
    let enroll = |joint_retreat: &JointRetreat, robot: usize| joint_retreat.enroll(four[robot].clone(), now);
    for (joint_retreat, far) in [(JointRetreat::new(&scene), true), (JointRetreat::default(), false)] {
        // the last one is coming to rest: only the third has to wait for it
        joint_retreat.announce(3, now);
        (0..3).for_each(|robot| enroll(&joint_retreat, robot));
        assert_eq!((goes(&joint_retreat, 0), goes(&joint_retreat, 1), goes(&joint_retreat, 2)), (far, far, false));
        enroll(&joint_retreat, 3);
        assert!(
            goes(&joint_retreat, 3) && goes(&joint_retreat, 2),
            "those two together, while the others are under way"
        );
        assert_eq!(joint_retreat.shares_group(0, 2), !far);
        assert!(joint_retreat.shares_group(2, 3));
        if far {
            // each group has its own clock, and is not affected by another group
            assert!(joint_retreat.step(0, 1.0, now + PERIOD * 10).is_some_and(|at| at > 0.0));
            joint_retreat.leave(0);
            assert_eq!(joint_retreat.step(1, 1.0, now + PERIOD * 10), None, "it was on its way with the one that left");
            assert!(joint_retreat.step(2, 1.0, now + PERIOD * 10).is_some());
            // a robot near a retreating group waits for it
            enroll(&joint_retreat, 0);
            assert!(!goes(&joint_retreat, 0));
        }
    }
}

/// A robot that follows its set-points sooner is commanded later: all are at one instant of the past at once.
#[test]
fn a_robot_that_follows_sooner_is_commanded_later() {
    let slow = Rules { latency: Duration::from_millis(30), ..Rules::clone(&rules(true)) };
    let both = [recorded(0, true, &A, 4.0), Participant { rules: Arc::new(slow), ..recorded(1, true, &B, 4.0) }];
    let joint_retreat = JointRetreat::default();
    both.iter().for_each(|participant| joint_retreat.enroll(participant.clone(), Time::from_secs(6.0)));
    let start = Time::from_secs(6.0);
    assert!((0..2).all(|robot| matches!(joint_retreat.request(robot, start), RetreatReply::Go(_))));
    let at = |robot: usize, k: u32| joint_retreat.step(robot, 10.0, start + PERIOD * k).unwrap();
    for k in 0..30 {
        let (quick, slow) = (at(0, k), at(1, k));
        assert!((slow - quick - 0.03).abs() < 1e-9 || quick == 0.0, "{quick} {slow}");
    }
    assert!(at(0, 31) > 0.15, "both are on their way");
}
