//! Supervise (Algorithm 5): the filtered interface that agents command, and the keeper of transactions.
//!
//! ```text
//!           Commit accepted                     motion done, at target
//!   Rest ---------------------> Moving ---------------------------------> Rest         Committed
//!    ^                            | contact, constraint, target missed, agent died
//!    |                            v
//!    |                         Stopping --> Retreating --> Settling --> Rest           RolledBack
//!    |                                        |
//!    +---- escape or `recover` ------- Holding(reason)                                 Faulted
//! ```
//!
//! Whatever else happens (stale encoders, a death, a stop): close, stop, wait for fresh readings at rest, and give the
//! open transaction the outcome that the measured pose shows. Then, if nothing touches the robot, open again: a robot
//! should not need a person to free it.
//!
//! The paper's Algorithm 5 passes a command on while the filter is open and notes the pose as safe. What is added here
//! is the transaction: each accepted commit ends exactly once (I2), by a measured pose and not by what was commanded,
//! whoever dies meanwhile.

mod back;
mod check;
mod commit;
mod credit;
mod displaced;
mod end;
mod forces;
mod halt;
mod hush;
mod stalled;
mod stream;
mod streaming;

use crate::effort::EffortWatch;
use crate::gate::Gate;
use crate::ledger::TransactionState;
use crate::ledger::Underway;
use crate::pulse::Pulse;
use crate::pushing::PushWatch;
use crate::reflex::ReflexReport;
use crate::shared::Shared;
use crate::stall::{Errands, StallWatch};
use crate::stop::Stop;
use crate::{Rules, distance};
use credit::Credits;
use mobee_contract::{
    Cause, Command, Commit, CommitId, Event, Hold, MotionEnd, Pose, Refusal, Setpoints, Status, Time, Verdict, Writer,
};
use std::collections::BTreeSet;
use std::sync::Arc;

/// What becomes of a motion that is under way. Apart from a commit: it must not begin a motion anew that is over by the
/// time it arrives.
#[derive(Debug)]
pub enum Revision {
    /// It goes to another target.
    Commit(Commit),
    /// Its stream goes on.
    Stream(Arc<str>, Setpoints),
}

/// What supervise hears. One enum for all of it, so that a run is a list of these with their times, which tests can
/// make up.
#[derive(Debug)]
pub enum SuperviseIn<'a> {
    /// An agent commits. Answered by [`SuperviseOut::Verdict`].
    Commit(Commit),
    /// An agent streams set-points. Answered by [`SuperviseOut::Verdict`].
    Stream(Arc<str>, Setpoints),
    /// An agent changes its motion, if that is still under way. Answered by [`SuperviseOut::Verdict`].
    Revise(CommitId, Revision),
    /// The agent wants its motion to brake.
    Stop(Arc<str>),
    /// The agent died.
    AgentDied(Arc<str>),
    /// A reading came through the whole chain.
    Pulse(&'a Pulse),
    /// Time passed.
    Tick,
    /// The board reports a fault.
    Fault(String),
    /// A motor is much faster than it was commanded.
    TooFast(String),
    /// The reflex closed the filter; the motors that brought together what touched, if it is known.
    Closed(u64, Cause, Option<BTreeSet<usize>>),
    /// The reflex tells how the retreat goes.
    ReflexReport(ReflexReport),
    /// Somebody asks to try the failed retreat again.
    Recover,
    /// A person stops the robot: it holds until `Release`, whatever happens meanwhile. The ledger has it already.
    Halt,
    /// A person lets a halted robot act again. The ledger has it already.
    Release,
    /// A part of the controller is to be exchanged: close at the next boundary, and say so by
    /// [`SuperviseOut::Yielded`].
    Yield,
    /// It is not exchanged after all: open again.
    Resume,
    /// The run ends: come to rest, and accept nothing more.
    Shutdown,
    /// The run ends without waiting: the open transaction gets its outcome by the newest reading, however old.
    Abandon,
}

/// What supervise wants done.
#[derive(Clone, Debug, PartialEq)]
pub enum SuperviseOut {
    /// Answer the commit.
    Verdict(Verdict),
    /// Tell the driver.
    Command(u64, Writer, Command),
    /// Let the driver move until then.
    Lease(Time),
    /// Ask the reflex to take the robot back; the filter is closed under this token.
    RollBack {
        /// The token.
        token: u64,
        /// What to roll back.
        motion: Underway,
        /// Whether it is another try.
        again: bool,
    },
    /// Say that the filter is closed at a boundary.
    Yielded,
    /// Tell the agent that its motion has ended.
    Ended(Arc<str>, CommitId, MotionEnd),
    /// Tell the taps.
    Event(Event),
}

/// What supervise keeps of a reading.
#[derive(Clone, Debug)]
struct Reading {
    /// When it was taken: what it is judged by, and what its lease is counted from. When it was heard is `Step::now`.
    sampled_at: Time,
    /// Where the motors were, rad.
    q: Pose,
    /// The greatest speed of a motor, rad/s.
    speed: f64,
    /// Whether that counts as rest, by the rules of when it was heard.
    at_rest: bool,
    /// Whether nothing is there that the reflex would act upon.
    free: bool,
}

/// How a closed filter comes to its end.
#[derive(Clone, Debug, PartialEq)]
enum Closing {
    /// Nothing is pending: open, or holding with the outcome given.
    No,
    /// When the readings are fresh and the robot rests, measure where it is; not before this time.
    Settle(Time),
    /// The reflex acts and will tell.
    Reflex,
    /// A part of the controller is being exchanged: nothing happens until it has been, or `Resume`.
    Yielded,
}

/// What supervise knows of the open transaction's motion beside the ledger. Dropped as a whole when the filter closes,
/// and begun anew with each transaction.
#[derive(Clone, Debug, Default)]
struct MotionState {
    /// The start of the board's own moves in it.
    started: Option<Started>,
    /// Its set-points.
    stream: Option<streaming::Streaming>,
    /// The forces that lead the set-points, if it is a motion under forces.
    forces: Option<forces::Forces>,
    /// Since when the board has said that it is done, away from its target.
    done_since: Option<Time>,
    /// When it was commanded to its target again, from which its board had left it, and how often.
    held: Option<(Time, u32)>,
    /// What its motors were told, by which it is seen whether they follow.
    told: Errands,
}

/// A commit as it was accepted, or last amended: what its readings should show by now.
#[derive(Clone, Copy, Debug)]
struct Started {
    /// When, by the clock: the command was written then.
    at: Time,
    /// Of the motor with the longest way, rad.
    distance_to_go: f64,
    /// How long it should take, s.
    expected: f64,
}

impl Started {
    /// Of the motor with the longest way, rad/s.
    fn mean_speed(self) -> f64 {
        // a commit to where the robot is takes no time at all
        self.distance_to_go / self.expected.max(1e-3)
    }
}

/// One step of supervise: it is built for each input and dropped with it, so that nothing is carried over by accident.
/// What it shares with the other actors of its robot, the time, and what it wants done.
struct Step<'a> {
    rules: &'a Rules,
    gate: &'a Gate,
    book: &'a mut TransactionState,
    now: Time,
    out: Vec<SuperviseOut>,
}

impl<'a> Step<'a> {
    /// At this time, with nothing to be done yet.
    fn new(shared: &'a mut Shared, now: Time) -> Step<'a> {
        Step { rules: shared.rules, gate: shared.gate, book: shared.book, now, out: Vec::new() }
    }

    /// Tells the taps: the journal, and whoever looks on.
    fn emit(&mut self, event: Event) {
        self.out.push(SuperviseOut::Event(event));
    }

    /// Tells the driver, under this token: as an agent's word, or supervise's own.
    fn command(&mut self, token: u64, writer: Writer, command: Command) {
        self.out.push(SuperviseOut::Command(token, writer, command));
    }

    /// The safe pose for a robot that rests at `q`: the last one if the robot counts as being there, so that many
    /// rollbacks to one vertex do not drift with the encoders' noise.
    fn safe_pose(&mut self, q: &Pose) -> Pose {
        let kept = self.book.safe.clone().filter(|safe| distance(safe, q) <= self.rules.tolerance);
        let safe = kept.unwrap_or_else(|| q.clone());
        self.book.safe = Some(safe.clone());
        safe
    }

    /// Who committed the open transaction.
    fn owner(&self) -> Option<Arc<str>> {
        self.book.open.as_ref().map(|open| open.agent.clone())
    }

    /// Why the open transaction fails. The cause that was there first stays: what comes later is often but its
    /// consequence, as a board's fault after a collision.
    fn give_cause(&mut self, cause: Cause) {
        if let Some(open) = &mut self.book.open {
            open.cause.get_or_insert(cause);
        }
    }

    fn robot(&self) -> String {
        self.rules.robot.clone()
    }
}

/// The state machine. Its transactions live in the ledger's book, which each step is handed.
#[derive(Clone, Debug)]
pub struct SuperviseCore {
    /// The token as far as supervise knows: another one at the gate means that the reflex, or the death of an actor,
    /// has closed it.
    token: u64,
    /// The filter's state, as the ledger shows it to others.
    status: Status,
    /// What is awaited before the filter may open.
    closing: Closing,
    /// The last stop that was told.
    stop: Stop,
    /// The newest reading.
    newest: Option<Reading>,
    /// Where the motors rest that nobody commands.
    resting: displaced::Resting,
    /// The safe pose of a retreat that failed, for another try.
    retry: Option<Underway>,
    /// How the open transaction is driven.
    motion: MotionState,
    /// Who streamed into something, and is not heard.
    hushed: Option<hush::Hush>,
    /// The motors that are perhaps in another control mode than that of position moves.
    modes: BTreeSet<usize>,
    /// The hold that a halted robot returns to when it is released, if that does not end by itself.
    held: Option<Hold>,
    /// Whether to close at the next boundary.
    yields: bool,
    /// Whether the run ends: nothing is accepted any more.
    shutdown: bool,
    /// How much of a flood is heard.
    credits: Credits,
    /// Whether the motors follow, if anybody looks.
    stall: Option<StallWatch>,
    /// Watches the external torques that the board reports.
    effort: EffortWatch,
    /// Reports with which force a simulated robot pushes.
    push: PushWatch,
}

impl SuperviseCore {
    /// Starts closed: nothing moves until the readings are fresh, the robot rests, and the open transaction, if a
    /// predecessor left one, has its outcome (I10). Returns what is to be done first.
    pub fn new(shared: &mut Shared, now: Time) -> (SuperviseCore, Vec<SuperviseOut>) {
        let step = &mut Step::new(shared, now);
        let token = step.gate.token();
        let named = step.book.open.as_ref().map(|o| o.named.clone());
        let open = named.is_some();
        let mut core = SuperviseCore {
            token,
            status: Status::Starting,
            closing: Closing::Settle(now),
            stop: Stop::told(now),
            newest: None,
            resting: displaced::Resting::default(),
            retry: None,
            motion: MotionState::default(),
            hushed: None,
            modes: named.iter().flat_map(|named| named.iter().copied()).collect(),
            held: None,
            yields: false,
            shutdown: false,
            credits: Credits::full(now),
            stall: StallWatch::new(step.rules),
            effort: EffortWatch::default(),
            push: PushWatch::default(),
        };
        if open || Gate::opens(token) {
            // a crash of the process is the cause already if that is what happened
            core.interrupt(Cause::ActorDied("supervise".into()), Status::Holding(Hold::Restarted), step);
        } else {
            core.enter(Status::Starting, step);
        }
        halt::tell_at_start(step);
        (core, std::mem::take(&mut step.out))
    }

    /// The filter's state.
    pub fn status(&self) -> Status {
        self.status
    }

    /// Whether the robot rests with every outcome given.
    pub fn is_settled(&self) -> bool {
        self.closing == Closing::No && matches!(self.status, Status::Rest | Status::Holding(_))
    }

    /// One step: what is to be done about this input at the time `now`, in the order in which it is to be done; a
    /// verdict comes first.
    pub fn on(&mut self, input: SuperviseIn, now: Time, shared: &mut Shared) -> Vec<SuperviseOut> {
        let step = &mut Step::new(shared, now);
        // before anything is decided: a commit that comes after a death is judged with the filter closed
        self.note_death(step);
        self.note_agent_death(step);
        match input {
            SuperviseIn::Commit(commit) => self.motion_asked(Revision::Commit(commit), true, step),
            SuperviseIn::Stream(agent, setpoints) => {
                self.motion_asked(Revision::Stream(agent, setpoints), true, step);
            }
            SuperviseIn::Revise(id, revision) => {
                let open = step.book.open.as_ref().is_some_and(|open| open.id == id);
                self.motion_asked(revision, open, step);
            }
            SuperviseIn::Stop(agent) => {
                let own = step.owner().is_some_and(|a| a == agent);
                if own && self.is_moving() {
                    self.interrupt(Cause::Asked, Status::Stopping, step);
                } else if own {
                    // something else closed the filter first: the journal shows that the agent gave its motion up (I23)
                    self.tell_refusal(&agent, &Err(Refusal::Closed), step);
                }
            }
            SuperviseIn::AgentDied(agent) => {
                step.book.note_agent_death(&agent);
                self.note_agent_death(step);
            }
            SuperviseIn::Pulse(pulse) => self.pulse(pulse, step),
            SuperviseIn::Tick => {
                self.sum_up(step);
                // only a tick can notice this: what stays away does not step anybody
                let stale = self.newest.as_ref().is_none_or(|newest| now > newest.sampled_at + step.rules.fresh);
                let known = matches!(self.status, Status::Starting | Status::Holding(Hold::Stale));
                if stale && !known && !matches!(self.closing, Closing::Settle(_)) {
                    self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), step);
                }
            }
            SuperviseIn::Fault(what) => {
                // a board that is faulty says so at each question: once is enough
                if self.status != Status::Holding(Hold::BoardFault) {
                    self.interrupt(Cause::BoardFault(what), Status::Holding(Hold::BoardFault), step);
                }
            }
            SuperviseIn::TooFast(what) => {
                // what something pushes is fast, too: in a motion it is taken back, and what drives a robot at rest is no contact
                if self.is_moving() && self.token == step.gate.token() {
                    self.roll_back(Cause::BoardFault(what), step);
                } else if self.status != Status::Holding(Hold::BoardFault) && self.closing != Closing::Reflex {
                    self.interrupt(Cause::BoardFault(what), Status::Holding(Hold::BoardFault), step);
                }
            }
            SuperviseIn::Closed(token, cause, blamed) => self.closed(token, (cause, blamed), step),
            SuperviseIn::ReflexReport(word) => self.word(word, step),
            SuperviseIn::Recover => self.recover(step),
            SuperviseIn::Halt => self.halt(step),
            SuperviseIn::Release => self.release(step),
            SuperviseIn::Yield => self.yields = true,
            SuperviseIn::Resume => {
                self.yields = false;
                // not open at once: the part that was tried may have moved something
                if self.closing == Closing::Yielded {
                    self.closing = Closing::Settle(now);
                }
            }
            SuperviseIn::Shutdown => {
                self.shutdown = true;
                let closed = self.closing == Closing::Yielded;
                if closed || self.is_moving() || self.status == Status::Rest {
                    self.interrupt(Cause::Asked, Status::Holding(Hold::ShuttingDown), step);
                }
            }
            SuperviseIn::Abandon => {
                self.shutdown = true;
                if self.closing != Closing::No || self.is_moving() {
                    self.interrupt(Cause::Asked, Status::Holding(Hold::ShuttingDown), step);
                    // nobody waits for rest any more: the outcome is what the newest reading shows
                    self.end(None, step);
                    self.closing = Closing::No;
                }
            }
        }
        if self.yields && self.is_at_boundary(step) {
            self.yields = false;
            self.close(Cause::Asked, step);
            self.closing = Closing::Yielded;
            self.enter(Status::Starting, step);
            step.out.push(SuperviseOut::Yielded);
        }
        self.note_told(step);
        std::mem::take(&mut step.out)
    }

    /// Whether the robot rests with every outcome given, and nothing is left to be tried. One that no reading comes
    /// from any more was at rest when it was last seen.
    fn is_at_boundary(&self, step: &Step) -> bool {
        let lost = matches!(self.status, Status::Holding(Hold::Stale | Hold::BoardFault))
            && matches!(self.closing, Closing::Settle(_));
        let rests = self.newest.as_ref().is_some_and(|newest| newest.at_rest);
        let tells = self.token == step.gate.token() && !self.shutdown && self.retry.is_none();
        (self.is_settled() || lost) && rests && tells && step.book.open.is_none()
    }

    /// Whether an agent's motion is under way, with the filter open as far as supervise knows.
    fn is_moving(&self) -> bool {
        matches!(self.status, Status::Moving | Status::Escaping)
    }

    /// An agent asks for a motion, or for another one in the place of one that may be over.
    fn motion_asked(&mut self, asked: Revision, goes_on: bool, step: &mut Step) {
        match asked {
            Revision::Commit(commit) => {
                let agent = commit.agent.clone();
                let verdict = if goes_on { self.commit(commit, step) } else { Err(Refusal::Over) };
                self.answer(&agent, verdict, step);
            }
            Revision::Stream(agent, setpoints) => {
                let verdict = if goes_on { self.stream(&agent, setpoints, step) } else { Err(Refusal::Over) };
                self.answer_setpoints(&agent, verdict, step);
            }
        }
    }

    /// The filter's next state, told once; that it starts is told each time, since each is another start.
    fn enter(&mut self, status: Status, step: &mut Step) {
        step.book.status = status;
        if std::mem::replace(&mut self.status, status) != status || status == Status::Starting {
            step.emit(Event::State { robot: step.robot(), status });
        }
    }

    /// Closes the filter and stops the robot: all motors, whatever mode they are in. In this order: what an agent wrote
    /// before the stop can't pass after it (I1).
    fn close(&mut self, cause: Cause, step: &mut Step) {
        self.note_stop(step);
        self.motion = MotionState::default();
        self.token = step.gate.close();
        let (robot, token) = (step.robot(), self.token);
        step.emit(Event::Disabled { robot, token, cause });
        step.command(token, Writer::Supervise, Command::Stop { motors: Vec::new() });
    }

    /// Something ends the motion that is no matter for the reflex: close, stop, then measure. A reading shows the
    /// stop's effect no earlier than a reaction later; before, a robot that is about to move on may look at rest.
    fn interrupt(&mut self, cause: Cause, status: Status, step: &mut Step) {
        self.close(cause.clone(), step);
        step.give_cause(cause);
        self.closing = Closing::Settle(step.now + step.rules.reaction());
        self.stop = Stop::told(step.now);
        self.enter(status, step);
    }

    /// An actor of the controller died since we looked last: its successor knows nothing of the motion.
    fn note_death(&mut self, step: &mut Step) {
        let died = step.book.died.take();
        let Some(actor) = died else { return };
        // a robot that never began to be supervised starts, it is not restarted
        let status = if self.status == Status::Starting { Status::Starting } else { Status::Holding(Hold::Restarted) };
        self.interrupt(Cause::ActorDied(actor), status, step);
    }
}

#[cfg(test)]
mod tests;
