//! Reflex (Algorithm 6): on contact close the filter, stop, take the robot back along its recorded path, and watch it.
//!
//! It is stepped by pulses alone: without fresh readings there are no set-points, so it never moves blindly.
//!
//! ```text
//! Watching ──touch, constraint, `RollBack`──> Stopping ──at rest──> Retreating ──last pose──> Settling ──at rest──> Watching
//!                                                ^                      │ new or deeper contact     │ not there in time
//!                                                └──────────────────────┴───────────────────────────┘ gives up
//! ```

mod back;
mod contacts;
mod retreat;

use crate::gate::Gate;
use crate::history::HistoryTooShort;
use crate::joint_retreat::{Asked, JointRetreat};
use crate::ledger::Places;
use crate::pulse::Pulse;
use crate::stop::Stop;
use crate::{Rules, Shared};
use contacts::{Contacts, Floors};
use mobee_contract::{Cause, Command, CommitId, Event, Hold, Pose, Status, Time};
use mobee_model::{Contact, Pair};
use retreat::Retreat;
use std::sync::Arc;
use std::time::Duration;

/// Readings equal bit for bit for so long, while set-points moved on by [`FROZEN_WAY`], are no readings.
pub const FROZEN: Duration = Duration::from_millis(500);
/// By how much deeper a constraint may be violated on the way of an escape that set out violating one, in the units of its clause
/// (degrees): the encoders' noise.
const NOISE: f64 = 0.1;
/// One degree.
pub const FROZEN_WAY: f64 = std::f64::consts::PI / 180.0;

/// What is under way, as the ledger has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Underway {
    /// The commit.
    pub id: CommitId,
    /// Its safe pose; an escape has none.
    pub safe: Option<(Time, Pose)>,
    /// The motors that it has named, in order: during the retreat no other is written to.
    pub named: Arc<[usize]>,
    /// Where all motors had been sent when it began.
    pub places: Places,
}

impl Underway {
    /// Whether it leads out of a contact, and has nowhere to be taken back to.
    pub fn is_escape(&self) -> bool {
        self.safe.is_none()
    }
}

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
    /// The path that was asked for is with the joint retreat, or there is none.
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
    /// It leads beyond the safe pose, to this earlier rest, and moves these motors: another robot has to pass there.
    Farther((Time, Pose), Arc<[usize]>),
    /// The last pose was written.
    Settling,
    /// The robot rests at the safe pose, control modes restored.
    Back,
    /// An escape broke its rule: the robot has stopped and rests.
    Stopped,
    /// The robot has stopped and rests, but not at the safe pose.
    GaveUp(Hold),
}

#[derive(Clone, Debug)]
enum Phase {
    Watching,
    Stopping { token: u64, since: Time, then: Then },
    Retreating { token: u64, retreat: Retreat, back: Back, violated: bool, mark: (Time, Vec<f64>, Time) },
    Settling { token: u64, since: Time, retreat: Retreat, violated: bool },
}

#[derive(Debug, Clone)]
enum Then {
    Retreat(Back),
    Say(ReflexReport),
}

/// A motion that is taken back: to where, and whether it is another try.
#[derive(Debug, Clone)]
struct Back {
    motion: Underway,
    safe: (Time, Pose),
    again: bool,
}

/// The two shapes of a pair in words.
type Names<'a> = dyn Fn(Pair) -> (String, String) + 'a;

/// One step of the reflex: what it shares with the other actors of its robot and with other reflexes, the time, and what it wants done.
struct Step<'a> {
    rules: &'a Rules,
    gate: &'a Gate,
    joint_retreat: &'a JointRetreat,
    names: &'a Names<'a>,
    now: Time,
    out: Vec<ReflexOut>,
}

impl Step<'_> {
    fn emit(&mut self, event: Event) {
        self.out.push(ReflexOut::Event(event));
    }

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
    robot: usize,
    phase: Phase,
    contacts: Contacts,
    near: Arc<[Contact]>,
    /// How near pairs came since the robot was stopped to be taken back, and may come on the way.
    floors: Floors,
    violated: bool,
    /// The last stop that it told, or was told of.
    stop: Stop,
    /// The motors of the motion that it has stopped: they are put back into the mode of position moves.
    stopped: Arc<[usize]>,
    /// The escape under way, how near it may come, and how deeply a constraint was violated as it set out, if one was.
    escape: Option<(CommitId, Floors, Option<f64>)>,
    /// The last motion, and the contacts that began in it.
    motion: Option<CommitId>,
    met: Vec<Contact>,
}

impl ReflexCore {
    /// A reflex that watches the robot of this index.
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
            violated: false,
            stop: Stop::told(Time::ZERO),
            stopped: Vec::new().into(),
            escape: None,
            motion: None,
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

    /// One step.
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

    fn pulse(&mut self, pulse: &mut Pulse, motion: Option<&Underway>, status: Status, step: &mut Step) {
        let newly_violated = pulse.violated.is_some() && !self.violated;
        self.violated = pulse.violated.is_some();
        self.near = pulse.contacts.clone();
        if let Some(m) = motion.filter(|m| self.motion != Some(m.id)) {
            self.motion = Some(m.id);
            self.met.clear();
        }
        let moving = !matches!(status, Status::Starting | Status::Rest | Status::Holding(_));
        let back = matches!(self.phase, Phase::Retreating { .. } | Phase::Settling { .. });
        let changes = self.contacts.update(&pulse.contacts, back, moving, pulse.epoch);
        let names = step.names;
        for contact in &changes.began {
            let (robot, names) = (step.robot(), names(contact.pair));
            step.emit(Event::ContactBegan { robot, contact: *contact, names, during: status });
        }
        for contact in &changes.hard {
            let (robot, names) = (step.robot(), names(contact.pair));
            step.emit(Event::HardContact { robot, contact: *contact, names });
        }
        for pair in &changes.ended {
            step.emit(Event::ContactEnded { robot: step.robot(), names: names(*pair) });
        }
        if motion.is_some() {
            self.met.extend_from_slice(&changes.began);
        }
        pulse.free = self.is_free(step);

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
                self.watch(pulse, motion, status, newly_violated, step);
            }
        } else {
            self.act(pulse, step);
            pulse.free = self.is_free(step);
        }
    }

    /// Whether nothing is there that the reflex would act upon.
    fn is_free(&self, step: &Step) -> bool {
        !step.rules.reflex || (self.present().is_empty() && !self.violated)
    }

    /// The filter is open: is there a reason to close it?
    fn watch(&mut self, pulse: &Pulse, motion: Option<&Underway>, status: Status, newly: bool, step: &mut Step) {
        let escape = motion.filter(|m| m.is_escape() && status == Status::Escaping);
        let cause = if let Some(m) = escape {
            if self.escape.as_ref().is_none_or(|(id, ..)| *id != m.id) {
                let violated = pulse.violated.map(|_| pulse.depth);
                self.escape = Some((m.id, Floors::new(step.rules.margin, &pulse.contacts), violated));
            }
            let (floors, depth) =
                self.escape.as_ref().map_or((None, None), |(_, floors, depth)| (Some(floors), *depth));
            let deeper = depth.map_or(newly, |depth| pulse.depth > depth + NOISE);
            match floors.and_then(|f| f.broken(&pulse.contacts)) {
                Some(c) => Some(Cause::Contact(vec![*c])),
                None if deeper => pulse.violated.map(|v| constraint(v, step.rules)),
                None => None,
            }
        } else if !step.rules.reflex {
            None
        } else if !self.present().is_empty() {
            Some(Cause::Contact(self.present().to_vec()))
        } else {
            pulse.violated.map(|v| constraint(v, step.rules))
        };
        let Some(cause) = cause else { return };
        let token = step.gate.close();
        step.emit(Event::Disabled { robot: step.robot(), token, cause: cause.clone() });
        step.stop(token);
        step.out.push(ReflexOut::Closed { token, cause });
        let Some(motion) = motion else { return };
        self.stopped = motion.named.clone();
        let back = |safe| Then::Retreat(Back { motion: motion.clone(), safe, again: false });
        let then = motion.safe.clone().map_or(Then::Say(ReflexReport::Stopped), back);
        // the stop takes effect from now on: a reading that was held up does not show it
        self.floors = Floors::new(step.rules.margin, &pulse.contacts);
        self.turn(Phase::Stopping { token, since: step.now, then }, step);
    }

    /// The next phase, and what it means for those who might go back with this robot.
    fn turn(&mut self, phase: Phase, step: &Step) {
        if let Phase::Stopping { .. } = phase {
            self.stop = Stop::told(step.now);
        }
        match &phase {
            Phase::Stopping { then: Then::Retreat(_), .. } => step.joint_retreat.coming(self.robot, step.now),
            Phase::Retreating { .. } | Phase::Settling { .. } => {}
            Phase::Watching | Phase::Stopping { then: Then::Say(_), .. } => step.joint_retreat.leave(self.robot),
        }
        self.phase = phase;
    }
}

fn constraint((part, clause): (usize, usize), rules: &Rules) -> Cause {
    Cause::Constraint { part: rules.parts.get(part).cloned().unwrap_or_default(), clause }
}

#[cfg(test)]
pub(crate) mod tests;
