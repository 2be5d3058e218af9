//! The retreat: actions of the reflex while the filter is closed, from the stop to the report that the robot is back or
//! that the retreat was aborted. [`phases`](super::phases) decides them.
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
use super::phases::{PhaseReading, ReflexPhase, RetreatingPhase, StoppingPhase, Transition};
use super::retreat::Retreat;
use super::yielding::{RetreatYield, another};
use super::{AfterStop, FrozenEncoderWatch, ReflexCore, ReflexOut, ReflexReport, ReflexStep, RetreatJob};
use crate::joint_retreat::{RetreatReply, RetreatRequest};
use crate::ledger::Underway;
use crate::look_ahead::Foreseen;
use crate::pulse::Pulse;
use mobee_contract::{Command, ControlMode, Event, Hold, Time};
use mobee_model::Contact;

impl ReflexCore {
    /// Processes a reading in a phase with a closed filter: the phase decides, and the transition is performed.
    /// `close`: the pairs checked against the floors, at their present distances.
    pub(super) fn step_phase(&mut self, pulse: &Pulse, close: &[Contact], step: &mut ReflexStep) {
        let at_rest = pulse.speed < step.rules.rest_speed;
        if self.phase.is_on_path() {
            self.passed.note(&self.near);
        }
        let ahead = self.foreseen_on_the_way(pulse, step);
        let near = &self.near;
        let reading = &PhaseReading { robot: self.robot, pulse, near, close, ahead: &ahead, at_rest };
        let transition = match &mut self.phase {
            ReflexPhase::Watching => Transition::Stay,
            ReflexPhase::Stopping(phase) => phase.step(reading, &mut self.stop, &mut self.floors, step),
            ReflexPhase::Retreating(phase) => phase.step(reading, &mut self.floors, step),
            ReflexPhase::Settling(phase) => phase.step(reading, &self.floors, step),
        };
        if let Some(token) = self.phase.token() {
            self.perform(transition, token, pulse.sample.at, step);
        }
    }

    /// Performs a transition of the phase with this token. `seen` is the time of the reading that caused it.
    fn perform(&mut self, transition: Transition, token: u64, seen: Time, step: &mut ReflexStep) {
        match transition {
            Transition::Stay => {}
            Transition::RequestRetreat => self.request_retreat(step),
            Transition::Report(report) => self.report(token, report, step),
            Transition::StopAgain(report) => {
                step.stop(token);
                self.enter_stop(token, AfterStop::Report(report), step);
            }
            Transition::Settle(phase) => {
                self.enter(ReflexPhase::Settling(*phase), step);
                step.out.push(ReflexOut::ReflexReport(ReflexReport::Settling));
            }
            Transition::Arrive => {
                let names = step.names;
                // The robot was free at the safe pose: a distance within the hysteresis is no contact there.
                for EndedContact { pair, depth } in self.contacts.settle() {
                    step.emit(Event::ContactEnded { robot: step.robot(), names: names(pair), depth });
                }
                self.report(token, ReflexReport::Back, step);
            }
            Transition::LeaveGroup(job) => self.leave_group(token, job, step),
            Transition::Abort(reason, what) => self.abort(token, reason, what, seen, step),
        }
    }

    /// Returns the foreseen contacts that the retreat must avoid: with objects that were placed since the motion set
    /// out, and with robots outside the retreat group. With everything else the path is as free as it was on the way
    /// there, and a robot that is about to turn off at a corner of it must not be stopped by an obstacle beyond the
    /// corner. A board that plans between way-points aborts where it would wait: other robots stop it only by the
    /// margin.
    fn foreseen_on_the_way(&self, pulse: &Pulse, step: &ReflexStep) -> Vec<Contact> {
        let ReflexPhase::Retreating(phase) = &self.phase else { return Vec::new() };
        let direct = phase.retreat.path().direct;
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
        let ReflexPhase::Stopping(StoppingPhase { token, then: AfterStop::Retreat(job), .. }) = &self.phase else {
            return;
        };
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
                let phase = RetreatingPhase { token, retreat, job, violated, frozen_watch, yielding };
                self.enter(ReflexPhase::Retreating(phase), step);
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
        self.enter_stop(token, AfterStop::Retreat(RetreatJob { again: !replan, ..job }), step);
    }

    /// Aborts the retreat: stops the robot, journals the reason, and reports it to Supervise once the robot rests.
    /// `seen` is the time of the reading that shows the reason.
    fn abort(&mut self, token: u64, reason: Hold, what: String, seen: Time, step: &mut ReflexStep) {
        step.stop(token);
        step.emit(Event::RetreatStopped { robot: step.robot(), reason, what, seen });
        self.enter_stop(token, AfterStop::Report(ReflexReport::GaveUp(reason)), step);
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
