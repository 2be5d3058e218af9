//! The way back as supervise sees it: it asks the reflex for one, hears how it goes, and may have one that failed tried again.

use super::{Closing, SuperviseCore, SuperviseOut};
use crate::reflex::Word;
use mobee_contract::{Cause, Event, Hold, Outcome, Status, Time};
use std::collections::BTreeSet;

impl SuperviseCore {
    /// The motion is to be rolled back for a reason that supervise saw. An escape has no way back: it is measured.
    pub(super) fn roll_back(&mut self, cause: Cause, now: Time, out: &mut Vec<SuperviseOut>) {
        let motion = self.motion();
        match motion.filter(|m| !m.is_escape()) {
            Some(motion) => {
                self.close(cause.clone(), out);
                self.give_cause(cause);
                self.closing = Closing::Reflex;
                self.enter(Status::Stopping, out);
                out.push(SuperviseOut::RollBack { token: self.token, motion, again: false });
            }
            None => self.interrupt(cause, Status::Stopping, now, out),
        }
    }

    /// The reflex closed the filter; the motors that had a part in it, if that is known.
    pub(super) fn closed(
        &mut self,
        token: u64,
        (cause, blamed): (Cause, Option<BTreeSet<usize>>),
        now: Time,
        out: &mut Vec<SuperviseOut>,
    ) {
        if token != self.gate.token() {
            return; // somebody closed it anew since
        }
        self.token = token;
        self.hush(now, blamed);
        (self.stream, self.forces) = (None, None);
        if self.is_moving() {
            self.give_cause(cause);
            self.closing = Closing::Reflex;
            self.enter(Status::Stopping, out);
        } else {
            self.closing = Closing::Settle(now + self.rules.reaction());
            self.enter(Status::Holding(Hold::InContact), out);
        }
    }

    /// How the way back goes.
    pub(super) fn word(&mut self, word: Word, now: Time, out: &mut Vec<SuperviseOut>) {
        if self.closing != Closing::Reflex || self.token != self.gate.token() {
            return;
        }
        if let (Some(again), Word::Back | Word::Stopped | Word::GaveUp(_)) = (&self.retry, &word) {
            self.resting.commanded(&again.named);
        }
        match word {
            Word::Retreating => {
                self.with_book(|book| book.open.iter_mut().for_each(|open| open.retreated = true));
                self.enter(Status::Retreating, out);
            }
            Word::Settling => self.enter(Status::Settling, out),
            Word::Farther((at, q), motors) => {
                let moved = self.with_book(|book| {
                    let open = book.open.as_mut()?;
                    open.name(&motors);
                    open.safe = Some((at, q.clone()));
                    Some(open.id)
                });
                let robot = self.rules.robot.clone();
                out.extend(moved.map(|id| SuperviseOut::Event(Event::SafePoseMoved { robot, id, q })));
            }
            // the outcome is measured at the next reading, which is the one that the reflex judged by
            Word::Back | Word::Stopped => {
                self.modes.clear();
                if let Some(motion) = self.retry.as_ref().filter(|_| word == Word::Back) {
                    self.with_book(|book| book.send_home(motion, self.rules.tolerance));
                }
                self.closing = Closing::Settle(Time::ZERO);
            }
            Word::GaveUp(hold) => {
                self.modes.clear();
                self.retry = self.retry.take().or(self.motion()).filter(|m| !m.is_escape());
                self.end(Some(Outcome::Faulted), out);
                self.closing = if hold == Hold::Stale { Closing::Settle(now) } else { Closing::No };
                self.enter(Status::Holding(hold), out);
            }
        }
    }

    /// Whether the robot holds where a way back can be tried again, or was held by a crash that left none.
    pub fn can_recover(&self) -> bool {
        let holds = self.closing == Closing::No && matches!(self.status, Status::Holding(_));
        holds && (self.retry.is_some() || self.status == Status::Holding(Hold::AfterCrash))
    }

    /// Tries the failed way back again.
    pub(super) fn recover(&mut self, now: Time, out: &mut Vec<SuperviseOut>) {
        if !self.can_recover() {
            return;
        }
        let Some(motion) = self.retry.clone() else {
            // there was no safe pose: the robot stays, and is asked to stay no longer
            return self.interrupt(Cause::Asked, Status::Holding(Hold::Restarted), now, out);
        };
        self.close(Cause::Asked, out);
        self.closing = Closing::Reflex;
        self.enter(Status::Stopping, out);
        out.push(SuperviseOut::RollBack { token: self.token, motion, again: true });
    }
}
