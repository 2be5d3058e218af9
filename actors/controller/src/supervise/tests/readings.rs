//! What readings decide: leases, targets, causes and safe poses, and what happens when they stay away or tell the same for ever.

use super::*;

/// The newest reading may be as old as the rules say, and no older.
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

/// A stream of velocities behind encoders that tell the same over and over is ended after half a second, or the time for a degree.
#[test]
fn a_stream_behind_frozen_encoders_is_ended() {
    let ended = |speed: f64, frozen: bool| {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        cell.apply(Op::Stream(speed, 20));
        let (begun, q) = (cell.now, cell.q);
        (1..300_u32).find(|k| {
            let at = begun + Duration::from_millis(10) * *k;
            let setpoints = Setpoints { motors: vec![0], values: Values::Velocity(vec![speed]) };
            cell.on(SuperviseIn::Stream("a".into(), setpoints), at);
            let sample = Sample { seq: 1000 + u64::from(*k), at, q: vec![q].into(), done: vec![false] };
            let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
            (pulse.speed, pulse.unchanged) = (speed, if frozen { begun } else { at });
            cell.on(SuperviseIn::Pulse(&pulse), at);
            cell.supervise.status() == Status::Holding(Hold::Stale)
        })
    };
    let ms = |at: Option<u32>| at.map(|k| 10 * k);
    assert!(ms(ended(0.5, true)).is_some_and(|ms| (500..540).contains(&ms)), "{:?}", ended(0.5, true));
    assert!(ms(ended(0.01, true)).is_some_and(|ms| (1740..1800).contains(&ms)), "{:?}", ended(0.01, true));
    assert_eq!(ended(0.5, false), None);
}

/// A robot at rest that is moved by half of the tolerance is told of once, and beyond it its filter closes and opens again where it
/// then rests. One reading, or two, are noise.
#[test]
fn a_robot_that_is_moved_at_rest_is_told_and_closes() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let (place, tolerance) = (cell.q, cell.rules.tolerance);
    let (mut at, mut seq) = (cell.now, 1000);
    let mut read = |cell: &mut Cell, away: f64| {
        (at, seq) = (at + Duration::from_millis(10), seq + 1);
        let sample = Sample { seq, at, q: vec![place + away * tolerance].into(), done: vec![true] };
        let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
        (pulse.speed, pulse.free, pulse.unchanged) = (0.0, true, at);
        let out = cell.on(SuperviseIn::Pulse(&pulse), at);
        let told = out.iter().filter(|o| matches!(o, SuperviseOut::Event(Event::Displaced { .. }))).count();
        (told, cell.supervise.status())
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

/// A robot that has just been told to move, and its next reading: so long after the last, heard so much later.
fn sets_out() -> (Cell, impl FnMut(&mut Cell, f64, Duration) -> Vec<SuperviseOut>) {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let target = Target { motors: vec![0], q: vec![1.0], speed: 0.5 };
    cell.on(SuperviseIn::Commit(Commit { agent: "a".into(), target, speeds: None }), cell.now);
    let (mut at, mut seq) = (cell.now, 1000);
    let read = move |cell: &mut Cell, q: f64, late: Duration| {
        (at, seq) = (at + Duration::from_millis(100), seq + 1);
        let sample = Sample { seq, at, q: vec![q].into(), done: vec![true] };
        let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
        (pulse.speed, pulse.free, pulse.unchanged) = (0.0, true, at);
        cell.on(SuperviseIn::Pulse(&pulse), at + late)
    };
    (cell, read)
}

/// I8: the lease is as long as a reading may be old, counted from the reading, in motion and during the retreat; one that is older
/// renews nothing, and decides nothing.
#[test]
fn a_lease_is_as_long_as_a_reading_is_fresh() {
    let leases = |out: &[SuperviseOut]| -> Vec<Time> {
        out.iter().filter_map(|o| if let SuperviseOut::Lease(until) = o { Some(*until) } else { None }).collect()
    };
    let (mut cell, mut read) = sets_out();
    let (fresh, begun) = (cell.rules.fresh, cell.now);
    assert_eq!(leases(&read(&mut cell, 0.5, fresh)), [begun + Duration::from_millis(100) + fresh]);
    assert_eq!(leases(&read(&mut cell, 1.0, fresh + Duration::from_nanos(1))), []);
    assert_eq!(cell.supervise.status(), Status::Moving, "it is there, but that was long ago");
    cell.on(SuperviseIn::AgentDied("a".into()), begun + Duration::from_millis(200));
    assert_eq!(cell.supervise.status(), Status::Stopping);
    assert_eq!(leases(&read(&mut cell, 0.5, Duration::ZERO)), [begun + Duration::from_millis(300) + fresh]);
}

/// A target is reached to the tolerance of the robot's settings, and no less.
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

/// What ended a motion first is why it failed, whatever comes after.
#[test]
fn the_first_cause_is_told() {
    let (mut cell, mut read) = sets_out();
    let _ = read(&mut cell, 0.5, Duration::ZERO);
    cell.on(SuperviseIn::AgentDied("a".into()), cell.now);
    cell.on(SuperviseIn::Fault("hot".into()), cell.now);
    let cause = cell.book.open.as_ref().and_then(|open| open.cause.clone());
    assert_eq!(cause, Some(Cause::AgentDied));
}

/// Who rests where it counts as being at the last safe pose has that one again: many retreats to one vertex do not drift.
#[test]
fn a_safe_pose_is_kept_while_the_robot_counts_as_being_there() {
    for (tolerances, kept) in [(0.99, true), (1.01, false)] {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        let before = cell.q + tolerances * cell.rules.tolerance;
        cell.book.safe = Some(vec![before].into());
        let safe = if kept { before } else { cell.q };
        let target = Target { motors: vec![0], q: vec![1.0], speed: 0.5 };
        let commit = Commit { agent: "a".into(), target, speeds: None };
        let out = cell.on(SuperviseIn::Commit(commit), cell.now);
        let told = out.iter().find_map(|o| match o {
            SuperviseOut::Event(Event::SafePose { q, .. }) => Some(q.to_vec()),
            _ => None,
        });
        assert_eq!(told, Some(vec![safe]), "{tolerances} tolerances away");
    }
}
