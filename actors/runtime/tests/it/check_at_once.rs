//! Journals in which something takes a robot out of its controller's hands, or violates a constraint, and nobody minds (I25, I26, I28).

use crate::events::{R, disabled, enabled, ended};
use mobee_contract::*;
use mobee_journal::check::Checker;
use mobee_journal::journal::JournalLine;

/// A robot of two motors of which the first is to stay below 10 degrees.
fn robot() -> Event {
    crate::events::robot(3.0, vec![vec![(vec![(0, -1.0)], 10.0)]])
}

fn commit(escape: bool) -> Event {
    let (robot, agent, target) = (R.into(), "jog".into(), vec![0.0, 1.0].into());
    Event::Commit { robot, id: CommitId(1), agent, target, escape, motors: vec![(0, 0.5), (1, 0.5)], stream: false }
}
fn command(writer: Writer, kind: CommandKind, motors: &[usize]) -> Event {
    let (robot, motors) = (R.into(), motors.to_vec());
    Event::Command { robot, token: 1, writer, kind, motors, q: vec![(1, 1.0)], speed: vec![(1, 0.2)], led: false }
}
fn streamed(writer: Writer, motors: &[usize]) -> Event {
    let (robot, motors, span) = (R.into(), motors.to_vec(), (Time::ZERO, Time::ZERO));
    Event::Streamed {
        robot,
        token: 1,
        writer,
        motors,
        count: 1,
        span,
        greatest_step: 0.5,
        within_limits: true,
        last: Vec::new(),
    }
}
fn state(status: Status) -> Event {
    Event::State { robot: R.into(), status }
}

/// How often this invariant is broken by these events, with readings 10 ms apart, at each of which the motors are at `q`.
fn broken(invariant: &str, events: &[(f64, Event)], q: impl Fn(f64) -> [f64; 2]) -> usize {
    broken_with_gaps(invariant, events, |at| Some(q(at)))
}

/// The same, with no reading where there is no `q`.
fn broken_with_gaps(invariant: &str, events: &[(f64, Event)], q: impl Fn(f64) -> Option<[f64; 2]>) -> usize {
    let mut checker = Checker::default();
    let mut events = events.iter().peekable();
    let mut n = 0;
    for k in 0..600 {
        let at = 0.01 * f64::from(k);
        while let Some((time, event)) = events.next_if(|(time, _)| *time <= at) {
            let (at, event) = (Time::from_secs(*time), event.clone());
            checker.on(&JournalLine { line: n + 1, n, at, event, hash: String::new() });
            n += 1;
        }
        if let Some(q) = q(at) {
            checker.pose(0, Time::from_secs(at), &q.as_slice().into());
        }
    }
    checker.on(&JournalLine { line: n + 1, n, at: Time::from_secs(6.0), event: ended(), hash: String::new() });
    checker.end().1.iter().filter(|v| v.invariant == invariant).count()
}

/// From the second second on the first motor is where it may not be.
fn violating(at: f64) -> [f64; 2] {
    [if at < 1.995 { 0.0 } else { 0.2 }, 0.0]
}

#[test]
fn i25_a_violated_constraint_closes_the_filter_at_rest_and_in_motion() {
    let begin = [(0.0, robot()), (0.1, enabled(1)), (0.1, state(Status::Rest))];
    let moving = [(1.0, commit(false)), (1.0, state(Status::Moving))];
    for more in [&[][..], &moving[..]] {
        let run = |closes: f64| {
            let mut all = [&begin[..], more].concat();
            all.push((closes, disabled(2)));
            broken("I25", &all, violating)
        };
        assert_eq!((run(2.05), run(2.1).min(1)), (0, 1));
        assert_eq!(broken("I25", &[&begin[..], more].concat(), |_| [0.1, 0.0]), 0, "it holds");
    }
    // a controller without a reflex promises nothing
    let without = Event::Controller {
        robot: R.into(),
        kind: "fields".into(),
        reflex: false,
        undo: None,
        clearance: None,
        stops: None,
    };
    assert_eq!(broken("I25", &[&begin[..], &[(0.1, without)]].concat(), violating), 0);
}

#[test]
fn i25_a_constraint_stops_the_retreat_unless_it_was_violated_from_the_start() {
    let began = Event::RetreatBegan { robot: R.into(), id: CommitId(1), poses: 3, secs: 0.1, near: vec![] };
    let (reason, what) = (Hold::RetreatBlocked, "a constraint would be violated".to_string());
    let stopped = Event::RetreatStopped { robot: R.into(), reason, what, seen: Time::from_secs(2.0) };
    let run = |begins: f64, stops: f64| {
        let events = [(0.0, robot()), (0.1, disabled(2)), (begins, began.clone()), (stops, stopped.clone())];
        broken("I25", &events, violating).min(1)
    };
    assert_eq!((run(1.0, 2.05), run(1.0, 2.2), run(2.3, 3.0)), (0, 1, 0));
    let escape = |begins: f64| {
        let events = [(0.0, robot()), (begins, enabled(1)), (begins, commit(true)), (4.0, disabled(2))];
        broken("I25", &events, violating).min(1)
    };
    assert_eq!((escape(1.0), escape(2.3)), (1, 0));
    // it may come out of what it set out violating, and not go on into it
    let slowly = |deg_s: f64| {
        let events = [(0.0, robot()), (1.0, enabled(1)), (1.0, commit(true)), (4.0, disabled(2))];
        broken("I25", &events, |at| [0.2 + deg_s.to_radians() * at, 0.0]).min(1)
    };
    assert_eq!((slowly(-0.5), slowly(0.01), slowly(0.2)), (0, 0, 1));
}

#[test]
fn i26_a_move_behind_readings_that_are_equal_ends_in_time() {
    // one radian at 0.2 rad/s: a degree takes 0.17 s at half of that
    let events = |closes: f64| {
        [
            (0.0, robot()),
            (0.1, enabled(1)),
            (1.0, commit(false)),
            (1.0, state(Status::Moving)),
            (1.0, command(Writer::Agent, CommandKind::Move, &[1])),
            (closes, disabled(2)),
        ]
    };
    let frozen = |freezes: f64, at: f64| [0.0, 0.1 * (at.min(freezes) - 1.0).max(0.0)];
    let run = |freezes: f64, closes: f64| broken("I26", &events(closes), |at| frozen(freezes, at));
    assert_eq!((run(2.0, 2.9), run(2.0, 3.2)), (0, 1));
    assert_eq!(run(6.0, 5.9), 0, "it moves");
    assert_eq!((run(0.0, 1.9), run(0.0, 2.2)), (0, 1), "it never moved");
    let asleep = |closes: f64| {
        broken_with_gaps("I26", &events(closes), |at| Some(frozen(2.0, at)).filter(|_| !(2.5..4.0).contains(&at)))
    };
    assert_eq!((asleep(4.1), asleep(4.5)), (0, 1), "nobody notices anything while the process is suspended");
}

#[test]
fn i28_a_new_driver_stops_its_board_first() {
    let died = Event::Died { actor: "edge/driver".into(), reason: "planted".into() };
    let run = |first: Event| broken("I28", &[(0.0, robot()), (1.0, died.clone()), (1.1, first)], |_| [0.0; 2]);
    assert_eq!(run(command(Writer::Driver, CommandKind::Stop, &[])), 0);
    assert_eq!(run(command(Writer::Reflex, CommandKind::Stop, &[])), 1);
    let reason = "the board does not answer".to_string();
    let unheard = Event::CommandDropped { robot: R.into(), token: 1, writer: Writer::Driver, reason };
    let events = [(0.0, robot()), (1.0, died), (1.1, unheard), (1.2, command(Writer::Reflex, CommandKind::Stop, &[]))];
    assert_eq!(broken("I28", &events, |_| [0.0; 2]), 0);
}

#[test]
fn i28_a_stop_hushes_what_waits() {
    let run = |events: &[Event]| {
        let events: Vec<(f64, Event)> =
            std::iter::once(robot()).chain(events.iter().cloned()).map(|e| (1.0, e)).collect();
        broken("I28", &events, |_| [0.0; 2])
    };
    let stop = |motors: &[usize]| command(Writer::Reflex, CommandKind::Stop, motors);
    assert_eq!(run(&[stop(&[]), streamed(Writer::Reflex, &[1])]), 1);
    assert_eq!(run(&[stop(&[1]), streamed(Writer::Reflex, &[0])]), 0, "other motors");
    assert_eq!(run(&[stop(&[]), command(Writer::Reflex, CommandKind::Mode, &[1]), streamed(Writer::Reflex, &[1])]), 0);
}

#[test]
fn i28_an_exchange_begins_with_a_closed_filter() {
    let took_over = |part| Event::Swap { robot: R.into(), part, step: SwapStep::TookOver { gap: 0.5, map: None } };
    let run = |closes: f64, part: SwapPart, died: bool| {
        let mut events = vec![(0.0, robot()), (0.1, enabled(1)), (closes, disabled(2))];
        if died {
            events.push((1.85, Event::Died { actor: "edge/history".into(), reason: "planted".into() }));
        }
        events.push((2.0, took_over(part)));
        broken("I28", &events, |_| [0.0; 2])
    };
    assert_eq!((run(1.4, SwapPart::Controller, false), run(1.8, SwapPart::Controller, false)), (0, 1));
    assert_eq!((run(1.8, SwapPart::Agent, false), run(1.8, SwapPart::Driver, true)), (0, 0));
}
