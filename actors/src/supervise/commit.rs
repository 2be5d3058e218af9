//! Algorithm 5: a command arrives, and is refused, accepted as a new transaction, or joins the open one.

use super::check::{check, check_speeds};
use super::{Closing, Reading, SuperviseCore, SuperviseOut};
use crate::controller::distance;
use crate::ledger::Open;
use mobee_contract::{
    Command, Commit, CommitId, Event, Hold, Move, Pose, Refusal, Status, Target, Time, Verdict, Writer,
};
use std::sync::Arc;
use std::time::Duration;

/// How many times longer than the straight way a motion under forces may take.
const ROUNDABOUT: u32 = 3;
/// Greatest share of a motor's speed that a motion under forces uses: what is streamed must be followed.
const FASTEST: f64 = 0.9;

impl SuperviseCore {
    /// Algorithm 5: a command arrives.
    pub(super) fn commit(&mut self, commit: Commit, now: Time, out: &mut Vec<SuperviseOut>) -> Verdict {
        check(&commit.target, &self.rules)?;
        check_speeds(&commit, &self.rules)?;
        if !self.credits.commits.take(now) {
            return Err(Refusal::Busy);
        }
        match self.admit(now)? {
            Way::Join { here } => self.amend(commit, here, now, out),
            Way::Begin { here, at, speed } => {
                let safe = self.take_safe(at, &here, speed, now, out);
                self.accept(commit, Some(safe), here, now, out)
            }
            Way::Escape { here, .. } => {
                let Some(token) = self.gate.open(self.token) else { return Err(Refusal::Closed) };
                self.token = token;
                out.push(SuperviseOut::Event(Event::Enabled { robot: self.rules.robot.clone(), token }));
                self.accept(commit, None, here, now, out)
            }
        }
    }

    /// What a command that fits would be now.
    ///
    /// # Errors
    /// Why none is taken now.
    pub(super) fn admit(&self, now: Time) -> Result<Way, Refusal> {
        if self.shutdown {
            return Err(Refusal::Holding { reason: Hold::ShuttingDown });
        }
        let not_ready = |missing: &str| Err(Refusal::NotReady { missing: missing.into() });
        let Some(Reading { at, q: here, speed, at_rest, free }) = self.newest.clone() else {
            return not_ready("a first reading of the encoders");
        };
        if now > at + self.rules.fresh {
            return not_ready("fresh readings of the encoders");
        }
        match self.status {
            Status::Starting => not_ready("the robot to come to rest"),
            Status::Stopping | Status::Retreating | Status::Settling => Err(Refusal::Closed),
            Status::Holding(reason) if self.closing != Closing::No => Err(Refusal::Holding { reason }),
            Status::Rest | Status::Moving | Status::Escaping if self.gate.token() != self.token => Err(Refusal::Closed),
            Status::Moving | Status::Escaping => Ok(Way::Join { here }),
            // the filter may have opened by a reading before the contact began: the reflex will close it at the next one
            Status::Rest if !free => Err(Refusal::Holding { reason: Hold::InContact }),
            Status::Holding(reason @ (Hold::AfterCrash | Hold::SlowBoard)) => Err(Refusal::Holding { reason }),
            // something moves it, though it was at rest: no pose to come back to (I4)
            Status::Rest | Status::Holding(_) if !at_rest => not_ready("the robot to come to rest"),
            Status::Rest => Ok(Way::Begin { here, at, speed }),
            Status::Holding(reason) => Ok(Way::Escape { here, reason }),
        }
    }

    /// Takes the safe pose of a new transaction from a reading at rest.
    pub(super) fn take_safe(
        &self,
        at: Time,
        q: &Pose,
        speed: f64,
        now: Time,
        out: &mut Vec<SuperviseOut>,
    ) -> (Time, Pose) {
        let safe = self.safe_pose(q);
        let (robot, age) = (self.rules.robot.clone(), now.since(at).as_secs_f64());
        out.push(SuperviseOut::Event(Event::SafePose { robot, q: safe.clone(), age, speed, free: self.rules.reflex }));
        (at, safe)
    }

    /// The safe pose for a robot that rests at `q`: the last one if the robot counts as being there, so that many rollbacks
    /// to one vertex do not drift with the encoders' noise.
    fn safe_pose(&self, q: &Pose) -> Pose {
        let mut book = self.ledger.book();
        let kept = book.safe.clone().filter(|safe| distance(safe, q) <= self.rules.tolerance);
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
        let course = self.course(&commit, &here, escape);
        let target = commit.target.pose(&here);
        // an escape creeps straight, watched
        let fields = self.rules.fields.clone().filter(|_| !escape);
        let due = now + course.patience() * if fields.is_some() { ROUNDABOUT } else { 1 };
        let id = self.open(commit.agent.clone(), (target.clone(), &commit.target.motors), safe, (Some(due), now), out);
        self.course = Some((now, distance(&target, &here), course.secs));
        let (robot, agent) = (self.rules.robot.clone(), commit.agent.to_string());
        let motors = self.allowed(&commit, escape);
        let told = Event::Commit { robot, id, agent, target: target.clone(), escape, motors: motors.clone() };
        out.push(SuperviseOut::Event(told));
        self.enter(if escape { Status::Escaping } else { Status::Moving }, out);
        if let Some(fields) = fields {
            self.begin_forces(&fields, (&target, &motors), &here, now, out);
            return Ok(id);
        }
        out.push(SuperviseOut::Command(self.token, Writer::Agent, Command::Move(course.command)));
        Ok(id)
    }

    /// Enters a transaction into the ledger: its target, and the motors that it names.
    pub(super) fn open(
        &mut self,
        agent: Arc<str>,
        (target, motors): (Pose, &[usize]),
        safe: Option<(Time, Pose)>,
        (due, now): (Option<Time>, Time),
        out: &mut Vec<SuperviseOut>,
    ) -> CommitId {
        self.retry = None;
        self.done_since = None;
        // the reading that opened the filter may have been the newest: it lets the robot move as the next will
        out.extend(self.newest.as_ref().map(|newest| SuperviseOut::Lease(newest.at + self.rules.fresh)));
        self.with_book(|book| {
            book.last_id += 1;
            let id = CommitId(book.last_id);
            let mut open = Open {
                id,
                agent,
                target,
                named: Vec::new().into(),
                safe,
                since: now,
                due,
                cause: None,
                retreated: false,
            };
            open.name(motors);
            book.open = Some(open);
            id
        })
    }

    /// A command in mid-motion changes the open transaction: same id, same safe pose. Motors that it does not name keep
    /// the targets they have.
    fn amend(&mut self, commit: Commit, here: Pose, now: Time, out: &mut Vec<SuperviseOut>) -> Verdict {
        let open = self.with_book(|b| b.open.as_ref().map(|o| o.agent.clone()));
        match open {
            None => return Err(Refusal::NotReady { missing: "the outcome of the last motion".into() }),
            Some(owner) if owner != commit.agent => return Err(Refusal::Busy),
            Some(_) if self.forces.is_some() => {}
            Some(_) => self.leave_stream(&commit.target.motors),
        }
        let escape = self.status == Status::Escaping;
        let course = self.course(&commit, &here, escape);
        let (id, target) = {
            let mut book = self.ledger.book();
            let Some(open) = book.open.as_mut() else {
                return Err(Refusal::NotReady { missing: "the outcome of the last motion".into() });
            };
            open.target = commit.target.pose(&open.target);
            open.name(&commit.target.motors);
            open.since = now;
            let due = now + course.patience() * if self.forces.is_some() { ROUNDABOUT } else { 1 };
            // motors that go on as they were may need longer
            let all = commit.target.motors.len() == here.len();
            open.due = open.due.filter(|_| !all).max(Some(due));
            (open.id, open.target.clone())
        };
        self.done_since = None;
        self.course = Some((now, distance(&target, &here), course.secs));
        let (robot, motors) = (self.rules.robot.clone(), self.allowed(&commit, escape));
        out.push(SuperviseOut::Event(Event::Amended { robot, id, target: target.clone(), motors: motors.clone() }));
        if self.forces.is_some() {
            self.aim_forces(&target, &motors, now, out);
            return Ok(id);
        }
        // from a moving start the motors can't be kept in step exactly; the board replans each from where it is
        out.push(SuperviseOut::Command(self.token, Writer::Agent, Command::Move(course.command)));
        Ok(id)
    }

    /// The motors of a commit, each with the greatest speed that it may have, rad/s: its own, or its share of the axis'. An escape
    /// creeps, and what is streamed under forces must be followed.
    fn allowed(&self, commit: &Commit, escape: bool) -> Vec<(usize, f64)> {
        let most = match &self.rules.fields {
            _ if escape => self.rules.escape_speed,
            Some(_) => FASTEST,
            None => 1.0,
        };
        let share = commit.target.speed.min(most);
        let cap = |(i, m): (usize, &usize)| {
            let most = self.rules.axes.get(*m).map_or(0.0, |a| a.max_speed * share);
            let own = commit.speeds.as_ref().and_then(|v| v.get(i)).copied().unwrap_or(most);
            (*m, own.min(most))
        };
        commit.target.motors.iter().enumerate().map(cap).collect()
    }

    /// How a commit is driven from `here`: in step, or each motor at its own speed, never above what its axis can do.
    fn course(&self, commit: &Commit, here: &Pose, escape: bool) -> Course {
        let share = if escape { self.rules.escape_speed.min(commit.target.speed) } else { commit.target.speed };
        let target = Target { speed: share, ..commit.target.clone() };
        let own: Option<Vec<f64>> =
            commit.speeds.as_ref().map(|_| self.allowed(commit, escape).into_iter().map(|(_, speed)| speed).collect());
        let mut secs = 0.0;
        for (i, (m, q)) in target.motors.iter().zip(&target.q).enumerate() {
            let (Some(axis), Some(here)) = (self.rules.axes.get(*m), here.get(*m)) else { continue };
            let speed = own.as_ref().and_then(|v| v.get(i)).copied().unwrap_or(share * axis.max_speed);
            let way = (q - here).abs();
            let push = (way / axis.max_acceleration.max(1e-6)).sqrt();
            // at a mean speed of half the greatest
            secs = f64::max(secs, 2.0 * way / speed.max(1e-6) + 2.0 * push);
        }
        let secs = secs + self.rules.latency.as_secs_f64();
        let command = match own {
            None => target.in_step(here, &self.rules.axes),
            Some(speed) => {
                let push = |m: &usize| self.rules.axes.get(*m).map_or(0.0, |a| a.max_acceleration);
                let acceleration = Some(target.motors.iter().map(push).collect());
                Move { motors: target.motors, q: target.q, relative: false, speed: Some(speed), acceleration }
            }
        };
        Course { command, secs }
    }
}

/// What a command that fits would be.
pub(super) enum Way {
    /// It joins the open transaction.
    Join {
        /// The newest reading.
        here: Pose,
    },
    /// It begins one.
    Begin {
        /// The newest reading.
        here: Pose,
        /// When it was read.
        at: Time,
        /// How fast the robot was.
        speed: f64,
    },
    /// It is an escape from a hold.
    Escape {
        /// The newest reading.
        here: Pose,
        /// Why the robot holds.
        reason: Hold,
    },
}

/// How a commit is driven, and how long that should take.
struct Course {
    command: Move,
    secs: f64,
}

impl Course {
    /// After which time it must have ended.
    fn patience(&self) -> Duration {
        Duration::from_secs_f64((2.0 * self.secs + 1.0).min(1e6))
    }
}
