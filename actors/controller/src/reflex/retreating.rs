//! The retreat phases: actions of the reflex while the filter is closed, from the stop to the report that the robot
//! is back or that the retreat was aborted.
//!
//! This is the part of Algorithm 6 between "stop" and "open". The paper drives the recorded poses backwards and
//! opens. A robot whose readings may be late, frozen or wrong needs more: each phase has a timeout, the retreat stops
//! if any pair gets closer than its floor, and nothing is reported before the readings show rest (I9, I17).
//!
//! Two times: `sampled_at` is the time of the reading and dates what it shows; `now` is the time of the step and
//! spaces the commands. Delayed readings arrive in a burst: dated by `now` they would prove a rest from before the
//! stop, and set-points spaced by `sampled_at` would be written all at once.

use super::contacts::EndedContact;
use super::floors::ClearanceFloors;
use super::retreat::{GroupBroken, Retreat};
use super::yielding::{RetreatYield, YieldDecision, another};
use super::{
    AfterStop, FROZEN_TIME, FROZEN_TRAVEL, FrozenEncoderWatch, Names, ReflexCore, ReflexOut, ReflexPhase, ReflexReport,
    ReflexStep, RetreatJob,
};
use crate::joint_retreat::{RetreatReply, RetreatRequest};
use crate::ledger::Underway;
use crate::look_ahead::Foreseen;
use crate::pulse::Pulse;
use crate::{Rules, distance};
use mobee_contract::{Command, ControlMode, Event, Hold, Time};
use mobee_model::Contact;
use std::time::Duration;

/// Time within which the robot must come to rest, follow its set-points, or arrive at its end. Long beside the
/// braking time, so that only a robot that does not obey times out.
const PHASE_TIMEOUT: Duration = Duration::from_secs(3);

/// Time after the effect of a stop from which a robot that still creeps counts as held.
const CREEP_TIME: Duration = Duration::from_millis(200);
/// Greatest speed of creeping, rad/s.
const MAX_CREEP_SPEED: f64 = 5.0 * std::f64::consts::PI / 180.0;

impl ReflexCore {
    /// Processes a reading in a phase with a closed filter.
    ///
    /// Each phase checks the conditions that forbid going on before those that complete it: a robot that arrives in
    /// contact has not arrived. `close`: the pairs checked against the floors, at their present distances.
    pub(super) fn step_phase(&mut self, pulse: &Pulse, close: &[Contact], step: &mut ReflexStep) {
        let rules = step.rules;
        let names = step.names;
        // The time of the reading dates what it shows; the clock spaces what is written.
        let sampled_at = pulse.sample.at;
        let now = step.now;
        let at_rest = pulse.speed < rules.rest_speed;
        if matches!(self.phase, ReflexPhase::Retreating { .. } | ReflexPhase::Settling { .. }) {
            self.passed.note(&self.near);
        }
        let ahead = self.foreseen_on_the_way(pulse, step);
        match &mut self.phase {
            ReflexPhase::Watching => {}
            ReflexPhase::Stopping { token, since, then } => {
                let token = *token;
                // The robot moves deeper into the contact while it brakes. The retreat path leads through there
                // again, so the floors include these distances.
                self.floors.note(&self.near);
                if self.stop.is_ignored(pulse, rules, now) {
                    step.stop(token);
                }
                // An earlier reading at rest may be from before the stop took effect.
                let (held, pressed) = match then {
                    AfterStop::Retreat(job) => (
                        is_held(pulse, *since, rules),
                        job.motion.pressed && rules.gives() && rules.position_direct && !job.again,
                    ),
                    AfterStop::Report(_) => (false, false),
                };
                // A robot that pushes something must not brake into it: set-points at its present configuration take
                // the load off at once.
                if pressed && sampled_at > *since || sampled_at >= *since + rules.reaction() && (at_rest || held) {
                    match then.clone() {
                        AfterStop::Retreat(_) => self.request_retreat(step),
                        AfterStop::Report(report) => self.report(token, report, step),
                    }
                } else if sampled_at >= *since + PHASE_TIMEOUT {
                    let then = then.clone();
                    self.stop_again(token, then, sampled_at, step);
                } else if let AfterStop::Retreat(_) = then {
                    step.joint_retreat.announce(self.robot, now);
                }
            }
            ReflexPhase::Retreating { token, retreat, job, violated, frozen_watch, yielding } => {
                let token = *token;
                // On the first segment, joints that are hooked to an obstacle stand still.
                if frozen_watch.unchanged != pulse.unchanged || retreat.takes_load_off() {
                    let written = retreat.written().to_vec();
                    *frozen_watch = FrozenEncoderWatch { unchanged: pulse.unchanged, written, sampled_at };
                }
                // A robot that pushes something still brakes: as before, the floors include these distances.
                if retreat.brakes() {
                    self.floors.note(&self.near);
                }
                // Frozen encoders also require that the set-points have moved: during a recorded rest, unchanged
                // readings are normal.
                let long = sampled_at.since(frozen_watch.sampled_at) >= FROZEN_TIME;
                let frozen = long && distance(retreat.written(), &frozen_watch.written) > FROZEN_TRAVEL;
                let met = self.floors.broken(close, rules);
                let broken = met.or_else(|| self.floors.broken(&ahead, rules)).copied();
                let foreseen = met.is_none();
                // A constraint that was violated as the retreat began is left by the retreat itself.
                let newly_violated = pulse.violated.is_some() && !*violated;
                let rests = at_rest && retreat.is_at_setpoint(&pulse.sample, rules);
                let decision = yielding.decide(broken.as_ref(), (foreseen, rests), self.robot, step.joint_retreat, now);
                // A board that plans between way-points goes on by itself, so waiting means stopping.
                let stops = decision == YieldDecision::Blocked
                    || (decision == YieldDecision::StartWait && !retreat.path().direct);
                if frozen {
                    self.abort(
                        token,
                        Hold::Stale,
                        "the encoders do not follow the set-points".into(),
                        sampled_at,
                        step,
                    );
                } else if stops || newly_violated {
                    let what = blocked(broken, pulse.violated.is_some(), names);
                    self.abort(token, Hold::RetreatBlocked, what, sampled_at, step);
                } else if retreat.lag_time(now) >= PHASE_TIMEOUT {
                    let what = "the robot does not follow the set-points".into();
                    self.abort(token, Hold::RetreatMissed, what, sampled_at, step);
                } else {
                    report_wait(decision, yielding, self.robot, broken, sampled_at, step);
                    let done = match decision {
                        YieldDecision::StartWait | YieldDecision::StillWaiting => {
                            retreat.halt(step.joint_retreat, &pulse.sample, now, rules)
                        }
                        _ => retreat.step(step.joint_retreat, &pulse.sample, now, rules),
                    };
                    match done {
                        Ok(command) => step.out.extend(command.map(|c| ReflexOut::Command(token, c))),
                        Err(GroupBroken) => {
                            let job = job.clone();
                            self.leave_group(token, job, step);
                            return;
                        }
                    }
                    if retreat.is_over() {
                        let retreat = retreat.clone();
                        let job = job.clone();
                        let violated = *violated;
                        let yielding = *yielding;
                        // Not by `enter`: the robot retains its place on the common clock for those that are still
                        // retreating.
                        let since = retreat.arrival(now);
                        self.phase = ReflexPhase::Settling { token, since, retreat, job, violated, yielding };
                        step.out.push(ReflexOut::ReflexReport(ReflexReport::Settling));
                    }
                }
            }
            ReflexPhase::Settling { token, job, .. } if step.joint_retreat.must_replan(self.robot, now) => {
                let token = *token;
                let job = job.clone();
                self.leave_group(token, job, step);
            }
            ReflexPhase::Settling { token, since, retreat, job, violated, yielding } => {
                let token = *token;
                let path = retreat.path();
                let broken = self.floors.broken(close, rules).copied();
                // The robot stays at its end. As on the path, it waits for another robot that drives into it there.
                let decision = yielding.decide(broken.as_ref(), (false, at_rest), self.robot, step.joint_retreat, now);
                if decision == YieldDecision::Blocked || (pulse.violated.is_some() && !*violated) {
                    let what = blocked(broken, pulse.violated.is_some(), names);
                    self.abort(token, Hold::RetreatBlocked, what, sampled_at, step);
                } else if decision != YieldDecision::Proceed {
                    report_wait(decision, yielding, self.robot, broken, sampled_at, step);
                    *since = now;
                } else if sampled_at >= *since + rules.reaction()
                    && at_rest
                    && distance(&pulse.sample.q, &path.end.q) <= rules.tolerance
                {
                    // The retreat ended before this robot's safe pose because another robot blocks the rest of the
                    // path.
                    if path.blocked {
                        let what = "another robot blocks the path and can't retreat farther".into();
                        self.abort(token, Hold::RetreatBlocked, what, sampled_at, step);
                        return;
                    }
                    // Readmitted alone, the robot would soon block those that are still retreating.
                    if !step.joint_retreat.is_over(self.robot, now) {
                        return;
                    }
                    // The other robots were elsewhere as this retreat set out. If one of them waits for this robot
                    // now, all are replanned, through the distances that they have passed.
                    if !job.again && blocks_waiting_robot(self.robot, close, step) {
                        let job = job.clone();
                        self.leave_group(token, job, step);
                        return;
                    }
                    // The robot was free at the safe pose: a distance within the hysteresis is no contact there.
                    for EndedContact { pair, depth } in self.contacts.settle() {
                        step.emit(Event::ContactEnded { robot: step.robot(), names: names(pair), depth });
                    }
                    self.report(token, ReflexReport::Back, step);
                } else if sampled_at >= *since + PHASE_TIMEOUT {
                    self.abort(
                        token,
                        Hold::RetreatMissed,
                        "the safe pose was not reached in time".into(),
                        sampled_at,
                        step,
                    );
                } else if at_rest {
                    // The robot rests beside its end: the last set-point may have been lost as the lease expired.
                    step.out.extend(retreat.resend(&pulse.sample, now, rules).map(|c| ReflexOut::Command(token, c)));
                }
            }
        }
    }

    /// Returns the foreseen contacts that the retreat must avoid: with objects that were placed since the motion set
    /// out, and with robots outside the retreat group. With everything else the path is as free as it was on the way
    /// there, and a robot that is about to turn off at a corner of it must not be stopped by an obstacle beyond the
    /// corner. A board that plans between way-points aborts where it would wait: other robots stop it only by the
    /// margin.
    fn foreseen_on_the_way(&self, pulse: &Pulse, step: &ReflexStep) -> Vec<Contact> {
        let ReflexPhase::Retreating { retreat, .. } = &self.phase else { return Vec::new() };
        let direct = retreat.path().direct;
        let counts = |f: &&Foreseen| {
            let meets = direct && another(&f.contact, self.robot).is_some() && !self.shares_group(&f.contact, step);
            f.edited > self.epoch || meets
        };
        pulse.foreseen.iter().filter(counts).map(|f| f.contact).collect()
    }

    /// Requests the retreat of a resting robot, and begins it once it is planned.
    ///
    /// Called at each reading until there is a plan: the planner waits for other robots to come to rest, and checks
    /// the plan in slices.
    pub(super) fn request_retreat(&mut self, step: &mut ReflexStep) {
        let ReflexPhase::Stopping { token, then: AfterStop::Retreat(job), .. } = &self.phase else { return };
        let token = *token;
        let mut job = job.clone();
        let robot = step.robot();
        let id = job.motion.id;
        match step.joint_retreat.request(self.robot, step.now) {
            RetreatReply::Wait => {}
            RetreatReply::FetchRecording => {
                let RetreatJob { motion, safe, again } = job;
                let Underway { named, places, extent, pressed, .. } = motion;
                let robot = self.robot;
                step.out.push(ReflexOut::Bring(RetreatRequest { robot, safe, again, named, places, extent, pressed }));
            }
            RetreatReply::Go(path) => {
                // Another robot has to pass where this one would rest. An earlier rest becomes its safe pose, and the
                // path passes everything again that the motions since then have passed.
                if path.farther {
                    self.floors.join(self.recent.since(path.end.since));
                }
                self.stopped = path.motors.clone();
                let elsewhere = path.end.since != job.safe.since && !path.blocked;
                let to = path.end.clone();
                let motors = path.motors.clone();
                let stream = !path.farther;
                if elsewhere {
                    job.safe = to.clone();
                }
                let elsewhere = elsewhere.then_some(ReflexReport::EndsAt { to, motors, stream });
                let bent = |m: &usize| !job.motion.named.contains(m);
                let joined: Vec<usize> =
                    if path.farther { Vec::new() } else { path.motors.iter().copied().filter(bent).collect() };
                let retreat = Retreat::new(self.robot, path, step.rules, step.now);
                let (poses, secs) = retreat.length();
                let near = self.floors.touched();
                step.emit(Event::RetreatBegan { robot, id, poses, secs, near });
                if !joined.is_empty() {
                    // From here on a retry moves these motors, too.
                    job.motion.named = self.stopped.clone();
                    let robot = step.robot();
                    step.emit(Event::RetreatJoined { robot, id, motors: joined.clone() });
                    step.out.push(ReflexOut::ReflexReport(ReflexReport::Joined(joined)));
                }
                step.out.push(ReflexOut::Command(token, retreat.begin()));
                step.out.push(ReflexOut::ReflexReport(ReflexReport::Retreating));
                step.out.extend(elsewhere.map(ReflexOut::ReflexReport));
                let written = retreat.written().to_vec();
                let frozen_watch = FrozenEncoderWatch { unchanged: Time::ZERO, written, sampled_at: step.now };
                let violated = self.violated;
                let yielding = RetreatYield::default();
                self.passed = ClearanceFloors::default();
                self.phase = ReflexPhase::Retreating { token, retreat, job, violated, frozen_watch, yielding };
            }
        }
    }

    /// Leaves a retreat group that has changed: the robot stops and requests another path. The plan covered all
    /// robots of the group and is void without one of them, so each retreats alone; if the paths block each other,
    /// all are replanned together, through the distances that they have passed.
    fn leave_group(&mut self, token: u64, job: RetreatJob, step: &mut ReflexStep) {
        let replan = step.joint_retreat.must_replan(self.robot, step.now);
        if replan {
            self.floors.join(std::mem::take(&mut self.passed));
        }
        step.stop(token);
        let then = AfterStop::Retreat(RetreatJob { again: !replan, ..job });
        self.enter(ReflexPhase::Stopping { token, since: step.now, then }, step);
    }

    /// Aborts the retreat: stops the robot, journals the reason, and reports it to Supervise once the robot rests.
    /// `seen` is the time of the reading that shows the reason.
    fn abort(&mut self, token: u64, reason: Hold, what: String, seen: Time, step: &mut ReflexStep) {
        step.stop(token);
        step.emit(Event::RetreatStopped { robot: step.robot(), reason, what, seen });
        self.enter(
            ReflexPhase::Stopping { token, since: step.now, then: AfterStop::Report(ReflexReport::GaveUp(reason)) },
            step,
        );
    }

    /// Handles a robot, or its readings, that did not come to rest in time: stops it again, and reports nothing
    /// before it rests (I17). A retreat that has not begun is aborted: the robot may have left its recorded path long
    /// ago.
    fn stop_again(&mut self, token: u64, then: AfterStop, seen: Time, step: &mut ReflexStep) {
        if let AfterStop::Report(_) = then {
            step.stop(token);
            self.enter(ReflexPhase::Stopping { token, since: step.now, then }, step);
        } else {
            let what = "the robot did not come to rest in time".into();
            self.abort(token, Hold::RetreatMissed, what, seen, step);
        }
    }

    /// Ends the phase of a resting robot: restores the control modes, then reports. The modes come first: Supervise
    /// may open the filter at the very next reading, and an agent's move in the mode of set-points would be a jump.
    pub(super) fn report(&mut self, token: u64, word: ReflexReport, step: &mut ReflexStep) {
        let motors = self.stopped.to_vec();
        if !motors.is_empty() {
            step.out.push(ReflexOut::Command(token, Command::Mode { motors, mode: ControlMode::Position }));
        }
        step.out.push(ReflexOut::ReflexReport(word));
        self.enter(ReflexPhase::Watching, step);
    }
}

/// Returns true for an arm that presses against an obstacle and creeps along it instead of coming to rest. Its
/// retreat begins from this low speed and takes the load off.
fn is_held(pulse: &Pulse, stopped: Time, rules: &Rules) -> bool {
    rules.gives() && pulse.speed < MAX_CREEP_SPEED && pulse.sample.at >= stopped + rules.reaction() + CREEP_TIME
}

/// Publishes that a retreat starts to wait or goes on, and updates the joint retreat for the robots that this one may
/// block.
fn report_wait(
    decision: YieldDecision,
    yielding: &RetreatYield,
    robot: usize,
    met: Option<Contact>,
    seen: Time,
    step: &mut ReflexStep,
) {
    match decision {
        YieldDecision::StartWait => {
            let what = blocked(met, false, step.names);
            step.emit(Event::RetreatWaits { robot: step.robot(), what, seen });
        }
        YieldDecision::Resume => step.emit(Event::RetreatGoesOn { robot: step.robot() }),
        YieldDecision::StillWaiting => {}
        YieldDecision::Proceed | YieldDecision::Blocked => return,
    }
    step.joint_retreat.set_waiting(robot, yielding.waits());
}

/// Returns whether the robot touches one whose own retreat waits for it: the group is replanned then.
fn blocks_waiting_robot(robot: usize, close: &[Contact], step: &ReflexStep) -> bool {
    let touches = close.iter().filter(|c| c.distance < step.rules.margin);
    let mut others = touches.filter_map(|c| another(c, robot));
    others.any(|other| step.joint_retreat.blocks_waiting_robot(robot, other))
}

/// Describes the obstruction of a retreat: this contact, or without one, a constraint, or a robot that does not halt.
fn blocked(contact: Option<Contact>, violated: bool, names: &Names) -> String {
    let Some(c) = contact else {
        let what = if violated { "a constraint would be violated" } else { "the robot does not rest at its set-point" };
        return what.into();
    };
    let (a, b) = names(c.pair);
    format!("{a} and {b} are at {:.1} mm", c.distance * 1e3)
}

#[cfg(test)]
mod tests;
