//! Algorithm 5: a command is refused, accepted as a new transaction, or joins the open one.
//!
//! The paper passes a command on if the filter is open. Here, the newest reading must also be fresh, at rest and
//! free: its configuration becomes the safe pose, and is only as safe as that reading shows (I4, I8).

use super::check::{check, check_speeds};
use super::{Closing, ExpectedProgress, MotionState, StoredReading, SuperviseCore, SuperviseOut, SuperviseStep};
use crate::Rules;
use crate::ledger::{Extent, Motion, Open, SafePose};
use mobee_contract::{
    Command, Commit, CommitId, Event, Hold, Move, Pose, Refusal, Status, Target, Time, Verdict, Writer, distance,
};
use std::sync::Arc;
use std::time::Duration;

/// Greatest duration of a motion under forces, relative to the straight path: it moves around obstacles, and slows
/// down beside them.
const DETOUR_FACTOR: u32 = 3;
/// Greatest speed of a motion under forces, as a share of a motor's greatest speed: following a stream takes slightly
/// more speed than the reference has.
const MAX_FORCES_SPEED: f64 = 0.9;

impl SuperviseCore {
    /// Handles a command (Algorithm 5).
    pub(super) fn commit(&mut self, commit: Commit, step: &mut SuperviseStep) -> Verdict {
        // Permanent errors are reported before temporary ones: the agent should correct its command, not retry.
        check(&commit.target, step.rules)?;
        check_speeds(&commit, step.rules)?;
        if !self.credits.commits.take(step.now) {
            return Err(Refusal::Busy);
        }
        // After the checks and before any event: refusals have a credit of their own.
        match self.admit(step)? {
            CommitAdmission::Join { here } => self.amend(commit, &here, step),
            CommitAdmission::Begin { here, sampled_at, speed } => {
                let safe = self.take_safe(sampled_at, &here, speed, step);
                self.accept(commit, Some(safe), here, step)
            }
            CommitAdmission::Escape { here, .. } => {
                // The filter opens for this commit only: the reflex lets it creep, and closes if any distance gets
                // worse.
                let Some(token) = step.gate.open(self.token) else { return Err(Refusal::Closed) };
                self.token = token;
                step.emit(Event::Enabled { robot: step.robot(), token });
                self.accept(commit, None, here, step)
            }
        }
    }

    /// Decides how a valid command would be admitted now.
    ///
    /// # Errors
    /// The reason why no command is admitted now.
    pub(super) fn admit(&self, step: &SuperviseStep) -> Result<CommitAdmission, Refusal> {
        if self.shutdown {
            return Err(Refusal::Holding { reason: Hold::ShuttingDown });
        }
        if step.book.halted {
            return Err(Refusal::Holding { reason: Hold::Halted });
        }
        let not_ready = |missing: &str| Err(Refusal::NotReady { missing: missing.into() });
        let Some(StoredReading { sampled_at, q: here, speed, at_rest, free }) = self.newest.clone() else {
            return not_ready("a first reading of the encoders");
        };
        if step.now > sampled_at + step.rules.fresh {
            return not_ready("fresh readings of the encoders");
        }
        // By the state, and within it by the newest reading; the token last, since the reflex may have closed at this
        // very reading.
        match self.status {
            Status::Starting => not_ready("the robot to come to rest"),
            Status::Stopping | Status::Retreating | Status::Settling => Err(Refusal::Closed),
            Status::Holding(reason) if self.closing != Closing::No => Err(Refusal::Holding { reason }),
            Status::Rest | Status::Moving | Status::Escaping if step.gate.token() != self.token => Err(Refusal::Closed),
            Status::Moving | Status::Escaping => Ok(CommitAdmission::Join { here }),
            // The filter may have opened by a reading before the contact began: the reflex will close it at the next
            // one.
            Status::Rest if !free => Err(Refusal::Holding { reason: Hold::InContact }),
            Status::Holding(reason @ (Hold::AfterCrash | Hold::SlowBoard)) => Err(Refusal::Holding { reason }),
            // Something moves the robot, though it was at rest: there is no safe pose to return to (I4).
            Status::Rest | Status::Holding(_) if !at_rest => not_ready("the robot to come to rest"),
            Status::Rest => Ok(CommitAdmission::Begin { here, sampled_at, speed }),
            Status::Holding(reason) => Ok(CommitAdmission::Escape { here, reason }),
        }
    }

    /// Takes the safe pose of a new transaction from a reading at rest (I4).
    pub(super) fn take_safe(&self, sampled_at: Time, q: &Pose, speed: f64, step: &mut SuperviseStep) -> SafePose {
        let safe = step.safe_pose(q);
        let robot = step.robot();
        let age = step.now.since(sampled_at).as_secs_f64();
        step.emit(Event::SafePose { robot, q: safe.clone(), age, speed, free: step.rules.reflex });
        SafePose { since: sampled_at, q: safe }
    }

    /// Begins a transaction for a commit: with a safe pose, or as an escape without one.
    fn accept(&mut self, commit: Commit, safe: Option<SafePose>, here: Pose, step: &mut SuperviseStep) -> Verdict {
        let escape = safe.is_none();
        let course = course(&commit, &here, escape, step.rules);
        let target = commit.target.pose(&here);
        // An escape creeps on a straight path, and is monitored.
        let fields = step.rules.fields.as_deref().filter(|_| !escape);
        let motion = match fields {
            _ if escape => Motion::Escape { due: step.now + course.patience() },
            Some(_) => Motion::Forces { due: step.now + course.patience() * DETOUR_FACTOR },
            None => Motion::Move { due: step.now + course.patience() },
        };
        let id = self.open(commit.agent.clone(), (target.clone(), &commit.target.motors), (safe, motion), step);
        self.motion.started = Some(course.started(distance(&target, &here), step.now));
        let motors = allowed(&commit, escape, step.rules);
        step.emit(Event::Commit {
            robot: step.robot(),
            id,
            agent: commit.agent.to_string(),
            target: target.clone(),
            escape,
            motors: motors.clone(),
            stream: false,
        });
        self.enter(if escape { Status::Escaping } else { Status::Moving }, step);
        if let Some(fields) = fields {
            self.begin_forces(fields, (&target, &motors), &here, step);
            return Ok(id);
        }
        step.command(self.token, Writer::Agent, Command::Move(course.command));
        Ok(id)
    }

    /// Records a transaction in the ledger: its target, and the motors that it names. From here on it must get an
    /// outcome, whatever dies.
    pub(super) fn open(
        &mut self,
        agent: Arc<str>,
        (target, motors): (Pose, &[usize]),
        (safe, motion): (Option<SafePose>, Motion),
        step: &mut SuperviseStep,
    ) -> CommitId {
        self.retry = None;
        self.motion = MotionState::default();
        // The reading that opened the filter may be the newest: it grants a lease, as the next one will.
        step.out.extend(self.newest.as_ref().map(|newest| SuperviseOut::Lease(newest.sampled_at + step.rules.fresh)));
        step.book.last_id += 1;
        let id = CommitId(step.book.last_id);
        let named = Vec::new().into();
        let since = step.now;
        let extent = if motion == Motion::Stream { Extent::Stream } else { Extent::Whole };
        let mut open = Open { id, agent, target, named, safe, since, motion, cause: None, retreated: false, extent };
        open.name(motors);
        step.book.open = Some(open);
        id
    }

    /// Amends the open transaction by a command in mid-motion: same id, same safe pose. Motors that the command does
    /// not name retain their targets.
    fn amend(&mut self, commit: Commit, here: &Pose, step: &mut SuperviseStep) -> Verdict {
        match step.owner() {
            None => return Err(Refusal::NotReady { missing: "the outcome of the last motion".into() }),
            Some(owner) if owner != commit.agent => return Err(Refusal::Busy),
            Some(_) if self.motion.forces.is_some() => {}
            Some(_) => self.leave_stream(&commit.target.motors),
        }
        // A command that joins an escape creeps as well, and has no safe pose either.
        let escape = self.status == Status::Escaping;
        let course = course(&commit, here, escape, step.rules);
        let (id, target) = {
            let Some(open) = step.book.open.as_mut() else {
                return Err(Refusal::NotReady { missing: "the outcome of the last motion".into() });
            };
            open.target = commit.target.pose(&open.target);
            open.name(&commit.target.motors);
            // A move is rolled back to its beginning, and with it the whole transaction.
            open.extent = Extent::Whole;
            open.since = step.now;
            let detours = if let Motion::Forces { .. } = open.motion { DETOUR_FACTOR } else { 1 };
            let due = step.now + course.patience() * detours;
            // Motors that go on as before may need longer.
            let all = commit.target.motors.len() == here.len();
            open.motion = open.motion.until(open.motion.due().filter(|_| !all).map_or(due, |before| before.max(due)));
            (open.id, open.target.clone())
        };
        // "Done" for the previous target does not apply to this one.
        self.motion.done_since = None;
        self.motion.held = None;
        self.motion.started = Some(course.started(distance(&target, here), step.now));
        let robot = step.robot();
        let motors = allowed(&commit, escape, step.rules);
        step.emit(Event::Amended { robot, id, target: target.clone(), motors: motors.clone(), stream: false });
        if self.motion.forces.is_some() {
            self.aim_forces(&target, &motors, step);
            return Ok(id);
        }
        // From a moving start the motors cannot move exactly in step; the board replans each from its present
        // position.
        step.command(self.token, Writer::Agent, Command::Move(course.command));
        Ok(id)
    }
}

/// Motors of a commit, each with its greatest speed, rad/s: its own, or its share of the axis'. An escape creeps, and
/// a stream under forces must be followed.
fn allowed(commit: &Commit, escape: bool, rules: &Rules) -> Vec<(usize, f64)> {
    let most = match &rules.fields {
        _ if escape => rules.escape_speed,
        Some(_) => MAX_FORCES_SPEED,
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

/// Plans the move of a commit from `here`, rad: in step, or each motor at its own speed, within the limits of its
/// axis. In step by default, since the path is then the straight line between the configurations, which planners
/// check for collisions.
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
        // A profile of constant acceleration needs sqrt(way / a) to accelerate, and as long to brake.
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

/// Admission of a valid command. It holds the reading that it was decided by: a newer one might lead to another
/// decision.
pub(super) enum CommitAdmission {
    /// The command joins the open transaction.
    Join {
        /// Configuration in the newest reading.
        here: Pose,
    },
    /// The command begins a transaction.
    Begin {
        /// Configuration in the newest reading.
        here: Pose,
        /// Time of the reading.
        sampled_at: Time,
        /// Speed of the robot, rad/s.
        speed: f64,
    },
    /// The command is an escape from a hold.
    Escape {
        /// Configuration in the newest reading.
        here: Pose,
        /// Reason of the hold.
        reason: Hold,
    },
}

/// Planned move of a commit, and its expected duration.
struct PlannedMove {
    /// Command for the board.
    command: Move,
    /// Expected duration, s: an upper estimate, as boards have profiles of their own.
    secs: f64,
}

impl PlannedMove {
    /// Expected progress of the move over this distance, starting now.
    fn started(&self, distance_to_go: f64, now: Time) -> ExpectedProgress {
        ExpectedProgress { at: now, distance_to_go, expected: self.secs }
    }

    /// Time after which the move must have ended: twice its expected duration, plus a second for a short move on a
    /// board that starts slowly.
    fn patience(&self) -> Duration {
        Duration::from_secs_f64((2.0 * self.secs + 1.0).min(1e6))
    }
}
