//! The retreat as supervise sees it: it asks the reflex for one, hears how it goes, and may have one that failed tried
//! again.
//!
//! The reflex drives, supervise keeps the books: only it gives outcomes and opens the filter. What passes between them
//! are messages, which may come late or after somebody has closed anew; each is judged by the token that it belongs to.

use super::{Closing, MotionState, Step, SuperviseCore, SuperviseOut};
use crate::ledger::{Extent, Underway};
use crate::reflex::ReflexReport;
use mobee_contract::{Cause, Event, Hold, Outcome, Status, Time};
use std::collections::BTreeSet;

impl SuperviseCore {
    /// The motion is to be rolled back for a reason that supervise saw. An escape has no retreat: it is measured.
    pub(super) fn roll_back(&mut self, cause: Cause, step: &mut Step) {
        // what a motor stalls at is in no model, so that nobody knows where it was free of it: back to the beginning
        let pressed = matches!(cause, Cause::Stall { .. } | Cause::ExternalTorque { .. });
        if let (true, Some(open)) = (pressed, &mut step.book.open) {
            open.extent = Extent::Whole;
        }
        self.note_stop(step);
        let motion = step.book.motion();
        match motion.filter(|m| !m.is_escape()) {
            Some(motion) => {
                let motion = Underway { pressed, ..motion };
                self.close(cause.clone(), step);
                step.give_cause(cause);
                self.closing = Closing::Reflex;
                self.enter(Status::Stopping, step);
                step.out.push(SuperviseOut::RollBack { token: self.token, motion, again: false });
            }
            None => self.interrupt(cause, Status::Stopping, step),
        }
    }

    /// The agent of the open motion died since we looked last: the motion is cancelled, whatever the agent had sent before
    /// and waits to be handled.
    pub(super) fn note_agent_death(&mut self, step: &mut Step) {
        let orphan = step.book.orphan.take();
        let is_open = step.book.open.as_ref().is_some_and(|open| Some(open.id) == orphan);
        if is_open && self.is_moving() {
            self.roll_back(Cause::AgentDied, step);
        }
    }

    /// The reflex closed the filter; the motors that had a part in it, if that is known. In mid-motion the reflex takes
    /// the robot back by itself; at rest there is nothing to be taken back, and the way out of the contact is an
    /// escape.
    pub(super) fn closed(&mut self, token: u64, (cause, blamed): (Cause, Option<BTreeSet<usize>>), step: &mut Step) {
        if token != step.gate.token() {
            return; // somebody closed it anew since
        }
        self.token = token;
        self.hush(blamed, step);
        self.motion = MotionState::default();
        if self.is_moving() {
            self.note_stop(step);
            step.give_cause(cause);
            self.closing = Closing::Reflex;
            self.enter(Status::Stopping, step);
        } else {
            self.closing = Closing::Settle(step.now + step.rules.reaction());
            self.enter(Status::Holding(Hold::InContact), step);
        }
    }

    /// The open motion is stopped now: a stream is undone from here, also by a retreat that is tried again.
    pub(super) fn note_stop(&self, step: &mut Step) {
        let recorded = step.book.history.newest().map(|newest| newest.at);
        let newest = self.newest.as_ref().map(|newest| newest.sampled_at).or(recorded);
        if let (Some(open), Some(newest)) = (&mut step.book.open, newest) {
            open.extent = open.extent.stopped(newest);
        }
    }

    /// How the retreat goes. A word counts only while a retreat is awaited, and under the present token: it may be the
    /// last of one that has been overtaken by a stop.
    pub(super) fn word(&mut self, word: ReflexReport, step: &mut Step) {
        if self.closing != Closing::Reflex || self.token != step.gate.token() {
            return;
        }
        if let (Some(again), ReflexReport::Back | ReflexReport::Stopped | ReflexReport::GaveUp(_)) =
            (&self.retry, &word)
        {
            // a retreat that is tried again moves motors of a motion that has its outcome, and is no longer open
            self.resting.commanded(&again.named);
        }
        match word {
            ReflexReport::Retreating => {
                step.book.open.iter_mut().for_each(|open| open.retreated = true);
                self.enter(Status::Retreating, step);
            }
            ReflexReport::Settling => self.enter(Status::Settling, step),
            ReflexReport::EndsAt { to, motors, stream } => {
                // from now on this is where it must end, to be rolled back and not faulted
                self.retry.iter_mut().for_each(|again| again.safe = Some(to.clone()));
                if let Some(open) = &mut step.book.open {
                    open.name(&motors);
                    let (id, q, recorded) = (open.id, to.q.clone(), stream.then_some(to.since));
                    open.safe = Some(to);
                    step.emit(Event::SafePoseMoved { robot: step.robot(), id, q, recorded });
                }
            }
            // the outcome is measured at the next reading, which is the one that the reflex judged by
            ReflexReport::Back | ReflexReport::Stopped => {
                self.modes.clear();
                if let Some(motion) = self.retry.as_ref().filter(|_| word == ReflexReport::Back) {
                    step.book.send_home(motion, step.rules.tolerance);
                }
                self.closing = Closing::Settle(Time::ZERO);
            }
            ReflexReport::GaveUp(hold) => {
                self.modes.clear();
                // kept for `recover`: what stood in the way may be taken away
                self.retry = self.retry.take().or(step.book.motion()).filter(|m| !m.is_escape());
                self.end(Some(Outcome::Faulted), step);
                self.closing = if hold == Hold::Stale { Closing::Settle(step.now) } else { Closing::No };
                self.enter(Status::Holding(hold), step);
            }
        }
    }

    /// Whether the robot holds where a retreat can be tried again, or was held by a crash that left none.
    pub fn can_recover(&self) -> bool {
        let halted = self.status == Status::Holding(Hold::Halted);
        let holds = self.closing == Closing::No && matches!(self.status, Status::Holding(_)) && !halted;
        holds && (self.retry.is_some() || self.status == Status::Holding(Hold::AfterCrash))
    }

    /// Tries the failed retreat again, as a person asked for it: nothing else moves a robot that holds after one.
    pub(super) fn recover(&mut self, step: &mut Step) {
        if !self.can_recover() || step.book.halted {
            return;
        }
        let Some(motion) = self.retry.clone() else {
            // there was no safe pose: the robot stays, and is asked to stay no longer
            return self.interrupt(Cause::Asked, Status::Holding(Hold::Restarted), step);
        };
        self.close(Cause::Asked, step);
        self.closing = Closing::Reflex;
        self.enter(Status::Stopping, step);
        step.out.push(SuperviseOut::RollBack { token: self.token, motion, again: true });
    }
}
