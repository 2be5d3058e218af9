//! Refusals and their reasons, state by state.

use super::*;
use crate::ledger::Motion;

/// A robot at rest.
fn rests() -> Cell {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell
}

/// Its newest reading has this speed; `free`: whether nothing touches it.
fn reads(cell: &mut Cell, speed: f64, free: bool) {
    let at = cell.now + Duration::from_millis(10);
    let sample = Sample { seq: 1000, at, q: vec![cell.q].into(), done: vec![true], ..Sample::default() };
    let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
    (pulse.speed, pulse.free, pulse.unchanged) = (speed, free, at);
    cell.on(SuperviseIn::Pulse(&pulse), at);
}

#[test]
fn a_commit_is_taken_at_rest_by_a_fresh_reading_only() {
    type Before = fn(&mut Cell);
    let cases: [(&str, Before, Result<(), &str>); 7] = [
        ("at rest", |_| (), Ok(())),
        ("stopped by a fault, and not settled", |cell| cell.apply(Op::Fault), Err("holding")),
        (
            "the reflex has closed, and not told yet",
            |cell| {
                cell.gate.close();
            },
            Err("closed"),
        ),
        ("something touches it in the newest reading", |cell| reads(cell, 0.0, false), Err("holding")),
        ("somebody pushes it", |cell| reads(cell, 0.5, true), Err("not_ready")),
        ("the reading is as old as it may be", |cell| cell.now = cell.now + cell.rules.fresh, Ok(())),
        ("older", |cell| cell.now = cell.now + cell.rules.fresh + Duration::from_nanos(1), Err("not_ready")),
    ];
    for (name, before, expected) in cases {
        let mut cell = rests();
        cell.now = cell.supervise.newest.as_ref().map(|newest| newest.sampled_at).unwrap();
        before(&mut cell);
        let commit =
            Commit { agent: "a".into(), target: Target { motors: vec![0], q: vec![1.0], speed: 0.5 }, speeds: None };
        let verdict = cell.on(SuperviseIn::Commit(commit), cell.now).into_iter().find_map(|o| match o {
            SuperviseOut::Verdict(verdict) => Some(verdict.map(drop).map_err(|refusal| refusal.code())),
            _ => None,
        });
        assert_eq!(verdict, Some(expected), "{name}");
    }
}

/// An amended motion has the deadline of the new one, however long the first would have taken.
#[test]
fn an_amended_motion_has_a_new_deadline() {
    let mut cell = rests();
    let commit = |speed: f64| {
        let target = Target { motors: vec![0], q: vec![1.0], speed };
        SuperviseIn::Commit(Commit { agent: "a".into(), target, speeds: None })
    };
    let due = |cell: &Cell| cell.book.open.as_ref().and_then(|open| open.motion.due()).unwrap();
    cell.on(commit(0.01), cell.now);
    let slow = due(&cell);
    cell.on(commit(0.5), cell.now);
    assert!(due(&cell).secs() - cell.now.secs() < 10.0 && slow.secs() - cell.now.secs() > 100.0);
}

/// The deadline is twice the expected duration, with the board's latency.
#[test]
fn a_motion_of_a_board_that_is_late_is_due_later() {
    let due = |latency: Duration| {
        let mut cell = rests();
        cell.rules = Arc::new(Rules { latency, ..(*cell.rules).clone() });
        cell.commit(1.0, true).unwrap();
        cell.book.open.as_ref().and_then(|open| open.motion.due()).unwrap()
    };
    let later = due(Duration::from_millis(300)).since(due(Duration::ZERO));
    assert!(later.abs_diff(Duration::from_millis(600)) < Duration::from_micros(1), "{later:?}");
}

/// Only its commit leads an escape: set-points, even of the same program, wait until it is over.
#[test]
fn an_escape_is_joined_by_no_stream() {
    let mut cell = rests();
    cell.apply(Op::Wall(Some(0.03)));
    cell.apply(Op::Samples(30));
    assert!(cell.commit(-0.5, true).is_ok() && cell.supervise.status() == Status::Escaping);
    let refused = cell.stream(true, Values::Velocity(vec![-0.1]));
    assert_eq!(refused, Err(Refusal::Holding { reason: Hold::InContact }));
}

/// The ledger has the kind of motion of a transaction, for a restarted supervise.
#[test]
fn a_transaction_has_its_kind_of_motion() {
    let motion = |cell: &Cell| cell.book.open.as_ref().map(|open| open.motion).unwrap();
    let mut cell = rests();
    assert!(cell.commit(1.0, true).is_ok() && matches!(motion(&cell), Motion::Move { .. }));
    let mut cell = rests();
    assert!(cell.stream(true, Values::Velocity(vec![0.1])).is_ok() && matches!(motion(&cell), Motion::Stream));
    let mut cell = Cell::of(Kind::Fields);
    cell.apply(Op::Samples(30));
    assert!(cell.commit(1.0, true).is_ok() && matches!(motion(&cell), Motion::Forces { .. }));
    let mut cell = rests();
    cell.apply(Op::Wall(Some(0.03)));
    cell.apply(Op::Samples(30));
    assert!(cell.commit(-0.5, true).is_ok() && matches!(motion(&cell), Motion::Escape { .. }));
}

/// Silence counts from the opening of the filter: the retreat is no pause of the agent that pushed.
#[test]
fn an_agent_that_pushed_must_be_silent_first() {
    let mut cell = rests();
    cell.wall = Some(cell.q + 0.8);
    let push = |cell: &mut Cell| cell.stream(true, Values::Velocity(vec![0.8])).map(drop).map_err(|r| r.code());
    while cell.commits == 0 || cell.supervise.status() == Status::Moving {
        push(&mut cell).unwrap();
        cell.apply(Op::Samples(2));
    }
    let closed = cell.now;
    while cell.supervise.status() != Status::Rest {
        cell.apply(Op::Samples(1));
    }
    assert!(cell.now > closed + Duration::from_millis(600));
    let refused = push(&mut cell);
    assert_eq!(refused, Err("pushing"));
    cell.apply(Op::Samples(45));
    assert_eq!(push(&mut cell), refused, "not half a second");
    cell.apply(Op::Samples(52));
    assert_eq!(push(&mut cell), Ok(()));
}
