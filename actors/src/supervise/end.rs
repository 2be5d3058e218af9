//! How motions end: what each reading decides.

use super::{Closing, Reading, SuperviseCore, SuperviseOut};
use crate::controller::distance;
use crate::gate::Gate;
use crate::pulse::Pulse;
use crate::reflex::{FROZEN, FROZEN_WAY};
use mobee_contract::{Cause, Command, Event, Hold, Outcome, Status, Time, Writer};
use std::time::Duration;

/// How long the board may say "done" away from the target.
const MISSED: Duration = Duration::from_millis(200);

impl SuperviseCore {
    /// A reading came through the whole chain: all live. Renew the lease, and see whether something has ended.
    pub(super) fn pulse(&mut self, pulse: &Pulse, now: Time, out: &mut Vec<SuperviseOut>) {
        let at = pulse.sample.at;
        let at_rest = pulse.speed < self.rules.rest_speed;
        if self.newest.as_ref().is_some_and(|newest| at <= newest.at) {
            return;
        }
        let (q, speed, free) = (pulse.sample.q.clone(), pulse.speed, pulse.free);
        self.newest = Some(Reading { at, q, speed, at_rest, free });
        // what was held up on its way is no ground for a decision (I8)
        if now > at + self.rules.fresh {
            return;
        }
        if self.watch_idle(pulse, now, out) || self.gate.token() != self.token {
            return; // somebody closed the filter, and will tell why
        }
        match self.closing {
            Closing::Settle(after) => {
                let rules = self.rules.clone();
                if self.stop.is_ignored(pulse, &rules, now) {
                    out.push(SuperviseOut::Command(
                        self.token,
                        Writer::Supervise,
                        Command::Stop { motors: Vec::new() },
                    ));
                }
                // what is written at a reading must be with the driver before the filter may open at the next
                if at_rest && at >= after && !self.restore_modes(Writer::Supervise, out) {
                    self.settle(pulse, out);
                }
            }
            Closing::Yielded => {}
            Closing::Reflex => out.push(SuperviseOut::Lease(at + self.rules.fresh)),
            Closing::No => {
                out.push(SuperviseOut::Lease(at + self.rules.fresh));
                match self.status {
                    Status::Moving | Status::Escaping => self.moving(pulse, now, at_rest, out),
                    Status::Holding(Hold::InContact | Hold::SlowBoard) if at_rest && pulse.free => {
                        self.open_or_hold(pulse, out)
                    }
                    _ => {}
                }
            }
        }
    }

    /// The robot rests: the open transaction, if any, gets the outcome that the pose shows; then open, or hold.
    fn settle(&mut self, pulse: &Pulse, out: &mut Vec<SuperviseOut>) {
        if self.take_back(out) {
            return;
        }
        let lost = self.end_after_crash(out);
        self.end(None, out);
        self.closing = Closing::No;
        let hold = match self.status {
            _ if self.shutdown => Some(Hold::ShuttingDown),
            // whatever was before, the way out of a contact is an escape
            _ if !pulse.free => Some(Hold::InContact),
            _ if lost => Some(Hold::AfterCrash),
            _ => None,
        };
        match hold {
            Some(reason) => self.enter(Status::Holding(reason), out),
            None => self.open_or_hold(pulse, out),
        }
    }

    /// A part of the controller was restarted in mid-motion, and is well again: if the path has been recorded without a gap, the
    /// motion is taken back after all, by a fresh reading and watched as always. Whether it is.
    fn take_back(&mut self, out: &mut Vec<SuperviseOut>) -> bool {
        let rested = self.newest.as_ref().map(|newest| newest.q.clone());
        let recorded = self.with_book(|book| {
            let (open, here) = (book.open.as_ref()?, rested?);
            let (since, safe) = open.safe.as_ref()?;
            let away = |pose: &[f64]| distance(&here, pose) > self.rules.tolerance;
            let crashed = open.cause == Some(Cause::Crashed);
            let recorded = !crashed && away(safe) && away(&open.target) && book.history.past(*since).is_ok();
            recorded.then_some(open.retreated)
        });
        let restarted = self.status == Status::Holding(Hold::Restarted) && !self.shutdown;
        let (Some(again), Some(motion)) = (recorded.filter(|_| restarted), self.motion()) else { return false };
        self.closing = Closing::Reflex;
        self.enter(Status::Stopping, out);
        out.push(SuperviseOut::RollBack { token: self.token, motion, again });
        true
    }

    /// All is well: open the filter, unless the board answers too slowly for what is reckoned with its latency.
    fn open_or_hold(&mut self, pulse: &Pulse, out: &mut Vec<SuperviseOut>) {
        let Some(answers) = pulse.answers.filter(|answers| answers.most > self.rules.latency) else {
            return self.reopen(out);
        };
        if self.status != Status::Holding(Hold::SlowBoard) {
            let (robot, allowed) = (&self.rules.robot, self.rules.latency.as_secs_f64() * 1e3);
            let text = format!(
                "{robot}: the filter stays closed: the board {answers}, and its `latency_ms` is {allowed}; find out what slows it, or allow more and keep a wider margin"
            );
            out.push(SuperviseOut::Event(Event::Warning { text }));
        }
        self.enter(Status::Holding(Hold::SlowBoard), out);
    }

    /// What an earlier process left open gets the outcome that the pose shows. Whether that is neither of its two ends: then
    /// nothing moves before somebody asks for it, and the way back can be tried.
    fn end_after_crash(&mut self, out: &mut Vec<SuperviseOut>) -> bool {
        let crashed = self.with_book(|b| b.open.as_ref().is_some_and(|o| o.cause == Some(Cause::Crashed)));
        if !crashed {
            return false;
        }
        let motion = self.motion();
        let lost = self.end(None, out) == Some(Outcome::Faulted);
        self.retry = motion.filter(|m| lost && !m.is_escape());
        lost
    }

    fn reopen(&mut self, out: &mut Vec<SuperviseOut>) {
        self.retry = None;
        if !Gate::opens(self.token) {
            let Some(token) = self.gate.open(self.token) else { return };
            self.token = token;
            out.push(SuperviseOut::Event(Event::Enabled { robot: self.rules.robot.clone(), token }));
            self.begin_silence(self.newest.as_ref().map_or(Time::ZERO, |newest| newest.at));
        }
        self.enter(Status::Rest, out);
    }

    /// Gives the open transaction its one outcome (I2): as told, or as the newest reading shows.
    pub(super) fn end(&mut self, told: Option<Outcome>, out: &mut Vec<SuperviseOut>) -> Option<Outcome> {
        let (newest, tolerance) = (self.newest.as_ref().map(|newest| newest.q.clone()), self.rules.tolerance);
        let ended = self.with_book(|book| book.settle(told, newest.or_else(|| book.last_known())?, tolerance))?;
        self.resting.commanded(&ended.open.named);
        let (outcome, end) = (ended.outcome, ended.end());
        let (agent, id) = (ended.open.agent.clone(), ended.open.id);
        if told.is_none() && outcome == Outcome::Committed {
            // it was cut off, and rests where its stream had led by then
            let (robot, target) = (self.rules.robot.clone(), ended.open.target.clone());
            out.push(SuperviseOut::Event(Event::Amended { robot, id, target, motors: Vec::new() }));
        }
        out.push(SuperviseOut::Event(ended.event(self.rules.robot.clone())));
        out.push(SuperviseOut::Ended(agent, id, end));
        Some(outcome)
    }

    /// A motion is under way: has it ended, or gone wrong?
    fn moving(&mut self, pulse: &Pulse, now: Time, at_rest: bool, out: &mut Vec<SuperviseOut>) {
        if self.forces.is_some() {
            return self.under_forces(pulse, now, at_rest, out);
        }
        if self.stream.is_some() && !self.streaming(pulse, now, at_rest, out) {
            return;
        }
        let at = pulse.sample.at;
        let q = &pulse.sample.q;
        let (target, since, due) = match self.with_book(|b| b.open.as_ref().map(|o| (o.target.clone(), o.since, o.due)))
        {
            Some(open) => open,
            None => return,
        };
        let done = pulse.sample.done.iter().all(|d| *d);
        let away = distance(q, &target);
        if done && at_rest && at > since && away <= self.rules.tolerance {
            self.done(pulse, out);
            return;
        }
        let reacted = at >= since + self.rules.reaction();
        // there, but not yet known to rest, as after a gap in the readings, is not missed
        let elsewhere = done && reacted && away > self.rules.tolerance;
        self.done_since = if elsewhere { self.done_since.or(Some(at)) } else { None };
        if self.done_since.is_some_and(|t| at >= t + MISSED) || due.is_some_and(|due| at > due) {
            self.roll_back(Cause::TargetMissed, now, out);
        } else if away > FROZEN_WAY && self.is_frozen(at, pulse.unchanged) {
            self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), now, out);
        } else {
            self.keep_in_history(out);
        }
    }

    /// The robot rests at its target.
    pub(super) fn done(&mut self, pulse: &Pulse, out: &mut Vec<SuperviseOut>) {
        let escaped = self.status == Status::Escaping;
        self.restore_modes(Writer::Agent, out);
        self.end(Some(Outcome::Committed), out);
        if escaped && !pulse.free {
            self.close(Cause::Contact(pulse.contacts.to_vec()), out);
            self.enter(Status::Holding(Hold::InContact), out);
        } else {
            self.enter(Status::Rest, out);
        }
    }

    /// Whether the readings have been equal bit for bit while the farthest motor should have gone on, at the motion's
    /// mean speed.
    fn is_frozen(&self, at: Time, unchanged: Time) -> bool {
        let Some((begun, way, secs)) = self.course else { return false };
        let still = at.since(unchanged.max(begun + self.rules.reaction()));
        still >= FROZEN && way / secs.max(1e-3) * still.as_secs_f64() > FROZEN_WAY
    }

    /// A motion that outlasts the history takes its safe pose along: all that was recorded in it was free, else the
    /// reflex would have ended it.
    pub(super) fn keep_in_history(&mut self, out: &mut Vec<SuperviseOut>) {
        let moved = self.with_book(|book| {
            let open = book.open.as_mut()?;
            let (at, _) = open.safe.as_ref()?;
            let later = book.history.later_start(*at)?;
            open.safe = Some((later.at, later.q.clone()));
            Some((open.id, later.q.clone()))
        });
        if let Some((id, q)) = moved {
            let robot = self.rules.robot.clone();
            out.push(SuperviseOut::Event(Event::SafePoseMoved { robot, id, q }));
        }
    }
}
