//! Reflex (Algorithm 6): on contact close the filter, stop, take the robot back along its recorded path, and watch it.
//!
//! It is stepped by pulses alone: without fresh readings there are no set-points, so it never moves blindly.
//!
//! ```text
//! Watching ──touch, constraint, `RollBack`──> Stopping ──at rest──> Retreating ──last pose──> Settling ──at rest──> Watching
//!                                                ^                      │ new or deeper contact     │ not there in time
//!                                                └──────────────────────┴───────────────────────────┘ gives up
//! ```

mod contacts;
mod retreat;

use crate::controller::{Rules, distance};
use crate::convoy::{Answer, Asked, Convoy, Way};
use crate::gate::Gate;
use crate::history::HistoryTooShort;
use crate::pulse::Pulse;
use contacts::{Contacts, Floors};
use mobee_contract::{Cause, Command, CommitId, ControlMode, Event, Hold, Pose, Status, Time};
use mobee_model::{Contact, Pair};
use retreat::{Parted, Retreat};
use std::sync::Arc;
use std::time::Duration;

/// How long the robot may take to come to rest before it is stopped once more, or to settle at the end of its way.
const PATIENCE: Duration = Duration::from_secs(3);
/// Readings equal bit for bit for so long, while set-points moved on by [`FROZEN_WAY`], are no readings.
pub const FROZEN: Duration = Duration::from_millis(500);
/// One degree.
pub const FROZEN_WAY: f64 = std::f64::consts::PI / 180.0;

/// What is under way, as the ledger has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// The commit.
    pub id: CommitId,
    /// Its safe pose; an escape has none.
    pub safe: Option<(Time, Pose)>,
}

/// What the reflex hears.
#[derive(Debug)]
pub enum ReflexIn<'a> {
    /// A reading, which it completes; what is under way; and the filter's state.
    Pulse(&'a mut Pulse, Option<&'a Motion>, Status),
    /// Supervise closed the filter under this token and stopped the robot: take it back.
    RollBack {
        /// The closing's token.
        token: u64,
        /// What is rolled back.
        motion: Motion,
        /// Whether this is another try after a failed one.
        again: bool,
    },
    /// The path that was asked for is with the convoy, or there is none.
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
    /// Bring the convoy what the robot recorded, then say so.
    Bring(Asked),
    /// Tell supervise.
    Word(Word),
    /// Tell the taps.
    Event(Event),
}

/// What supervise learns about the way back.
#[derive(Clone, Debug, PartialEq)]
pub enum Word {
    /// The way back begins.
    Retreating,
    /// It leads beyond the safe pose, to this earlier rest: another robot has to pass there.
    Farther((Time, Pose)),
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
    Retreating { token: u64, retreat: Retreat, back: Back, floors: Floors, violated: bool, mark: (Time, Pose, Time) },
    Settling { token: u64, since: Time, way: Way, floors: Floors, violated: bool },
}

#[derive(Debug, Clone)]
enum Then {
    Retreat(Back),
    Say(Word),
}

/// A motion that is taken back: to where, and whether it is another try.
#[derive(Debug, Clone)]
struct Back {
    id: CommitId,
    safe: (Time, Pose),
    again: bool,
}

/// The state machine.
#[derive(Clone, Debug)]
pub struct ReflexCore {
    robot: usize,
    rules: Arc<Rules>,
    gate: Arc<Gate>,
    convoy: Arc<Convoy>,
    phase: Phase,
    contacts: Contacts,
    near: Arc<[Contact]>,
    /// How near pairs came since the robot was stopped to be taken back.
    floors: Floors,
    violated: bool,
    /// The escape under way, how near it may come, and whether a constraint was violated as it set out.
    escape: Option<(CommitId, Floors, bool)>,
    /// The last motion, and the contacts that began in it.
    motion: Option<CommitId>,
    met: Vec<Contact>,
}

impl ReflexCore {
    /// A reflex that watches the robot of this index.
    pub fn new(robot: usize, rules: Arc<Rules>, gate: Arc<Gate>, convoy: Arc<Convoy>) -> ReflexCore {
        convoy.leave(robot);
        let contacts = Contacts::new(rules.margin);
        let near = contacts.present().clone();
        let phase = Phase::Watching;
        ReflexCore {
            robot,
            rules,
            gate,
            convoy,
            phase,
            contacts,
            near,
            floors: Floors::default(),
            violated: false,
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
    pub fn on(&mut self, input: ReflexIn, now: Time, name: &dyn Fn(Pair) -> (String, String)) -> Vec<ReflexOut> {
        let mut out = Vec::new();
        match input {
            ReflexIn::Pulse(pulse, motion, status) => self.pulse(pulse, motion, (status, now), name, &mut out),
            ReflexIn::RollBack { token, motion, again } => {
                if token == self.gate.token() {
                    let back = motion.safe.map(|safe| Then::Retreat(Back { id: motion.id, safe, again }));
                    let then = back.unwrap_or(Then::Say(Word::GaveUp(Hold::HistoryTooShort)));
                    self.floors = Floors::new(self.rules.margin, &self.near);
                    self.turn(Phase::Stopping { token, since: now, then }, now);
                }
            }
            ReflexIn::Brought(Ok(())) => self.ask(now, &mut out),
            ReflexIn::Brought(Err(why)) => {
                if let Phase::Stopping { token, then: Then::Retreat(_), .. } = self.phase {
                    let (robot, reason, what) = (self.rules.robot.clone(), Hold::HistoryTooShort, why.to_string());
                    out.push(ReflexOut::Event(Event::RetreatStopped { robot, reason, what, seen: now }));
                    self.say(token, Word::GaveUp(reason), now, &mut out);
                }
            }
        }
        out
    }

    fn pulse(
        &mut self,
        pulse: &mut Pulse,
        motion: Option<&Motion>,
        (status, now): (Status, Time),
        name: &dyn Fn(Pair) -> (String, String),
        out: &mut Vec<ReflexOut>,
    ) {
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
        let robot = &self.rules.robot;
        for contact in &changes.began {
            let (robot, names) = (robot.clone(), name(contact.pair));
            out.push(ReflexOut::Event(Event::ContactBegan { robot, contact: *contact, names, during: status }));
        }
        for contact in &changes.hard {
            let (robot, names) = (robot.clone(), name(contact.pair));
            out.push(ReflexOut::Event(Event::HardContact { robot, contact: *contact, names }));
        }
        for pair in &changes.ended {
            out.push(ReflexOut::Event(Event::ContactEnded { robot: robot.clone(), names: name(*pair) }));
        }
        if motion.is_some() {
            self.met.extend_from_slice(&changes.began);
        }
        pulse.free = self.is_free();

        let token = self.gate.token();
        let outdated = match &self.phase {
            Phase::Watching => false,
            Phase::Stopping { token: t, .. }
            | Phase::Retreating { token: t, .. }
            | Phase::Settling { token: t, .. } => *t != token,
        };
        if outdated {
            // somebody closed the filter anew, and stopped the robot
            self.turn(Phase::Watching, now);
        }
        if matches!(self.phase, Phase::Watching) {
            if Gate::opens(token) {
                self.watch(pulse, motion, (status, now), newly_violated, out);
            }
        } else {
            self.act(pulse, now, name, out);
            pulse.free = self.is_free();
        }
    }

    /// Whether nothing is there that the reflex would act upon.
    fn is_free(&self) -> bool {
        !self.rules.reflex || (self.present().is_empty() && !self.violated)
    }

    /// The filter is open: is there a reason to close it?
    fn watch(
        &mut self,
        pulse: &Pulse,
        motion: Option<&Motion>,
        (status, now): (Status, Time),
        newly: bool,
        out: &mut Vec<ReflexOut>,
    ) {
        let escape = motion.filter(|m| m.safe.is_none() && status == Status::Escaping);
        let cause = if let Some(m) = escape {
            if self.escape.as_ref().is_none_or(|(id, ..)| *id != m.id) {
                self.escape = Some((m.id, Floors::new(self.rules.margin, &pulse.contacts), pulse.violated.is_some()));
            }
            let (floors, violated) = self.escape.as_ref().map_or((None, true), |(_, f, v)| (Some(f), *v));
            match floors.and_then(|f| f.broken(&pulse.contacts)) {
                Some(c) => Some(Cause::Contact(vec![*c])),
                None if newly && !violated => pulse.violated.map(|v| self.constraint(v)),
                None => None,
            }
        } else if !self.rules.reflex {
            None
        } else if !self.present().is_empty() {
            Some(Cause::Contact(self.present().to_vec()))
        } else {
            pulse.violated.map(|v| self.constraint(v))
        };
        let Some(cause) = cause else { return };
        let token = self.gate.close();
        out.push(ReflexOut::Event(Event::Disabled { robot: self.rules.robot.clone(), token, cause: cause.clone() }));
        out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
        out.push(ReflexOut::Closed { token, cause });
        let Some(motion) = motion else { return };
        let back = |safe| Then::Retreat(Back { id: motion.id, safe, again: false });
        let then = motion.safe.clone().map_or(Then::Say(Word::Stopped), back);
        // the stop takes effect from now on: a reading that was held up does not show it
        self.floors = Floors::new(self.rules.margin, &pulse.contacts);
        self.turn(Phase::Stopping { token, since: now, then }, now);
    }

    /// The next phase, and what it means for those who might go back with this robot.
    fn turn(&mut self, phase: Phase, now: Time) {
        match &phase {
            Phase::Stopping { then: Then::Retreat(_), .. } => self.convoy.coming(self.robot, now),
            Phase::Retreating { .. } | Phase::Settling { .. } => {}
            Phase::Watching | Phase::Stopping { then: Then::Say(_), .. } => self.convoy.leave(self.robot),
        }
        self.phase = phase;
    }

    fn constraint(&self, (part, clause): (usize, usize)) -> Cause {
        Cause::Constraint { part: self.rules.parts.get(part).cloned().unwrap_or_default(), clause }
    }

    /// The filter is closed by us or for us.
    fn act(&mut self, pulse: &Pulse, clock: Time, name: &dyn Fn(Pair) -> (String, String), out: &mut Vec<ReflexOut>) {
        let now = pulse.sample.at;
        let rules = self.rules.clone();
        let at_rest = pulse.speed < rules.rest_speed;
        match &mut self.phase {
            Phase::Watching => {}
            Phase::Stopping { token, since, then } => {
                let token = *token;
                self.floors.note(&pulse.contacts);
                if now >= *since + rules.reaction() && at_rest {
                    match then.clone() {
                        Then::Retreat(_) => self.ask(clock, out),
                        Then::Say(word) => self.say(token, word, clock, out),
                    }
                } else if now >= *since + PATIENCE {
                    let then = then.clone();
                    self.stop_again(token, then, (now, clock), out);
                } else if let Then::Retreat(_) = then {
                    self.convoy.coming(self.robot, clock);
                }
            }
            Phase::Retreating { token, retreat, back, floors, violated, mark } => {
                let token = *token;
                if mark.0 != pulse.unchanged {
                    *mark = (pulse.unchanged, retreat.written().clone(), now);
                }
                let frozen = now.since(mark.2) >= FROZEN && distance(retreat.written(), &mark.1) > FROZEN_WAY;
                let broken = floors.broken(&pulse.contacts).copied();
                let newly_violated = pulse.violated.is_some() && !*violated;
                if frozen {
                    self.give_up(
                        token,
                        Hold::Stale,
                        "the encoders do not follow the set-points".into(),
                        (now, clock),
                        out,
                    );
                } else if broken.is_some() || newly_violated {
                    let what = blocked(broken, name);
                    self.give_up(token, Hold::RetreatBlocked, what, (now, clock), out);
                } else {
                    match retreat.step(&self.convoy, &pulse.sample, clock, &rules) {
                        Ok(command) => out.extend(command.map(|c| ReflexOut::Command(token, c))),
                        Err(Parted) => {
                            let then = Then::Retreat(Back { again: true, ..back.clone() });
                            out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
                            self.convoy.leave(self.robot);
                            self.turn(Phase::Stopping { token, since: clock, then }, clock);
                            return;
                        }
                    }
                    if retreat.is_over() {
                        let (way, floors, violated) = (retreat.way().clone(), std::mem::take(floors), *violated);
                        let since = retreat.arrival(clock);
                        self.phase = Phase::Settling { token, since, way, floors, violated };
                        out.push(ReflexOut::Word(Word::Settling));
                    }
                }
            }
            Phase::Settling { token, since, way, floors, violated } => {
                let token = *token;
                let broken = floors.broken(&pulse.contacts).copied();
                if broken.is_some() || (pulse.violated.is_some() && !*violated) {
                    let what = blocked(broken, name);
                    self.give_up(token, Hold::RetreatBlocked, what, (now, clock), out);
                } else if now >= *since + rules.reaction()
                    && at_rest
                    && distance(&pulse.sample.q, &way.end.1) <= rules.tolerance
                {
                    if way.blocked {
                        let what = "another robot, which stands in the way, can't go back farther".into();
                        self.give_up(token, Hold::RetreatBlocked, what, (now, clock), out);
                        return;
                    }
                    for pair in self.contacts.settle() {
                        out.push(ReflexOut::Event(Event::ContactEnded {
                            robot: rules.robot.clone(),
                            names: name(pair),
                        }));
                    }
                    self.say(token, Word::Back, clock, out);
                } else if now >= *since + PATIENCE {
                    self.give_up(
                        token,
                        Hold::RetreatMissed,
                        "the safe pose was not reached in time".into(),
                        (now, clock),
                        out,
                    );
                }
            }
        }
    }

    /// The robot rests: ask for the way back, and begin it once it is known.
    fn ask(&mut self, now: Time, out: &mut Vec<ReflexOut>) {
        let Phase::Stopping { token, then: Then::Retreat(back), .. } = &self.phase else { return };
        let (token, mut back) = (*token, back.clone());
        let (robot, id) = (self.rules.robot.clone(), back.id);
        match self.convoy.ask(self.robot, now) {
            Answer::Wait => {}
            Answer::Bring => {
                out.push(ReflexOut::Bring(Asked { robot: self.robot, safe: back.safe, again: back.again }));
            }
            Answer::Go(way) => {
                if way.farther {
                    back.safe = way.end.clone();
                }
                let farther = way.farther.then(|| Word::Farther(way.end.clone()));
                let retreat = Retreat::new(self.robot, way, &self.rules, now);
                let (poses, secs) = retreat.length();
                let near = self.floors.touched();
                out.push(ReflexOut::Event(Event::RetreatBegan { robot, id, poses, secs, near }));
                out.push(ReflexOut::Command(token, retreat.begin()));
                out.push(ReflexOut::Word(Word::Retreating));
                out.extend(farther.map(ReflexOut::Word));
                let floors = self.floors.clone();
                let mark = (Time::ZERO, retreat.written().clone(), now);
                let violated = self.violated;
                self.phase = Phase::Retreating { token, retreat, back, floors, violated, mark };
            }
        }
    }

    fn give_up(&mut self, token: u64, reason: Hold, what: String, (seen, now): (Time, Time), out: &mut Vec<ReflexOut>) {
        out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
        out.push(ReflexOut::Event(Event::RetreatStopped { robot: self.rules.robot.clone(), reason, what, seen }));
        self.turn(Phase::Stopping { token, since: now, then: Then::Say(Word::GaveUp(reason)) }, now);
    }

    /// The robot does not come to rest, or its readings don't: stop it once more, and say nothing before it rests (I17). A
    /// path that it may have left long ago is not driven back.
    fn stop_again(&mut self, token: u64, then: Then, (seen, now): (Time, Time), out: &mut Vec<ReflexOut>) {
        if let Then::Say(_) = then {
            out.push(ReflexOut::Command(token, Command::Stop { motors: Vec::new() }));
            self.turn(Phase::Stopping { token, since: now, then }, now);
        } else {
            let what = "the robot did not come to rest in time".into();
            self.give_up(token, Hold::RetreatMissed, what, (seen, now), out);
        }
    }

    /// The robot rests: restore the control modes and tell.
    fn say(&mut self, token: u64, word: Word, now: Time, out: &mut Vec<ReflexOut>) {
        out.push(ReflexOut::Command(token, Command::Mode { motors: Vec::new(), mode: ControlMode::Position }));
        out.push(ReflexOut::Word(word));
        self.turn(Phase::Watching, now);
    }
}

fn blocked(contact: Option<Contact>, name: &dyn Fn(Pair) -> (String, String)) -> String {
    let Some(c) = contact else { return "a constraint would be violated".into() };
    let (a, b) = name(c.pair);
    format!("{a} and {b} are at {:.1} mm", c.distance * 1e3)
}

#[cfg(test)]
impl ReflexCore {
    /// Another one in the same state, at another gate.
    pub fn fork(&self, gate: Arc<Gate>, convoy: Arc<Convoy>) -> ReflexCore {
        ReflexCore { gate, convoy, ..self.clone() }
    }

    /// What its future depends on.
    pub fn state(&self) -> impl std::fmt::Debug + '_ {
        let seen = (&self.contacts, &self.near, &self.floors, self.violated);
        (&self.phase, &self.convoy, seen, &self.escape, self.motion, &self.met)
    }
}
