//! Streams of set-points as transactions: YARP's position direct and velocity move.
//!
//! ```text
//! Rest ──first set-point──> Moving ──quiet for `stream_quiet`──> brakes ──at rest──> Rest   Committed where it rests
//!                            └^ each next amends                 └── contact at any time: rolled back as any motion
//! ```
//!
//! Several programs may share one transaction: some stream positions, some velocities, some move; each motor follows
//! the latest command that names it. Streams are refused while the robot holds: an escape is a commit. [`OpenStream`]
//! decides what is written.

use super::check::check_setpoints;
use super::commit::CommitAdmission;
use super::streaming::{OpenStream, StreamFreezeWatch, mode_of};
use super::{SuperviseCore, SuperviseStep};
use crate::Rules;
use crate::ledger::{Motion, home};
use crate::pulse::Pulse;
use crate::reflex::{FROZEN_TIME, FROZEN_TRAVEL};
use mobee_contract::{
    Cause, Command, ControlMode, Event, Hold, Pose, Refusal, Setpoints, Status, Time, Verdict, Writer,
};
use std::sync::Arc;
use std::time::Duration;

/// Time within which the robot must come to rest after the last set-point: long beside braking. A robot that still
/// moves then is moved by something else, and its stream is rolled back.
const REST_TIMEOUT: Duration = Duration::from_secs(5);

impl SuperviseCore {
    /// Handles set-points: they open a transaction, or amend the open stream. The checks are in the order in which a
    /// program can correct the error: the set-points, a continued push, the state of the filter.
    pub(super) fn stream(&mut self, agent: &Arc<str>, setpoints: Setpoints, step: &mut SuperviseStep) -> Verdict {
        let rules = step.rules;
        let now = step.now;
        check_setpoints(&setpoints, rules)?;
        self.admit_stream(agent, &setpoints.motors, step)?;
        match self.admit(step)? {
            CommitAdmission::Escape { reason, .. } => Err(Refusal::Holding { reason }),
            CommitAdmission::Join { .. } if self.status == Status::Escaping => {
                Err(Refusal::Holding { reason: Hold::InContact })
            }
            CommitAdmission::Join { here } => self.join_stream(agent, &setpoints, &here, step),
            CommitAdmission::Begin { here, sampled_at, speed } => {
                let mut stream = OpenStream::new(rules, now);
                stream.take(&setpoints, (&here, now), rules)?;
                let safe = self.take_safe(sampled_at, &here, speed, step);
                let target = stream.requested(&here);
                let motors = setpoints.motors.as_slice();
                let id = self.open(agent.clone(), (target.clone(), motors), (Some(safe), Motion::Stream), step);
                let robot = rules.robot.clone();
                let agent = agent.to_string();
                let named = stream.named();
                let motors = greatest(&named, rules);
                step.emit(Event::Commit { robot, id, agent, target, escape: false, motors, stream: true });
                self.enter(Status::Moving, step);
                self.begin_stream(stream, &named, &here, step);
                Ok(id)
            }
        }
    }

    /// Begins or continues the stream, with these new motors; `here`: the newest reading, rad.
    pub(super) fn begin_stream(&mut self, stream: OpenStream, new: &[usize], here: &Pose, step: &mut SuperviseStep) {
        self.motion.stream = Some(stream);
        if let Some(target) = step.book.open.as_ref().map(|open| open.target.clone()) {
            step.book.history.note_setpoint(step.now, target);
        }
        self.switch_modes(new, step);
        self.write_stream(here, step);
    }

    /// Adds set-points to a motion in progress: from its owner only, and not while it brakes. A refusal changes
    /// nothing.
    fn join_stream(
        &mut self,
        agent: &Arc<str>,
        setpoints: &Setpoints,
        here: &Pose,
        step: &mut SuperviseStep,
    ) -> Verdict {
        let not_ready = |missing: &str| Err(Refusal::NotReady { missing: missing.into() });
        let Some(open) = &mut step.book.open else { return not_ready("the outcome of the last motion") };
        if open.agent != *agent {
            return Err(Refusal::Busy);
        }
        if self.motion.forces.is_some() {
            return not_ready("the end of the move under way");
        }
        // A copy, which replaces the stream once all set-points are accepted.
        let rules = step.rules;
        let now = step.now;
        let mode = mode_of(&setpoints.values);
        let mut stream = self.motion.stream.clone().unwrap_or_else(|| OpenStream::new(rules, now));
        if stream.braking.is_some() {
            return not_ready("the robot to come to rest");
        }
        // Motors that move otherwise are taken over; the others go on.
        let new: Vec<usize> = setpoints.motors.iter().copied().filter(|m| !stream.drives(*m, mode)).collect();
        stream.take(setpoints, (here, now), rules)?;
        open.name(&setpoints.motors);
        open.target = stream.requested(&open.target);
        let id = open.id;
        let target = open.target.clone();
        if !new.is_empty() {
            let motors = greatest(&new, rules);
            step.emit(Event::Amended { robot: step.robot(), id, target, motors, stream: true });
        }
        self.begin_stream(stream, &new, here, step);
        Ok(id)
    }

    /// Writes the due set-points of the stream, for a robot at `here`, rad.
    pub(super) fn write_stream(&mut self, here: &[f64], step: &mut SuperviseStep) {
        let Some(stream) = &mut self.motion.stream else { return };
        for command in stream.write(here, step.rules, step.now) {
            step.command(self.token, Writer::Agent, command);
        }
    }

    /// Removes the motors of a commit from the stream, which goes on with the others, or ends if there are none.
    pub(super) fn leave_stream(&mut self, motors: &[usize]) {
        if let Some(stream) = &mut self.motion.stream {
            stream.leave(motors);
        }
        self.motion.stream.take_if(|stream| stream.named().is_empty());
    }

    /// Processes a reading during a stream: goes on, brakes, or detects rest. Returns whether the stream is over and
    /// the motion is to be checked like any other.
    pub(super) fn streaming(&mut self, pulse: &Pulse, at_rest: bool, step: &mut SuperviseStep) -> bool {
        let rules = step.rules;
        let sampled_at = pulse.sample.at;
        let q = &pulse.sample.q;
        if self.is_stream_frozen(pulse) {
            self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), step);
            return false;
        }
        let Some(stream) = &mut self.motion.stream else { return true };
        match stream.braking {
            None if sampled_at >= stream.last_request + rules.stream_quiet => {
                // Positions end at the last set-point, where the board holds by itself.
                let motors = stream.brake(sampled_at);
                if !motors.is_empty() {
                    step.command(self.token, Writer::Agent, Command::Stop { motors });
                }
            }
            None => self.write_stream(q, step),
            Some(_) if stream.goes_on() => self.write_stream(q, step),
            Some(since) => {
                let all_done = |of: bool| {
                    let motors = pulse.sample.done.iter().enumerate();
                    motors.filter(|(m, _)| stream.names(*m) == of).all(|(_, done)| *done)
                };
                // Motors that a commit moves may still be moving.
                let done = all_done(true);
                let others_move = !all_done(false);
                if sampled_at >= since + rules.reaction() && done && (at_rest || others_move) {
                    self.end_stream(q, since, sampled_at, step);
                    return true;
                }
                if sampled_at >= since + REST_TIMEOUT {
                    self.roll_back(Cause::TargetMissed, step);
                    return false;
                }
            }
        }
        self.advance_safe_pose(step);
        false
    }

    /// Returns whether the readings have been equal bit for bit while the set-points moved on for [`FROZEN_TIME`] (I26). Velocities move
    /// the set-points by their time, positions by their steps.
    pub(super) fn is_stream_frozen(&mut self, pulse: &Pulse) -> bool {
        let Some(stream) = &mut self.motion.stream else { return false };
        let sampled_at = pulse.sample.at;
        if stream.freeze_watch.since != pulse.unchanged {
            stream.freeze_watch = StreamFreezeWatch::begin(pulse.unchanged);
        } else {
            stream.freeze_watch.moved += stream.fastest() * sampled_at.since(stream.seen).as_secs_f64();
        }
        stream.seen = sampled_at;
        let watch = &mut stream.freeze_watch;
        watch.count(sampled_at, FROZEN_TIME);
        let long = watch.began.is_some_and(|began| sampled_at.since(began) >= FROZEN_TIME);
        long && watch.moved > FROZEN_TRAVEL
    }

    /// Ends the stream of a robot at rest. Its target becomes the configuration at rest, or the last set-point if the
    /// robot is close to it. A stream has no target before its end: its outcome is `Committed` wherever it has led,
    /// unless something stopped it.
    fn end_stream(&mut self, q: &Pose, since: Time, sampled_at: Time, step: &mut SuperviseStep) {
        let Some(stream) = self.motion.stream.take() else { return };
        if let Some(open) = &mut step.book.open {
            let rest = |(m, q): (usize, &f64)| home(stream.sent(m), *q, step.rules.tolerance);
            let rests: Vec<f64> = q.iter().enumerate().map(rest).collect();
            open.target = stream.with(&open.target, &rests);
            open.since = since;
            if open.motion == Motion::Stream {
                self.motion.started = None;
            }
            // Motors that a commit moves may still be on their way.
            open.motion =
                Motion::Move { due: open.motion.due().max(Some(sampled_at + REST_TIMEOUT)).unwrap_or(sampled_at) };
            let id = open.id;
            let target = open.target.clone();
            step.emit(Event::Amended { robot: step.robot(), id, target, motors: Vec::new(), stream: true });
        }
        self.restore_modes(Writer::Agent, step);
    }

    /// Switches motors that join the stream to the mode of its set-points. The mode goes before the first set-point,
    /// which the board would drop otherwise.
    pub(super) fn switch_modes(&mut self, motors: &[usize], step: &mut SuperviseStep) {
        let Some(stream) = &self.motion.stream else { return };
        self.modes.extend(motors);
        for mode in [ControlMode::Velocity, ControlMode::PositionDirect] {
            let motors: Vec<usize> = motors.iter().copied().filter(|m| stream.drives(*m, mode)).collect();
            if !motors.is_empty() {
                step.command(self.token, Writer::Agent, Command::Mode { motors, mode });
            }
        }
    }

    /// Switches motors that a stream has taken out of the mode of position moves back to it. Returns whether there
    /// were any. They are stored in this core, and not in the stream: an interrupted stream is gone before its motors
    /// are at rest.
    pub(super) fn restore_modes(&mut self, writer: Writer, step: &mut SuperviseStep) -> bool {
        let motors: Vec<usize> = std::mem::take(&mut self.modes).into_iter().collect();
        let any = !motors.is_empty();
        if any {
            step.command(self.token, writer, Command::Mode { motors, mode: ControlMode::Position });
        }
        any
    }
}

/// Greatest speeds of these motors, rad/s: a stream may use all of them.
fn greatest(motors: &[usize], rules: &Rules) -> Vec<(usize, f64)> {
    motors.iter().filter_map(|m| Some((*m, rules.axes.get(*m)?.max_speed))).collect()
}
