//! Extent of rollbacks: streams by `undo_s`, moves to their beginning.

use super::*;
use crate::history::Recorded;

/// A motor at rest, whose streams are undone by this number of seconds.
fn cell(undo: f64) -> Cell {
    let mut cell = Cell::new();
    cell.rules = Arc::new(Rules { undo: Duration::from_secs_f64(undo), ..(*cell.rules).clone() });
    cell.apply(Op::Samples(30));
    cell
}

/// Recorded positions at the closing of the filter, and this number of seconds before.
fn recorded(cell: &Cell, closed: Time, before: f64) -> Recorded {
    cell.book.history.recorded_near(closed - Duration::from_secs_f64(before), &[0.0], Duration::ZERO).unwrap().clone()
}

/// Streams a velocity until something stops it; returns the reading of the stop.
fn pushes(cell: &mut Cell, speed: f64) -> Time {
    while cell.supervise.status() == Status::Moving {
        cell.apply(Op::Stream(speed, 1));
        assert!(cell.now < Time::from_secs(60.0), "nothing stops it");
    }
    let stopped = |cell: &Cell| cell.book.open.as_ref().map(|open| open.extent);
    match stopped(cell) {
        Some(Extent::Stopped(at)) => at,
        _ => cell.now,
    }
}

proptest! {
    /// The retreat after a long stream ends where the robot was this long before the stop, free of contact.
    #[test]
    fn a_stream_is_undone_by_as_much_as_the_rules_say(
        undo in 0.1..1.5_f64, speed in 0.2..0.8_f64, wall in 1.8..2.8_f64, up in any::<bool>()
    ) {
        let (undo, sign) = ((undo * 100.0).round() / 100.0, if up { 1.0 } else { -1.0 });
        let mut cell = cell(undo);
        cell.apply(Op::Wall(Some(sign * wall)));
        cell.apply(Op::Stream(sign * speed, 1));
        let closed = pushes(&mut cell, sign * speed);
        let home = recorded(&cell, closed, undo);
        prop_assert!(home.q[0].abs() > 0.2, "the stream is longer than what is undone of it");
        cell.heal();
        prop_assert_eq!((cell.supervise.status(), cell.outcome), (Status::Rest, Some(Outcome::RolledBack)));
        // the reflex closes at the reading of which supervise is notified at once, or at the one before
        let apart = (cell.q - home.q[0]).abs();
        prop_assert!(apart <= 1.5 * 0.01 * speed + cell.rules.tolerance, "{} from {:?}", cell.q, home);
        prop_assert!((wall - cell.q.abs()) - 0.05 > cell.rules.margin);
    }

    /// A move in the same transaction is rolled back to its beginning, in any order, and the stream with it.
    #[test]
    fn a_move_is_rolled_back_whole(undo in 0.0..1.0_f64, first in any::<bool>()) {
        let mut cell = cell(undo);
        cell.apply(Op::Wall(Some(2.0)));
        if first {
            cell.apply(Op::Commit(0.6, true));
            cell.apply(Op::Samples(20));
        }
        cell.apply(Op::Stream(0.5, 60));
        if !first {
            cell.apply(Op::Commit(2.5, true));
            cell.apply(Op::Samples(5));
        }
        prop_assert_eq!(cell.commits, 1);
        pushes(&mut cell, 0.5);
        cell.heal();
        prop_assert_eq!((cell.supervise.status(), cell.outcome), (Status::Rest, Some(Outcome::RolledBack)));
        prop_assert!(cell.q.abs() <= cell.rules.tolerance, "it rests at {}", cell.q);
    }
}

/// A stream that is shorter than the undo time is undone whole.
#[test]
fn nothing_is_undone_beyond_the_beginning() {
    let mut cell = cell(5.0);
    cell.apply(Op::Wall(Some(1.0)));
    cell.apply(Op::Stream(0.8, 1));
    pushes(&mut cell, 0.8);
    cell.heal();
    assert_eq!((cell.supervise.status(), cell.outcome), (Status::Rest, Some(Outcome::RolledBack)));
    assert!(cell.q.abs() <= cell.rules.tolerance, "it rests at {}", cell.q);
}

/// A rollback of a stream after a death goes back no farther.
#[test]
fn a_restart_undoes_no_more() {
    for died in [Op::SuperviseDies, Op::ReflexDies] {
        let mut cell = cell(0.5);
        cell.apply(Op::Stream(0.5, 150));
        let (at, q) = (cell.now, cell.q);
        cell.apply(died.clone());
        cell.heal();
        let home = recorded(&cell, at, 0.5);
        assert_eq!((cell.supervise.status(), cell.outcome), (Status::Rest, Some(Outcome::RolledBack)), "{died:?}");
        assert!(cell.q < q - 0.2 && (cell.q - home.q[0]).abs() < 0.03, "{died:?}: {} from {home:?}", cell.q);
    }
}
