//! Reflex (Algorithm 6): on contact it closes the filter, stops the robot and retreats along the recorded path, under
//! observation.
//!
//! Pulses alone step the reflex: without fresh readings it writes no set-points, so it never moves blindly. It closes
//! the gate itself, before any notification is sent: no mailbox lies between the reading and the stop. Only Supervise
//! opens the gate again, so that a single component decides that the robot is safe.
//!
//! ```text
//! Watching ──touch, constraint, `RollBack`──> Stopping ──at rest──> Retreating ──last pose──> Settling ──at rest──> Watching
//!                                                ^                      │ new or deeper contact     │ timeout
//!                                                └──────────────────────┴───────────────────────────┘ aborts
//! ```

mod contacts;
mod floors;
mod phases;
mod retreat;
mod retreating;
mod yielding;

use crate::gate::Gate;
use crate::history::HistoryTooShort;
use crate::joint_retreat::{JointRetreat, RetreatRequest};
use crate::ledger::{SafePose, Underway};
use crate::pulse::Pulse;
use crate::stop::Stop;
use crate::{Rules, Shared};
use contacts::Contacts;
use floors::{ClearanceFloors, RecentClearances};
use mobee_contract::{Cause, Command, CommitId, Event, Hold, Status, Time};
use mobee_model::{Contact, Pair};
use phases::{ReflexPhase, StoppingPhase};
pub use retreat::HALT_ACCELERATION_SHARE;
use std::sync::Arc;
use std::time::Duration;

/// Time for which readings must be equal bit for bit, while set-points move by [`FROZEN_TRAVEL`], to count as frozen
/// (I26). Encoders are noisy: if they are equal for half a second, they were not read. A shorter time would mistake a
/// slow board for a frozen one.
pub const FROZEN_TIME: Duration = Duration::from_millis(500);
/// Tolerance for a constraint that was violated as an escape set out, in the units of its clause (degrees): encoder
/// noise.
const CONSTRAINT_NOISE: f64 = 0.1;
/// Least travel of the set-points in that time, rad: one degree, so that a robot that creeps or stands still is not
/// suspected.
pub const FROZEN_TRAVEL: f64 = std::f64::consts::PI / 180.0;

/// Input of the reflex.
#[derive(Debug)]
pub enum ReflexIn<'a> {
    /// A reading, which the reflex completes.
    Pulse(&'a mut Pulse),
    /// Supervise closed the filter under this token and stopped the robot: retreat.
    RollBack {
        /// Token of the closing.
        token: u64,
        /// Motion to roll back.
        motion: Underway,
        /// True if this is a retry after a failed retreat.
        again: bool,
    },
    /// The requested recording was handed to the joint retreat, or does not exist. Request and answer are messages:
    /// the history belongs to the ledger, and copying it takes longer than a step may.
    Brought(Result<(), HistoryTooShort>),
}

/// Action requested by the reflex.
#[derive(Clone, Debug, PartialEq)]
pub enum ReflexOut {
    /// Send this command to the driver, with the reflex as writer, under this token.
    Command(u64, Command),
    /// Notify Supervise that the filter was closed.
    Closed {
        /// Token of the closing.
        token: u64,
        /// Cause of the closing.
        cause: Cause,
    },
    /// Hand the robot's recording to the joint retreat, then answer with [`ReflexIn::Brought`].
    Bring(RetreatRequest),
    /// Send this report to Supervise.
    ReflexReport(ReflexReport),
    /// Publish this event.
    Event(Event),
}

/// Progress of a retreat, as reported to Supervise.
#[derive(Clone, Debug, PartialEq)]
pub enum ReflexReport {
    /// The retreat begins.
    Retreating,
    /// The retreat leads to this configuration instead of the safe pose, and moves these motors. It is an earlier
    /// rest, since another robot has to pass where this one would stand; or a later configuration of a stream, which
    /// is not undone completely.
    EndsAt {
        /// The configuration.
        to: SafePose,
        /// The motors, in ascending order.
        motors: Arc<[usize]>,
        /// True if a stream is undone partially.
        stream: bool,
    },
    /// The retreat also moves these motors, which the motion did not name and a contact has bent.
    Joined(Vec<usize>),
    /// The last set-point of the retreat was written.
    Settling,
    /// The robot rests at the safe pose, and the control modes are restored.
    Back,
    /// An escape violated its rule: the robot has stopped and rests.
    Stopped,
    /// The robot has stopped and rests, but not at the safe pose.
    GaveUp(Hold),
}

/// Action after a stop, once the robot rests.
#[derive(Debug, Clone)]
enum AfterStop {
    /// Retreat.
    Retreat(RetreatJob),
    /// Remain there, and send this report to Supervise.
    Report(ReflexReport),
}

/// Detects frozen encoders during a retreat: duration of equal readings, and the set-points at their beginning.
#[derive(Debug, Clone)]
struct FrozenEncoderWatch {
    /// Time since which the readings are equal bit for bit, from the history.
    unchanged: Time,
    /// Set-points at the first of these readings within the retreat, rad.
    written: Vec<f64>,
    /// Time of that reading.
    sampled_at: Time,
}

/// Escape in progress, and the limits that it must not exceed (I24).
#[derive(Debug, Clone)]
struct Escape {
    /// Commit of the escape.
    id: CommitId,
    /// Least distances of the pairs.
    floors: ClearanceFloors,
    /// Depth of a constraint violation as it set out, if there was one, in the units of its clause.
    depth: Option<f64>,
}

/// Retreat to perform: the motion and its end.
#[derive(Debug, Clone)]
struct RetreatJob {
    /// Motion to roll back.
    motion: Underway,
    /// Safe pose of the motion: the end of the retreat.
    safe: SafePose,
    /// True if this is a retry: a retry is planned for this robot alone, and skips detours.
    again: bool,
}

/// Returns the names of the two shapes of a pair.
type Names<'a> = dyn Fn(Pair) -> (String, String) + 'a;

/// One step of the reflex: the values shared with the robot's other actors and with other reflexes, the time, and the
/// requested actions.
struct ReflexStep<'a> {
    rules: &'a Rules,
    gate: &'a Gate,
    joint_retreat: &'a JointRetreat,
    names: &'a Names<'a>,
    now: Time,
    out: Vec<ReflexOut>,
}

impl ReflexStep<'_> {
    /// Publishes an event.
    fn emit(&mut self, event: Event) {
        self.out.push(ReflexOut::Event(event));
    }

    /// Stops all motors: the set of moving motors is not reliably known.
    fn stop(&mut self, token: u64) {
        self.out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
    }

    fn robot(&self) -> String {
        self.rules.robot.clone()
    }
}

/// State machine of the reflex.
#[derive(Clone, Debug)]
pub struct ReflexCore {
    /// Index of the robot in the scene.
    robot: usize,
    /// Current phase.
    phase: ReflexPhase,
    /// Present contacts.
    contacts: Contacts,
    /// Pairs near the robot in the newest reading; those with other robots at a common instant.
    near: Arc<[Contact]>,
    /// Least distances of the pairs since the robot was stopped: the limits of the retreat.
    floors: ClearanceFloors,
    /// Least distances during the retreat: a replanned retreat passes there again.
    passed: ClearanceFloors,
    /// Least distances in the latest motions: a retreat to an earlier rest passes there again.
    recent: RecentClearances,
    /// True if a constraint was violated in the newest reading.
    violated: bool,
    /// True if the robot rested in the newest reading.
    rests: bool,
    /// Last stop, sent by the reflex or by Supervise.
    stop: Stop,
    /// Motors of the stopped motion: they are switched back to the mode of position moves.
    stopped: Arc<[usize]>,
    /// Last escape.
    escape: Option<Escape>,
    /// Last motion.
    motion: Option<CommitId>,
    /// Edit count of the scene as the motion set out: up to this count the retreat path was free.
    epoch: u64,
    /// Contacts that began in the motion. The agent learns from them, even if the retreat has ended them since.
    met: Vec<Contact>,
}

impl ReflexCore {
    /// Creates a reflex for the robot of this index. A predecessor that died may have been retreating with other
    /// robots: the reflex leaves that group, and the group stops, since nothing writes this robot's set-points any
    /// more.
    pub fn new(robot: usize, shared: &Shared) -> ReflexCore {
        shared.joint_retreat.leave(robot);
        let contacts = Contacts::new(shared.rules.margin);
        let near = contacts.present().clone();
        let phase = ReflexPhase::Watching;
        ReflexCore {
            robot,
            phase,
            contacts,
            near,
            floors: ClearanceFloors::default(),
            passed: ClearanceFloors::default(),
            recent: RecentClearances::new(shared.rules.margin),
            violated: false,
            rests: false,
            stop: Stop::sent(Time::ZERO),
            stopped: Vec::new().into(),
            escape: None,
            motion: None,
            epoch: 0,
            met: Vec::new(),
        }
    }

    /// Present contacts.
    pub fn present(&self) -> &Arc<[Contact]> {
        self.contacts.present()
    }

    /// Contacts from which an agent may learn the cause: the present ones, else those that began during the last
    /// motion.
    pub fn seen(&self) -> Arc<[Contact]> {
        if self.present().is_empty() && !self.met.is_empty() {
            self.met.as_slice().into()
        } else {
            self.present().clone()
        }
    }

    /// Performs one step at the time `now`. Returns the requested actions in the order in which they must be
    /// performed. `names` returns the names of a pair of shapes.
    pub fn on(
        &mut self,
        input: ReflexIn,
        now: Time,
        shared: &Shared,
        names: &dyn Fn(Pair) -> (String, String),
    ) -> Vec<ReflexOut> {
        let Shared { rules, gate, joint_retreat, book } = shared;
        let step = &mut ReflexStep { rules, gate, joint_retreat, names, now, out: Vec::new() };
        match input {
            ReflexIn::Pulse(pulse) => self.pulse(pulse, book.motion().as_ref(), book.status, step),
            ReflexIn::RollBack { token, motion, again } => {
                if token == step.gate.token() {
                    self.stopped = motion.named.clone();
                    let back = motion.safe.clone().map(|safe| AfterStop::Retreat(RetreatJob { motion, safe, again }));
                    let then = back.unwrap_or(AfterStop::Report(ReflexReport::GaveUp(Hold::HistoryTooShort)));
                    self.floors = ClearanceFloors::new(step.rules.margin, &self.near);
                    self.enter_stop(token, then, step);
                }
            }
            ReflexIn::Brought(Ok(())) => self.request_retreat(step),
            ReflexIn::Brought(Err(why)) => {
                if let ReflexPhase::Stopping(StoppingPhase { token, then: AfterStop::Retreat(_), .. }) = self.phase {
                    let robot = step.robot();
                    let reason = Hold::HistoryTooShort;
                    let what = why.to_string();
                    step.emit(Event::RetreatStopped { robot, reason, what, seen: step.now });
                    let report = ReflexReport::GaveUp(reason);
                    // A robot that an obstacle holds requests its retreat while it still creeps or pushes.
                    match self.rests {
                        true => self.report(token, report, step),
                        false => self.enter_stop(token, AfterStop::Report(report), step),
                    }
                }
            }
        }
        std::mem::take(&mut step.out)
    }

    /// Processes a reading: reports changes of contacts, then either looks for a reason to close the filter or
    /// continues the phase. Sets whether the robot is free in the pulse.
    fn pulse(&mut self, pulse: &mut Pulse, motion: Option<&Underway>, status: Status, step: &mut ReflexStep) {
        self.violated = pulse.violated.is_some();
        self.rests = pulse.speed < step.rules.rest_speed;
        self.near = pulse.near(|_| true);
        if let Some(m) = motion.filter(|m| self.motion != Some(m.id)) {
            self.motion = Some(m.id);
            self.epoch = pulse.epoch;
            self.met.clear();
            self.recent.begin();
        }
        self.recent.note(&self.near, pulse.sample.at);
        // An object that touches a robot at rest was moved there by something else.
        let moving = !matches!(status, Status::Starting | Status::Rest | Status::Holding(_));
        let back = self.phase.is_on_path();
        // A robot that retreats in the same group passes this one as recorded. Of any other robot, and during a
        // motion, the smallest known distance counts.
        let along = |c: &Contact| back && self.shares_group(c, step);
        let close = pulse.near(along);
        let changes = self.contacts.update(&close, back, moving, pulse.epoch);
        let names = step.names;
        for contact in &changes.began {
            let robot = step.robot();
            let names = names(contact.pair);
            step.emit(Event::ContactBegan { robot, contact: *contact, names, during: status });
        }
        for contact in &changes.hard {
            let robot = step.robot();
            let names = names(contact.pair);
            step.emit(Event::HardContact { robot, contact: *contact, names });
        }
        for ended in &changes.ended {
            step.emit(Event::ContactEnded { robot: step.robot(), names: names(ended.pair), depth: ended.depth });
        }
        if motion.is_some() {
            self.met.extend_from_slice(&changes.began);
        }
        pulse.free = self.is_free(step);

        // The gate's current token, not the one at the beginning of this step: the last component that closed it is
        // in charge.
        let token = step.gate.token();
        let outdated = self.phase.token().is_some_and(|own| own != token);
        if outdated {
            // The filter was closed again, and the robot stopped, by another component.
            self.enter(ReflexPhase::Watching, step);
        }
        if matches!(self.phase, ReflexPhase::Watching) {
            if Gate::opens(token) {
                self.watch(pulse, &close, motion, status, step);
            }
        } else {
            self.step_phase(pulse, &close, step);
            // A retreat that ended with this reading has ended contacts.
            pulse.free = self.is_free(step);
        }
    }

    /// Returns whether this is a contact with a robot of the same retreat group.
    fn shares_group(&self, contact: &Contact, step: &ReflexStep) -> bool {
        let mut others =
            [contact.pair.0.robot(), contact.pair.1.robot()].into_iter().flatten().filter(|r| *r != self.robot);
        others.any(|other| step.joint_retreat.shares_group(self.robot, other))
    }

    /// Returns whether there is nothing that the reflex would act upon.
    fn is_free(&self, step: &ReflexStep) -> bool {
        !step.rules.reflex || (self.present().is_empty() && !self.violated)
    }

    /// Looks for a reason to close the open filter, and closes it.
    fn watch(
        &mut self,
        pulse: &Pulse,
        close: &[Contact],
        motion: Option<&Underway>,
        status: Status,
        step: &mut ReflexStep,
    ) {
        let escape = motion.filter(|m| m.is_escape() && status == Status::Escaping);
        let cause = if let Some(m) = escape {
            // An escape begins in contact by its nature: it is stopped only by pairs and constraints that are worse
            // than at its start.
            if self.escape.as_ref().is_none_or(|escape| escape.id != m.id) {
                let floors = ClearanceFloors::new(step.rules.margin, close);
                let depth = pulse.violated.map(|_| pulse.depth);
                self.escape = Some(Escape { id: m.id, floors, depth });
            }
            let (floors, depth) =
                self.escape.as_ref().map_or((None, None), |escape| (Some(&escape.floors), escape.depth));
            // An escape that set out without a violation may violate nothing.
            let deeper = depth.is_none_or(|depth| pulse.depth > depth + CONSTRAINT_NOISE);
            match floors.and_then(|f| f.broken(close, step.rules)) {
                Some(c) => Some(Cause::Contact(vec![*c])),
                None if deeper => pulse.violated.map(|v| constraint(v, step.rules)),
                None => None,
            }
        } else if !step.rules.reflex {
            None
        } else if !self.present().is_empty() {
            Some(Cause::Contact(self.present().to_vec()))
        } else if motion.is_some() && !pulse.foreseen.is_empty() {
            // The agent learns from a foreseen contact as from a contact.
            let foreseen: Vec<Contact> = pulse.foreseen.iter().map(|f| f.contact).collect();
            self.met.extend_from_slice(&foreseen);
            Some(Cause::Foreseen(foreseen))
        } else {
            pulse.violated.map(|v| constraint(v, step.rules))
        };
        let Some(cause) = cause else { return };
        // Close first: from here on, no agent's command passes, including those in flight (I1).
        let token = step.gate.close();
        step.emit(Event::Disabled { robot: step.robot(), token, cause: cause.clone() });
        step.stop(token);
        step.out.push(ReflexOut::Closed { token, cause });
        // At rest there is nothing to roll back: Supervise holds, and an escape is the way out.
        let Some(motion) = motion else { return };
        self.stopped = motion.named.clone();
        let motion = &Underway { extent: motion.extent.stopped(pulse.sample.at), ..motion.clone() };
        let back = |safe| AfterStop::Retreat(RetreatJob { motion: motion.clone(), safe, again: false });
        let then = motion.safe.clone().map_or(AfterStop::Report(ReflexReport::Stopped), back);
        // The stop takes effect from now on: a delayed reading does not show it.
        self.floors = ClearanceFloors::new(step.rules.margin, &self.near);
        self.enter_stop(token, then, step);
    }

    /// Enters the phase that waits for rest after a stop, which was sent just before.
    fn enter_stop(&mut self, token: u64, then: AfterStop, step: &ReflexStep) {
        self.stop = Stop::sent(step.now);
        self.enter(ReflexPhase::Stopping(StoppingPhase { token, since: step.now, then }), step);
    }

    /// Enters the next phase, and joins or leaves the joint retreat accordingly. On its path and at the end of it, the
    /// robot retains its place on the common clock for those that are still retreating.
    fn enter(&mut self, phase: ReflexPhase, step: &ReflexStep) {
        match &phase {
            ReflexPhase::Stopping(StoppingPhase { then: AfterStop::Retreat(_), .. }) => {
                // The robot may have been retreating already: that retreat is over, and would not plan another path
                // for it.
                step.joint_retreat.leave(self.robot);
                step.joint_retreat.announce(self.robot, step.now);
            }
            ReflexPhase::Retreating(_) | ReflexPhase::Settling(_) => {}
            ReflexPhase::Watching | ReflexPhase::Stopping(_) => step.joint_retreat.leave(self.robot),
        }
        self.phase = phase;
    }
}

/// Returns the cause for a violated constraint. It contains the part's name, so that the journal can be read without
/// the model.
fn constraint((part, clause): (usize, usize), rules: &Rules) -> Cause {
    Cause::Constraint { part: rules.parts.get(part).cloned().unwrap_or_default(), clause }
}

#[cfg(test)]
pub(crate) mod tests;
