//! Reflex (Algorithm 6): on contact close the filter, stop, take the robot back along its recorded path, and watch it.
//!
//! It is stepped by pulses alone: without fresh readings there are no set-points, so it never moves blindly. It closes
//! the gate itself, before anybody is told: between the reading and the stop no mailbox is waited for. Only supervise
//! opens it again, so that there is one who decides that all is well.
//!
//! ```text
//! Watching ──touch, constraint, `RollBack`──> Stopping ──at rest──> Retreating ──last pose──> Settling ──at rest──> Watching
//!                                                ^                      │ new or deeper contact     │ not there in time
//!                                                └──────────────────────┴───────────────────────────┘ gives up
//! ```

mod back;
mod contacts;
mod floors;
mod retreat;
mod room;

use crate::gate::Gate;
use crate::history::HistoryTooShort;
use crate::joint_retreat::{Asked, JointRetreat};
use crate::ledger::{SafePose, Underway};
use crate::pulse::Pulse;
use crate::stop::Stop;
use crate::{Rules, Shared};
use contacts::Contacts;
use floors::{Floors, Lately};
use mobee_contract::{Cause, Command, CommitId, Event, Hold, Status, Time};
use mobee_model::{Contact, Pair};
pub use retreat::HALT_BRAKES;
use retreat::Retreat;
use room::Room;
use std::sync::Arc;
use std::time::Duration;

/// Readings equal bit for bit for so long, while set-points moved on by [`FROZEN_WAY`], are no readings (I26). Encoders
/// are noisy: equal for half a second, they were not read. Shorter, a board that answers slowly would be taken for one
/// that froze.
pub const FROZEN: Duration = Duration::from_millis(500);
/// By how much deeper a constraint may be violated on the way of an escape that set out violating one, in the units of
/// its clause (degrees): the encoders' noise.
const NOISE: f64 = 0.1;
/// How far set-points must have moved meanwhile, rad: one degree, so that a robot
/// that creeps or stands is not suspected.
pub const FROZEN_WAY: f64 = std::f64::consts::PI / 180.0;

/// What the reflex hears.
#[derive(Debug)]
pub enum ReflexIn<'a> {
    /// A reading, which it completes.
    Pulse(&'a mut Pulse),
    /// Supervise closed the filter under this token and stopped the robot: take it back.
    RollBack {
        /// The closing's token.
        token: u64,
        /// What is rolled back.
        motion: Underway,
        /// Whether this is another try after a failed one.
        again: bool,
    },
    /// The path that was asked for is with the joint retreat, or there is none: asked for and answered by messages,
    /// since the history is the ledger's, and copying it out takes longer than a step may.
    Brought(Result<(), HistoryTooShort>),
}

/// What the reflex wants done.
#[derive(Clone, Debug, PartialEq)]
pub enum ReflexOut {
    /// Tell the driver, as the reflex, under this token.
    Command(u64, Command),
    /// Tell supervise that the filter was closed.
    Closed {
        /// The closing's token.
        token: u64,
        /// Why.
        cause: Cause,
    },
    /// Bring the joint retreat what the robot recorded, then say so.
    Bring(Asked),
    /// Tell supervise.
    ReflexReport(ReflexReport),
    /// Tell the taps.
    Event(Event),
}

/// What supervise learns about the retreat.
#[derive(Clone, Debug, PartialEq)]
pub enum ReflexReport {
    /// The retreat begins.
    Retreating,
    /// It leads to this pose and not to the safe pose, and moves these motors: to an earlier rest, since another robot has to
    /// pass where it would stand; or to a later pose of a stream, which is not undone whole.
    EndsAt {
        /// The pose.
        to: SafePose,
        /// The motors, in order.
        motors: Arc<[usize]>,
        /// Whether it is the latter.
        stream: bool,
    },
    /// The last pose was written.
    Settling,
    /// The robot rests at the safe pose, control modes restored.
    Back,
    /// An escape broke its rule: the robot has stopped and rests.
    Stopped,
    /// The robot has stopped and rests, but not at the safe pose.
    GaveUp(Hold),
}

/// What the reflex is about. All but the first hold the token under which the filter was closed: under another one it
/// is somebody else who acts, and this one is back to watching.
#[derive(Clone, Debug)]
enum Phase {
    /// The filter is open, or closed by somebody who needs no retreat.
    Watching,
    /// The robot was stopped at `since`, and is waited for to rest.
    Stopping { token: u64, since: Time, then: Then },
    /// It is being taken back. `violated`: whether a constraint was as it began.
    Retreating { token: u64, retreat: Retreat, back: Back, violated: bool, still: Still, room: Room },
    /// The last pose was written; it should be reached at `since`.
    Settling { token: u64, since: Time, retreat: Retreat, back: Back, violated: bool, room: Room },
}

/// What is due once the robot rests.
#[derive(Debug, Clone)]
enum Then {
    /// It is taken back.
    Retreat(Back),
    /// It stays, and supervise is told why.
    Say(ReflexReport),
}

/// How long the readings of a retreat have been the same, and where it was sent when that began: what tells frozen
/// encoders.
#[derive(Debug, Clone)]
struct Still {
    /// Since when they are equal bit for bit, as the history tells it.
    unchanged: Time,
    /// The set-points at the first of them that came in the retreat, rad.
    written: Vec<f64>,
    /// When that reading was taken.
    sampled_at: Time,
}

/// An escape under way, and what it must not make worse (I24).
#[derive(Debug, Clone)]
struct Escape {
    /// Its commit.
    id: CommitId,
    /// How near pairs may come.
    floors: Floors,
    /// How deeply a constraint was violated as it set out, if one was, in the units of its clause.
    depth: Option<f64>,
}

/// A motion that is taken back: to where, and whether it is another try.
#[derive(Debug, Clone)]
struct Back {
    /// The motion.
    motion: Underway,
    /// Its safe pose: the retreat's end.
    safe: SafePose,
    /// Whether it is another try: such a one goes by itself, and leaves out detours.
    again: bool,
}

/// The two shapes of a pair in words.
type Names<'a> = dyn Fn(Pair) -> (String, String) + 'a;

/// One step of the reflex: what it shares with the other actors of its robot and with other reflexes, the time, and
/// what it wants done.
struct Step<'a> {
    rules: &'a Rules,
    gate: &'a Gate,
    joint_retreat: &'a JointRetreat,
    names: &'a Names<'a>,
    now: Time,
    out: Vec<ReflexOut>,
}

impl Step<'_> {
    /// Tells the taps.
    fn emit(&mut self, event: Event) {
        self.out.push(ReflexOut::Event(event));
    }

    /// Stops all motors: which of them move is not asked, since that would be a matter of belief.
    fn stop(&mut self, token: u64) {
        self.out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
    }

    fn robot(&self) -> String {
        self.rules.robot.clone()
    }
}

/// The state machine.
#[derive(Clone, Debug)]
pub struct ReflexCore {
    /// Its robot's index in the scene.
    robot: usize,
    /// What it is about.
    phase: Phase,
    /// The present contacts.
    contacts: Contacts,
    /// The pairs near the robot in the newest reading, those with other robots as they were at one instant.
    near: Arc<[Contact]>,
    /// How near pairs came since the robot was stopped to be taken back, and may come on the way.
    floors: Floors,
    /// How near they came on the way: one that begins anew leads through there once more.
    passed: Floors,
    /// How near they came in the latest motions: a way that leads farther back leads through those.
    lately: Lately,
    /// Whether a constraint was violated in the newest reading.
    violated: bool,
    /// The last stop that it told, or was told of.
    stop: Stop,
    /// The motors of the motion that it has stopped: they are put back into the mode of position moves.
    stopped: Arc<[usize]>,
    /// The last escape.
    escape: Option<Escape>,
    /// The last motion.
    motion: Option<CommitId>,
    /// The scene's count of edits as it set out: up to there the way back was free.
    epoch: u64,
    /// The contacts that began in it: what its agent learns from, though the retreat has ended them since.
    met: Vec<Contact>,
}

impl ReflexCore {
    /// A reflex that watches the robot of this index. A predecessor that died may have been on its way with others: it
    /// leaves them, and they stop, since nobody writes its set-points any more.
    pub fn new(robot: usize, shared: &Shared) -> ReflexCore {
        shared.joint_retreat.leave(robot);
        let contacts = Contacts::new(shared.rules.margin);
        let near = contacts.present().clone();
        let phase = Phase::Watching;
        ReflexCore {
            robot,
            phase,
            contacts,
            near,
            floors: Floors::default(),
            passed: Floors::default(),
            lately: Lately::new(shared.rules.margin),
            violated: false,
            stop: Stop::told(Time::ZERO),
            stopped: Vec::new().into(),
            escape: None,
            motion: None,
            epoch: 0,
            met: Vec::new(),
        }
    }

    /// The present contacts.
    pub fn present(&self) -> &Arc<[Contact]> {
        self.contacts.present()
    }

    /// What an agent may learn a cause from: the present contacts, else those that began during the last motion.
    pub fn seen(&self) -> Arc<[Contact]> {
        if self.present().is_empty() && !self.met.is_empty() {
            self.met.as_slice().into()
        } else {
            self.present().clone()
        }
    }

    /// One step: what is to be done about this input at the time `now`, in the order in which it is to be done. `names`
    /// gives the words for a pair of shapes.
    pub fn on(
        &mut self,
        input: ReflexIn,
        now: Time,
        shared: &Shared,
        names: &dyn Fn(Pair) -> (String, String),
    ) -> Vec<ReflexOut> {
        let Shared { rules, gate, joint_retreat, book } = shared;
        let step = &mut Step { rules, gate, joint_retreat, names, now, out: Vec::new() };
        match input {
            ReflexIn::Pulse(pulse) => self.pulse(pulse, book.motion().as_ref(), book.status, step),
            ReflexIn::RollBack { token, motion, again } => {
                if token == step.gate.token() {
                    self.stopped = motion.named.clone();
                    let back = motion.safe.clone().map(|safe| Then::Retreat(Back { motion, safe, again }));
                    let then = back.unwrap_or(Then::Say(ReflexReport::GaveUp(Hold::HistoryTooShort)));
                    self.floors = Floors::new(step.rules.margin, &self.near);
                    self.turn(Phase::Stopping { token, since: step.now, then }, step);
                }
            }
            ReflexIn::Brought(Ok(())) => self.ask(step),
            ReflexIn::Brought(Err(why)) => {
                if let Phase::Stopping { token, then: Then::Retreat(_), .. } = self.phase {
                    let (robot, reason, what) = (step.robot(), Hold::HistoryTooShort, why.to_string());
                    step.emit(Event::RetreatStopped { robot, reason, what, seen: step.now });
                    self.say(token, ReflexReport::GaveUp(reason), step);
                }
            }
        }
        std::mem::take(&mut step.out)
    }

    /// A reading: contacts are told, then either watched for a reason to close, or acted upon. Completes the pulse by
    /// whether the robot is free.
    fn pulse(&mut self, pulse: &mut Pulse, motion: Option<&Underway>, status: Status, step: &mut Step) {
        self.violated = pulse.violated.is_some();
        self.near = pulse.near(|_| true);
        if let Some(m) = motion.filter(|m| self.motion != Some(m.id)) {
            (self.motion, self.epoch) = (Some(m.id), pulse.epoch);
            self.met.clear();
            self.lately.begin();
        }
        self.lately.note(&self.near, pulse.sample.at);
        // what touches a robot at rest was moved there by somebody else
        let moving = !matches!(status, Status::Starting | Status::Rest | Status::Holding(_));
        let back = matches!(self.phase, Phase::Retreating { .. } | Phase::Settling { .. });
        // who is on its way with others passes them as it did; of anybody else, and in a motion, the worst that is known counts
        let along = |c: &Contact| back && self.goes_along(c, step);
        let close = pulse.near(along);
        let changes = self.contacts.update(&close, back, moving, pulse.epoch);
        let names = step.names;
        for contact in &changes.began {
            let (robot, names) = (step.robot(), names(contact.pair));
            step.emit(Event::ContactBegan { robot, contact: *contact, names, during: status });
        }
        for contact in &changes.hard {
            let (robot, names) = (step.robot(), names(contact.pair));
            step.emit(Event::HardContact { robot, contact: *contact, names });
        }
        for ended in &changes.ended {
            step.emit(Event::ContactEnded { robot: step.robot(), names: names(ended.pair), depth: ended.depth });
        }
        if motion.is_some() {
            self.met.extend_from_slice(&changes.began);
        }
        pulse.free = self.is_free(step);

        // as it is now, not as this step began: whoever closed the filter since then is in charge
        let token = step.gate.token();
        let outdated = match &self.phase {
            Phase::Watching => false,
            Phase::Stopping { token: t, .. }
            | Phase::Retreating { token: t, .. }
            | Phase::Settling { token: t, .. } => *t != token,
        };
        if outdated {
            // somebody closed the filter anew, and stopped the robot
            self.turn(Phase::Watching, step);
        }
        if matches!(self.phase, Phase::Watching) {
            if Gate::opens(token) {
                self.watch(pulse, &close, motion, status, step);
            }
        } else {
            self.act(pulse, &close, step);
            // a retreat that ended in this very reading has ended contacts
            pulse.free = self.is_free(step);
        }
    }

    /// Whether this is a contact with a robot that is taken back together with this one.
    fn goes_along(&self, contact: &Contact, step: &Step) -> bool {
        let mut others =
            [contact.pair.0.robot(), contact.pair.1.robot()].into_iter().flatten().filter(|r| *r != self.robot);
        others.any(|other| step.joint_retreat.goes_along(self.robot, other))
    }

    /// Whether nothing is there that the reflex would act upon.
    fn is_free(&self, step: &Step) -> bool {
        !step.rules.reflex || (self.present().is_empty() && !self.violated)
    }

    /// The filter is open: is there a reason to close it?
    fn watch(&mut self, pulse: &Pulse, close: &[Contact], motion: Option<&Underway>, status: Status, step: &mut Step) {
        let escape = motion.filter(|m| m.is_escape() && status == Status::Escaping);
        let cause = if let Some(m) = escape {
            // it begins in contact by its nature: only what gets worse than it was as it set out stops it
            if self.escape.as_ref().is_none_or(|escape| escape.id != m.id) {
                let (floors, depth) = (Floors::new(step.rules.margin, close), pulse.violated.map(|_| pulse.depth));
                self.escape = Some(Escape { id: m.id, floors, depth });
            }
            let (floors, depth) =
                self.escape.as_ref().map_or((None, None), |escape| (Some(&escape.floors), escape.depth));
            // one that set out violating nothing may violate nothing
            let deeper = depth.is_none_or(|depth| pulse.depth > depth + NOISE);
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
            // the agent learns from what it did not come to touch as from a contact
            let foreseen: Vec<Contact> = pulse.foreseen.iter().map(|f| f.contact).collect();
            self.met.extend_from_slice(&foreseen);
            Some(Cause::Foreseen(foreseen))
        } else {
            pulse.violated.map(|v| constraint(v, step.rules))
        };
        let Some(cause) = cause else { return };
        // closed first: from here on nothing that an agent wrote can pass, whatever is in flight (I1)
        let token = step.gate.close();
        step.emit(Event::Disabled { robot: step.robot(), token, cause: cause.clone() });
        step.stop(token);
        step.out.push(ReflexOut::Closed { token, cause });
        // at rest there is nothing to be taken back: supervise holds, and an escape is the way out
        let Some(motion) = motion else { return };
        self.stopped = motion.named.clone();
        let motion = &Underway { extent: motion.extent.stopped(pulse.sample.at), ..motion.clone() };
        let back = |safe| Then::Retreat(Back { motion: motion.clone(), safe, again: false });
        let then = motion.safe.clone().map_or(Then::Say(ReflexReport::Stopped), back);
        // the stop takes effect from now on: a reading that was held up does not show it
        self.floors = Floors::new(step.rules.margin, &self.near);
        self.turn(Phase::Stopping { token, since: step.now, then }, step);
    }

    /// The next phase, and what it means for those who might go back with this robot.
    fn turn(&mut self, phase: Phase, step: &Step) {
        // whoever turned to this phase has just told it
        if let Phase::Stopping { .. } = phase {
            self.stop = Stop::told(step.now);
        }
        match &phase {
            Phase::Stopping { then: Then::Retreat(_), .. } => {
                // it may have been on its way already: that retreat is over, and would never give it another path
                step.joint_retreat.leave(self.robot);
                step.joint_retreat.coming(self.robot, step.now);
            }
            Phase::Retreating { .. } | Phase::Settling { .. } => {}
            Phase::Watching | Phase::Stopping { then: Then::Say(_), .. } => step.joint_retreat.leave(self.robot),
        }
        self.phase = phase;
    }
}

/// The cause that a violated constraint is: the part by name, so that the journal needs no model to be read.
fn constraint((part, clause): (usize, usize), rules: &Rules) -> Cause {
    Cause::Constraint { part: rules.parts.get(part).cloned().unwrap_or_default(), clause }
}

#[cfg(test)]
pub(crate) mod tests;
