//! Ends of motions: the decisions at each reading.
//!
//! A board's "done" is a hint and no proof: it may come early, late, or belong to the previous motion. The measured
//! configuration counts, at rest, within the tolerance of the target (I2, I17). All decisions use `sampled_at`, the
//! time of the reading; `now` only decides whether the reading is still fresh.

use super::{Closing, ExpectedProgress, StoredReading, SuperviseCore, SuperviseOut, SuperviseStep};
use crate::gate::Gate;
use crate::history::BridgedGap;
use crate::ledger::{Open, SafePose, TransactionState};
use crate::pulse::Pulse;
use crate::reflex::{FROZEN_TIME, FROZEN_TRAVEL};
use crate::{Rules, hold_offset};
use mobee_contract::{Cause, Command, Event, Hold, Outcome, Status, Target, Time, Writer, distance};
use std::time::Duration;

/// Time for which the board may report "done" away from the target, by the times of the readings. Some boards report
/// it for a reading or two between a command and its start. Waiting for the motion's deadline instead would make an
/// agent wait for seconds at a target that will not be reached.
const MISSED_TIME: Duration = Duration::from_millis(200);
/// Initial share of its path, at its mean speed, in which a joint has hardly begun to move.
const START_SHARE: f64 = 0.2;
/// Time for which a joint may still move after its board has reported the end.
const SETTLE_TIME: Duration = Duration::from_secs(1);
/// Number of repeated commands for a robot that rests beside its target.
const MAX_HOLD_COMMANDS: u32 = 6;
/// Speed of such a command, as a share of full speed.
const HOLD_SPEED_SHARE: f64 = 0.1;

impl SuperviseCore {
    /// Processes a reading that has passed the whole chain, so all links are alive: renews the lease, and checks
    /// whether a motion has ended. The lease is counted from the time of the reading: a late chain has used up a part
    /// of it.
    pub(super) fn pulse(&mut self, pulse: &Pulse, step: &mut SuperviseStep) {
        let sampled_at = pulse.sample.at;
        let at_rest = pulse.speed < step.rules.rest_speed;
        if self.newest.as_ref().is_some_and(|newest| sampled_at <= newest.sampled_at) {
            return;
        }
        self.newest = Some(StoredReading {
            sampled_at,
            q: pulse.sample.q.clone(),
            speed: pulse.speed,
            at_rest,
            free: pulse.free,
        });
        if let Some(BridgedGap { since, poses }) = pulse.bridged {
            step.emit(Event::Bridged { robot: step.robot(), since, until: sampled_at, poses });
        }
        if let Some(pushed) = self.push.read(&pulse.sample, &step.rules.robot) {
            step.emit(pushed);
        }
        // A delayed reading is no basis for a decision (I8).
        if step.now > sampled_at + step.rules.fresh {
            return;
        }
        let closes = self.watch_effort(pulse, step) || self.watch_stall(pulse, step) || self.watch_idle(pulse, step);
        if closes || step.gate.token() != self.token {
            return; // another component closed the filter, and will report the cause
        }
        match self.closing {
            Closing::Settle(after) => {
                if self.stop.is_ignored(pulse, step.rules, step.now) {
                    step.command(self.token, Writer::Supervise, Command::Stop { motors: Vec::new() });
                }
                // Commands written at a reading must reach the driver before the filter may open at the next one.
                if at_rest && sampled_at >= after && !self.restore_modes(Writer::Supervise, step) {
                    self.settle(pulse, step);
                }
            }
            // Without a lease nothing can move, whatever the part under trial writes.
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

    /// Settles a robot at rest: the open transaction, if any, gets the outcome that the configuration shows; then the
    /// filter opens, or the robot holds.
    ///
    /// The order matters: a motion that can still be rolled back has no outcome yet; a motion left by a crash must
    /// not open the filter by itself; then all others are measured.
    fn settle(&mut self, pulse: &Pulse, step: &mut SuperviseStep) {
        if self.resume_rollback(step) {
            return;
        }
        let lost = self.end_after_crash(step);
        let ended = self.end(None, step);
        // A retreat that a halt cut off at its end needs no retry.
        self.retry = self.retry.take().filter(|_| ended != Some(Outcome::RolledBack));
        self.closing = Closing::No;
        if step.book.halted && !self.shutdown {
            return self.settle_halted(lost, step);
        }
        let held = self.held.take();
        let hold = match self.status {
            _ if self.shutdown => Some(Hold::ShuttingDown),
            _ if held.is_some() => held,
            // Regardless of the state before, an escape is the way out of a contact.
            _ if !pulse.free => Some(Hold::InContact),
            _ if lost => Some(Hold::AfterCrash),
            _ => None,
        };
        match hold {
            Some(reason) => self.enter(Status::Holding(reason), step),
            None => self.open_or_hold(pulse, step),
        }
    }

    /// Rolls back a motion after a restart of a part of the controller: if the path has been recorded without a gap,
    /// the retreat is driven after all, from a fresh reading and monitored as always. Returns whether it is.
    fn resume_rollback(&mut self, step: &mut SuperviseStep) -> bool {
        let restarted = self.status == Status::Holding(Hold::Restarted) && !self.shutdown && !step.book.halted;
        let (Some(open), Some(StoredReading { q: here, .. }), true) = (&step.book.open, &self.newest, restarted) else {
            return false;
        };
        let Some(SafePose { since, q: safe }) = &open.safe else { return false };
        let away = |pose: &[f64]| distance(here, pose) > step.rules.tolerance;
        // After a crash nothing moves until a person requests it (I10).
        let crashed = open.cause == Some(Cause::Crashed);
        if crashed || !away(safe) || !away(&open.target) || step.book.history.past(*since).is_err() {
            return false;
        }
        let Some(motion) = step.book.motion() else { return false };
        let again = open.retreated;
        self.closing = Closing::Reflex;
        self.enter(Status::Stopping, step);
        step.out.push(SuperviseOut::RollBack { token: self.token, motion, again });
        true
    }

    /// Opens the filter, unless the board answers more slowly than its assumed latency. The margin was chosen for
    /// that latency: a robot that stops later than assumed stops in contact.
    fn open_or_hold(&mut self, pulse: &Pulse, step: &mut SuperviseStep) {
        let Some(answers) = pulse.answers.filter(|answers| answers.most > step.rules.latency) else {
            return self.reopen(step);
        };
        if self.status != Status::Holding(Hold::SlowBoard) {
            let robot = step.robot();
            let allowed = step.rules.latency.as_secs_f64() * 1e3;
            let text = format!(
                "{robot}: the filter stays closed: the board {answers}, and its `latency_ms` is {allowed}; find out what slows it, or allow more and keep a wider margin"
            );
            step.emit(Event::Warning { text });
        }
        self.enter(Status::Holding(Hold::SlowBoard), step);
    }

    /// Gives a transaction of an earlier process the outcome that the configuration shows. Returns whether the robot
    /// is at neither end of the motion: then nothing moves until a person requests it, and the retreat can be tried.
    fn end_after_crash(&mut self, step: &mut SuperviseStep) -> bool {
        let crashed = step.book.open.as_ref().is_some_and(|o| o.cause == Some(Cause::Crashed));
        if !crashed {
            return false;
        }
        let motion = step.book.motion();
        let lost = self.end(None, step) == Some(Outcome::Faulted);
        self.retry = motion.filter(|m| lost && !m.is_escape());
        lost
    }

    /// Opens the filter, if it was not closed again since; a retry of a failed retreat is no longer possible.
    fn reopen(&mut self, step: &mut SuperviseStep) {
        debug_assert!(!step.book.halted, "only a release ends a halt");
        self.retry = None;
        if !Gate::opens(self.token) {
            let Some(token) = step.gate.open(self.token) else { return };
            self.token = token;
            step.emit(Event::Enabled { robot: step.robot(), token });
            self.restart_cooldown(self.newest.as_ref().map_or(Time::ZERO, |newest| newest.sampled_at));
        }
        self.enter(Status::Rest, step);
    }

    /// Gives the open transaction its single outcome (I2): the given one, or the one shown by the newest reading.
    /// This is the only place that does so; the ledger takes the transaction and records its end in one step, so that
    /// a death in between loses nothing. No-op if none is open.
    pub(super) fn end(&mut self, given: Option<Outcome>, step: &mut SuperviseStep) -> Option<Outcome> {
        let newest = self.newest.as_ref().map(|newest| newest.q.clone());
        let q = newest.or_else(|| step.book.last_known())?;
        let ended = step.book.settle(given, q, step.rules.tolerance)?;
        self.resting.commanded(&ended.open.named);
        let outcome = ended.outcome;
        let end = ended.end();
        let agent = ended.open.agent.clone();
        let id = ended.open.id;
        ended.events(step.robot()).into_iter().for_each(|event| step.emit(event));
        step.out.push(SuperviseOut::Ended(agent, id, end));
        Some(outcome)
    }

    /// Checks whether a motion in progress has ended or failed, in the order of certainty: at rest at its target;
    /// done elsewhere for a while, or overdue; frozen encoders. Else it goes on.
    fn moving(&mut self, pulse: &Pulse, at_rest: bool, step: &mut SuperviseStep) {
        if self.motion.forces.is_some() {
            return self.under_forces(pulse, at_rest, step);
        }
        if self.motion.stream.is_some() && !self.streaming(pulse, at_rest, step) {
            return;
        }
        let sampled_at = pulse.sample.at;
        let q = &pulse.sample.q;
        let Some(Open { target, since, motion, .. }) = &step.book.open else { return };
        let since = *since;
        let due = motion.due();
        let done = pulse.sample.done.iter().all(|d| *d);
        let away = distance(q, target);
        let far = step.rules.beyond_hold_error(q, target);
        // Later than the commit: an earlier reading shows the end of the previous motion.
        if done && at_rest && sampled_at > since && away <= step.rules.tolerance {
            self.done(pulse, step);
            return;
        }
        // Until then "done" may still belong to the previous motion.
        let reacted = sampled_at >= since + step.rules.reaction();
        // A robot at its target that is not yet known to rest, as after a gap in the readings, has not missed it.
        let elsewhere = done && reacted && away > step.rules.tolerance;
        self.motion.done_since = self.motion.done_since.filter(|_| elsewhere).or(elsewhere.then_some(sampled_at));
        // A board may report the end of its own trajectory, when a lagging joint is still moving.
        let settled = |t: Time| sampled_at >= t + if at_rest { MISSED_TIME } else { SETTLE_TIME };
        if elsewhere && at_rest && self.command_hold(pulse, step) {
            self.advance_safe_pose(step);
        } else if self.motion.done_since.is_some_and(settled) || due.is_some_and(|due| sampled_at > due) {
            self.roll_back(Cause::TargetMissed, step);
        // A robot that has nearly arrived may stand still.
        } else if far > FROZEN_TRAVEL && self.is_frozen(sampled_at, pulse.unchanged, step.rules) {
            self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), step);
        } else {
            self.advance_safe_pose(step);
        }
    }

    /// Repeats the command to the target if the board left its joints beside it by no more than a servo may under
    /// load; by then the hold offsets have been measured. Returns whether this is the case, and the motion goes on.
    fn command_hold(&mut self, pulse: &Pulse, step: &mut SuperviseStep) -> bool {
        let sampled_at = pulse.sample.at;
        let q = &pulse.sample.q;
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
        if sampled_at < since + hold_offset::SETTLE_TIME + step.rules.reaction() {
            return true;
        }
        if times == MAX_HOLD_COMMANDS {
            return false;
        }
        self.motion.held = Some((step.now, times + 1));
        let expected = SETTLE_TIME.as_secs_f64();
        self.motion.started =
            Some(ExpectedProgress { at: step.now, distance_to_go: distance(q, &open.target), expected });
        open.since = step.now;
        open.motion = open.motion.until(open.motion.due().unwrap_or(step.now).max(step.now + SETTLE_TIME));
        let to = |m: &usize| open.target.get(*m).copied();
        let speed = if open.safe.is_none() { step.rules.escape_speed.min(HOLD_SPEED_SHARE) } else { HOLD_SPEED_SHARE };
        let target = Target { motors: open.named.to_vec(), q: open.named.iter().filter_map(to).collect(), speed };
        let command = Command::Move(target.in_step(q, &step.rules.axes));
        step.command(self.token, Writer::Agent, command);
        true
    }

    /// Completes a motion at rest at its target. An escape may have led to a configuration that is still in contact:
    /// then the filter closes in the same step, not by the reflex one reading later, so that no commit slips in
    /// between.
    pub(super) fn done(&mut self, pulse: &Pulse, step: &mut SuperviseStep) {
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

    /// Returns whether the readings have been equal bit for bit while the farthest motor should have moved, at the
    /// motion's mean speed (I26). The criterion is the expected distance, not the time alone: during a slow motion,
    /// unchanged readings are normal.
    fn is_frozen(&self, sampled_at: Time, unchanged: Time, rules: &Rules) -> bool {
        let Some(started) = self.motion.started else { return false };
        let still = sampled_at.since(unchanged.max(started.at + rules.reaction()));
        // A coarse encoder normally shows the same while a motion begins, and it has no noise.
        let begins = if rules.has_coarse_encoders() { START_SHARE * started.distance_to_go } else { 0.0 };
        still >= FROZEN_TIME && started.mean_speed() * still.as_secs_f64() > FROZEN_TRAVEL + begins
    }

    /// Moves the safe pose of a motion that outlasts the history, which would otherwise lose the path back to it.
    /// Everything recorded in the motion was free, else the reflex would have ended it.
    pub(super) fn advance_safe_pose(&self, step: &mut SuperviseStep) {
        let TransactionState { open: Some(open), history, .. } = &mut *step.book else { return };
        let later = open.safe.as_ref().and_then(|safe| history.later_start(safe.since));
        if let Some(later) = later {
            open.safe = Some(SafePose { since: later.at, q: later.q.clone() });
            let id = open.id;
            let q = later.q.clone();
            step.emit(Event::SafePoseMoved { robot: step.robot(), id, q, recorded: None });
        }
    }
}
