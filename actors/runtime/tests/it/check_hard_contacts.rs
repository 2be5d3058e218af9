//! I34: which hard contacts are held against a controller, and which are only counted. I35: how long it may push.

use crate::events::{R, enabled, robot, started};
use mobee_contract::{Cause, CommitId, Event, Time, WorldChange};
use mobee_journal::check::{Checker, HardContactTally};
use mobee_journal::journal::JournalLine;
use mobee_model::{Contact, ShapeId};

type Run = Vec<(f64, Event)>;

const CUP: ShapeId = ShapeId::Object { object: 7, shape: 0 };
const FOREARM: ShapeId = ShapeId::Robot { robot: 0, node: 4, shape: 0 };

fn controller(clearance: Option<f64>) -> Event {
    let stops = clearance.map(|_| 0.5);
    Event::Controller { robot: R.into(), kind: "rollback".into(), reflex: true, undo: None, clearance, stops }
}

fn commit(escape: bool) -> Event {
    let (robot, agent, target) = (R.into(), "explorer".into(), vec![0.1, 0.1].into());
    Event::Commit { robot, id: CommitId(1), agent, target, escape, motors: vec![(0, 0.5)], stream: false }
}

/// Shapes of the hand and another body, so many millimeters apart.
fn hard(node: u16, other: ShapeId, mm: f64) -> Event {
    let pair = (ShapeId::Robot { robot: 0, node, shape: 0 }, other);
    let contact = Contact { pair, distance: mm * 1e-3, points: Default::default() };
    Event::HardContact { robot: R.into(), contact, names: names(node, other) }
}

fn names(node: u16, other: ShapeId) -> (String, String) {
    let other = if other == CUP { "cup#0".to_owned() } else { format!("{other:?}") };
    (format!("arm:hand/{node}#0"), other)
}

fn clear(node: u16, other: ShapeId, mm: f64) -> Event {
    Event::ContactEnded { robot: R.into(), names: names(node, other), depth: Some(mm * 1e-3) }
}

fn moved(object: &str) -> Event {
    Event::World { object: object.into(), what: WorldChange::Moved, class: None, at: None }
}

/// A run under a controller with this clearance.
fn checked(clearance: Option<f64>, rest: Run) -> Checker {
    let mut run: Run =
        vec![(0.0, started()), (0.0, robot(1.0, Vec::new())), (0.0, controller(clearance)), (0.1, enabled(1))];
    run.extend(rest);
    let mut checker = Checker::default();
    for (n, (at, event)) in (0..).zip(run) {
        checker.on(&JournalLine { line: n + 1, n, at: Time::from_secs(at), event, hash: String::new() });
    }
    checker
}

/// How a run breaks this invariant.
fn broken(checker: &Checker, invariant: &str) -> Vec<String> {
    checker.violations().iter().filter(|v| v.invariant == invariant).map(ToString::to_string).collect()
}

/// All hard contacts of a run, and how it breaks I34.
fn judged(clearance: Option<f64>, rest: Run) -> (HardContactTally, Vec<String>) {
    let checker = checked(clearance, rest);
    (checker.hard_contacts(), broken(&checker, "I34"))
}

#[test]
fn who_looks_ahead_and_touches_breaks_it_once_per_contact() {
    let run = vec![
        (5.0, commit(false)),
        (6.0, hard(1, CUP, -0.2)),
        (6.1, hard(2, CUP, -3.0)),
        (7.0, clear(1, CUP, 1.0)),
        (7.0, clear(2, CUP, 44.0)),
        (9.0, hard(1, FOREARM, -0.1)),
    ];
    let (tally, broken) = judged(Some(0.01), run);
    assert_eq!((tally.episodes, tally.avoidable, tally.depth), (2, 2, 0.044));
    assert_eq!(broken.len(), 2, "{broken:?}");
    assert!(broken[0].contains("arm:hand/1#0 touches cup#0, 0.2 mm deep"), "{broken:?}");
    assert!(tally.to_string().starts_with("2 hard contacts, at most 44.0 mm deep: 2 avoidable"), "{tally}");
}

#[test]
fn what_was_put_there_too_late_to_brake_is_not_held_against_it() {
    let after = |edit: Event, secs: f64, shape: ShapeId| {
        judged(Some(0.01), vec![(5.0, commit(false)), (6.0, edit), (6.0 + secs, hard(1, shape, -1.0))])
    };
    let (late, _) = after(moved("cup"), 0.4, CUP);
    assert_eq!((late.episodes, late.unavoidable, late.avoidable), (1, 1, 0));
    for (what, (tally, broken)) in [
        ("it had time to brake", after(moved("cup"), 0.6, CUP)),
        ("another object was moved", after(moved("plate"), 0.1, CUP)),
        ("it touches itself", after(moved("cup"), 0.1, FOREARM)),
    ] {
        assert_eq!((tally.avoidable, broken.len()), (1, 1), "{what}: {tally}");
    }
}

#[test]
fn escapes_and_disturbances_are_excused() {
    let (escape, _) = judged(Some(0.01), vec![(5.0, commit(true)), (6.0, hard(1, CUP, -1.0))]);
    assert_eq!((escape.unavoidable, escape.avoidable), (1, 0));
    let stale = Event::Disabled { robot: R.into(), token: 2, cause: Cause::Stale };
    let died = Event::Died { actor: "arm/model".into(), reason: "killed".into() };
    for event in [stale, died] {
        let after = |secs: f64| {
            let run = vec![(5.0, commit(false)), (6.0, event.clone()), (6.0 + secs, hard(1, CUP, -1.0))];
            judged(Some(0.01), run).0.avoidable
        };
        assert_eq!((after(1.0), after(4.0)), (0, 1), "{event:?}");
    }
}

#[test]
fn contacts_under_algorithm_6_and_in_older_journals_are_counted_only() {
    let run = || vec![(5.0, commit(false)), (6.0, hard(1, CUP, -1.0))];
    let (stated, broken) = judged(Some(0.0), run());
    assert_eq!((stated.episodes, stated.unpromised, broken.len()), (1, 1, 0));
    assert!(stated.to_string().contains("1 under Algorithm 6 (`reserve_mm = 0`)"), "{stated}");
    let (older, broken) = judged(None, run());
    assert_eq!((older.episodes, older.unjudged, broken.len()), (1, 1, 0));
    assert!(older.to_string().contains("not judged"), "{older}");
}

/// A push of 90 N that ends, or not, after so many seconds.
fn pushed(secs: f64, lasting: bool) -> Event {
    Event::Pushed { robot: R.into(), newtons: 90.0, secs, lasting }
}

/// The robot brakes within half a second, and comes back in as long: two seconds are allowed.
#[test]
fn who_goes_on_pushing_breaks_a_promise() {
    let of = |rest: Run| broken(&checked(Some(0.01), rest), "I35");
    let ends = |secs: f64| vec![(5.0, commit(false)), (7.0, pushed(1.0, true)), (6.0 + secs, pushed(secs, false))];
    assert!(of(ends(1.9)).is_empty());
    let told = of(ends(2.1));
    assert!(told.len() == 1 && told[0].contains("pushed something for 2.10 s, with at most 90.0 N"), "{told:?}");
    let escape = vec![(5.0, commit(true)), (9.0, pushed(4.0, false))];
    assert!(of(escape).is_empty(), "an escape sets out in contact");
    let stale = Event::Disabled { robot: R.into(), token: 2, cause: Cause::Stale };
    let blind = vec![(5.0, commit(false)), (7.0, stale), (9.0, pushed(4.0, false))];
    assert!(of(blind).is_empty(), "nobody saw it");
    let end = Event::Ended { reason: "time".into() };
    let open = |end_at: f64| vec![(5.0, commit(false)), (7.0, pushed(1.0, true)), (end_at, end.clone())];
    assert_eq!((of(open(7.5)).len(), of(open(17.0)).len()), (0, 1), "it pushed until the end");
}
