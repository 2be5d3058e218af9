//! Algorithm 5: a command arrives, and is refused, accepted as a new transaction, or joins the open one.

use super::check::check;
use super::{Closing, SuperviseCore, SuperviseOut};
use crate::controller::distance;
use crate::ledger::Open;
use mobee_contract::{Command, Commit, CommitId, Event, Hold, Pose, Refusal, Status, Target, Time, Verdict, Writer};
use std::time::Duration;

impl SuperviseCore {
    /// Algorithm 5: a command arrives.
    pub(super) fn commit(&mut self, commit: Commit, now: Time, out: &mut Vec<SuperviseOut>) -> Verdict {
        check(&commit.target, &self.rules)?;
        if self.shutdown {
            return Err(Refusal::Holding { reason: Hold::ShuttingDown });
        }
        let not_ready = |missing: &str| Err(Refusal::NotReady { missing: missing.into() });
        let (at, here, at_rest) = match &self.newest {
            Some((at, q, rest, _)) => (*at, q.clone(), *rest),
            None => return not_ready("a first reading of the encoders"),
        };
        if now > at + self.rules.fresh {
            return not_ready("fresh readings of the encoders");
        }
        match self.status {
            Status::Starting => not_ready("the robot to come to rest"),
            Status::Stopping | Status::Retreating | Status::Settling => Err(Refusal::Closed),
            Status::Holding(reason) if self.closing != Closing::No => Err(Refusal::Holding { reason }),
            Status::Moving | Status::Escaping => self.amend(commit, here, now, out),
            Status::Rest if self.gate.token() != self.token => Err(Refusal::Closed),
            Status::Rest => {
                let Some((at, q, speed)) = self.rest.clone().filter(|(at, ..)| now <= *at + self.rules.fresh) else {
                    return not_ready("the robot to come to rest");
                };
                let safe = self.safe_pose(&q);
                let (robot, age) = (self.rules.robot.clone(), now.since(at).as_secs_f64());
                out.push(SuperviseOut::Event(Event::SafePose { robot, q: safe.clone(), age, speed, free: true }));
                self.accept(commit, Some((at, safe)), here, now, out)
            }
            Status::Holding(_) if !at_rest => not_ready("the robot to come to rest"),
            Status::Holding(_) => {
                let Some(token) = self.gate.open(self.token) else { return Err(Refusal::Closed) };
                self.token = token;
                out.push(SuperviseOut::Event(Event::Enabled { robot: self.rules.robot.clone(), token }));
                self.accept(commit, None, here, now, out)
            }
        }
    }

    /// The safe pose for a robot that rests at `q`: the last one if the reading confirms it, so that many rollbacks to
    /// one vertex do not drift with the encoders' noise.
    fn safe_pose(&self, q: &Pose) -> Pose {
        let mut book = self.ledger.book();
        let kept = book.safe.clone().filter(|safe| distance(safe, q) <= 0.25 * self.rules.tolerance);
        let safe = kept.unwrap_or_else(|| q.clone());
        book.safe = Some(safe.clone());
        safe
    }

    fn accept(
        &mut self,
        commit: Commit,
        safe: Option<(Time, Pose)>,
        here: Pose,
        now: Time,
        out: &mut Vec<SuperviseOut>,
    ) -> Verdict {
        let escape = safe.is_none();
        let target = self.limited(commit.target, escape);
        let whole = target.pose(&here);
        let (due, secs) = self.due(&target, &here, now);
        let id = {
            let mut book = self.ledger.book();
            book.last_id += 1;
            let id = CommitId(book.last_id);
            let (agent, target) = (commit.agent.clone(), whole.clone());
            book.open = Some(Open { id, agent, target, safe, since: now, due, cause: None });
            id
        };
        self.retry = None;
        self.done_since = None;
        self.course = Some((now, distance(&whole, &here), secs));
        let (robot, agent) = (self.rules.robot.clone(), commit.agent.to_string());
        out.push(SuperviseOut::Event(Event::Commit { robot, id, agent, target: whole, escape }));
        self.enter(if escape { Status::Escaping } else { Status::Moving }, out);
        out.push(SuperviseOut::Command(
            self.token,
            Writer::Agent,
            Command::Move(target.in_step(&here, &self.rules.axes)),
        ));
        Ok(id)
    }

    /// A command in mid-motion changes the open transaction: same id, same safe pose.
    fn amend(&mut self, commit: Commit, here: Pose, now: Time, out: &mut Vec<SuperviseOut>) -> Verdict {
        if self.gate.token() != self.token {
            return Err(Refusal::Closed);
        }
        let escape = self.status == Status::Escaping;
        let target = self.limited(commit.target, escape);
        let whole = target.pose(&here);
        let (due, secs) = self.due(&target, &here, now);
        let id = {
            let mut book = self.ledger.book();
            let Some(open) = book.open.as_mut() else {
                return Err(Refusal::NotReady { missing: "the outcome of the last motion".into() });
            };
            if open.agent != commit.agent {
                return Err(Refusal::Busy);
            }
            open.target = whole.clone();
            open.since = now;
            open.due = due;
            open.id
        };
        self.done_since = None;
        self.course = Some((now, distance(&whole, &here), secs));
        out.push(SuperviseOut::Event(Event::Amended { robot: self.rules.robot.clone(), id, target: whole }));
        // from a moving start the motors can't be kept in step exactly; the board replans each from where it is
        let command = Command::Move(target.in_step(&here, &self.rules.axes));
        out.push(SuperviseOut::Command(self.token, Writer::Agent, command));
        Ok(id)
    }

    fn limited(&self, target: Target, escape: bool) -> Target {
        let speed = if escape { target.speed.min(self.rules.escape_speed) } else { target.speed };
        Target { speed, ..target }
    }

    /// When the motion must have ended, and how long it should take: at a mean speed of half the greatest.
    fn due(&self, target: &Target, here: &Pose, now: Time) -> (Time, f64) {
        let ways = target.motors.iter().zip(&target.q).filter_map(|(m, q)| {
            let (axis, here) = (self.rules.axes.get(*m)?, here.get(*m)?);
            let way = (q - here).abs();
            let push = (way / axis.max_acceleration.max(1e-6)).sqrt();
            Some(2.0 * way / (target.speed * axis.max_speed).max(1e-6) + 2.0 * push)
        });
        let secs = ways.fold(0.0, f64::max) + self.rules.latency.as_secs_f64();
        (now + Duration::from_secs_f64((2.0 * secs + 1.0).min(1e6)), secs)
    }
}
