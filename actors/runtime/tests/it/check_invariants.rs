//! Every invariant has a good journal that passes and a planted fault that is found, by name and line.

use crate::events::{R, disabled, enabled, ended, started};
use mobee_contract::{
    Cause, CommandKind, CommitId, EdgeState, Entry, Event, Hold, MotionEnd, Note, Outcome, Pose, Refusal, Status, Time,
    WorldChange, Writer,
};
use mobee_journal::check::{Checker, Violation, check, check_events, summary};
use mobee_journal::journal::{Journal, JournalLine, NOT_FINITE};
use mobee_model::{Contact, ShapeId};
use serde_json::json;
use std::sync::Arc;

fn pose(q: &[f64]) -> Pose {
    q.into()
}

fn robot() -> Event {
    crate::events::robot(1.0, Vec::new())
}

fn safe(q: &[f64]) -> Event {
    Event::SafePose { robot: R.into(), q: pose(q), age: 0.01, speed: 0.0, free: true }
}
fn commit(id: u64, q: &[f64]) -> Event {
    commit_of(id, q, &[(0, 0.5), (1, 0.5)])
}
/// A commit that names these motors, each with its greatest speed.
fn commit_of(id: u64, q: &[f64], motors: &[(usize, f64)]) -> Event {
    let (robot, agent, target) = (R.into(), "explorer".into(), pose(q));
    Event::Commit { robot, id: CommitId(id), agent, target, escape: false, motors: motors.to_vec(), stream: false }
}
fn outcome(id: u64, outcome: Outcome, q: &[f64], safe: &[f64]) -> Event {
    Event::Outcome { robot: R.into(), id: CommitId(id), outcome, q: pose(q), safe: Some(pose(safe)), cause: None }
}
fn command(writer: Writer, token: u64, kind: CommandKind, q: &[f64]) -> Event {
    let q: Vec<(usize, f64)> = q.iter().copied().enumerate().collect();
    let speed = q.iter().map(|(m, _)| (*m, 0.5)).collect();
    let motors = q.iter().map(|(m, _)| *m).collect();
    Event::Command { robot: R.into(), token, writer, kind, motors, q, speed, led: false }
}
fn streamed(writer: Writer, token: u64, from: f64, to: f64) -> Event {
    let span = (Time::from_secs(from), Time::from_secs(to));
    let (robot, motors, last) = (R.into(), vec![0], vec![(0, 0.0)]);
    Event::Streamed { robot, token, writer, motors, count: 10, span, greatest_step: 0.5, within_limits: true, last }
}
fn contact(during: Status) -> Event {
    contact_at(0.008, during)
}
fn contact_at(distance: f64, during: Status) -> Event {
    let shape = |node| ShapeId::Robot { robot: 0, node, shape: 0 };
    let other = if during == Status::Retreating { 3 } else { 2 };
    let contact = Contact { pair: (shape(1), shape(other)), distance, points: Default::default() };
    Event::ContactBegan { robot: R.into(), contact, names: ("hand".into(), "table".into()), during }
}
fn contact_ended() -> Event {
    Event::ContactEnded { robot: R.into(), names: ("hand".into(), "table".into()), depth: None }
}
fn note(note: Note) -> Event {
    Event::Note { robot: R.into(), note }
}
fn vertex(id: u32, q: &[f64]) -> Event {
    note(Note::Vertex { id, q: q.to_vec(), at: [0.0; 3] })
}
fn edge(from: u32, to: u32, state: EdgeState) -> Event {
    note(Note::Edge { from, to, state, cause: None })
}
fn plan(path: &[u32]) -> Event {
    note(Note::Plan { path: path.to_vec() })
}
fn retreat_stopped(seen: f64) -> Event {
    let (reason, what) = (Hold::RetreatBlocked, "hand meets post".to_string());
    Event::RetreatStopped { robot: R.into(), reason, what, seen: Time::from_secs(seen) }
}
fn restarted(actor: &str) -> Event {
    Event::Restarted { actor: actor.into(), restarts: 1 }
}
fn link(sent: u64) -> Event {
    Event::Link { link: "samples".into(), sent, handled: 7, queued: 1, dropped: 2, most: 0, capacity: 0 }
}

type Run = Vec<(f64, Event)>;

/// A run with everything in it and nothing wrong: to a vertex, a rollback from an edge, a blocked retreat, an escape, a
/// restart, and on.
fn good() -> Run {
    let (a, b) = ([0.0, 0.0], [0.5, 0.5]);
    vec![
        (0.0, started()),
        (0.0, robot()),
        (0.1, safe(&[0.2, 0.2])),
        (0.1, enabled(1)),
        (0.2, vertex(0, &a)),
        (0.2, vertex(1, &b)),
        (0.2, edge(0, 1, EdgeState::Optimistic)),
        (0.3, commit(1, &a)),
        (0.3, command(Writer::Agent, 1, CommandKind::Move, &a)),
        (1.0, outcome(1, Outcome::Committed, &a, &[0.2, 0.2])),
        (1.0, safe(&a)),
        (1.1, plan(&[0, 1])),
        (1.1, commit(2, &b)),
        (1.1, command(Writer::Agent, 1, CommandKind::Move, &b)),
        (1.5, contact(Status::Moving)),
        (1.5, disabled(2)),
        (1.5, command(Writer::Reflex, 2, CommandKind::Stop, &[])),
        (1.6, command(Writer::Reflex, 2, CommandKind::Mode, &[])),
        (2.0, streamed(Writer::Reflex, 2, 1.6, 1.9)),
        (2.0, outcome(2, Outcome::RolledBack, &[0.001, 0.0], &a)),
        (2.0, edge(0, 1, EdgeState::Removed)),
        (2.0, safe(&a)),
        (2.0, enabled(3)),
        (2.1, plan(&[0, 2, 1])),
        (2.1, commit(3, &[0.1, 0.1])),
        (2.1, command(Writer::Agent, 3, CommandKind::Move, &[0.1, 0.1])),
        (2.3, disabled(4)),
        (2.3, Event::RetreatBegan { robot: R.into(), id: CommitId(3), poses: 10, secs: 0.2, near: vec![] }),
        (2.3, command(Writer::Reflex, 4, CommandKind::Move, &a)),
        (2.4, contact(Status::Retreating)),
        (2.41, command(Writer::Reflex, 4, CommandKind::Stop, &[])),
        (2.41, retreat_stopped(2.4)),
        (2.5, outcome(3, Outcome::Faulted, &[0.05, 0.05], &a)),
        (3.0, enabled(5)),
        (
            3.0,
            Event::Commit {
                robot: R.into(),
                id: CommitId(4),
                agent: "explorer".into(),
                target: pose(&[0.04, 0.04]),
                escape: true,
                motors: vec![(0, 0.5), (1, 0.5)],
                stream: false,
            },
        ),
        (3.0, command(Writer::Agent, 5, CommandKind::Move, &[0.04, 0.04])),
        (
            3.5,
            Event::Outcome {
                robot: R.into(),
                id: CommitId(4),
                outcome: Outcome::Committed,
                q: pose(&[0.04, 0.04]),
                safe: None,
                cause: None,
            },
        ),
        (3.6, disabled(6)),
        (3.6, restarted("edge/driver")),
        (3.6, command(Writer::Driver, 6, CommandKind::Stop, &[])),
        (3.7, safe(&[0.04, 0.04])),
        (3.7, enabled(7)),
        (3.8, commit(5, &a)),
        (3.8, command(Writer::Agent, 7, CommandKind::Move, &a)),
        (4.0, outcome(5, Outcome::Committed, &a, &[0.04, 0.04])),
        (4.0, safe(&a)),
        (5.0, link(10)),
        (5.0, ended()),
    ]
}

fn run(events: Run) -> Vec<Violation> {
    check_events(events.into_iter().map(|(at, e)| (Time::from_secs(at), Arc::new(e))))
}

/// The run with events put in after the one with this index.
fn with(after: &Event, events: &[Event]) -> Run {
    let mut run = good();
    let i = run.iter().rposition(|(_, e)| e == after).expect("no such event");
    let at = run[i].0;
    run.splice(i + 1..=i, events.iter().map(|e| (at, e.clone())));
    run
}

/// The run with an event replaced.
fn instead(of: &Event, event: Event) -> Run {
    let mut run = good();
    let i = run.iter().rposition(|(_, e)| e == of).expect("no such event");
    run[i].1 = event;
    run
}

fn without(event: &Event) -> Run {
    let mut run = good();
    run.retain(|(_, e)| e != event);
    run
}

/// Exactly this invariant is broken, and the place is the planted event's (or the end, if none is given).
#[track_caller]
fn broken(invariant: &str, events: Run, at: Option<&Event>, says: &str) {
    let line = at.map(|e| events.iter().rposition(|(_, x)| x == e).unwrap() as u64 + 1);
    let found = run(events);
    assert!(!found.is_empty(), "nothing found");
    assert!(found.iter().all(|v| v.invariant == invariant), "{found:#?}");
    assert!(found.iter().any(|v| v.what.contains(says) && line.is_none_or(|l| l == v.line)), "{found:#?}");
}

#[test]
fn a_good_run_breaks_nothing() {
    assert_eq!(run(good()), []);
}

#[test]
fn i1_an_agents_command_while_the_filter_is_closed() {
    let bad = command(Writer::Agent, 1, CommandKind::Stop, &[]);
    broken("I1", with(&disabled(2), std::slice::from_ref(&bad)), Some(&bad), "closed under 2");
}

#[test]
fn i1_the_reflex_under_an_old_token_or_through_an_open_filter() {
    let old = command(Writer::Reflex, 2, CommandKind::Stop, &[]);
    broken("I1", with(&disabled(4), std::slice::from_ref(&old)), Some(&old), "under token 2");
    let open = command(Writer::Reflex, 3, CommandKind::Stop, &[]);
    broken("I1", with(&enabled(3), std::slice::from_ref(&open)), Some(&open), "open under 3");
}

#[test]
fn i1_a_stream_that_outlives_its_token() {
    let late = streamed(Writer::Reflex, 2, 1.6, 2.05);
    broken("I1", with(&enabled(3), std::slice::from_ref(&late)), Some(&late), "after it ended");
    let agent = streamed(Writer::Agent, 2, 1.6, 1.7);
    broken("I1", instead(&streamed(Writer::Reflex, 2, 1.6, 1.9), agent.clone()), Some(&agent), "not its own");
}

#[test]
fn i1_a_stream_told_after_its_token_ended_is_judged_by_when_it_was_written() {
    assert_eq!(run(with(&enabled(3), &[streamed(Writer::Reflex, 2, 1.7, 1.9)])), []);
}

#[test]
fn i1_tokens_only_grow_and_the_driver_only_stops() {
    broken("I1", with(&enabled(1), &[disabled(1)]).into_iter().take(5).collect(), None, "only grow");
    let bad = command(Writer::Driver, 6, CommandKind::Reference, &[]);
    broken("I1", with(&disabled(6), std::slice::from_ref(&bad)), Some(&bad), "only stop");
}

#[test]
fn i1_supervise_itself_stops_while_the_filter_is_closed_and_no_more() {
    let stop = command(Writer::Supervise, 2, CommandKind::Stop, &[]);
    assert_eq!(run(with(&disabled(2), std::slice::from_ref(&stop))), []);
    let moves = command(Writer::Supervise, 2, CommandKind::Move, &[0.0, 0.0]);
    broken("I1", with(&disabled(2), std::slice::from_ref(&moves)), Some(&moves), "supervise itself wrote a `move`");
    let open = command(Writer::Supervise, 3, CommandKind::Stop, &[]);
    broken("I1", with(&enabled(3), std::slice::from_ref(&open)), Some(&open), "open under 3");
    let stream = streamed(Writer::Supervise, 2, 1.6, 1.9);
    broken("I1", instead(&streamed(Writer::Reflex, 2, 1.6, 1.9), stream.clone()), Some(&stream), "not its own");
}

#[test]
fn i2_a_second_outcome_a_missing_one_and_a_stray_one() {
    let twice = outcome(5, Outcome::Committed, &[0.0, 0.0], &[0.04, 0.04]);
    broken("I2", with(&twice, std::slice::from_ref(&twice)), Some(&twice), "second outcome");
    let cut: Run = good().into_iter().filter(|(at, e)| *at < 4.0 || matches!(e, Event::Ended { .. })).collect();
    broken("I2", cut, None, "commit 5 has no outcome");
    let stray = outcome(9, Outcome::Committed, &[0.0, 0.0], &[0.0, 0.0]);
    broken("I2", with(&link(10), std::slice::from_ref(&stray)), Some(&stray), "not open");
}

#[test]
fn i2_a_commit_that_is_open_at_the_end_is_no_fault_of_a_run_that_was_cut_off() {
    let mut cut: Run = good().into_iter().take_while(|(at, _)| *at < 3.9).collect();
    assert_eq!(run(cut.clone()), []);
    cut.push((4.0, ended()));
    broken("I2", cut, None, "no outcome");
}

#[test]
fn i2_an_amendment_of_a_commit_that_is_not_open() {
    let bad =
        Event::Amended { robot: R.into(), id: CommitId(4), target: pose(&[0.0, 0.0]), motors: vec![], stream: false };
    broken("I2", with(&disabled(6), std::slice::from_ref(&bad)), Some(&bad), "not open");
}

#[test]
fn i3_a_rollback_that_ends_away_from_the_safe_pose() {
    let good = outcome(2, Outcome::RolledBack, &[0.001, 0.0], &[0.0, 0.0]);
    let bad = outcome(2, Outcome::RolledBack, &[0.003, 0.0], &[0.0, 0.0]);
    broken("I3", instead(&good, bad.clone()), Some(&bad), "from its safe pose");
    let other = outcome(2, Outcome::RolledBack, &[0.001, 0.0], &[0.001, 0.0]);
    broken("I3", instead(&good, other.clone()), Some(&other), "not the last safe pose");
}

/// A rollback in the second motion of a run that is on the map from the first.
fn rollback(moved: bool, on_map: bool, home: &[f64]) -> Run {
    let first = if on_map { [0.0, 0.0] } else { [0.3, 0.3] };
    let mut run: Run = good().into_iter().take(7).collect();
    run.extend([(0.3, commit(1, &first)), (1.0, outcome(1, Outcome::Committed, &first, &[0.2, 0.2]))]);
    run.extend([(1.0, safe(if moved { &first } else { home })), (1.1, commit(2, &[0.5, 0.5]))]);
    if moved {
        run.push((1.2, Event::SafePoseMoved { robot: R.into(), id: CommitId(2), q: pose(home), recorded: None }));
    }
    run.extend([(2.0, outcome(2, Outcome::RolledBack, home, home)), (2.0, ended())]);
    run
}

#[test]
fn i3_a_rollback_from_the_map_ends_at_a_vertex() {
    assert_eq!(run(rollback(false, true, &[0.001, 0.0])), []);
    broken("I3", rollback(false, true, &[0.01, 0.0]), None, "from the nearest vertex");
}

#[test]
fn i3_a_moved_safe_pose_and_a_start_off_the_map_are_no_vertices() {
    assert_eq!(run(rollback(true, true, &[0.2, 0.2])), []);
    assert_eq!(run(rollback(false, false, &[0.3, 0.3])), []);
}

#[test]
fn i4_a_dishonest_safe_pose() {
    let bad = |age, speed, free| Event::SafePose { robot: R.into(), q: pose(&[0.0, 0.0]), age, speed, free };
    for (event, says) in
        [(bad(0.11, 0.0, true), "s old"), (bad(0.0, 0.02, true), "deg/s"), (bad(0.0, 0.0, false), "in contact")]
    {
        broken("I4", instead(&safe(&[0.04, 0.04]), event.clone()).into_iter().take(41).collect(), Some(&event), says);
    }
    let in_motion = safe(&[0.0, 0.0]);
    broken("I4", with(&commit(2, &[0.5, 0.5]), &[in_motion]), None, "transaction open");
}

/// What is found where an event follows readings every 10 ms: 0.2 s at rest, then so long at this speed of the first motor, rad/s.
fn after_readings(speed: f64, secs: f64, event: &dyn Fn(f64) -> Event) -> Vec<&'static str> {
    let mut checker = Checker::default();
    let line = |at: f64, event| JournalLine { line: 1, n: 0, at: Time::from_secs(at), event, hash: String::new() };
    checker.on(&line(0.0, robot()));
    let (mut at, mut q) = (0.0, 0.0);
    while at < 0.2 + secs {
        at += 0.01;
        q = speed * (at - 0.2_f64).max(0.0);
        checker.pose(0, Time::from_secs(at), &pose(&[q, 0.0]));
    }
    checker.on(&line(at, event(q)));
    let found = checker.violations().iter().map(|v| v.invariant);
    found.filter(|i| ["I4", "I17"].contains(i)).collect()
}

#[test]
fn i4_a_safe_pose_that_was_told_to_rest_while_the_poses_moved() {
    let told = |q: f64| safe(&[q, 0.0]);
    assert_eq!(after_readings(0.1, 0.1, &told), ["I4"]);
    assert!(after_readings(0.005, 0.1, &told).is_empty());
    // it was taken from a reading before the robot moved
    let earlier = |_: f64| Event::SafePose { robot: R.into(), q: pose(&[0.0; 2]), age: 0.055, speed: 0.0, free: true };
    assert!(after_readings(0.1, 0.05, &earlier).is_empty());
}

#[test]
fn i17_an_outcome_is_judged_by_the_reading_that_it_was_given_by() {
    assert_eq!(after_readings(0.1, 0.1, &|q| outcome(1, Outcome::Faulted, &[q, 0.0], &[0.0; 2])), ["I17"]);
    assert_eq!(after_readings(0.1, 0.1, &|_| outcome(1, Outcome::Faulted, &[9.0, 0.0], &[0.0; 2])), ["I17"]);
    assert!(after_readings(0.1, 0.1, &|_| outcome(1, Outcome::Faulted, &[0.0; 2], &[0.0; 2])).is_empty());
    assert!(after_readings(0.005, 0.1, &|q| outcome(1, Outcome::Faulted, &[q, 0.0], &[0.0; 2])).is_empty());
}

#[test]
fn i4_a_controller_without_a_reflex_calls_no_pose_free() {
    let told = Event::Controller {
        robot: R.into(),
        kind: "fields".into(),
        reflex: false,
        undo: None,
        clearance: None,
        stops: None,
    };
    let touching = Event::SafePose { robot: R.into(), q: pose(&[0.04, 0.04]), age: 0.01, speed: 0.0, free: false };
    let mut events = instead(&safe(&[0.04, 0.04]), touching.clone());
    broken("I4", events.clone(), Some(&touching), "in contact");
    events.insert(2, (0.0, told));
    assert_eq!(run(events.clone()), []);
    // once it has one again, so has the promise
    events.insert(
        3,
        (
            0.0,
            Event::Controller {
                robot: R.into(),
                kind: "rollback".into(),
                reflex: true,
                undo: None,
                clearance: None,
                stops: None,
            },
        ),
    );
    broken("I4", events, Some(&touching), "in contact");
}

#[test]
fn i4_a_commit_without_a_safe_pose_and_an_escape_with_one() {
    let run: Run = vec![(0.0, robot()), (0.1, commit(1, &[0.0, 0.0]))];
    broken("I4", run, None, "without a safe pose");
    let mut run = good();
    for (_, event) in &mut run {
        if let Event::Outcome { id: CommitId(4), safe, .. } = event {
            *safe = Some(pose(&[0.0, 0.0]));
        }
    }
    broken("I4", run, None, "was an escape");
}

#[test]
fn i5_values_beyond_the_limits() {
    let mv = command(Writer::Agent, 1, CommandKind::Move, &[0.5, 0.5]);
    for (q, says) in [([0.5, 1.00001], "motor b"), ([-1.1, 0.0], "motor a"), ([0.0, f64::NAN], "motor b")] {
        let mut run = good();
        let i = run.iter().position(|(_, e)| *e == mv).unwrap();
        run[i].1 = command(Writer::Agent, 1, CommandKind::Move, &q);
        let found = self::run(run);
        assert!(found.len() == 1 && found[0].invariant == "I5" && found[0].what.contains(says), "{found:?}");
    }
    let mut lift = instead(&mv, command(Writer::Agent, 1, CommandKind::Move, &[0.5, 1.1]));
    let described =
        lift.iter_mut().find_map(|(_, e)| if let Event::Robot { sliding, .. } = e { Some(sliding) } else { None });
    described.unwrap().push(1);
    broken("I5", lift, None, "motor b was sent to 63.0254 mm, outside -57.2958 to 57.2958 mm");
    let far = commit(2, &[0.5, 1.1]);
    broken("I5", instead(&commit(2, &[0.5, 0.5]), far.clone()), Some(&far), "motor b");
    // what a commit does not name may stand beyond a limit; what it has named is looked at as long as it is open
    let sags = commit_of(2, &[0.5, 1.1], &[(0, 0.5)]);
    let found = run(instead(&commit(2, &[0.5, 0.5]), sags));
    assert!(found.iter().all(|found| found.invariant != "I5"), "{found:?}");
    let ended = Event::Amended {
        robot: R.into(),
        id: CommitId(2),
        target: pose(&[0.5, 1.1]),
        motors: Vec::new(),
        stream: true,
    };
    let found = run(with(&commit(2, &[0.5, 0.5]), std::slice::from_ref(&ended)));
    assert!(found.iter().any(|found| found.invariant == "I5" && found.what.contains("motor b")), "{found:?}");
    let short = commit(2, &[0.5]);
    broken("I5", instead(&commit(2, &[0.5, 0.5]), short.clone()), Some(&short), "1 motors");
}

#[test]
fn i5_too_fast() {
    let mut run = good();
    for (_, event) in &mut run {
        if let Event::Command { speed, token: 7, .. } = event {
            speed[0].1 = 2.1;
        }
    }
    broken("I5", run, None, "motor a was given");
    let mut run = good();
    for (_, event) in &mut run {
        if let Event::Streamed { greatest_step, .. } = event {
            *greatest_step = 1.01;
        }
    }
    broken("I5", run, None, "greatest step");
}

#[test]
fn i5_what_could_not_be_written_as_json() {
    let bad = Event::Warning { text: format!("{NOT_FINITE}{{}}") };
    broken("I5", with(&link(10), std::slice::from_ref(&bad)), Some(&bad), "not finite");
}

#[test]
fn i6_counters_that_do_not_add_up() {
    broken("I6", instead(&link(10), link(11)), Some(&link(11)), "11 sent");
}

#[test]
fn i9_a_contact_on_the_retreat_that_does_not_stop_it() {
    broken("I9", without(&retreat_stopped(2.4)), None, "did not stop it");
    let mut late = good();
    let i = late.iter().position(|(_, e)| *e == contact(Status::Retreating)).unwrap();
    late[i].0 = 2.35;
    broken("I9", late, Some(&retreat_stopped(2.4)), "60.0 ms");
    broken("I9", instead(&retreat_stopped(2.4), retreat_stopped(2.38)), None, "30.0 ms");
}

#[test]
fn i9_a_graze_may_pass_but_a_touch_may_not() {
    let mut run = good();
    run.retain(|(_, e)| !matches!(e, Event::RetreatStopped { .. }));
    let i = run.iter().position(|(_, e)| *e == contact(Status::Retreating)).unwrap();
    run[i].1 = contact_at(0.0095, Status::Retreating);
    assert_eq!(self::run(run.clone()), []);
    let Event::ContactBegan { robot, contact, names, .. } = contact_at(0.0, Status::Retreating) else { return };
    let hard = Event::HardContact { robot: robot.clone(), contact, names };
    let retreating = Event::State { robot, status: Status::Retreating };
    run.splice(i + 1..=i, [(2.4, retreating), (2.4, hard)]);
    broken("I9", run, None, "did not stop it");
}

/// The good run, but for its second retreat, which begins with a pair at this distance and touches at that one; it is driven on.
fn touching(start: f64, touch: f64) -> Vec<(f64, Event)> {
    let mut run = good();
    run.retain(|(_, e)| !matches!(e, Event::RetreatStopped { .. }));
    let Event::ContactBegan { contact: start, .. } = contact_at(start, Status::Retreating) else { unreachable!() };
    let Event::ContactBegan { robot, contact, names, during } = contact_at(touch, Status::Retreating) else {
        unreachable!()
    };
    for (_, event) in &mut run {
        if let Event::RetreatBegan { near, .. } = event {
            near.push(start);
        }
    }
    let i = run.iter().position(|(_, e)| *e == self::contact(Status::Retreating)).unwrap();
    let retreating = Event::State { robot: robot.clone(), status: during };
    let hard = Event::HardContact { robot, contact, names };
    run.splice(i..=i, [(2.4, retreating), (2.4, hard)]);
    run
}

#[test]
fn i9_a_pair_that_nearly_touched_as_the_retreat_began_may_touch_but_not_deeper() {
    assert_eq!(run(touching(0.00005, -0.0001)), []);
    assert_eq!(run(touching(-0.003, -0.0039)), []);
    broken("I9", touching(0.00005, -0.0011), None, "did not stop it");
    broken("I9", touching(0.002, -0.0001), None, "did not stop it");
    broken("I9", touching(0.02, 0.0), None, "did not stop it");
}

/// A retreat that waits for another robot has stopped, if that comes in time; once it goes on it is watched again.
#[test]
fn i9_a_retreat_that_waits_has_stopped_until_it_goes_on() {
    let waits =
        |at: f64| (at, Event::RetreatWaits { robot: R.into(), what: "in the way".into(), seen: Time::from_secs(2.4) });
    let with = |more: Vec<(f64, Event)>| {
        let mut run = touching(0.02, 0.0);
        let i = run.iter().position(|(_, e)| matches!(e, Event::HardContact { .. })).unwrap();
        let hard = run[i].1.clone();
        run.splice(
            i + 1..i + 1,
            more.into_iter()
                .map(|(at, e)| if matches!(e, Event::Warning { .. }) { (at, hard.clone()) } else { (at, e) }),
        );
        run
    };
    let again = || Event::Warning { text: "the other presses on".into() };
    let goes_on = || Event::RetreatGoesOn { robot: R.into() };
    assert_eq!(run(with(vec![waits(2.405)])), []);
    assert_eq!(run(with(vec![waits(2.405), (2.41, again())])), [], "that is the other's doing");
    broken("I9", with(vec![waits(2.48)]), None, "stopped it after");
    broken("I9", with(vec![waits(2.405), (2.41, goes_on()), (2.42, again())]), None, "did not stop it");
    // the robots of a joint retreat part: it is stopped, and begins anew from what is near by then
    let stop = |at: f64| (at, command(Writer::Reflex, 4, CommandKind::Stop, &[]));
    let anew =
        |at: f64| (at, Event::RetreatBegan { robot: R.into(), id: CommitId(3), poses: 10, secs: 0.2, near: vec![] });
    assert_eq!(run(with(vec![stop(2.404), anew(2.408)])), []);
    assert_eq!(run(with(vec![stop(2.404), (2.406, again()), anew(2.408)])), [], "it was put there meanwhile");
    broken("I9", with(vec![stop(2.404)]), None, "did not stop it");
    broken("I9", with(vec![anew(2.408)]), None, "did not stop the retreat");
    broken("I9", with(vec![stop(2.48), anew(2.49)]), None, "did not stop the retreat");
    broken("I9", with(vec![stop(2.404), anew(2.406), (2.408, again())]), None, "did not stop it");
}

#[test]
fn i14_a_contact_begins_on_the_retreat_of_both() {
    let of = |robot: &str, mut event: Event| {
        match &mut event {
            Event::Robot { robot: r, .. } | Event::RetreatBegan { robot: r, .. } | Event::Outcome { robot: r, .. } => {
                *r = robot.into();
            }
            other => unreachable!("{other:?}"),
        }
        event
    };
    let began = |robot: &str, near: Vec<Contact>| {
        of(robot, Event::RetreatBegan { robot: R.into(), id: CommitId(1), poses: 10, secs: 0.2, near })
    };
    let Event::ContactBegan { mut contact, names, .. } = contact(Status::Retreating) else { unreachable!() };
    contact.pair.1 = ShapeId::Robot { robot: 1, node: 1, shape: 0 };
    let meet = Event::ContactBegan { robot: R.into(), contact, names, during: Status::Retreating };
    let judged = |events: Vec<Event>| {
        let mut all = vec![(0.0, started()), (0.0, robot()), (0.0, of("other", robot())), (0.0, of("third", robot()))];
        all.extend((1..).zip(events).map(|(at, e)| (f64::from(at), e)));
        run(all).iter().filter(|v| v.invariant == "I14").count()
    };
    assert_eq!(judged(vec![began(R, vec![]), began("other", vec![]), meet.clone()]), 1);
    // they had touched there before; one of them is at home, or has stopped
    assert_eq!(judged(vec![began(R, vec![contact]), began("other", vec![]), meet.clone()]), 0);
    assert_eq!(judged(vec![began(R, vec![]), meet.clone()]), 0);
    let home = of("other", outcome(1, Outcome::RolledBack, &[0.0, 0.0], &[0.0, 0.0]));
    assert_eq!(judged(vec![began(R, vec![]), began("other", vec![]), home, meet.clone()]), 0);
    assert_eq!(judged(vec![began("other", vec![]), began(R, vec![]), retreat_stopped(2.0), meet.clone()]), 0);
    // one of them stays where it is, until it goes on
    let waits = || Event::RetreatWaits { robot: R.into(), what: "in the way".into(), seen: Time::from_secs(2.0) };
    let goes_on = || Event::RetreatGoesOn { robot: R.into() };
    assert_eq!(judged(vec![began(R, vec![]), began("other", vec![]), waits(), meet.clone()]), 0);
    assert_eq!(judged(vec![began(R, vec![]), began("other", vec![]), waits(), goes_on(), meet.clone()]), 1);
    // a third waits, and one of the two goes along with it, as their equal ways tell: it stays as well
    let third = |secs: f64| {
        let (robot, id, near) = ("third".to_string(), CommitId(1), vec![]);
        Event::RetreatBegan { robot, id, poses: 10, secs, near }
    };
    let waits_too = || Event::RetreatWaits { robot: "third".into(), what: "x".into(), seen: Time::from_secs(2.0) };
    let on = || Event::RetreatGoesOn { robot: "third".into() };
    let own = || {
        let (robot, id, near) = ("other".to_string(), CommitId(1), vec![]);
        Event::RetreatBegan { robot, id, poses: 11, secs: 0.3, near }
    };
    assert_eq!(judged(vec![began(R, vec![]), own(), third(0.2), waits_too(), meet.clone()]), 0);
    assert_eq!(judged(vec![began(R, vec![]), own(), third(0.2), waits_too(), on(), meet.clone()]), 1);
    assert_eq!(judged(vec![began(R, vec![]), own(), third(0.4), waits_too(), meet.clone()]), 1);
    // they part: one of them has stopped, until it begins anew
    let parts = || command(Writer::Reflex, 2, CommandKind::Stop, &[]);
    assert_eq!(judged(vec![began(R, vec![]), began("other", vec![]), parts(), meet.clone()]), 0);
    assert_eq!(judged(vec![began(R, vec![]), began("other", vec![]), parts(), began(R, vec![]), meet]), 1);
}

#[test]
fn i19_a_contact_in_mid_motion_that_closes_nothing() {
    let met =
        with(&command(Writer::Agent, 3, CommandKind::Move, &[0.1, 0.1]), &[contact_ended(), contact(Status::Moving)]);
    broken("I19", met, Some(&disabled(4)), "did not close the filter");
}

/// What is put there shows in a reading that is older than it.
#[test]
fn i9_a_reading_shows_nothing_that_was_not_there_yet() {
    let late = |world: Option<f64>| {
        let mut run = good();
        for (at, event) in &mut run {
            match event {
                Event::RetreatStopped { seen, .. } => *seen = Time::from_secs(2.37),
                Event::ContactBegan { during: Status::Retreating, .. } => *at = 2.405,
                _ => {}
            }
        }
        let (object, what) = ("ball".into(), WorldChange::Added);
        let added = Event::World { object, what, class: None, at: None };
        let i = run.iter().position(|(at, _)| *at == 2.405).unwrap();
        world.into_iter().for_each(|at| run.insert(i, (at, added.clone())));
        of(&self::run(run), "I9")
    };
    assert_eq!((late(None), late(Some(2.38)), late(Some(2.4))), (1, 1, 0));
}

#[test]
fn i9_the_reflex_pushes_on() {
    let mv = command(Writer::Reflex, 4, CommandKind::Move, &[0.0, 0.0]);
    broken("I9", with(&retreat_stopped(2.4), std::slice::from_ref(&mv)), Some(&mv), "moved on");
    let stream = streamed(Writer::Reflex, 4, 2.3, 2.45);
    let found = run(with(&outcome(3, Outcome::Faulted, &[0.05, 0.05], &[0.0, 0.0]), &[stream]));
    assert!(found.iter().any(|v| v.invariant == "I9" && v.what.contains("streamed on")), "{found:?}");
}

#[test]
fn i10_motion_after_a_restart() {
    let mv = command(Writer::Agent, 7, CommandKind::Move, &[0.0, 0.0]);
    broken("I10", with(&enabled(7), std::slice::from_ref(&mv)).into_iter().take(43).collect(), None, "edge/driver");
    let early = command(Writer::Agent, 1, CommandKind::Move, &[0.0, 0.0]);
    broken("I10", with(&enabled(1), &[early]), None, "before its first commit");
}

#[test]
fn i10_the_restart_of_an_agent_or_recorder_does_not_hinder_a_rollback() {
    let run = with(&disabled(2), &[restarted("edge/agent"), restarted("recorder"), restarted("other/driver")]);
    assert_eq!(self::run(run), []);
    let run = with(&disabled(2), &[restarted("model")]);
    broken("I10", run, None, "model");
}

#[test]
fn i11_a_plan_over_a_removed_edge() {
    let bad = plan(&[2, 0, 1]);
    broken("I11", with(&link(10), std::slice::from_ref(&bad)), Some(&bad), "0 -> 1");
    assert_eq!(run(with(&link(10), &[plan(&[1, 0]), edge(0, 1, EdgeState::Optimistic), bad.clone()])), []);
    // what the world blocks, until it does no more; and that lifts no removal
    let blocked = edge(2, 0, EdgeState::Blocked);
    let over = plan(&[2, 0]);
    broken("I11", with(&link(10), &[blocked.clone(), over.clone()]), Some(&over), "2 -> 0, which the world blocks");
    assert_eq!(run(with(&link(10), &[blocked, edge(2, 0, EdgeState::Doubtful), over])), []);
    let again = [edge(0, 1, EdgeState::Blocked), edge(0, 1, EdgeState::Doubtful), bad.clone()];
    broken("I11", with(&link(10), &again), Some(&bad), "0 -> 1, which was removed");
}

#[test]
fn a_journal_on_disk_is_checked_and_summed_up() {
    let dir = tempfile::tempdir().unwrap();
    let journal = Journal::create(dir.path(), &json!({})).unwrap();
    let mut sink = journal.sink();
    for (at, event) in good() {
        sink.write(Time::from_secs(at), &Entry::Event(Arc::new(event))).unwrap();
    }
    let report = check(dir.path()).unwrap();
    assert_eq!((report.violations.len(), report.truncated, report.ended.as_deref()), (0, None, Some("done")));
    assert_eq!((report.events, report.hash), (journal.events(), journal.hash()));

    let sum = summary(dir.path()).unwrap();
    assert_eq!((sum.commits, sum.escapes, sum.committed, sum.rolled_back, sum.faulted), (5, 1, 3, 1, 1));
    assert_eq!((sum.contacts, sum.restarts, sum.vertices), (2, 1, 2));
    assert_eq!(sum.edges.into_iter().collect::<Vec<_>>(), [(EdgeState::Removed, 1)]);
    assert_eq!((sum.secs, sum.hash, sum.robots), (5.0, journal.hash(), vec![R.to_string()]));

    let bytes = std::fs::read(journal.path()).unwrap();
    std::fs::write(journal.path(), &bytes[..bytes.len() - 40]).unwrap();
    assert!(!check(dir.path()).unwrap_err().truncated, "it ends before what was known to be on the disk");
    std::fs::remove_file(dir.path().join("journal.seal")).unwrap();
    let report = check(dir.path()).unwrap();
    assert!(report.truncated.is_some() && report.ended.is_none() && report.violations.is_empty());
    assert!(summary(dir.path()).unwrap().truncated.is_some());
    let changed = String::from_utf8(bytes)
        .unwrap()
        .replace("\"id\":2,\"outcome\":\"rolled_back\"", "\"id\":2,\"outcome\":\"committed\"");
    std::fs::write(journal.path(), changed).unwrap();
    assert!(!check(dir.path()).unwrap_err().truncated);
}

/// A run of one motion with its readings 20 ms apart: commits to `motors` at 1 s, which the filter ends at 3 s; where both motors are at
/// a time is `q`.
fn moved(motors: &[(usize, f64)], q: impl Fn(f64) -> [f64; 2]) -> Vec<Violation> {
    moved_on(robot(), motors, q)
}

/// [`moved`] on the board of this description.
fn moved_on(robot: Event, motors: &[(usize, f64)], q: impl Fn(f64) -> [f64; 2]) -> Vec<Violation> {
    let (mut checker, mut n) = (Checker::default(), 0);
    let mut tell = |checker: &mut Checker, at: f64, event: Event| {
        checker.on(&JournalLine { line: n + 1, n, at: Time::from_secs(at), event, hash: String::new() });
        n += 1;
    };
    let events = [
        (0.0, started()),
        (0.0, robot),
        (1.9, safe(&q(1.9))),
        (1.9, enabled(1)),
        (2.0, commit_of(1, &q(4.0), motors)),
        (2.0, command(Writer::Agent, 1, CommandKind::Move, &q(4.0))),
        (4.0, outcome(1, Outcome::Committed, &q(4.0), &q(1.9))),
        (4.0, Event::State { robot: R.into(), status: Status::Rest }),
        (9.0, Event::Warning { text: "the end is near".into() }),
        (9.0, ended()),
    ];
    let mut events = events.into_iter().peekable();
    for k in 0..450 {
        let at = 0.02 * f64::from(k);
        while let Some((time, event)) = events.next_if(|(time, _)| *time <= at) {
            tell(&mut checker, time, event);
        }
        checker.pose(0, Time::from_secs(at), &pose(&q(at)));
    }
    events.for_each(|(at, event)| tell(&mut checker, at, event));
    checker.end().1
}

/// From 2 s on for a second, at this speed.
fn ramp(speed: f64, at: f64) -> f64 {
    speed * (at - 2.0).clamp(0.0, 1.0)
}

fn of(violations: &[Violation], invariant: &str) -> usize {
    violations.iter().filter(|v| v.invariant == invariant).count()
}

#[test]
fn i20_a_motor_that_is_faster_than_its_commit_allows() {
    let run = |speed: f64| moved(&[(0, 0.2)], move |at| [ramp(speed, at), 0.5]);
    assert_eq!(of(&run(0.2), "I20"), 0, "{:?}", run(0.2));
    assert_eq!(of(&run(0.22), "I20"), 1, "{:?}", run(0.22));
    assert!(run(0.22)[0].what.contains("motor a was measured"), "{:?}", run(0.22));
    // one that hardly moves is not faster than encoders tell
    assert_eq!(of(&moved(&[(0, 0.0002)], |at| [ramp(0.0025, at), 0.5]), "I20"), 0);
    // an older journal does not tell what is allowed
    assert_eq!(of(&moved(&[], |at| [ramp(0.9, at), 0.5]), "I20"), 0);
}

#[test]
fn i20_an_encoder_that_lies_is_no_evidence() {
    let noisy = |at: f64| [ramp(0.2, at) + 0.003 * (1e4 * at).sin(), 0.5];
    assert_eq!(of(&moved(&[(0, 0.2)], noisy), "I20"), 0, "{:?}", moved(&[(0, 0.2)], noisy));
    let off = |at: f64| [ramp(0.2, at) + if at > 2.5 { 0.05 } else { 0.0 }, 0.5];
    assert_eq!(of(&moved(&[(0, 0.2)], off), "I20"), 0);
}

#[test]
fn i23_an_edge_that_failed_and_stayed_or_one_that_had_not() {
    let mut run = good();
    for (_, event) in &mut run {
        if let Event::Commit { agent, .. } = event {
            *agent = "edge/agent".into();
        }
    }
    assert_eq!(self::run(run.clone()), []);
    let removed = edge(0, 1, EdgeState::Removed);
    let i = run.iter().position(|(_, e)| *e == removed).unwrap();
    let mut kept = run.clone();
    kept.remove(i);
    let found = self::run(kept.clone());
    assert!(found.len() == 1 && found[0].invariant == "I23" && found[0].what.contains("0 -> 1"), "{found:?}");
    // it was stopped because somebody asked for that
    let mut asked = kept.clone();
    for (_, event) in &mut asked {
        if let Event::Outcome { outcome, cause, .. } = event
            && *outcome != Outcome::Committed
        {
            *cause = Some(Cause::Asked);
        }
    }
    assert_eq!(of(&self::run(asked), "I23"), 0);
    // its agent wanted to stop it, or turn it elsewhere, when the filter was closed already; or asks for something once it is over
    let refused = |refusal: Refusal| Event::Refused { robot: R.into(), agent: "edge/agent".into(), refusal };
    let failed = |e: &Event| matches!(e, Event::Outcome { outcome: Outcome::RolledBack, .. });
    let end = kept.iter().position(|(_, e)| failed(e)).unwrap();
    let died = |actor: &str| Event::Died { actor: actor.into(), reason: "planted".into() };
    let cases = [
        (end, refused(Refusal::Closed), 0),
        (end, refused(Refusal::Busy), 1),
        (end + 1, refused(Refusal::Closed), 1),
        // a stalled agent redirects its motion after the end, and before the notification
        (end + 1, refused(Refusal::Over), 0),
        // the wish may have been lost with the one, and not with the other
        (end, died("edge/supervise"), 0),
        (end, died("edge/reflex"), 1),
    ];
    for (place, event, broken) in cases {
        let mut late = kept.clone();
        late.insert(place, (late[place].0, event.clone()));
        assert_eq!(of(&self::run(late), "I23"), broken, "{event:?} at {place}");
    }
    kept.insert(i, (2.0, edge(1, 0, EdgeState::Removed)));
    let found = self::run(kept);
    assert!(found.len() == 2 && found[0].what.contains("1 -> 0 was removed"), "{found:?}");
    // a successor was told nothing
    run[i].1 = Event::Died { actor: "edge/agent".into(), reason: "planted".into() };
    assert_eq!(of(&self::run(run), "I23"), 0);
}

#[test]
fn i21_a_motor_that_no_commit_names_leaves_its_place() {
    // the other motor walks, as slowly as no other check would see
    let walks = |by: f64| move |at: f64| [ramp(0.2, at), 0.5 + by * at / 9.0];
    assert_eq!(of(&moved(&[(0, 0.2)], walks(0.001)), "I21"), 0);
    let found = moved(&[(0, 0.2)], walks(0.01));
    assert!(of(&found, "I21") >= 1, "{found:?}");
    assert!(found.iter().any(|v| v.what.contains("motor b, which no open commit names")), "{found:?}");
    // named motors go where they are sent, and then stay
    assert_eq!(of(&moved(&[(0, 0.2), (1, 0.2)], |at| [ramp(0.2, at), ramp(0.1, at)]), "I21"), 0);
    // an encoder that jumps says nothing of its motor
    assert_eq!(of(&moved(&[(0, 0.2)], |at| [ramp(0.2, at), if at < 4.0 { 0.5 } else { 0.52 }]), "I21"), 0);
    let later = |at: f64| [ramp(0.2, at), 0.1 * (at - 6.0).clamp(0.0, 1.0)];
    assert_eq!(of(&moved(&[(0, 0.2), (1, 0.2)], later), "I21"), 1);
}

#[test]
fn i31_a_robot_that_is_moved_at_rest_and_stays_open() {
    // both motors are named; one gives way from 6 s on, for a while
    let pushed = |by: f64, lasts: f64| {
        move |at: f64| {
            let away = (6.0..6.0 + lasts).contains(&at);
            [ramp(0.2, at), if away { by } else { 0.0 }]
        }
    };
    let found = moved(&[(0, 0.2), (1, 0.2)], pushed(0.003, 2.0));
    assert_eq!(of(&found, "I31"), 1, "{found:?}");
    assert!(found.iter().any(|v| v.what.contains("motor b was moved by 0.172 deg at rest")), "{found:?}");
    assert_eq!(of(&moved(&[(0, 0.2), (1, 0.2)], pushed(0.0015, 2.0)), "I31"), 0, "within the tolerance");
    assert_eq!(of(&moved(&[(0, 0.2), (1, 0.2)], pushed(0.003, 0.4)), "I31"), 0, "there is time to close");
    // a board that holds within 0.005 rad: a changed load moves a motor by that much
    let compliant = || {
        let mut robot = robot();
        if let Event::Robot { hold_error, .. } = &mut robot {
            *hold_error = 0.005;
        }
        robot
    };
    let found = |by: f64| of(&moved_on(compliant(), &[(0, 0.2), (1, 0.2)], pushed(by, 2.0)), "I31");
    assert_eq!((found(0.006), found(0.009)), (0, 1));
}

#[test]
fn i22_a_contact_in_mid_motion_ends_rolled_back_unless_the_journal_says_why_not() {
    let closing = |cause: Cause| Event::Disabled { robot: R.into(), token: 2, cause };
    let began = Event::RetreatBegan { robot: R.into(), id: CommitId(1), poses: 3, secs: 0.1, near: vec![] };
    let judged = |events: &[Event]| {
        let mut all = vec![(0.0, started()), (0.0, robot()), (0.1, safe(&[0.0, 0.0])), (0.1, enabled(1))];
        all.push((0.2, commit(1, &[0.5, 0.5])));
        all.extend(events.iter().map(|e| (0.5, e.clone())));
        of(&run(all), "I22")
    };
    let back = outcome(1, Outcome::RolledBack, &[0.0, 0.0], &[0.0, 0.0]);
    let faulted = outcome(1, Outcome::Faulted, &[0.2, 0.2], &[0.0, 0.0]);
    let contact = || closing(Cause::Contact(vec![]));
    assert_eq!(judged(&[contact(), began.clone(), back.clone()]), 0);
    assert_eq!(judged(&[contact(), began.clone(), faulted.clone()]), 1);
    assert_eq!(judged(&[contact(), faulted.clone()]), 1);
    assert_eq!(judged(&[contact(), back]), 1, "without a retreat");
    assert_eq!(judged(&[closing(Cause::AgentDied), faulted.clone()]), 1);
    assert_eq!(judged(&[contact(), began.clone(), retreat_stopped(0.5), faulted.clone()]), 0);
    assert_eq!(judged(&[closing(Cause::Asked), faulted.clone()]), 0);
    let again = Event::Disabled { robot: R.into(), token: 4, cause: Cause::Stale };
    assert_eq!(judged(&[contact(), began, again, faulted.clone()]), 0);
    let died = Event::Died { actor: "edge/reflex".into(), reason: "planted".into() };
    assert_eq!(judged(&[contact(), died, faulted]), 0);
}

#[test]
fn i27_a_contact_begins_below_the_margin_and_not_twice() {
    let far = contact_at(0.0101, Status::Moving);
    broken("I27", instead(&contact(Status::Moving), far.clone()), Some(&far), "beyond the margin");
    let again = contact_at(0.007, Status::Moving);
    let ended = &[contact_ended(), again.clone()];
    assert_eq!(of(&run(with(&contact(Status::Moving), ended)), "I27"), 0);
    broken("I27", with(&contact(Status::Moving), std::slice::from_ref(&again)), Some(&again), "a second time");
}

#[test]
fn i28_a_death_that_leaves_the_filter_open() {
    let judged = |actor: &str, closes: f64| {
        let died = Event::Died { actor: actor.into(), reason: "planted".into() };
        let events = [
            (0.0, started()),
            (0.0, robot()),
            (0.1, enabled(1)),
            (1.0, died),
            (closes, disabled(2)),
            (3.0, Event::Warning { text: "later".into() }),
            (4.0, ended()),
        ];
        of(&run(events.to_vec()), "I28")
    };
    for actor in ["model", "edge/driver", "edge/history", "edge/supervise", "edge/reflex"] {
        assert_eq!((judged(actor, 1.15), judged(actor, 1.25)), (0, 1), "{actor}");
    }
    assert_eq!(judged("edge/agent", 2.0), 0);
    assert_eq!(judged("other/driver", 2.0), 0);
}

#[test]
fn i29_an_agent_is_told_the_outcome_once_and_before_it_goes_on() {
    let told = |id, end| Event::Told { robot: R.into(), id: Some(CommitId(id)), end };
    // with what is told after the outcome of the first two commits
    let run = |first: &[Event], second: &[Event]| {
        let mut run = Run::new();
        for (at, mut event) in good() {
            if let Event::Commit { agent, .. } = &mut event {
                *agent = "edge/agent".into();
            }
            let after = match &event {
                Event::Outcome { id: CommitId(1), .. } => first,
                Event::Outcome { id: CommitId(2), .. } => second,
                _ => &[],
            };
            let ended = if let Event::Outcome { id, .. } = &event { id.0 } else { 0 };
            run.push((at, event));
            run.extend(after.iter().map(|e| (at, e.clone())));
            if ended > 2 {
                run.push((at, told(ended, if ended == 3 { MotionEnd::Failed } else { MotionEnd::Reached })));
            }
        }
        let found = self::run(run);
        found.into_iter().filter(|found| found.invariant == "I29").map(|found| found.what).collect::<Vec<_>>()
    };
    let (reached, failed) = (told(1, MotionEnd::Reached), told(2, MotionEnd::Failed));
    let one = std::slice::from_ref;
    assert_eq!(run(one(&reached), one(&failed)), [""; 0]);
    let says = |found: Vec<String>, what: &str| assert!(found.len() == 1 && found[0].contains(what), "{found:?}");
    says(run(one(&reached), &[told(2, MotionEnd::Reached)]), "its outcome is RolledBack");
    says(run(&[told(1, MotionEnd::Failed)], one(&failed)), "its outcome is Committed");
    says(run(one(&reached), &[]), "was not told how commit 2 had ended");
    says(run(&[reached.clone(), reached.clone()], one(&failed)), "a second time");
    says(run(one(&reached), &[failed.clone(), told(3, MotionEnd::Failed)]), "which is not its last");
    let refused = Event::Told { robot: R.into(), id: None, end: MotionEnd::Reached };
    says(run(&[reached.clone(), refused], one(&failed)), "what was refused");
    // a successor is told nothing of a motion that it did not ask for
    let died = Event::Died { actor: "edge/agent".into(), reason: "planted".into() };
    assert_eq!(run(one(&reached), &[died]), [""; 0]);
}

#[test]
fn i29_committed_is_said_at_the_target() {
    let there = outcome(5, Outcome::Committed, &[0.0, 0.0], &[0.04, 0.04]);
    let beside = outcome(5, Outcome::Committed, &[0.0, 0.02], &[0.04, 0.04]);
    let found = run(instead(&there, beside));
    assert!(found.iter().any(|found| found.invariant == "I29" && found.what.contains("1.146 deg away")), "{found:?}");
}
