//! I22 by the measured poses: a retreat that is none, each as a run in which nothing else is wrong.

use crate::events::{R, ended, robot, started};
use mobee_contract::{Cause, CommandKind, CommitId, Event, Hold, Outcome, Pose, Status, Time, Writer};
use mobee_journal::check::{Checker, Violation};
use mobee_journal::journal::JournalLine;

/// When it is committed, stopped and taken back, s.
const COMMIT: f64 = 1.0;
const STOP: f64 = 3.0;
const BACK: f64 = 3.2;

/// First one motor goes, then the other: a path with a bend, at 0.3 rad/s.
fn there(at: f64) -> [f64; 2] {
    [0.3 * (at - COMMIT).clamp(0.0, 1.0), 0.3 * (at - COMMIT - 1.0).clamp(0.0, 1.0)]
}

/// The path backwards at this rate.
fn backwards(rate: f64) -> impl Fn(f64) -> [f64; 2] {
    move |at| there(STOP - rate * (at - BACK - 0.06).max(0.0))
}

/// What of I22 is found where the robot goes back as `back` says, with more events; the outcome comes at `end`.
fn found(back: impl Fn(f64) -> [f64; 2], end: f64, outcome: Outcome, more: Vec<(f64, Event)>) -> Vec<Violation> {
    gone(|at| there(at.min(STOP)), back, end, outcome, more)
}

/// The same of a robot that was, until the retreat began, where `forth` says.
fn gone(
    forth: impl Fn(f64) -> [f64; 2],
    back: impl Fn(f64) -> [f64; 2],
    end: f64,
    outcome: Outcome,
    more: Vec<(f64, Event)>,
) -> Vec<Violation> {
    let (name, id, home) = (|| R.to_string(), CommitId(1), || Pose::from([0.0, 0.0]));
    let motors = vec![(0, 0.5), (1, 0.5)];
    let (agent, target) = ("explorer".into(), Pose::from([0.5, 0.5]));
    let q = Pose::from(back(end));
    let mut events = vec![
        (0.0, started()),
        (0.0, robot(1.0, Vec::new())),
        (0.9, Event::SafePose { robot: name(), q: home(), age: 0.01, speed: 0.0, free: true }),
        (0.9, Event::Enabled { robot: name(), token: 1 }),
        (COMMIT, Event::Commit { robot: name(), id, agent, target, escape: false, motors, stream: false }),
        (STOP, Event::Disabled { robot: name(), token: 2, cause: Cause::Contact(vec![]) }),
        (BACK, Event::RetreatBegan { robot: name(), id, poses: 200, secs: 2.0, near: vec![] }),
        (end, Event::Outcome { robot: name(), id, outcome, q, safe: Some(home()), cause: None }),
        (end + 1.0, ended()),
    ];
    events.extend(more);
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut checker, mut events) = (Checker::default(), (0..).zip(events).peekable());
    for k in 0.. {
        let at = 0.01 * f64::from(k);
        while let Some((n, (time, event))) = events.next_if(|(_, (time, _))| *time <= at) {
            checker.on(&JournalLine { line: n + 1, n, at: Time::from_secs(time), event, hash: String::new() });
        }
        if events.peek().is_none() {
            break;
        }
        checker.pose(0, Time::from_secs(at), &if at < BACK { forth(at) } else { back(at) }.into());
    }
    checker.end().1.into_iter().filter(|v| v.invariant == "I22").collect()
}

/// The same of a retreat that ends as one should.
fn back(q: impl Fn(f64) -> [f64; 2], end: f64) -> String {
    found(q, end, Outcome::RolledBack, vec![]).iter().map(|v| v.what.clone()).collect()
}

#[test]
fn the_recorded_path_backwards_at_its_rate_is_one() {
    assert_eq!(back(backwards(1.0), 5.5), "");
    // a little late, and with a halt in between, as for another robot
    assert_eq!(back(backwards(0.95), 5.7), "");
    assert_eq!(back(|at| backwards(1.0)(if at < 4.0 { at } else { (at - 2.0).max(4.0) }), 8.0), "");
    // half a degree beside it
    assert_eq!(back(|at| backwards(1.0)(at).map(|q| q + 0.008 * (at - BACK).clamp(0.0, 0.5)), 5.5), "");
}

#[test]
fn another_path_is_none() {
    let straight = |at: f64| [0.3, 0.3].map(|q| q * (1.0 - 0.5 * (at - BACK - 0.06)).clamp(0.0, 1.0));
    assert!(back(straight, 5.5).contains("beside the way"), "{}", back(straight, 5.5));
    let beside = |at: f64| backwards(1.0)(at).map(|q| q + 0.1 * (at - BACK).clamp(0.0, 1.2));
    assert!(back(beside, 5.5).contains("beside the way"));
    // to its beginning at once, and from there to its end
    let reversed = |at: f64| there(COMMIT + (at - BACK - 0.6).max(0.0)).map(|q| q * ((at - BACK) / 0.6).min(1.0));
    let hurries = |at: f64| if at < BACK + 0.6 { [0.3 * (1.0 - (at - BACK) / 0.6); 2] } else { reversed(at) };
    assert!(!back(hurries, 5.5).is_empty());
}

#[test]
fn another_rate_is_none() {
    assert!(back(backwards(0.5), 7.5).contains("was in motion for"), "{}", back(backwards(0.5), 7.5));
    assert!(back(backwards(1.3), 5.0).contains("of its retreat in"), "{}", back(backwards(1.3), 5.0));
    // from way-point to way-point the board goes as it does
    let (robot, kind) = (R.into(), CommandKind::Move);
    let mv = Event::Command {
        robot,
        token: 2,
        writer: Writer::Reflex,
        kind,
        motors: vec![0],
        q: vec![],
        speed: vec![],
        led: false,
    };
    assert_eq!(found(backwards(0.5), 7.5, Outcome::RolledBack, vec![(BACK, mv)]), []);
}

/// A board that had to be told twice to stop is late with set-points as well, and is waited for at every step. Where the retreat
/// leads is judged all the same.
#[test]
fn a_board_that_is_late_may_take_its_time() {
    let stop = |at: f64| {
        let (robot, kind) = (R.into(), CommandKind::Stop);
        let (motors, q, speed) = (vec![], vec![], vec![]);
        (at, Event::Command { robot, token: 2, writer: Writer::Reflex, kind, motors, q, speed, led: false })
    };
    let of =
        |back: &dyn Fn(f64) -> [f64; 2], stops: Vec<(f64, Event)>| found(back, 7.5, Outcome::RolledBack, stops).len();
    assert_eq!(of(&backwards(0.5), vec![stop(STOP)]), 1, "it heeded");
    assert_eq!(of(&backwards(0.5), vec![stop(STOP), stop(STOP + 0.15)]), 0);
    let beside = |at: f64| backwards(0.5)(at).map(|q| q + 0.1 * (at - BACK).clamp(0.0, 1.2));
    assert_eq!(of(&beside, vec![stop(STOP), stop(STOP + 0.15)]), 1);
}

/// A board that is very late shows no motion before it is stopped, and then sets out after all, until the stop and the set-points reach
/// it: it has no way to retrace. One that had begun has.
#[test]
fn a_board_that_sets_out_late_has_no_way_to_retrace() {
    let judged = |begins: f64| {
        let late = move |at: f64| {
            let away = (at - begins).clamp(0.0, 0.5) - (at - begins - 0.7).clamp(0.0, 0.5);
            [0.0, 0.3 * away]
        };
        gone(late, late, 5.5, Outcome::RolledBack, vec![]).len()
    };
    assert_eq!(judged(BACK + 0.05), 0);
    assert_eq!(judged(BACK - 0.1), 1, "it had begun, and went on during the retreat");
}

/// Each halt for another robot costs a little time in motion, and no more.
#[test]
fn a_halt_excuses_half_a_second() {
    let halts = |n: usize| {
        let seen = Time::from_secs(BACK);
        let waits =
            |k| (4.0 + 0.1 * k as f64, Event::RetreatWaits { robot: R.into(), what: "in the way".into(), seen });
        found(backwards(0.63), 7.0, Outcome::RolledBack, (0..n).map(waits).collect()).len()
    };
    assert_eq!((halts(0), halts(1)), (1, 0));
}

#[test]
fn an_encoder_that_jumps_and_readings_that_are_missing_say_nothing() {
    let off = |at: f64| backwards(1.0)(at).map(|q| if at > 4.0 { q + 0.05 } else { q });
    assert_eq!(back(off, 5.5), "");
    let lost = vec![(3.5, Event::Died { actor: "edge/driver".into(), reason: "planted".into() })];
    assert_eq!(found(|at| [0.3 + at - BACK, 0.3], 5.5, Outcome::RolledBack, lost), []);
}

#[test]
fn a_retreat_that_missed_its_end_was_written_to_it() {
    let missed = |last: Vec<(usize, f64)>| {
        let (robot, span) = (|| R.to_string(), (Time::from_secs(BACK), Time::from_secs(5.0)));
        let (writer, motors) = (Writer::Reflex, vec![0, 1]);
        let written = Event::Streamed {
            robot: robot(),
            token: 2,
            writer,
            motors,
            count: 90,
            span,
            greatest_step: 0.5,
            within_limits: true,
            last,
        };
        let (reason, what) = (Hold::RetreatMissed, "the safe pose was not reached in time".into());
        let more = vec![
            (5.0, Event::State { robot: robot(), status: Status::Settling }),
            (8.1, Event::RetreatStopped { robot: robot(), reason, what, seen: Time::from_secs(8.1) }),
            (8.11, written),
        ];
        found(|at| backwards(1.0)(at.min(5.0)), 9.0, Outcome::Faulted, more)
    };
    let short = missed(vec![(0, 0.05), (1, 0.0)]);
    assert!(short.len() == 1 && short[0].what.contains("2.86 deg from its safe pose"), "{short:?}");
    // the robot was sent there, and is not: something holds it
    assert_eq!(missed(vec![(0, 0.001), (1, 0.0)]), []);
    assert_eq!(missed(vec![]), [], "an older journal does not tell");
}

#[test]
fn only_to_let_another_pass_does_it_go_beyond_its_safe_pose() {
    let q = [-0.2, 0.0].into();
    let farther = Event::SafePoseMoved { robot: R.into(), id: CommitId(1), q, recorded: None };
    let alone = found(backwards(1.0), 5.5, Outcome::RolledBack, vec![(BACK, farther.clone())]);
    assert!(alone.len() == 1 && alone[0].what.contains("lets nobody pass"), "{alone:?}");
    let (robot, agent, target) = ("other".to_string(), "explorer".to_string(), Pose::from([0.0, 0.0]));
    let (robot_too, motors) = (robot.clone(), vec![]);
    let commit =
        Event::Commit { robot: robot_too, id: CommitId(1), agent, target, escape: false, motors, stream: false };
    let other = |more: &[Event]| {
        let more = more.iter().map(|event| (3.0, event.clone()));
        let events = [(2.0, commit.clone())].into_iter().chain(more).chain([(BACK, farther.clone())]).collect();
        found(backwards(1.0), 5.5, Outcome::RolledBack, events).len()
    };
    let closed = |cause: Cause| Event::Disabled { robot: robot.clone(), token: 2, cause };
    let enters = |status: Status| Event::State { robot: robot.clone(), status };
    assert_eq!(other(&[closed(Cause::Contact(vec![]))]), 0);
    // an actor of the other's controller died: it is taken back after all, or only holds
    let holds = [closed(Cause::ActorDied("supervise".into())), enters(Status::Holding(Hold::Restarted))];
    assert_eq!(other(&holds), 1);
    assert_eq!(other(&[&holds[..], &[enters(Status::Stopping)]].concat()), 0);
}

/// A move is taken back whole, a stream by no less than its controller says.
#[test]
fn only_a_stream_is_taken_back_to_where_it_was_on_its_way() {
    let to = |at: f64| {
        let (robot, id, q) = (R.into(), CommitId(1), [0.0, 0.0].into());
        vec![(BACK, Event::SafePoseMoved { robot, id, q, recorded: Some(Time::from_secs(at)) })]
    };
    let found = found(backwards(1.0), 5.5, Outcome::RolledBack, to(2.0));
    assert!(found.len() == 1 && found[0].what.contains("a move is taken back whole"), "{found:?}");
}
