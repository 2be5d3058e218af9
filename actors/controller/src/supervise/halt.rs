//! A halt: a person stops the robot, and it stays stopped until a person releases it.
//!
//! ```text
//! any state ──Halt──> filter closed, stopped ──at rest, outcome given──> Holding(Halted) ──Release──> as after any stop
//! ```
//!
//! The filter closes under a new token, as the reflex closes it. A motion in progress gets the outcome that the
//! configuration shows. A retreat stops on its path: `recover` can drive the rest of it after the release, if the
//! robot still holds then. While the robot is halted nothing moves it: no commit and no escape, no set-point, no
//! retreat, no `recover`. The ledger records the halt, so that it outlives every actor. A request to halt or release
//! is recorded there first, so that the newest request counts, whatever messages are still in transit.

use super::{Closing, SuperviseCore, SuperviseStep};
use mobee_contract::{Cause, Event, Hold, Status};

/// Journals a halt, or a release, that the predecessor of a new Supervise did not live to journal.
pub(super) fn journal_at_start(step: &mut SuperviseStep) {
    let was_halted = std::mem::replace(&mut step.book.halt_journaled, step.book.halted);
    if step.book.halted {
        step.emit(Event::Halted { robot: step.robot() });
    } else if was_halted {
        step.emit(Event::Released { robot: step.robot() });
    }
}

impl SuperviseCore {
    /// Halts the robot on the request of a person.
    pub(super) fn halt(&mut self, step: &mut SuperviseStep) {
        if self.shutdown || !step.book.halted {
            return;
        }
        if !std::mem::replace(&mut step.book.halt_journaled, true) {
            step.emit(Event::Halted { robot: step.robot() });
        }
        if self.status == Status::Holding(Hold::Halted) {
            return;
        }
        if self.closing == Closing::Yielded {
            // Closed at a boundary while a part is swapped: the halt takes effect after that.
            return;
        }
        if let (Status::Holding(hold), Closing::No) = (self.status, &self.closing) {
            self.held = stays(hold).then_some(hold).or(self.held);
        }
        if self.closing == Closing::Reflex {
            self.retry = self.retry.take().or(step.book.motion()).filter(|motion| !motion.is_escape());
            // The reflex drives in the mode of set-points, and no longer restores the original mode.
            self.modes.extend(self.retry.iter().flat_map(|motion| motion.named.iter().copied()));
        }
        self.interrupt(Cause::Asked, Status::Holding(Hold::Halted), step);
    }

    /// Releases the robot on the request of a person. The filter opens no sooner than after any stop: by a fresh
    /// reading at rest, free of contact.
    pub(super) fn release(&mut self, step: &mut SuperviseStep) {
        if step.book.halted || !std::mem::take(&mut step.book.halt_journaled) {
            return;
        }
        step.emit(Event::Released { robot: step.robot() });
        if self.status == Status::Holding(Hold::Halted) && self.closing == Closing::No {
            self.closing = Closing::Settle(step.now);
        }
    }

    /// Settles a halted robot at rest, with every outcome given. A retreat that the halt cut off before its end can
    /// be retried; the motors that it moved rest where they are now.
    pub(super) fn settle_halted(&mut self, lost: bool, step: &mut SuperviseStep) {
        self.held = self.held.or(lost.then_some(Hold::AfterCrash));
        if let Some(motion) = &self.retry {
            self.resting.commanded(&motion.named);
        }
        self.enter(Status::Holding(Hold::Halted), step);
    }
}

/// Returns whether a robot that holds for this reason does so until an escape or `recover`.
fn stays(hold: Hold) -> bool {
    matches!(hold, Hold::AfterCrash | Hold::RetreatBlocked | Hold::HistoryTooShort | Hold::RetreatMissed)
}
