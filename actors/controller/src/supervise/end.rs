//! How motions end: what each reading decides.
//!
//! A board's "done" is a hint and no proof: it may come early, late, or from the motion before. What counts is the
//! measured pose, at rest, within the tolerance of the target (I2, I17). All is judged by `sampled_at`, when the
//! reading was taken; `now` only tells whether it is still worth anything.

use super::{Closing, Reading, Started, Step, SuperviseCore, SuperviseOut};
use crate::gate::Gate;
use crate::ledger::{Open, SafePose, TransactionState};
use crate::pulse::Pulse;
use crate::reflex::{FROZEN, FROZEN_WAY};
use crate::{Rules, distance, hold_offset};
use mobee_contract::{Cause, Command, Event, Hold, Outcome, Status, Target, Time, Writer};
use std::time::Duration;

/// How long the board may say "done" away from the target, by the readings' time. Some say it for a reading or two
/// between a command and its start; waiting for the motion's due time instead would leave an agent standing for seconds
/// at a target that it will not reach.
const MISSED: Duration = Duration::from_millis(200);
/// The share of its path at its mean speed in which a joint has hardly begun to move.
const BEGINS: f64 = 0.2;
/// How long a joint may still move after its board has reported the end.
const SETTLES: Duration = Duration::from_secs(1);
/// How often a robot that rests beside its target is commanded there again.
const HOLDS: u32 = 6;
/// The share of full speed of such a move.
const HOLD_SPEED: f64 = 0.1;

impl SuperviseCore {
    /// A reading came through the whole chain: all live. Renew the lease, and see whether something has ended. The
    /// lease is counted from when the reading was taken: a chain that is late has used up a part of it.
    pub(super) fn pulse(&mut self, pulse: &Pulse, step: &mut Step) {
        let sampled_at = pulse.sample.at;
        let at_rest = pulse.speed < step.rules.rest_speed;
        if self.newest.as_ref().is_some_and(|newest| sampled_at <= newest.sampled_at) {
            return;
        }
        let (q, speed, free) = (pulse.sample.q.clone(), pulse.speed, pulse.free);
        self.newest = Some(Reading { sampled_at, q, speed, at_rest, free });
        if let Some(pushed) = self.push.read(&pulse.sample, &step.rules.robot) {
            step.emit(pushed);
        }
        // what was held up on its way is no ground for a decision (I8)
        if step.now > sampled_at + step.rules.fresh {
            return;
        }
        let closes = self.watch_effort(pulse, step) || self.watch_stall(pulse, step) || self.watch_idle(pulse, step);
        if closes || step.gate.token() != self.token {
            return; // somebody closed the filter, and will tell why
        }
        match self.closing {
            Closing::Settle(after) => {
                if self.stop.is_ignored(pulse, step.rules, step.now) {
                    step.command(self.token, Writer::Supervise, Command::Stop { motors: Vec::new() });
                }
                // what is written at a reading must be with the driver before the filter may open at the next
                if at_rest && sampled_at >= after && !self.restore_modes(Writer::Supervise, step) {
                    self.settle(pulse, step);
                }
            }
            // without a lease nothing can move, whatever the part that is being tried writes
            Closing::Yielded => {}
            Closing::No if step.book.halted => {}
            Closing::Reflex => step.out.push(SuperviseOut::Lease(sampled_at + step.rules.fresh)),
            Closing::No => {
                step.out.push(SuperviseOut::Lease(sampled_at + step.rules.fresh));
                match self.status {
                    Status::Moving | Status::Escaping => self.moving(pulse, at_rest, step),
                    Status::Holding(Hold::InContact | Hold::SlowBoard) if at_rest && pulse.free => {
                        self.open_or_hold(pulse, step)
                    }
                    _ => {}
                }
            }
        }
    }

    /// The robot rests: the open transaction, if any, gets the outcome that the pose shows; then open, or hold.
    ///
    /// In this order: a motion that can still be taken back has no outcome yet; one that was left by a crash must not
    /// open the filter by itself; then all others are measured.
    fn settle(&mut self, pulse: &Pulse, step: &mut Step) {
        if self.take_back(step) {
            return;
        }
        let lost = self.end_after_crash(step);
        let ended = self.end(None, step);
        // a retreat that a halt cut off at its end has nothing left to be tried
        self.retry = self.retry.take().filter(|_| ended != Some(Outcome::RolledBack));
        self.closing = Closing::No;
        if step.book.halted && !self.shutdown {
            return self.settle_halted(lost, step);
        }
        let held = self.held.take();
        let hold = match self.status {
            _ if self.shutdown => Some(Hold::ShuttingDown),
            _ if held.is_some() => held,
            // whatever was before, the way out of a contact is an escape
            _ if !pulse.free => Some(Hold::InContact),
            _ if lost => Some(Hold::AfterCrash),
            _ => None,
        };
        match hold {
            Some(reason) => self.enter(Status::Holding(reason), step),
            None => self.open_or_hold(pulse, step),
        }
    }

    /// A part of the controller was restarted in mid-motion, and is well again: if the path has been recorded without a
    /// gap, the motion is taken back after all, by a fresh reading and watched as always. Whether it is.
    fn take_back(&mut self, step: &mut Step) -> bool {
        let restarted = self.status == Status::Holding(Hold::Restarted) && !self.shutdown && !step.book.halted;
        let (Some(open), Some(Reading { q: here, .. }), true) = (&step.book.open, &self.newest, restarted) else {
            return false;
        };
        let Some(SafePose { since, q: safe }) = &open.safe else { return false };
        let away = |pose: &[f64]| distance(here, pose) > step.rules.tolerance;
        // after a crash nothing moves before a person asks for it (I10)
        let crashed = open.cause == Some(Cause::Crashed);
        if crashed || !away(safe) || !away(&open.target) || step.book.history.past(*since).is_err() {
            return false;
        }
        let (again, Some(motion)) = (open.retreated, step.book.motion()) else { return false };
        self.closing = Closing::Reflex;
        self.enter(Status::Stopping, step);
        step.out.push(SuperviseOut::RollBack { token: self.token, motion, again });
        true
    }

    /// All is well: open the filter, unless the board answers too slowly for what is reckoned with its latency. The
    /// margin was chosen for that latency: a robot that stops later than believed stops in contact.
    fn open_or_hold(&mut self, pulse: &Pulse, step: &mut Step) {
        let Some(answers) = pulse.answers.filter(|answers| answers.most > step.rules.latency) else {
            return self.reopen(step);
        };
        if self.status != Status::Holding(Hold::SlowBoard) {
            let (robot, allowed) = (step.robot(), step.rules.latency.as_secs_f64() * 1e3);
            let text = format!(
                "{robot}: the filter stays closed: the board {answers}, and its `latency_ms` is {allowed}; find out what slows it, or allow more and keep a wider margin"
            );
            step.emit(Event::Warning { text });
        }
        self.enter(Status::Holding(Hold::SlowBoard), step);
    }

    /// What an earlier process left open gets the outcome that the pose shows. Whether that is neither of its two ends:
    /// then nothing moves before somebody asks for it, and the retreat can be tried.
    fn end_after_crash(&mut self, step: &mut Step) -> bool {
        let crashed = step.book.open.as_ref().is_some_and(|o| o.cause == Some(Cause::Crashed));
        if !crashed {
            return false;
        }
        let motion = step.book.motion();
        let lost = self.end(None, step) == Some(Outcome::Faulted);
        self.retry = motion.filter(|m| lost && !m.is_escape());
        lost
    }

    /// Opens the filter, if nobody closed it anew since; a retreat that failed before is no longer asked for.
    fn reopen(&mut self, step: &mut Step) {
        debug_assert!(!step.book.halted, "only a release ends a halt");
        self.retry = None;
        if !Gate::opens(self.token) {
            let Some(token) = step.gate.open(self.token) else { return };
            self.token = token;
            step.emit(Event::Enabled { robot: step.robot(), token });
            self.begin_silence(self.newest.as_ref().map_or(Time::ZERO, |newest| newest.sampled_at));
        }
        self.enter(Status::Rest, step);
    }

    /// Gives the open transaction its one outcome (I2): as told, or as the newest reading shows. The only place that
    /// does; the ledger takes the transaction and keeps its end in one step, so that a death in between loses nothing.
    /// Nothing if none is open.
    pub(super) fn end(&mut self, told: Option<Outcome>, step: &mut Step) -> Option<Outcome> {
        let newest = self.newest.as_ref().map(|newest| newest.q.clone());
        let q = newest.or_else(|| step.book.last_known())?;
        let ended = step.book.settle(told, q, step.rules.tolerance)?;
        self.resting.commanded(&ended.open.named);
        let (outcome, end) = (ended.outcome, ended.end());
        let (agent, id) = (ended.open.agent.clone(), ended.open.id);
        ended.events(step.robot()).into_iter().for_each(|event| step.emit(event));
        step.out.push(SuperviseOut::Ended(agent, id, end));
        Some(outcome)
    }

    /// A motion is under way: has it ended, or gone wrong? Asked in the order of certainty: at rest at its target; done
    /// elsewhere for a while, or overdue; behind encoders that tell the same for ever. Else it goes on.
    fn moving(&mut self, pulse: &Pulse, at_rest: bool, step: &mut Step) {
        if self.motion.forces.is_some() {
            return self.under_forces(pulse, at_rest, step);
        }
        if self.motion.stream.is_some() && !self.streaming(pulse, at_rest, step) {
            return;
        }
        let sampled_at = pulse.sample.at;
        let q = &pulse.sample.q;
        let Some(Open { target, since, motion, .. }) = &step.book.open else { return };
        let (since, due) = (*since, motion.due());
        let done = pulse.sample.done.iter().all(|d| *d);
        let (away, far) = (distance(q, target), step.rules.beyond_hold_error(q, target));
        // later than the commit: a reading from before it shows the end of the motion before
        if done && at_rest && sampled_at > since && away <= step.rules.tolerance {
            self.done(pulse, step);
            return;
        }
        // until then "done" may still be said of the motion before
        let reacted = sampled_at >= since + step.rules.reaction();
        // there, but not yet known to rest, as after a gap in the readings, is not missed
        let elsewhere = done && reacted && away > step.rules.tolerance;
        self.motion.done_since = self.motion.done_since.filter(|_| elsewhere).or(elsewhere.then_some(sampled_at));
        // a board may report the end of its own trajectory: a joint that lags is still on its way then
        let settled = |t: Time| sampled_at >= t + if at_rest { MISSED } else { SETTLES };
        if elsewhere && at_rest && self.hold_there(pulse, step) {
            self.keep_in_history(step);
        } else if self.motion.done_since.is_some_and(settled) || due.is_some_and(|due| sampled_at > due) {
            self.roll_back(Cause::TargetMissed, step);
        // a robot that has nearly arrived stands still rightly
        } else if far > FROZEN_WAY && self.is_frozen(sampled_at, pulse.unchanged, step.rules) {
            self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), step);
        } else {
            self.keep_in_history(step);
        }
    }

    /// The board left its joints beside the target, by no more than a servo may leave them under their load: it is commanded there again,
    /// with the offsets that were measured meanwhile. Whether that is so, and the motion goes on.
    fn hold_there(&mut self, pulse: &Pulse, step: &mut Step) -> bool {
        let (sampled_at, q) = (pulse.sample.at, &pulse.sample.q);
        let Some(open) = step.book.open.as_mut().filter(|_| self.motion.stream.is_none()) else { return false };
        let left = |m: &usize| match (q.get(*m), open.target.get(*m)) {
            (Some(q), Some(target)) => (q - target).abs() <= step.rules.tolerance + step.rules.hold_error(*m),
            _ => false,
        };
        if !(open.named.iter().all(left) && open.named.iter().any(|m| step.rules.hold_error(*m) > 0.0)) {
            return false;
        }
        let (since, times) = self.motion.held.unwrap_or((sampled_at, 0));
        self.motion.held = Some((since, times));
        if sampled_at < since + hold_offset::SETTLES + step.rules.reaction() {
            return true;
        }
        if times == HOLDS {
            return false;
        }
        self.motion.held = Some((step.now, times + 1));
        let expected = SETTLES.as_secs_f64();
        self.motion.started = Some(Started { at: step.now, distance_to_go: distance(q, &open.target), expected });
        open.since = step.now;
        open.motion = open.motion.until(open.motion.due().unwrap_or(step.now).max(step.now + SETTLES));
        let to = |m: &usize| open.target.get(*m).copied();
        let speed = if open.safe.is_none() { step.rules.escape_speed.min(HOLD_SPEED) } else { HOLD_SPEED };
        let target = Target { motors: open.named.to_vec(), q: open.named.iter().filter_map(to).collect(), speed };
        let command = Command::Move(target.in_step(q, &step.rules.axes));
        step.command(self.token, Writer::Agent, command);
        true
    }

    /// The robot rests at its target. An escape may have led to a pose that still touches: then the filter closes in
    /// the same step, and not by the reflex one reading later, so that no commit slips in between.
    pub(super) fn done(&mut self, pulse: &Pulse, step: &mut Step) {
        self.learn_following();
        let escaped = self.status == Status::Escaping;
        self.restore_modes(Writer::Agent, step);
        self.end(Some(Outcome::Committed), step);
        if escaped && !pulse.free {
            self.close(Cause::Contact(pulse.contacts.to_vec()), step);
            self.enter(Status::Holding(Hold::InContact), step);
        } else {
            self.enter(Status::Rest, step);
        }
    }

    /// Whether the readings have been equal bit for bit while the farthest motor should have gone on, at the motion's
    /// mean speed (I26). By how far it should have gone, and not by time alone: a slow motion may rightly show the same
    /// for long.
    fn is_frozen(&self, sampled_at: Time, unchanged: Time, rules: &Rules) -> bool {
        let Some(started) = self.motion.started else { return false };
        let still = sampled_at.since(unchanged.max(started.at + rules.reaction()));
        // a coarse encoder rightly shows the same while a motion begins, and it has no noise
        let begins = if rules.has_coarse_encoders() { BEGINS * started.distance_to_go } else { 0.0 };
        still >= FROZEN && started.mean_speed() * still.as_secs_f64() > FROZEN_WAY + begins
    }

    /// A motion that outlasts the history takes its safe pose along, or there would be no recorded way back to it: all
    /// that was recorded in it was free, else the reflex would have ended it.
    pub(super) fn keep_in_history(&self, step: &mut Step) {
        let TransactionState { open: Some(open), history, .. } = &mut *step.book else { return };
        let later = open.safe.as_ref().and_then(|safe| history.later_start(safe.since));
        if let Some(later) = later {
            open.safe = Some(SafePose { since: later.at, q: later.q.clone() });
            let (id, q) = (open.id, later.q.clone());
            step.emit(Event::SafePoseMoved { robot: step.robot(), id, q, recorded: None });
        }
    }
}
