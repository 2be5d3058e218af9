//! Decisions by readings: leases, targets, causes and safe poses; and missing or frozen readings.

use super::*;
use crate::ledger::SafePose;

/// The newest reading may be as old as the rules allow, and no older.
#[test]
fn readings_that_stay_away_close_the_filter_in_time() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let newest = cell.supervise.newest.as_ref().map(|newest| newest.sampled_at).unwrap();
    let last = newest + cell.rules.fresh;
    cell.on(SuperviseIn::Tick, last);
    assert_eq!((cell.supervise.status(), cell.gate.is_open()), (Status::Rest, true));
    cell.on(SuperviseIn::Tick, last + Duration::from_nanos(1));
    assert_eq!((cell.supervise.status(), cell.gate.is_open()), (Status::Holding(Hold::Stale), false));
}

/// A stream of velocities with frozen encoders ends after half a second, or the time for a degree.
#[test]
fn a_stream_behind_frozen_encoders_is_ended() {
    let ended = |speed: f64, equal_since: Option<Time>| {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        cell.apply(Op::Stream(speed, 20));
        let (begun, q) = (cell.now, cell.q);
        (1..300_u32).find(|k| {
            let at = begun + Duration::from_millis(10) * *k;
            let setpoints = Setpoints { motors: vec![0], values: Values::Velocity(vec![speed]) };
            cell.on(SuperviseIn::Stream("a".into(), setpoints), at);
            let sample =
                Sample { seq: 1000 + u64::from(*k), at, q: vec![q].into(), done: vec![false], ..Sample::default() };
            let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
            (pulse.speed, pulse.unchanged) = (speed, equal_since.map_or(at, |since| since.min(begun)));
            cell.on(SuperviseIn::Pulse(&pulse), at);
            cell.supervise.status() == Status::Holding(Hold::Stale)
        })
    };
    let ms = |at: Option<u32>| at.map(|k| 10 * k);
    let frozen = Some(Time(u64::MAX));
    assert!(ms(ended(0.5, frozen)).is_some_and(|ms| (500..540).contains(&ms)), "{:?}", ended(0.5, frozen));
    assert!(ms(ended(0.01, frozen)).is_some_and(|ms| (1740..1800).contains(&ms)), "{:?}", ended(0.01, frozen));
    assert_eq!(ended(0.5, None), None);
    // The readings of a robot that rests are equal, too: only the time in which set-points move counts.
    let rested = Some(Time::ZERO);
    assert!(ms(ended(0.5, rested)).is_some_and(|ms| (500..540).contains(&ms)), "{:?}", ended(0.5, rested));
}

/// A robot at rest that is moved by half of the tolerance is reported once; beyond the tolerance its filter closes,
/// and opens again where it then rests. One reading, or two, are noise.
#[test]
fn a_robot_moved_at_rest_is_reported_and_closes_the_filter() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let (place, tolerance) = (cell.q, cell.rules.tolerance);
    let (mut at, mut seq) = (cell.now, 1000);
    let mut read = |cell: &mut Cell, away: f64| {
        (at, seq) = (at + Duration::from_millis(10), seq + 1);
        let sample =
            Sample { seq, at, q: vec![place + away * tolerance].into(), done: vec![true], ..Sample::default() };
        let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
        (pulse.speed, pulse.free, pulse.unchanged) = (0.0, true, at);
        let out = cell.on(SuperviseIn::Pulse(&pulse), at);
        let reports = out.iter().filter(|o| matches!(o, SuperviseOut::Event(Event::Displaced { .. }))).count();
        (reports, cell.supervise.status())
    };
    let holds = Status::Holding(Hold::Displaced);
    assert_eq!(read(&mut cell, 0.0), (0, Status::Rest));
    let noise = [2.0, -2.0, 0.0, 0.45, 0.45, 0.45, 0.45];
    assert!(noise.iter().all(|away| read(&mut cell, *away) == (0, Status::Rest)));
    assert_eq!([0.6; 4].map(|away| read(&mut cell, away).0), [0, 0, 1, 0], "once");
    assert_eq!([1.1; 3].map(|away| read(&mut cell, away).1), [Status::Rest, Status::Rest, holds]);
    assert!(!cell.gate.is_open());
    let opens = (0..100).find(|_| read(&mut cell, 1.1).1 == Status::Rest);
    assert!(opens.is_some_and(|readings| readings > 0) && cell.gate.is_open(), "{opens:?}");
    assert!((0..10).all(|_| read(&mut cell, 1.1) == (0, Status::Rest)), "this is its place now");
}

/// A robot that has just been commanded to move, and its next reading: this long after the last, delivered this much
/// later.
fn sets_out() -> (Cell, impl FnMut(&mut Cell, f64, Duration) -> Vec<SuperviseOut>) {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let target = Target { motors: vec![0], q: vec![1.0], speed: 0.5 };
    cell.on(SuperviseIn::Commit(Commit { agent: "a".into(), target, speeds: None }), cell.now);
    let (mut at, mut seq) = (cell.now, 1000);
    let read = move |cell: &mut Cell, q: f64, late: Duration| {
        (at, seq) = (at + Duration::from_millis(100), seq + 1);
        let sample = Sample { seq, at, q: vec![q].into(), done: vec![true], ..Sample::default() };
        let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
        (pulse.speed, pulse.free, pulse.unchanged) = (0.0, true, at);
        cell.on(SuperviseIn::Pulse(&pulse), at + late)
    };
    (cell, read)
}

/// I8: the lease is as long as a reading may be old, counted from the reading, in motion and during the retreat; an
/// older reading renews nothing, and decides nothing.
#[test]
fn a_lease_is_as_long_as_a_reading_is_fresh() {
    let leases = |out: &[SuperviseOut]| -> Vec<Time> {
        out.iter().filter_map(|o| if let SuperviseOut::Lease(until) = o { Some(*until) } else { None }).collect()
    };
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let until = cell.supervise.newest.as_ref().map(|newest| newest.sampled_at).unwrap() + cell.rules.fresh;
    let target = Target { motors: vec![0], q: vec![1.0], speed: 0.5 };
    let out = cell.on(SuperviseIn::Commit(Commit { agent: "a".into(), target, speeds: None }), cell.now);
    assert_eq!(leases(&out), [until], "it may set out before the next reading");
    let (mut cell, mut read) = sets_out();
    let (fresh, begun) = (cell.rules.fresh, cell.now);
    assert_eq!(leases(&read(&mut cell, 0.5, fresh)), [begun + Duration::from_millis(100) + fresh]);
    assert_eq!(leases(&read(&mut cell, 1.0, fresh + Duration::from_nanos(1))), []);
    assert_eq!(cell.supervise.status(), Status::Moving, "it is there, but that was long ago");
    cell.on(SuperviseIn::AgentDied("a".into()), begun + Duration::from_millis(200));
    assert_eq!(cell.supervise.status(), Status::Stopping);
    assert_eq!(leases(&read(&mut cell, 0.5, Duration::ZERO)), [begun + Duration::from_millis(300) + fresh]);
}

/// A target is reached within the tolerance of the robot's settings, and no less.
#[test]
fn a_target_is_reached_to_the_tolerance() {
    for (tolerances, status) in [(0.99, Status::Rest), (1.01, Status::Stopping)] {
        let (mut cell, mut read) = sets_out();
        let q = 1.0 - tolerances * cell.rules.tolerance;
        let ended = (0..10).find(|_| {
            let _ = read(&mut cell, q, Duration::ZERO);
            cell.supervise.status() != Status::Moving
        });
        assert_eq!((ended.is_some(), cell.supervise.status()), (true, status), "{tolerances} tolerances away");
    }
}

/// A reading of one motor, delivered to supervise at once.
fn read_at(cell: &mut Cell, at: Time, (q, speed, done): (f64, f64, bool)) -> Vec<SuperviseOut> {
    let sample = Sample { seq: at.0, at, q: vec![q].into(), done: vec![done], ..Sample::default() };
    let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
    (pulse.speed, pulse.free, pulse.unchanged) = (speed, true, at);
    cell.on(SuperviseIn::Pulse(&pulse), at)
}

fn commit_to(cell: &mut Cell, q: f64, at: Time) -> Vec<SuperviseOut> {
    let target = Target { motors: vec![0], q: vec![q], speed: 0.5 };
    cell.on(SuperviseIn::Commit(Commit { agent: "a".into(), target, speeds: None }), at)
}

/// The rest speed and a target's tolerance are exact bounds.
#[test]
fn rest_and_tolerance_are_judged_at_their_bounds() {
    let ended = |rests: f64, tolerances: f64| {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        // an exact number, with an exact difference from one
        cell.rules = Arc::new(Rules { tolerance: 1.0 / 128.0, ..(*cell.rules).clone() });
        let (begun, speed) = (cell.now, rests * cell.rules.rest_speed);
        commit_to(&mut cell, 1.0, begun);
        for k in 1..=5 {
            let at = begun + Duration::from_millis(100) * k;
            read_at(&mut cell, at, (1.0 - tolerances / 128.0, speed, true));
        }
        cell.supervise.status()
    };
    assert_eq!([ended(0.99, 0.0), ended(0.99, 1.0)], [Status::Rest; 2]);
    assert_eq!([ended(1.0, 0.0), ended(1.0, 1.0)], [Status::Moving; 2], "it is there, and may still move");
    assert_eq!(ended(0.99, 1.01), Status::Stopping, "it is done elsewhere");
}

/// A reading taken in the instant of a commit shows nothing of it.
#[test]
fn a_motion_ends_by_a_reading_from_after_its_commit() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let at = cell.now + Duration::from_millis(10);
    commit_to(&mut cell, 0.0, at);
    read_at(&mut cell, at, (0.0, 0.0, true));
    assert_eq!(cell.supervise.status(), Status::Moving);
    read_at(&mut cell, at + Duration::from_nanos(1), (0.0, 0.0, true));
    assert_eq!(cell.supervise.status(), Status::Rest);
}

/// A motion may take until its deadline, and no longer, straight or under forces.
#[test]
fn a_motion_is_overdue_when_it_is_past_due() {
    for kind in [Kind::Straight, Kind::Fields] {
        for (late, status) in [(0, Status::Moving), (1, Status::Stopping)] {
            let mut cell = Cell::of(kind);
            cell.apply(Op::Samples(30));
            let begun = cell.now;
            commit_to(&mut cell, 1.0, begun);
            let due = cell.book.open.as_ref().and_then(|open| open.motion.due()).unwrap();
            read_at(&mut cell, due + Duration::from_nanos(late), (0.5, 0.5, false));
            assert_eq!(cell.supervise.status(), status, "{kind:?}, {late} ns late");
        }
    }
}

/// The commanded position of a motor is its resting position from then on: nothing was displaced.
#[test]
fn a_motor_that_was_sent_elsewhere_is_not_displaced() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Commit(0.5, true));
    while cell.outcomes.is_empty() {
        cell.apply(Op::Samples(1));
    }
    let token = cell.gate.token();
    cell.apply(Op::Samples(30));
    assert_eq!((cell.supervise.status(), cell.gate.token()), (Status::Rest, token));
}

/// A motion that outlasts the history moves its safe pose along: a recorded path leads back to it at any time.
#[test]
fn a_motion_that_outlasts_the_history_can_be_taken_back() {
    let mut cell = Cell::with(Kind::Straight, Duration::from_millis(10), false, 60);
    cell.apply(Op::Samples(30));
    let begun = cell.now;
    cell.apply(Op::Commit(2.0, true));
    for _ in 0..150 {
        cell.apply(Op::Samples(1));
        let SafePose { since, .. } = cell.book.open.as_ref().and_then(|open| open.safe.clone()).unwrap();
        assert!(cell.book.history.past(since).is_ok(), "no way leads back to {since}");
    }
    assert!(cell.book.open.as_ref().and_then(|open| open.safe.clone()).is_some_and(|safe| safe.since > begun));
}

/// A motion that was cut off at its target has its target journaled before its outcome; for one that ended by itself,
/// it was journaled before.
#[test]
fn a_motion_cut_off_at_its_target_is_journaled() {
    let amended = |fault: bool, q: f64| {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        let begun = cell.now;
        commit_to(&mut cell, 1.0, begun);
        if fault {
            cell.on(SuperviseIn::Fault("hot".into()), begun);
        }
        let out = (1..=10).flat_map(|k| read_at(&mut cell, begun + Duration::from_millis(50) * k, (q, 0.0, true)));
        let journaled = |o: SuperviseOut| match o {
            SuperviseOut::Event(Event::Amended { .. }) => Some("amended"),
            SuperviseOut::Event(Event::Outcome { .. }) => Some("outcome"),
            _ => None,
        };
        out.filter_map(journaled).collect::<Vec<_>>()
    };
    assert_eq!(amended(true, 1.0), ["amended", "outcome"]);
    assert_eq!((amended(false, 1.0), amended(true, 0.0)), (vec!["outcome"], vec!["outcome"]));
}

/// Under forces the reference moves once a period, by no more than a period and a half of time, in any timing of the
/// readings; a board that takes velocities stands still at first, at any position.
#[test]
fn a_reference_moves_once_per_period() {
    let mut cell = Cell::of(Kind::Fields);
    cell.apply(Op::Samples(30));
    cell.apply(Op::Commit(2.0, true));
    let ahead = |cell: &Cell| cell.book.ahead.as_ref().map(|q| q[0]).unwrap();
    let mut moved = 0;
    for _ in 0..40 {
        let before = ahead(&cell);
        cell.apply(Op::Samples(1));
        moved += u32::from(ahead(&cell) != before);
    }
    assert!((19..=21).contains(&moved), "40 readings in 20 periods: {moved} steps");
    let (before, at, q) = (ahead(&cell), cell.now + Duration::from_millis(90), cell.q);
    read_at(&mut cell, at, (q, 0.5, false));
    let most = 1.5 * cell.rules.period.as_secs_f64() * cell.rules.axes[0].max_speed;
    let step = ahead(&cell) - before;
    assert!(step > 0.0 && step <= most, "{step} rad after a pause");
    let mut cell = Cell::of(Kind::Velocities);
    cell.apply(Op::Samples(30));
    cell.apply(Op::Commit(0.5, true));
    cell.heal();
    let now = cell.now;
    let first = commit_to(&mut cell, 1.0, now).into_iter().find_map(|o| match o {
        SuperviseOut::Command(_, _, Command::Velocity { speed, .. }) => Some(speed),
        _ => None,
    });
    assert_eq!(first, Some(vec![0.0]));
}

/// The first cause that ended a motion is its cause, whatever comes after.
#[test]
fn the_first_cause_is_journaled() {
    let (mut cell, mut read) = sets_out();
    let _ = read(&mut cell, 0.5, Duration::ZERO);
    cell.on(SuperviseIn::AgentDied("a".into()), cell.now);
    cell.on(SuperviseIn::Fault("hot".into()), cell.now);
    let cause = cell.book.open.as_ref().and_then(|open| open.cause.clone());
    assert_eq!(cause, Some(Cause::AgentDied));
}

/// A robot that rests close to the last safe pose has that one again: many retreats to one vertex do not drift.
#[test]
fn a_safe_pose_is_retained_while_the_robot_is_close_to_it() {
    for (tolerances, retained) in [(0.99, true), (1.01, false)] {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        let before = cell.q + tolerances * cell.rules.tolerance;
        cell.book.safe = Some(vec![before].into());
        let safe = if retained { before } else { cell.q };
        let target = Target { motors: vec![0], q: vec![1.0], speed: 0.5 };
        let commit = Commit { agent: "a".into(), target, speeds: None };
        let out = cell.on(SuperviseIn::Commit(commit), cell.now);
        let safe_pose = out.iter().find_map(|o| match o {
            SuperviseOut::Event(Event::SafePose { q, .. }) => Some(q.to_vec()),
            _ => None,
        });
        assert_eq!(safe_pose, Some(vec![safe]), "{tolerances} tolerances away");
    }
}

/// I18: if supervise is delayed, commands that an agent sent before it died, and the progress of its motion, are
/// processed late: the motion is cancelled first. The death of another agent changes nothing.
#[test]
fn commands_of_a_dead_agent_are_not_executed() {
    for (agent, cancelled) in [("a", true), ("b", false)] {
        let (mut cell, _) = sets_out();
        let id = cell.book.open.as_ref().map(|open| open.id).unwrap();
        cell.book.note_agent_death(agent);
        let target = Target { motors: vec![0], q: vec![0.8], speed: 0.5 };
        let revision = Revision::Commit(Commit { agent: "a".into(), target, speeds: None });
        let out = cell.on(SuperviseIn::Revise(id, revision), cell.now);
        assert_eq!(out.first(), Some(&SuperviseOut::Verdict(if cancelled { Err(Refusal::Closed) } else { Ok(id) })));
        let cause = cell.book.open.as_ref().and_then(|open| open.cause.clone());
        assert_eq!(cause, cancelled.then_some(Cause::AgentDied), "{agent}");
        let (mut arrived, mut read_there) = sets_out();
        arrived.book.note_agent_death(agent);
        let ended = (0..10).any(|_| {
            let _ = read_there(&mut arrived, 1.0, Duration::ZERO);
            arrived.supervise.status() == Status::Rest
        });
        assert_eq!(ended, !cancelled, "{agent}: it is at its target");
    }
}

/// A joint much faster than commanded has met something: its motion is rolled back. At rest another program drives
/// it.
#[test]
fn a_joint_that_is_too_fast_is_a_contact_in_motion_and_a_fault_at_rest() {
    let fast = || SuperviseIn::TooFast("elbow moves at 60 deg/s and was told 20".into());
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let now = cell.now;
    commit_to(&mut cell, 1.0, now);
    let out = cell.on(fast(), now);
    assert!(out.iter().any(|out| matches!(out, SuperviseOut::RollBack { again: false, .. })), "{out:?}");
    assert_eq!(cell.supervise.status(), Status::Stopping);
    let mut still = Cell::new();
    still.apply(Op::Samples(30));
    let now = still.now;
    let out = still.on(fast(), now);
    assert!(!out.iter().any(|out| matches!(out, SuperviseOut::RollBack { .. })), "{out:?}");
    assert_eq!(still.supervise.status(), Status::Holding(Hold::BoardFault));
}
