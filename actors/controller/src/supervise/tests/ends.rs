//! Ends of floods, exchanges, runs and motions without progress.

use super::*;
use crate::ledger::{Extent, Motion, Open, SafePose};

/// Outputs of supervise: texts of warnings, and whether it yielded.
fn warnings_and_yield(out: &[SuperviseOut]) -> (Vec<&str>, bool) {
    let warnings = out.iter().filter_map(|o| match o {
        SuperviseOut::Event(Event::Warning { text }) => Some(text.as_str()),
        _ => None,
    });
    (warnings.collect(), out.contains(&SuperviseOut::Yielded))
}

/// Refusals beyond 500 at once are counted, and summarized in one line after a second.
#[test]
fn a_flood_of_refusals_is_summed_up() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let now = cell.now;
    let nothing =
        || Commit { agent: "a".into(), target: Target { motors: vec![], q: vec![], speed: 0.5 }, speeds: None };
    let lines = (0..520).filter(|_| {
        let out = cell.on(SuperviseIn::Commit(nothing()), now);
        assert!(matches!(out[0], SuperviseOut::Verdict(Err(_))), "each is answered");
        out.iter().any(|o| matches!(o, SuperviseOut::Event(Event::Refused { .. })))
    });
    assert_eq!(lines.count(), 500);
    let mut tick = |ms: u64| {
        let out = cell.on(SuperviseIn::Tick, now + Duration::from_millis(ms));
        warnings_and_yield(&out).0.iter().map(|text| text.to_string()).collect::<Vec<_>>()
    };
    let warnings = [0, 600, 2000, 3500].map(&mut tick);
    assert_eq!(warnings.each_ref().map(Vec::len), [0, 0, 1, 0], "{warnings:?}");
    assert!(warnings[2][0].contains("20 more commands were refused"), "{warnings:?}");
}

/// Of valid commits, more than 500 at once are refused unchecked; 250 more are accepted with each second.
#[test]
fn a_flood_of_commits_is_not_judged() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let target = || Target { motors: vec![0], q: vec![1.0], speed: 0.1 };
    let mut accepted = |now: Time| {
        let commit = || Commit { agent: "a".into(), target: target(), speeds: None };
        let judged = (0..600).filter(|_| {
            let out = cell.on(SuperviseIn::Commit(commit()), now);
            !matches!(out[0], SuperviseOut::Verdict(Err(Refusal::Busy)))
        });
        judged.count()
    };
    let now = Time::from_secs(2.0);
    assert_eq!([accepted(now), accepted(now), accepted(now + Duration::from_secs(1))], [500, 0, 250]);
}

/// An exchange happens only at a boundary: at rest, with every outcome given, and no retry pending.
#[test]
fn a_filter_yields_at_a_boundary() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Commit(0.5, true));
    cell.apply(Op::Samples(5));
    let now = cell.now;
    assert!(!warnings_and_yield(&cell.on(SuperviseIn::Yield, now)).1, "in mid-motion");
    cell.on(SuperviseIn::Resume, now);
    cell.apply(Op::Samples(200));
    assert_eq!(cell.supervise.status(), Status::Rest, "it was taken back, and nothing happened");
    assert!(cell.gate.is_open());
    assert!(warnings_and_yield(&cell.on(SuperviseIn::Yield, cell.now)).1, "at rest");
    assert!(!cell.gate.is_open());
    assert!(!warnings_and_yield(&cell.on(SuperviseIn::Tick, cell.now)).1, "once");
    cell.apply(Op::Samples(30));
    assert_eq!((cell.supervise.status(), cell.gate.is_open()), (Status::Starting, false), "it waits for the exchange");
    cell.on(SuperviseIn::Resume, cell.now);
    cell.apply(Op::Samples(30));
    assert_eq!((cell.supervise.status(), cell.gate.is_open()), (Status::Rest, true));
    cell.apply(Op::SuperviseDies);
    assert!(!warnings_and_yield(&cell.on(SuperviseIn::Yield, cell.now)).1, "its successor has seen nothing yet");
    cell.on(SuperviseIn::Resume, cell.now);
    cell.apply(Op::Samples(30));
    cell.on(SuperviseIn::Shutdown, cell.now);
    cell.apply(Op::Samples(30));
    assert!(!warnings_and_yield(&cell.on(SuperviseIn::Yield, cell.now)).1, "the run ends");
}

/// At the end of a run the filter closes from any state, and nothing is accepted any more.
#[test]
fn at_the_end_of_a_run_everything_is_closed() {
    type Before = fn(&mut Cell);
    let cases: [(&str, Before, Hold); 4] = [
        ("at rest", |_| (), Hold::ShuttingDown),
        ("in motion", |cell| cell.apply(Op::Commit(1.0, true)), Hold::ShuttingDown),
        ("yielded", |cell| drop(cell.on(SuperviseIn::Yield, cell.now)), Hold::ShuttingDown),
        ("in contact", |cell| cell.wall = Some(cell.q), Hold::InContact),
    ];
    for (name, before, hold) in cases {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        before(&mut cell);
        cell.apply(Op::Samples(20));
        cell.on(SuperviseIn::Shutdown, cell.now);
        assert!(!cell.gate.is_open(), "{name}: closed at once");
        cell.apply(Op::Samples(60));
        assert_eq!((cell.supervise.status(), cell.supervise.is_settled()), (Status::Holding(hold), true), "{name}");
        assert_eq!(cell.outcomes.len() as u64, cell.commits, "{name}");
        let refused = cell.commit(0.3, true);
        assert_eq!(refused, Err(Refusal::Holding { reason: Hold::ShuttingDown }), "{name}");
    }
}

/// A run that ends without waiting gives the open motion its outcome at once, in motion as during its retreat.
#[test]
fn a_run_that_is_abandoned_settles_at_once() {
    for stopped in [false, true] {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        cell.apply(Op::Commit(1.0, true));
        cell.apply(Op::Samples(5));
        if stopped {
            cell.on(SuperviseIn::Shutdown, cell.now);
        }
        assert!(!cell.supervise.is_settled());
        let out = cell.on(SuperviseIn::Abandon, cell.now);
        let ended =
            |o: &&SuperviseOut| matches!(o, SuperviseOut::Event(Event::Outcome { outcome: Outcome::Faulted, .. }));
        assert_eq!((out.iter().filter(ended).count(), cell.supervise.is_settled()), (1, true), "{out:?}");
        assert!(!cell.gate.is_open());
        assert!(!cell.on(SuperviseIn::Abandon, cell.now).iter().any(|o| ended(&o)), "once");
    }
}

/// A motion that had arrived as supervise died is not rolled back.
#[test]
fn a_motion_that_arrived_as_supervise_died_is_committed() {
    for (far, outcome) in [(false, Outcome::RolledBack), (true, Outcome::Committed)] {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        cell.apply(Op::Commit(1.0, true));
        cell.apply(Op::Samples(10));
        while far && cell.q < 1.0 {
            cell.sample(); // not delivered yet
        }
        cell.apply(Op::SuperviseDies);
        cell.heal();
        assert_eq!((cell.outcome, cell.supervise.status()), (Some(outcome), Status::Rest));
    }
}

/// The board reports "done" elsewhere: missed after 0.2 s if it rests, after a second if it still moves. It reports
/// nothing: missed when the motion is overdue. The readings are unchanged while the motor should have moved a degree,
/// and for half a second: frozen.
#[test]
fn a_motion_that_goes_nowhere_ends_in_time() {
    /// The time in milliseconds at which a motion to 1 rad ends, and the state then.
    fn ends(speed: f64, reading: impl Fn(u64) -> (f64, bool, bool)) -> (u64, Status) {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        let target = Target { motors: vec![0], q: vec![1.0], speed };
        cell.on(SuperviseIn::Commit(Commit { agent: "a".into(), target, speeds: None }), cell.now);
        let begun = cell.now;
        for k in 1..2000_u64 {
            let at = begun + Duration::from_millis(10 * k);
            let (q, done, frozen) = reading(10 * k);
            let sample = Sample { seq: 100 + k, at, q: vec![q].into(), done: vec![done], ..Sample::default() };
            let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
            (pulse.speed, pulse.free) = (if frozen { 0.0 } else { 0.1 }, true);
            pulse.unchanged = if frozen { begun } else { at };
            cell.on(SuperviseIn::Pulse(&pulse), at);
            if cell.supervise.status() != Status::Moving {
                return (10 * k, cell.supervise.status());
            }
        }
        panic!("it goes on and on")
    }
    // the reaction time is two periods, 40 ms; "done" is accepted from then on
    assert_eq!(ends(0.5, |_| (0.5, true, true)), (240, Status::Stopping));
    assert_eq!(ends(0.5, |_| (0.5, true, false)), (1040, Status::Stopping));
    assert_eq!(ends(0.5, |ms| (0.5, ms >= 300, false)), (1300, Status::Stopping));
    assert_eq!(ends(0.5, |ms| (0.5, ms % 100 != 0 && ms < 900, false)).1, Status::Stopping);
    // 2 way / speed + 2 sqrt(way / acceleration), twice, and a second more
    let due = |share: f64| 2.0 * (2.0 / (share * 1.7) + 2.0 * (1.0_f64 / 3.5).sqrt()) + 1.0;
    let (ms, status) = ends(0.5, |ms| (0.5 + 1e-6 * ms as f64, false, false));
    assert_eq!(status, Status::Stopping);
    assert!((ms as f64 * 1e-3 - due(0.5)).abs() <= 0.011, "{ms} ms, {} s", due(0.5));
    assert_eq!(ends(0.5, |_| (0.5, false, true)), (540, Status::Holding(Hold::Stale)));
    // at 0.01 of 1.7 rad/s a degree takes 2 s
    let (ms, status) = ends(0.01, |_| (0.5, false, true));
    let degree = 1_f64.to_radians() * (2.0 / 0.017 + 2.0 * (1.0_f64 / 3.5).sqrt());
    assert_eq!(status, Status::Holding(Hold::Stale));
    assert!((ms as f64 * 1e-3 - degree - 0.04).abs() <= 0.011, "{ms} ms, {degree} s");
}

/// Reports of the reflex have an effect only during its retreat: they may be late.
#[test]
fn late_words_of_the_reflex_change_nothing() {
    let words = [
        ReflexReport::Retreating,
        ReflexReport::Settling,
        ReflexReport::Back,
        ReflexReport::Stopped,
        ReflexReport::GaveUp(Hold::RetreatMissed),
    ];
    for report in words {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        let reported = |cell: &mut Cell| {
            let out = cell.on(SuperviseIn::ReflexReport(report.clone()), cell.now);
            (cell.supervise.status(), out.len())
        };
        assert_eq!(reported(&mut cell), (Status::Rest, 0), "{report:?}");
        cell.on(SuperviseIn::Fault("hot".into()), cell.now);
        let status = cell.supervise.status();
        assert_eq!(reported(&mut cell), (status, 0), "{report:?}");
    }
}

/// A motion left open by another process ends as the pose shows. If that is neither of its ends, nothing moves until
/// a person requests it.
#[test]
fn a_motion_left_open_by_a_crash_ends_as_the_pose_shows() {
    let ended = |target: f64, safe: Option<f64>, retreated: bool| {
        let mut cell = Cell::new();
        let at = Time::ZERO;
        cell.book.open = Some(Open {
            id: CommitId(1),
            agent: "a".into(),
            target: vec![target].into(),
            named: [0].into(),
            safe: safe.map(|q| SafePose { since: at, q: vec![q].into() }),
            since: at,
            motion: Motion::Move { due: at },
            cause: Some(Cause::Crashed),
            retreated,
            extent: Extent::Whole,
        });
        cell.commits = 1;
        cell.apply(Op::Samples(30));
        assert_eq!(cell.outcomes, [CommitId(1)]);
        (cell.outcome, cell.supervise.status(), cell.gate.is_open(), cell.supervise.retry.is_some())
    };
    let rests = |outcome| (Some(outcome), Status::Rest, true, false);
    assert_eq!(ended(0.0, Some(1.0), false), rests(Outcome::Committed));
    assert_eq!(ended(1.0, Some(0.0), false), rests(Outcome::RolledBack));
    let lost = |again| (Some(Outcome::Faulted), Status::Holding(Hold::AfterCrash), false, again);
    assert_eq!(ended(1.0, Some(0.5), false), lost(true));
    assert_eq!(ended(0.0, Some(0.5), true), lost(true), "it was being taken back");
    assert_eq!(ended(1.0, None, false), lost(false), "an escape has no retreat");
}

/// An escape that ends in contact leaves the filter closed, and further escapes may follow.
#[test]
fn an_escape_that_ends_in_contact_holds() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Wall(Some(0.03)));
    cell.apply(Op::Samples(30));
    assert_eq!(cell.supervise.status(), Status::Holding(Hold::InContact));
    for (q, status) in [(-0.02, Status::Holding(Hold::InContact)), (-0.3, Status::Rest), (-0.2, Status::Rest)] {
        let ended = cell.outcomes.len();
        assert!(cell.commit(q, true).is_ok());
        // at the reading that ends it: a filter that was left open would be closed at the next one
        while cell.outcomes.len() == ended {
            cell.apply(Op::Samples(1));
        }
        assert_eq!((cell.outcome, cell.supervise.status()), (Some(Outcome::Committed), status), "to {q}");
        assert_eq!(cell.gate.is_open(), status == Status::Rest);
    }
}

/// A contact at rest closes the filter for as long as a stop needs to take effect, and nothing else begins in that
/// time.
#[test]
fn a_contact_at_rest_is_settled_when_a_stop_would_have_had_its_effect() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Wall(Some(0.03)));
    while cell.gate.is_open() || cell.supervise.status() == Status::Rest {
        cell.apply(Op::Samples(1));
    }
    let closed = cell.now;
    assert!(!warnings_and_yield(&cell.on(SuperviseIn::Yield, closed)).1, "no boundary");
    cell.on(SuperviseIn::Resume, closed);
    while !cell.supervise.is_settled() {
        cell.apply(Op::Samples(1));
    }
    assert!(cell.now >= closed + cell.rules.reaction(), "after {:?}", cell.now.since(closed));
    assert_eq!(cell.supervise.status(), Status::Holding(Hold::InContact));
}

/// A retry that succeeds restores the commanded positions of the motors, though their motion has had its outcome.
/// While it is in progress, or readings are missing, there is nothing to retry.
#[test]
fn a_retreat_that_succeeds_at_last_leaves_the_motors_at_home() {
    let given_up = |hold: Hold| {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        cell.apply(Op::Commit(1.0, true));
        cell.apply(Op::Samples(20));
        cell.on(SuperviseIn::AgentDied("a".into()), cell.now);
        cell.on(SuperviseIn::ReflexReport(ReflexReport::GaveUp(hold)), cell.now);
        assert_eq!(cell.book.places[..], [Some(cell.q)], "where it stands, for now");
        cell
    };
    assert!(!given_up(Hold::Stale).supervise.can_recover());
    let mut cell = given_up(Hold::RetreatMissed);
    assert!(cell.q > 0.1 && cell.supervise.can_recover());
    let out = cell.on(SuperviseIn::Recover, cell.now);
    assert!(out.iter().any(|o| matches!(o, SuperviseOut::RollBack { again: true, .. })), "{out:?}");
    assert!(!cell.supervise.can_recover(), "it is being tried");
    cell.on(SuperviseIn::ReflexReport(ReflexReport::Back), cell.now);
    assert_eq!(cell.book.places[..], [Some(0.0)]);
}

/// Only a motion in progress can be revised: a late revision begins no other one.
#[test]
fn only_a_motion_in_progress_is_revised() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let id = cell.commit(1.0, true).unwrap();
    let revise = |cell: &mut Cell, id| {
        let target = Target { motors: vec![0], q: vec![0.5], speed: 0.5 };
        let commit = Commit { agent: "a".into(), target, speeds: None };
        match cell.on(SuperviseIn::Revise(id, Revision::Commit(commit)), cell.now).first() {
            Some(SuperviseOut::Verdict(verdict)) => verdict.clone(),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(revise(&mut cell, CommitId(7)), Err(Refusal::Over));
    assert_eq!(cell.book.open.as_ref().map(|open| open.target[0]), Some(1.0));
    assert_eq!(revise(&mut cell, id), Ok(id));
    assert_eq!(cell.book.open.as_ref().map(|open| open.target[0]), Some(0.5));
    cell.heal();
    assert_eq!((cell.supervise.status(), revise(&mut cell, id)), (Status::Rest, Err(Refusal::Over)));
}

/// The journal is shared by several robots: each line names its robot.
#[test]
fn events_name_their_robot() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let robots: Vec<String> = cell
        .on(SuperviseIn::Shutdown, cell.now)
        .into_iter()
        .filter_map(|o| match o {
            SuperviseOut::Event(Event::Disabled { robot, .. } | Event::State { robot, .. }) => Some(robot),
            _ => None,
        })
        .collect();
    assert_eq!(robots, ["r", "r"]);
}

/// Without a failed retreat there is nothing to retry.
#[test]
fn to_recover_does_nothing_where_no_retreat_failed() {
    type Before = fn(&mut Cell);
    let cases: [(&str, Before); 3] = [
        ("at rest", |_| ()),
        ("in motion", |cell| cell.apply(Op::Commit(1.0, true))),
        ("in contact", |cell| cell.apply(Op::Wall(Some(0.03)))),
    ];
    for (name, before) in cases {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        before(&mut cell);
        cell.apply(Op::Samples(30));
        let (status, token) = (cell.supervise.status(), cell.gate.token());
        assert!(!cell.supervise.can_recover(), "{name}");
        assert_eq!(cell.on(SuperviseIn::Recover, cell.now), [], "{name}");
        assert_eq!((cell.supervise.status(), cell.gate.token()), (status, token), "{name}");
    }
}

/// An escape creeps, whatever speed its commit requests, and the journal shows it.
#[test]
fn an_escape_creeps() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Wall(Some(0.03)));
    cell.apply(Op::Samples(30));
    let most = cell.rules.escape_speed * cell.rules.axes[0].max_speed;
    for speeds in [None, Some(vec![1.0])] {
        let mut cell = cell.fork();
        let target = Target { motors: vec![0], q: vec![-0.5], speed: 0.5 };
        let out = cell.on(SuperviseIn::Commit(Commit { agent: "a".into(), target, speeds }), cell.now);
        let fastest = |o: &SuperviseOut| match o {
            SuperviseOut::Event(Event::Commit { motors, escape: true, .. }) => Some(motors[0].1),
            SuperviseOut::Command(_, Writer::Agent, Command::Move(m)) => m.speed.as_ref().map(|v| v[0]),
            _ => None,
        };
        let speeds: Vec<f64> = out.iter().filter_map(fastest).collect();
        assert!(speeds.len() == 2 && speeds.iter().all(|v| *v <= most + 1e-9), "{speeds:?} of {most}");
    }
}

/// A hundred refused set-points a second are one line, until there is a silence or another reason.
#[test]
fn refused_set_points_are_one_line_per_burst() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let mut burst = |n: usize, jump: f64| {
        for _ in 0..n {
            assert!(cell.stream(true, Values::Position(vec![jump])).is_err());
            cell.apply(Op::Samples(1));
        }
        let refused = cell.refused;
        cell.apply(Op::Samples(30));
        refused
    };
    assert_eq!(burst(200, 1.0), 1);
    assert_eq!(burst(100, 1.0), 1, "a pause of 0.3 s is none");
    assert_eq!(burst(100, 9.0), 2, "another reason");
    cell.apply(Op::Samples(30));
    assert!(cell.stream(true, Values::Position(vec![1.0])).is_err());
    assert_eq!(cell.refused, 3, "after a silence");
    let refused = [9.0, 9.0].map(|q| {
        assert!(cell.commit(q, true).is_err());
        cell.refused
    });
    assert_eq!(refused, [4, 5], "commits are journaled one by one");
}

/// The last set-points of a retreat may be lost, as after the end of a lease: they are repeated.
#[test]
fn a_retreat_ends_although_its_last_set_points_are_lost() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Wall(Some(0.5)));
    cell.apply(Op::Commit(1.0, true));
    let (mut lost, mut far) = (0, 0.0);
    while cell.outcomes.is_empty() {
        cell.sample();
        cell.settle_chain();
        let back = matches!(cell.supervise.status(), Status::Retreating | Status::Settling);
        if back && cell.q < 0.012 && lost < 12 {
            (lost, far) = (lost + u32::from(cell.waits(0)), cell.q);
            cell.lose();
        }
        cell.flush();
    }
    assert!(lost == 12 && far > cell.rules.tolerance, "{lost} commands lost, at {far}");
    assert_eq!((cell.outcome, cell.supervise.status()), (Some(Outcome::RolledBack), Status::Rest));
    assert!(cell.q.abs() <= cell.rules.tolerance, "at {}", cell.q);
}

/// An agent aborts its motion in the instant in which it ends for another reason: the journal shows that, since the
/// agent reacts to its own request (I23).
#[test]
fn a_stop_that_comes_too_late_is_refused() {
    let mut cell = Cell::new();
    let mut refused = |ops: &[Op]| {
        ops.iter().cloned().for_each(|op| cell.apply(op));
        cell.apply(Op::Stop);
        std::mem::take(&mut cell.refused)
    };
    assert_eq!(refused(&[Op::Samples(30)]), 0, "nothing is under way");
    assert_eq!(refused(&[Op::Commit(0.5, true), Op::Samples(5)]), 0, "it is in time");
    assert_eq!(refused(&[Op::Samples(100), Op::Commit(0.5, true), Op::Samples(5), Op::Fault]), 1);
    assert_eq!(refused(&[Op::Samples(100)]), 0, "it has its outcome");
}
