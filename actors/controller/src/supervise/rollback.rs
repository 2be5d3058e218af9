//! Rollback from the point of view of Supervise: it requests a retreat from the reflex, receives the reports, and can
//! have a failed retreat retried.
//!
//! The reflex drives; Supervise owns the transactions: only it gives outcomes and opens the filter. They communicate
//! by messages, which may arrive late or after another closing; each belongs to a token and is checked against it.

use super::{Closing, MotionState, SuperviseCore, SuperviseOut, SuperviseStep};
use crate::ledger::{Extent, Underway, union};
use crate::reflex::ReflexReport;
use mobee_contract::{Cause, Event, Hold, Outcome, Status, Time};
use std::collections::BTreeSet;

impl SuperviseCore {
    /// Rolls back the motion for a cause detected by Supervise. An escape has no retreat: its outcome is measured.
    pub(super) fn roll_back(&mut self, cause: Cause, step: &mut SuperviseStep) {
        // An obstacle that stalls a motor is not in the model, so no later configuration is known to be free of it:
        // undo the whole motion.
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

    /// Handles the death of the open motion's agent since the last step: the motion is cancelled, whatever the agent
    /// had sent before and is still queued.
    pub(super) fn note_agent_death(&mut self, step: &mut SuperviseStep) {
        let orphan = step.book.orphan.take();
        let is_open = step.book.open.as_ref().is_some_and(|open| Some(open.id) == orphan);
        if is_open && self.is_moving() {
            self.roll_back(Cause::AgentDied, step);
        }
    }

    /// Handles a closing by the reflex; `blamed`: the motors that caused it, if they are known. In mid-motion the
    /// reflex retreats by itself. At rest there is nothing to roll back, and an escape is the way out of the contact.
    pub(super) fn closed(
        &mut self,
        token: u64,
        (cause, blamed): (Cause, Option<BTreeSet<usize>>),
        step: &mut SuperviseStep,
    ) {
        if token != step.gate.token() {
            return; // closed again since
        }
        self.token = token;
        self.start_cooldown(blamed, step);
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

    /// Marks the open motion as stopped now: a stream is undone from here, also by a retry.
    pub(super) fn note_stop(&self, step: &mut SuperviseStep) {
        let recorded = step.book.history.newest().map(|newest| newest.at);
        let newest = self.newest.as_ref().map(|newest| newest.sampled_at).or(recorded);
        if let (Some(open), Some(newest)) = (&mut step.book.open, newest) {
            open.extent = open.extent.stopped(newest);
        }
    }

    /// Handles a report of the retreat. It counts only while a retreat is awaited, and under the current token: it
    /// may be the last report of a retreat that was superseded by a stop.
    pub(super) fn on_report(&mut self, report: ReflexReport, step: &mut SuperviseStep) {
        if self.closing != Closing::Reflex || self.token != step.gate.token() {
            return;
        }
        if let (Some(again), ReflexReport::Back | ReflexReport::Stopped | ReflexReport::GaveUp(_)) =
            (&self.retry, &report)
        {
            // A retry moves the motors of a motion that has its outcome and is no longer open.
            self.resting.commanded(&again.named);
        }
        match report {
            ReflexReport::Retreating => {
                step.book.open.iter_mut().for_each(|open| open.retreated = true);
                self.enter(Status::Retreating, step);
            }
            ReflexReport::Joined(motors) => {
                let joins = |again: &mut Underway| again.named = union(&again.named, &motors);
                self.retry.iter_mut().for_each(joins);
                step.book.open.iter_mut().for_each(|open| open.name(&motors));
            }
            ReflexReport::Settling => self.enter(Status::Settling, step),
            ReflexReport::EndsAt { to, motors, stream } => {
                // From now on this is the configuration in which the retreat counts as rolled back and not as
                // faulted.
                self.retry.iter_mut().for_each(|again| again.safe = Some(to.clone()));
                if let Some(open) = &mut step.book.open {
                    open.name(&motors);
                    let id = open.id;
                    let q = to.q.clone();
                    let recorded = stream.then_some(to.since);
                    open.safe = Some(to);
                    step.emit(Event::SafePoseMoved { robot: step.robot(), id, q, recorded });
                }
            }
            // The outcome is measured at the next reading, which is the one that the reflex used.
            ReflexReport::Back | ReflexReport::Stopped => {
                self.modes.clear();
                if let Some(motion) = self.retry.as_ref().filter(|_| report == ReflexReport::Back) {
                    step.book.send_home(motion, step.rules.tolerance);
                }
                self.closing = Closing::Settle(Time::ZERO);
            }
            ReflexReport::GaveUp(hold) => {
                self.modes.clear();
                // Stored for `recover`: the obstacle may be removed.
                self.retry = self.retry.take().or(step.book.motion()).filter(|m| !m.is_escape());
                self.end(Some(Outcome::Faulted), step);
                self.closing = if hold == Hold::Stale { Closing::Settle(step.now) } else { Closing::No };
                self.enter(Status::Holding(hold), step);
            }
        }
    }

    /// Returns whether the robot holds where a retreat can be retried, or holds after a crash that left no retreat.
    pub fn can_recover(&self) -> bool {
        let halted = self.status == Status::Holding(Hold::Halted);
        let holds = self.closing == Closing::No && matches!(self.status, Status::Holding(_)) && !halted;
        holds && (self.retry.is_some() || self.status == Status::Holding(Hold::AfterCrash))
    }

    /// Retries the failed retreat on the request of a person: nothing else moves a robot that holds after one.
    pub(super) fn recover(&mut self, step: &mut SuperviseStep) {
        if !self.can_recover() || step.book.halted {
            return;
        }
        let Some(motion) = self.retry.clone() else {
            // There was no safe pose: the robot stays, and its hold ends.
            return self.interrupt(Cause::Asked, Status::Holding(Hold::Restarted), step);
        };
        self.close(Cause::Asked, step);
        self.closing = Closing::Reflex;
        self.enter(Status::Stopping, step);
        step.out.push(SuperviseOut::RollBack { token: self.token, motion, again: true });
    }
}
