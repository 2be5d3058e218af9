//! Algorithm 5: a command arrives, and is refused, accepted as a new transaction, or joins the open one.
//!
//! The paper passes a command on if the filter is open. Here it is asked, too, whether the newest reading is fresh, at
//! rest and free: its pose becomes the safe pose, and the promise that it is one is worth as much as that reading (I4,
//! I8).

use super::check::{check, check_speeds};
use super::{Closing, MotionState, Reading, Started, Step, SuperviseCore, SuperviseOut};
use crate::ledger::{Extent, Motion, Open, SafePose};
use crate::{Rules, distance};
use mobee_contract::{
    Command, Commit, CommitId, Event, Hold, Move, Pose, Refusal, Status, Target, Time, Verdict, Writer,
};
use std::sync::Arc;
use std::time::Duration;

/// How many times longer than the straight way a motion under forces may take: it goes round what is near, and slows
/// down beside it.
const DETOUR_FACTOR: u32 = 3;
/// Greatest share of a motor's speed that a motion under forces uses: what is streamed must be followed, which takes a
/// little more speed than the reference has.
const FASTEST: f64 = 0.9;

impl SuperviseCore {
    /// Algorithm 5: a command arrives.
    pub(super) fn commit(&mut self, commit: Commit, step: &mut Step) -> Verdict {
        // what can never be is said before what can't be now: its agent should mend it, not try again
        check(&commit.target, step.rules)?;
        check_speeds(&commit, step.rules)?;
        if !self.credits.commits.take(step.now) {
            return Err(Refusal::Busy);
        }
        // after the checks and before anything is told: refusals have credit of their own
        match self.admit(step)? {
            Admission::Join { here } => self.amend(commit, &here, step),
            Admission::Begin { here, sampled_at, speed } => {
                let safe = self.take_safe(sampled_at, &here, speed, step);
                self.accept(commit, Some(safe), here, step)
            }
            Admission::Escape { here, .. } => {
                // opened for this commit alone: the reflex lets it creep, and closes at anything that gets worse
                let Some(token) = step.gate.open(self.token) else { return Err(Refusal::Closed) };
                self.token = token;
                step.emit(Event::Enabled { robot: step.robot(), token });
                self.accept(commit, None, here, step)
            }
        }
    }

    /// What a command that fits would be now.
    ///
    /// # Errors
    /// Why none is taken now.
    pub(super) fn admit(&self, step: &Step) -> Result<Admission, Refusal> {
        if self.shutdown {
            return Err(Refusal::Holding { reason: Hold::ShuttingDown });
        }
        if step.book.halted {
            return Err(Refusal::Holding { reason: Hold::Halted });
        }
        let not_ready = |missing: &str| Err(Refusal::NotReady { missing: missing.into() });
        let Some(Reading { sampled_at, q: here, speed, at_rest, free }) = self.newest.clone() else {
            return not_ready("a first reading of the encoders");
        };
        if step.now > sampled_at + step.rules.fresh {
            return not_ready("fresh readings of the encoders");
        }
        // by the state, and within it by the newest reading; the token last, since the reflex may have closed at this
        // very reading
        match self.status {
            Status::Starting => not_ready("the robot to come to rest"),
            Status::Stopping | Status::Retreating | Status::Settling => Err(Refusal::Closed),
            Status::Holding(reason) if self.closing != Closing::No => Err(Refusal::Holding { reason }),
            Status::Rest | Status::Moving | Status::Escaping if step.gate.token() != self.token => Err(Refusal::Closed),
            Status::Moving | Status::Escaping => Ok(Admission::Join { here }),
            // the filter may have opened by a reading before the contact began: the reflex will close it at the next
            // one
            Status::Rest if !free => Err(Refusal::Holding { reason: Hold::InContact }),
            Status::Holding(reason @ (Hold::AfterCrash | Hold::SlowBoard)) => Err(Refusal::Holding { reason }),
            // something moves it, though it was at rest: no pose to come back to (I4)
            Status::Rest | Status::Holding(_) if !at_rest => not_ready("the robot to come to rest"),
            Status::Rest => Ok(Admission::Begin { here, sampled_at, speed }),
            Status::Holding(reason) => Ok(Admission::Escape { here, reason }),
        }
    }

    /// Takes the safe pose of a new transaction from a reading at rest (I4).
    pub(super) fn take_safe(&self, sampled_at: Time, q: &Pose, speed: f64, step: &mut Step) -> SafePose {
        let safe = step.safe_pose(q);
        let (robot, age) = (step.robot(), step.now.since(sampled_at).as_secs_f64());
        step.emit(Event::SafePose { robot, q: safe.clone(), age, speed, free: step.rules.reflex });
        SafePose { since: sampled_at, q: safe }
    }

    /// A commit begins a transaction: with a safe pose, or as an escape without one.
    fn accept(&mut self, commit: Commit, safe: Option<SafePose>, here: Pose, step: &mut Step) -> Verdict {
        let escape = safe.is_none();
        let course = course(&commit, &here, escape, step.rules);
        let target = commit.target.pose(&here);
        // an escape creeps straight, watched
        let fields = step.rules.fields.as_deref().filter(|_| !escape);
        let motion = match fields {
            _ if escape => Motion::Escape { due: step.now + course.patience() },
            Some(_) => Motion::Forces { due: step.now + course.patience() * DETOUR_FACTOR },
            None => Motion::Move { due: step.now + course.patience() },
        };
        let id = self.open(commit.agent.clone(), (target.clone(), &commit.target.motors), (safe, motion), step);
        self.motion.started = Some(course.started(distance(&target, &here), step.now));
        let (robot, agent) = (step.robot(), commit.agent.to_string());
        let motors = allowed(&commit, escape, step.rules);
        let (target_told, motors_told) = (target.clone(), motors.clone());
        let told = Event::Commit { robot, id, agent, target: target_told, escape, motors: motors_told, stream: false };
        step.emit(told);
        self.enter(if escape { Status::Escaping } else { Status::Moving }, step);
        if let Some(fields) = fields {
            self.begin_forces(fields, (&target, &motors), &here, step);
            return Ok(id);
        }
        step.command(self.token, Writer::Agent, Command::Move(course.command));
        Ok(id)
    }

    /// Enters a transaction into the ledger: its target, and the motors that it names. From here on it is owed an
    /// outcome, whoever dies.
    pub(super) fn open(
        &mut self,
        agent: Arc<str>,
        (target, motors): (Pose, &[usize]),
        (safe, motion): (Option<SafePose>, Motion),
        step: &mut Step,
    ) -> CommitId {
        self.retry = None;
        self.motion = MotionState::default();
        // the reading that opened the filter may have been the newest: it lets the robot move as the next will
        step.out.extend(self.newest.as_ref().map(|newest| SuperviseOut::Lease(newest.sampled_at + step.rules.fresh)));
        step.book.last_id += 1;
        let id = CommitId(step.book.last_id);
        let (named, since) = (Vec::new().into(), step.now);
        let extent = if motion == Motion::Stream { Extent::Stream } else { Extent::Whole };
        let mut open = Open { id, agent, target, named, safe, since, motion, cause: None, retreated: false, extent };
        open.name(motors);
        step.book.open = Some(open);
        id
    }

    /// A command in mid-motion changes the open transaction: same id, same safe pose. Motors that it does not name keep
    /// the targets they have.
    fn amend(&mut self, commit: Commit, here: &Pose, step: &mut Step) -> Verdict {
        match step.owner() {
            None => return Err(Refusal::NotReady { missing: "the outcome of the last motion".into() }),
            Some(owner) if owner != commit.agent => return Err(Refusal::Busy),
            Some(_) if self.motion.forces.is_some() => {}
            Some(_) => self.leave_stream(&commit.target.motors),
        }
        // what joins an escape creeps as it does, and has no safe pose either
        let escape = self.status == Status::Escaping;
        let course = course(&commit, here, escape, step.rules);
        let (id, target) = {
            let Some(open) = step.book.open.as_mut() else {
                return Err(Refusal::NotReady { missing: "the outcome of the last motion".into() });
            };
            open.target = commit.target.pose(&open.target);
            open.name(&commit.target.motors);
            // a move is taken back to where it began, and with it all that is one transaction with it
            open.extent = Extent::Whole;
            open.since = step.now;
            let detours = if let Motion::Forces { .. } = open.motion { DETOUR_FACTOR } else { 1 };
            let due = step.now + course.patience() * detours;
            // motors that go on as they were may need longer
            let all = commit.target.motors.len() == here.len();
            open.motion = open.motion.until(open.motion.due().filter(|_| !all).map_or(due, |before| before.max(due)));
            (open.id, open.target.clone())
        };
        // "done" of the target before says nothing of this one
        (self.motion.done_since, self.motion.held) = (None, None);
        self.motion.started = Some(course.started(distance(&target, here), step.now));
        let (robot, motors) = (step.robot(), allowed(&commit, escape, step.rules));
        step.emit(Event::Amended { robot, id, target: target.clone(), motors: motors.clone(), stream: false });
        if self.motion.forces.is_some() {
            self.aim_forces(&target, &motors, step);
            return Ok(id);
        }
        // from a moving start the motors can't be kept in step exactly; the board replans each from where it is
        step.command(self.token, Writer::Agent, Command::Move(course.command));
        Ok(id)
    }
}

/// The motors of a commit, each with the greatest speed that it may have, rad/s: its own, or its share of the axis'. An
/// escape creeps, and what is streamed under forces must be followed.
fn allowed(commit: &Commit, escape: bool, rules: &Rules) -> Vec<(usize, f64)> {
    let most = match &rules.fields {
        _ if escape => rules.escape_speed,
        Some(_) => FASTEST,
        None => 1.0,
    };
    let share = commit.target.speed.min(most);
    let cap = |(i, m): (usize, &usize)| {
        let most = rules.axes.get(*m).map_or(0.0, |a| a.max_speed * share);
        let own = commit.speeds.as_ref().and_then(|v| v.get(i)).copied().unwrap_or(most);
        (*m, own.min(most))
    };
    commit.target.motors.iter().enumerate().map(cap).collect()
}

/// How a commit is driven from `here`, rad: in step, or each motor at its own speed, never above what its axis can do.
/// In step by default, since then the way is the straight line between the poses, which is what planners check for
/// collisions.
fn course(commit: &Commit, here: &Pose, escape: bool, rules: &Rules) -> PlannedMove {
    let share = if escape { rules.escape_speed.min(commit.target.speed) } else { commit.target.speed };
    let target = Target { speed: share, ..commit.target.clone() };
    let own: Option<Vec<f64>> =
        commit.speeds.as_ref().map(|_| allowed(commit, escape, rules).into_iter().map(|(_, speed)| speed).collect());
    let mut secs = 0.0;
    for (i, (m, q)) in target.motors.iter().zip(&target.q).enumerate() {
        let (Some(axis), Some(here)) = (rules.axes.get(*m), here.get(*m)) else { continue };
        let speed = own.as_ref().and_then(|v| v.get(i)).copied().unwrap_or(share * axis.max_speed);
        let way = (q - here).abs();
        // a profile of constant acceleration needs sqrt(way / a) to gain speed, and as long to lose it
        let push = (way / axis.max_acceleration.max(1e-6)).sqrt();
        // at a mean speed of half the greatest
        secs = f64::max(secs, 2.0 * way / speed.max(1e-6) + 2.0 * push);
    }
    let secs = secs + rules.latency.as_secs_f64();
    let command = match own {
        None => target.in_step(here, &rules.axes),
        Some(speed) => {
            let push = |m: &usize| rules.axes.get(*m).map_or(0.0, |a| a.max_acceleration);
            let acceleration = Some(target.motors.iter().map(push).collect());
            Move { motors: target.motors, q: target.q, relative: false, speed: Some(speed), acceleration }
        }
    };
    PlannedMove { command, secs }
}

/// What a command that fits would be. Made from one reading, which is handed on: a newer one might come to another
/// answer.
pub(super) enum Admission {
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
        sampled_at: Time,
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
struct PlannedMove {
    /// What the board is told.
    command: Move,
    /// How long it should take, s: an upper estimate, as boards have profiles of their own.
    secs: f64,
}

impl PlannedMove {
    /// It is driven from now on, so far.
    fn started(&self, distance_to_go: f64, now: Time) -> Started {
        Started { at: now, distance_to_go, expected: self.secs }
    }

    /// After which time it must have ended: twice what it should take, and a second for a short one whose board is slow
    /// to begin.
    fn patience(&self) -> Duration {
        Duration::from_secs_f64((2.0 * self.secs + 1.0).min(1e6))
    }
}
