//! A halt: a person stops the robot, and it stays stopped until a person releases it.
//!
//! ```text
//! any state ──Halt──> filter closed, stopped ──at rest, outcome given──> Holding(Halted) ──Release──> as after any stop
//! ```
//!
//! The filter closes under a new token, as the reflex closes it. A motion that is under way gets the outcome that the
//! pose shows. A retreat stops where it is: what is left of its path can be driven by `recover` once the robot is
//! released, if the robot still holds then. While the robot is halted nothing moves it: no commit and no escape, no
//! set-point, no retreat, no `recover`. The ledger has the halt, so that it outlives every actor; who halts or releases
//! writes it there first, so that the newest request counts whatever messages are still on their way.

use super::{Closing, Step, SuperviseCore};
use mobee_contract::{Cause, Event, Hold, Status};

/// A supervise that starts finds a halt, or a release that its predecessor did not live to tell.
pub(super) fn tell_at_start(step: &mut Step) {
    let told = std::mem::replace(&mut step.book.halt_told, step.book.halted);
    if step.book.halted {
        step.emit(Event::Halted { robot: step.robot() });
    } else if told {
        step.emit(Event::Released { robot: step.robot() });
    }
}

impl SuperviseCore {
    /// A person halts the robot.
    pub(super) fn halt(&mut self, step: &mut Step) {
        if self.shutdown || !step.book.halted {
            return;
        }
        if !std::mem::replace(&mut step.book.halt_told, true) {
            step.emit(Event::Halted { robot: step.robot() });
        }
        if self.status == Status::Holding(Hold::Halted) {
            return;
        }
        if self.closing == Closing::Yielded {
            // closed at a boundary while a part is exchanged: the halt takes effect when that is over
            return;
        }
        if let (Status::Holding(hold), Closing::No) = (self.status, &self.closing) {
            self.held = stays(hold).then_some(hold).or(self.held);
        }
        if self.closing == Closing::Reflex {
            self.retry = self.retry.take().or(step.book.motion()).filter(|motion| !motion.is_escape());
            // the reflex drives in the mode of set-points, and no longer restores the mode that it found
            self.modes.extend(self.retry.iter().flat_map(|motion| motion.named.iter().copied()));
        }
        self.interrupt(Cause::Asked, Status::Holding(Hold::Halted), step);
    }

    /// A person releases the robot. The filter opens no sooner than after any stop: by a fresh reading at rest, free of
    /// contact.
    pub(super) fn release(&mut self, step: &mut Step) {
        if step.book.halted || !std::mem::take(&mut step.book.halt_told) {
            return;
        }
        step.emit(Event::Released { robot: step.robot() });
        if self.status == Status::Holding(Hold::Halted) && self.closing == Closing::No {
            self.closing = Closing::Settle(step.now);
        }
    }

    /// A halted robot rests, with every outcome given. A retreat that the halt cut off beside its end can be tried
    /// again; the motors that it moved rest where they are now.
    pub(super) fn settle_halted(&mut self, lost: bool, step: &mut Step) {
        self.held = self.held.or(lost.then_some(Hold::AfterCrash));
        if let Some(motion) = &self.retry {
            self.resting.commanded(&motion.named);
        }
        self.enter(Status::Holding(Hold::Halted), step);
    }
}

/// Whether a robot that holds for this reason stays so until an escape or `recover`.
fn stays(hold: Hold) -> bool {
    matches!(hold, Hold::AfterCrash | Hold::RetreatBlocked | Hold::HistoryTooShort | Hold::RetreatMissed)
}
