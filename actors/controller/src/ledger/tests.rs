use super::*;
use mobee_contract::{Event, Time};

/// A motion of the second of three motors, from rest at 0.2 to 1.
fn open(retreated: bool) -> Open {
    let safe = Some(SafePose { since: Time::ZERO, q: vec![0.001, 0.2, 0.501].into() });
    let target = vec![0.001, 1.0, 2.0].into();
    let (named, agent) = (vec![1].into(), "a".into());
    let (since, motion) = (Time::ZERO, Motion::Move { due: Time::ZERO });
    Open { id: CommitId(1), agent, target, named, safe, since, motion, cause: None, retreated, extent: Extent::Whole }
}

#[test]
fn the_pose_shows_the_outcome() {
    let shown = |open: &Open, q: f64| open.shown_at(&[0.001, q, 2.0], 0.01);
    let (mut forth, mut back) = (open(false), open(true));
    for (q, outcome) in [(1.005, Outcome::Committed), (1.02, Outcome::Faulted)] {
        assert_eq!(shown(&forth, q), outcome);
        // a robot that came to rest at the target during its retreat has not reached it by the motion
        assert_eq!(shown(&back, q), Outcome::Faulted);
    }
    (forth.target, back.target) = (vec![0.0, 0.205, 0.5].into(), vec![0.0, 0.205, 0.5].into());
    assert_eq!(forth.shown_at(&[0.0, 0.2, 0.5], 0.01), Outcome::Committed);
    assert_eq!(back.shown_at(&[0.0, 0.2, 0.5], 0.01), Outcome::RolledBack);
    back.safe = None;
    assert_eq!(back.shown_at(&[0.0, 0.2, 0.5], 0.01), Outcome::Faulted);
}

#[test]
fn a_settled_transaction_is_recorded_with_its_positions() {
    let ledger = Ledger::new(1);
    let mut book = ledger.book();
    book.open = Some(open(false));
    assert_eq!(book.end_of(CommitId(1)), None);
    let q: Pose = vec![0.0, 0.999, 2.0].into();
    let ended = book.settle(None, q.clone(), 0.01).unwrap();
    assert_eq!((ended.outcome, ended.end()), (Outcome::Committed, MotionEnd::Reached));
    assert_eq!((book.end_of(CommitId(1)), &book.places[..]), (Some(MotionEnd::Reached), &[None, Some(1.0), None][..]));
    assert!(book.settle(None, q.clone(), 0.01).is_none(), "one outcome");
    // the given outcome, whatever the configuration shows
    book.open = Some(Open { id: CommitId(2), ..open(false) });
    assert_eq!(book.settle(Some(Outcome::Faulted), q, 0.01).unwrap().end(), MotionEnd::Failed);
}

/// The journal has the cause of a failed motion, and none for a motion that reached its target after all.
#[test]
fn a_failed_transaction_has_its_cause() {
    for outcome in [Outcome::Committed, Outcome::RolledBack, Outcome::Faulted] {
        let open = Open { cause: Some(Cause::Asked), ..open(false) };
        let events = EndedTransaction { open, outcome, q: vec![0.0; 3].into(), measured: false }.events("r".into());
        let [Event::Outcome { robot, cause, .. }] = events.as_slice() else { panic!("{events:?}") };
        assert_eq!((robot.as_str(), cause.is_some()), ("r", outcome != Outcome::Committed), "{outcome:?}");
    }
}

/// A stream has no event for each set-point: where it was cut off, its latest target is journaled, or `committed`
/// would be journaled far from the last target (I29).
#[test]
fn a_transaction_cut_off_at_its_target_is_journaled_with_it() {
    let ledger = Ledger::new(1);
    let end = |given: Option<Outcome>, q: f64| {
        let mut book = ledger.book();
        book.open = Some(Open { motion: Motion::Stream, ..open(false) });
        let ended = book.settle(given, vec![0.001, q, 2.0].into(), 0.01).unwrap();
        let target = |event: &Event| match event {
            Event::Amended { target, .. } => target[1],
            Event::Outcome { .. } => f64::NAN,
            other => panic!("{other:?}"),
        };
        ended.events("r".into()).iter().map(target).map(|q| q.to_string()).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(end(None, 0.999), "1 NaN");
    assert_eq!(end(None, 0.6), "NaN", "it did not get there");
    assert_eq!(end(Some(Outcome::Committed), 0.999), "NaN", "supervise has told where its stream ended");
}

/// An agent may query the contacts of its motion: of that motion alone, and only if it failed by them.
#[test]
fn contacts_of_a_motion_are_remembered() {
    use mobee_model::ShapeId;
    let contact = |object| {
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object, shape: 0 });
        Contact { pair, distance: 0.005, points: Default::default() }
    };
    let ledger = Ledger::new(1);
    let mut book = ledger.book();
    let mut end = |id: u64, cause: Cause, outcome| {
        book.open = Some(Open { id: CommitId(id), cause: Some(cause), ..open(false) });
        book.settle(Some(outcome), vec![0.0; 3].into(), 0.01);
    };
    end(1, Cause::Contact(vec![contact(1)]), Outcome::RolledBack);
    end(2, Cause::Contact(vec![contact(2), contact(3)]), Outcome::Faulted);
    end(3, Cause::Contact(vec![contact(4)]), Outcome::Committed);
    end(4, Cause::TargetMissed, Outcome::RolledBack);
    let met = [1, 2, 3, 4, 5].map(|id| book.contacts_of(CommitId(id)).map(<[Contact]>::to_vec));
    assert_eq!(met, [Some(vec![contact(1)]), Some(vec![contact(2), contact(3)]), None, None, None]);
}

#[test]
fn configuration_and_motion_in_progress_are_available() {
    let ledger = Ledger::new(1);
    let mut book = ledger.book();
    assert_eq!((book.motion(), book.last_known()), (None, None));
    book.open = Some(open(false));
    book.places = vec![None, Some(0.3), None].into();
    let motion = book.motion().unwrap();
    assert_eq!((motion.id, &motion.named[..], &motion.places), (CommitId(1), &[1][..], &book.places));
    assert_eq!(motion.safe, open(false).safe);
    assert_eq!(book.last_known(), Some(open(false).target), "nothing was recorded: where it was sent");
    let sample = mobee_contract::Sample {
        seq: 1,
        at: Time(1),
        q: vec![0.0, 0.4, 0.0].into(),
        done: vec![true; 3],
        external: Vec::new(),
        contact_n: 0.0,
    };
    book.history.push(&mut crate::pulse::Pulse::new(sample, &Vec::new().into()), std::time::Duration::MAX);
    assert_eq!(book.last_known(), Some(vec![0.0, 0.4, 0.0].into()));
}

/// A retreat that succeeds after its outcome was given leaves the named motors at their commanded positions, or where
/// they were safe.
#[test]
fn a_late_retreat_leaves_the_motors_at_home() {
    let ledger = Ledger::new(1);
    let mut book = ledger.book();
    book.open = Some(open(false));
    let mut motion = book.motion().unwrap();
    book.places = vec![Some(7.0), Some(8.0), Some(9.0)].into();
    motion.places = vec![None, Some(0.204), None].into();
    book.send_home(&motion, 0.01);
    assert_eq!(book.places[..], [Some(7.0), Some(0.204), Some(9.0)], "within half of the tolerance it is its place");
    motion.places = vec![None, Some(0.206), None].into();
    book.send_home(&motion, 0.01);
    assert_eq!(book.places[..], [Some(7.0), Some(0.2), Some(9.0)]);
    book.send_home(&Underway { safe: None, ..motion }, 0.01);
    assert_eq!(book.places[..], [Some(7.0), Some(0.2), Some(9.0)]);
}

#[test]
fn the_newest_hundred_ends_are_remembered() {
    let ledger = Ledger::new(1);
    let mut book = ledger.book();
    for id in 1..=150 {
        book.open = Some(Open { id: CommitId(id), ..open(false) });
        book.settle(Some(Outcome::Committed), vec![0.0; 3].into(), 0.01);
    }
    let end = |id| book.end_of(CommitId(id));
    assert_eq!((end(51), end(150)), (Some(MotionEnd::Reached), Some(MotionEnd::Reached)));
    assert_eq!((end(50), end(151)), (Some(MotionEnd::Failed), Some(MotionEnd::Failed)), "forgotten, or never begun");
}

/// Three motors, of which the second and third were named; their commanded positions were 0, none and 0.5.
#[test]
fn places_are_those_that_the_outcome_leaves() {
    let mut open = Open { named: Vec::new().into(), ..open(false) };
    open.name(&[2]);
    open.name(&[1, 2]);
    assert_eq!(open.named[..], [1, 2]);
    let before = [Some(0.0), None, Some(0.5)];
    let after = |outcome, q: [f64; 3]| open.places_after(&before, outcome, &q, 0.01).to_vec();
    assert_eq!(after(Outcome::Committed, [0.0, 0.999, 2.001]), [Some(0.0), Some(1.0), Some(2.0)]);
    assert_eq!(after(Outcome::RolledBack, [0.0, 0.201, 0.499]), [Some(0.0), Some(0.2), Some(0.5)]);
    assert_eq!(after(Outcome::Faulted, [0.0, 0.7, 0.9]), [Some(0.0), Some(0.7), Some(0.9)]);
    // never commanded, and not named now
    assert_eq!(open.places_after(&[], Outcome::Faulted, &[0.0, 0.7, 0.9], 0.01).to_vec()[0], None);
}
