//! A halt holds the robot from any state until its release, whatever dies or is requested in between.

use super::*;

type Before = fn(&mut Cell);

fn until(cell: &mut Cell, status: Status) {
    for _ in 0..400 {
        if cell.supervise.status() == status {
            return;
        }
        cell.apply(Op::Samples(1));
    }
    panic!("{status:?} is not reached, but {:?}", cell.supervise.status());
}

/// On its way to 1 rad, and about to retreat, since an obstacle came into its way.
fn retreating(cell: &mut Cell) {
    cell.apply(Op::Commit(1.0, true));
    cell.apply(Op::Samples(40));
    cell.wall = Some(cell.q + 0.055);
    until(cell, Status::Stopping);
    cell.wall = None;
    until(cell, Status::Retreating);
    cell.apply(Op::Samples(5));
}

const MOMENTS: [(&str, Before); 7] = [
    ("starting", |_| ()),
    ("at rest", |cell| cell.apply(Op::Samples(30))),
    ("in motion", |cell| {
        cell.apply(Op::Samples(30));
        cell.apply(Op::Commit(1.0, true));
        cell.apply(Op::Samples(20));
    }),
    ("in a stream", |cell| {
        cell.apply(Op::Samples(30));
        cell.apply(Op::Stream(0.5, 10));
    }),
    ("in a retreat", |cell| {
        cell.apply(Op::Samples(30));
        retreating(cell);
    }),
    ("in contact", |cell| {
        cell.apply(Op::Samples(30));
        cell.wall = Some(cell.q);
        cell.apply(Op::Samples(30));
        cell.wall = None;
    }),
    ("at a fault of the board", |cell| {
        cell.apply(Op::Samples(30));
        cell.apply(Op::Fault);
    }),
];

#[test]
fn a_halted_robot_holds_with_its_filter_closed_until_it_is_released() {
    for (name, before) in MOMENTS {
        let mut cell = Cell::new();
        before(&mut cell);
        let token = cell.gate.token();
        cell.apply(Op::Halt);
        assert!(!cell.gate.is_open() && cell.gate.token() > token, "{name}: closed at once, under a new token");
        cell.apply(Op::Samples(60));
        let held = (cell.supervise.status(), cell.supervise.is_settled(), cell.gate.is_open());
        assert_eq!(held, (Status::Holding(Hold::Halted), true, false), "{name}");
        assert_eq!(cell.outcomes.len() as u64, cell.commits, "{name}: the open motion has its outcome");
        let rests = cell.q;
        for dies in [None, Some(Op::SuperviseDies), Some(Op::ReflexDies), Some(Op::AgentDies)] {
            dies.into_iter().for_each(|op| cell.apply(op));
            cell.apply(Op::Samples(60));
            let refused = Err(Refusal::Holding { reason: Hold::Halted });
            assert_eq!(cell.commit(0.3, true), refused, "{name}");
            assert_eq!(cell.stream(true, Values::Velocity(vec![0.3])), refused, "{name}");
            assert!(!cell.supervise.can_recover(), "{name}");
            cell.supervise_on(SuperviseIn::Recover);
            cell.apply(Op::Samples(60));
            let held = (cell.supervise.status(), cell.gate.is_open(), cell.q);
            assert_eq!(held, (Status::Holding(Hold::Halted), false, rests), "{name}");
        }
        cell.apply(Op::Release);
        assert!(!cell.gate.is_open(), "{name}: a fresh reading at rest opens it");
        cell.apply(Op::Samples(60));
        assert_eq!((cell.supervise.status(), cell.gate.is_open(), cell.q), (Status::Rest, true, rests), "{name}");
        assert!(cell.commit(0.3, true).is_ok(), "{name}");
    }
}

/// A retreat that a halt cuts off stops at once. Released in a contact, the robot holds as after any stop there, and
/// the rest of the retreat can be requested.
#[test]
fn a_halted_retreat_stops_and_can_be_requested_after_the_release() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let start = cell.q;
    retreating(&mut cell);
    cell.apply(Op::Halt);
    cell.apply(Op::Samples(2));
    let stopped = cell.q;
    cell.apply(Op::Samples(100));
    assert_eq!((cell.q, cell.outcome), (stopped, Some(Outcome::Faulted)), "it stays where it was stopped");
    assert!((stopped - start).abs() > 0.05, "and not at its safe pose");
    cell.wall = Some(cell.q + 0.055);
    cell.apply(Op::Release);
    cell.apply(Op::Samples(60));
    assert_eq!(cell.supervise.status(), Status::Holding(Hold::InContact));
    assert!(cell.supervise.can_recover());
    cell.apply(Op::Recover);
    cell.apply(Op::Samples(200));
    assert_eq!(cell.supervise.status(), Status::Rest);
    assert!((cell.q - start).abs() < 0.01, "back where the motion began: {}", cell.q);
}

/// A hold that does not end by itself is restored after the release: a halt weakens nothing.
#[test]
fn a_hold_that_stays_comes_back_at_the_release() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    retreating(&mut cell);
    cell.wall = Some(cell.q - 0.052);
    until(&mut cell, Status::Holding(Hold::RetreatBlocked));
    cell.wall = None;
    for op in [Op::Halt, Op::Samples(60), Op::Release, Op::Samples(60)] {
        cell.apply(op);
    }
    assert_eq!(cell.supervise.status(), Status::Holding(Hold::RetreatBlocked));
    assert!(!cell.gate.is_open() && cell.supervise.can_recover());
}

/// The newest request counts, also if the message of an older one arrives after it.
#[test]
fn an_outdated_message_neither_halts_nor_releases() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.supervise_on(SuperviseIn::Halt);
    assert!(cell.gate.is_open(), "released before the halt was heard");
    cell.apply(Op::Halt);
    cell.apply(Op::Samples(60));
    cell.supervise_on(SuperviseIn::Release);
    cell.apply(Op::Samples(60));
    assert_eq!(cell.supervise.status(), Status::Holding(Hold::Halted), "halted anew before the release was heard");
}

/// Released while supervise is being restarted: its successor journals that before the filter opens.
#[test]
fn a_release_missed_by_a_dead_supervise_is_journaled() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Halt);
    cell.apply(Op::Samples(60));
    cell.book.halted = false;
    let Cell { rules, gate, book, joint_retreat, .. } = &mut cell;
    let (_, first) = SuperviseCore::new(&mut Shared { rules, gate, book, joint_retreat }, Time::from_secs(9.0));
    assert!(first.contains(&SuperviseOut::Event(Event::Released { robot: "r".into() })), "{first:?}");
}

/// A part that is swapped while the robot is halted, or as it is being halted, does not release it.
#[test]
fn an_exchange_does_not_release() {
    for halted_first in [true, false] {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        if halted_first {
            cell.apply(Op::Halt);
            cell.apply(Op::Samples(60));
        }
        assert!(cell.on(SuperviseIn::Yield, cell.now).contains(&SuperviseOut::Yielded));
        cell.apply(Op::Halt);
        cell.apply(Op::Samples(30));
        assert_eq!(cell.supervise.status(), Status::Starting, "it waits for the exchange");
        cell.on(SuperviseIn::Resume, cell.now);
        cell.apply(Op::Samples(60));
        assert_eq!((cell.supervise.status(), cell.gate.is_open()), (Status::Holding(Hold::Halted), false));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn any_interleaving_with_halts_fulfills_the_promises(
        ops in prop::collection::vec(prop_oneof![8 => op(), 2 => Just(Op::Halt), 1 => Just(Op::Release)], 1..60),
    ) {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        for op in ops {
            let (halted, commits) = (cell.book.halted, cell.commits);
            cell.apply(op);
            if halted && cell.book.halted {
                prop_assert!(!cell.gate.is_open() && cell.commits == commits);
            }
        }
        cell.wall = None;
        cell.apply(Op::Release);
        cell.heal();
        if matches!(cell.supervise.status(), Status::Holding(_)) {
            cell.apply(Op::Commit(cell.q, true));
            cell.heal();
        }
        prop_assert_eq!(cell.supervise.status(), Status::Rest);
        let expected: Vec<CommitId> = (1..=cell.commits).map(CommitId).collect();
        prop_assert_eq!(cell.outcomes, expected, "I2: exactly one outcome each, in order");
    }
}
