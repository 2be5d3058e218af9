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

mod back;
mod check;
mod commit;
mod credit;
mod displaced;
mod end;
mod forces;
mod hush;
mod stream;
mod streaming;

use crate::controller::Rules;
use crate::gate::Gate;
use crate::ledger::{Book, Ledger};
use crate::pulse::Pulse;
use crate::reflex::{Motion, Word};
use crate::stop::Stop;
use credit::Credits;
use mobee_contract::{
    Cause, Command, Commit, CommitId, Event, Hold, MotionEnd, Pose, Refusal, Setpoints, Status, Time, Verdict, Writer,
};
use std::collections::BTreeSet;
use std::sync::Arc;

/// What becomes of a motion that is under way.
#[derive(Debug)]
pub enum Revision {
    /// It goes to another target.
    Commit(Commit),
    /// Its stream goes on.
    Stream(Arc<str>, Setpoints),
}

/// What supervise hears.
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
    /// The reflex closed the filter; the motors that brought together what touched, if it is known.
    Closed(u64, Cause, Option<BTreeSet<usize>>),
    /// The reflex tells how the way back goes.
    Word(Word),
    /// Somebody asks to try the failed way back again.
    Recover,
    /// A part of the controller is to be exchanged: close at the next border, and say so by [`SuperviseOut::Yielded`].
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
        motion: Motion,
        /// Whether it is another try.
        again: bool,
    },
    /// Say that the filter is closed at a border.
    Yielded,
    /// Tell the agent that its motion has ended.
    Ended(Arc<str>, CommitId, MotionEnd),
    /// Tell the taps.
    Event(Event),
}

/// What supervise keeps of a reading.
#[derive(Clone, Debug)]
struct Reading {
    at: Time,
    q: Pose,
    /// The greatest speed of a motor, rad/s.
    speed: f64,
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

/// The state machine. Its transactions live in the ledger.
#[derive(Clone, Debug)]
pub struct SuperviseCore {
    rules: Arc<Rules>,
    gate: Arc<Gate>,
    ledger: Ledger,
    /// The token as far as supervise knows.
    token: u64,
    status: Status,
    closing: Closing,
    /// The last stop that was told.
    stop: Stop,
    /// The newest reading.
    newest: Option<Reading>,
    /// Where the motors rest that nobody commands.
    resting: displaced::Resting,
    /// Since when the board has said that the motion is done.
    done_since: Option<Time>,
    /// The safe pose of a way back that failed, for another try.
    retry: Option<Motion>,
    /// A commit's start: when it was accepted, how far it had to go (rad, the motor with the longest way), and how long it
    /// should take (s).
    course: Option<(Time, f64, f64)>,
    /// The stream of set-points that the open transaction is.
    stream: Option<streaming::Streaming>,
    /// Who streamed into something, and is not heard.
    hushed: Option<hush::Hush>,
    /// The motion under forces that the open transaction is; its set-points are the stream.
    forces: Option<forces::Forces>,
    /// The motors that are perhaps in another control mode than that of position moves.
    modes: BTreeSet<usize>,
    /// Whether to close at the next border.
    yields: bool,
    shutdown: bool,
    /// How much of a flood is heard.
    credits: Credits,
}

impl SuperviseCore {
    /// Starts closed: nothing moves until the readings are fresh, the robot rests, and the open transaction, if a
    /// predecessor left one, has its outcome (I10). Returns what is to be done first.
    pub fn new(rules: Arc<Rules>, gate: Arc<Gate>, ledger: Ledger, now: Time) -> (SuperviseCore, Vec<SuperviseOut>) {
        let token = gate.token();
        let named = ledger.book().open.as_ref().map(|o| o.named.clone());
        let open = named.is_some();
        let mut core = SuperviseCore {
            rules,
            gate,
            ledger,
            token,
            status: Status::Starting,
            closing: Closing::Settle(now),
            stop: Stop::told(now),
            newest: None,
            resting: displaced::Resting::default(),
            done_since: None,
            retry: None,
            course: None,
            stream: None,
            hushed: None,
            forces: None,
            modes: named.iter().flat_map(|named| named.iter().copied()).collect(),
            yields: false,
            shutdown: false,
            credits: Credits::full(now),
        };
        let mut out = Vec::new();
        if open || Gate::opens(token) {
            // a crash of the process is the cause already if that is what happened
            core.interrupt(Cause::ActorDied("supervise".into()), Status::Holding(Hold::Restarted), now, &mut out);
        } else {
            core.enter(Status::Starting, &mut out);
        }
        (core, out)
    }

    /// The filter's state.
    pub fn status(&self) -> Status {
        self.status
    }

    /// Whether the robot rests with every outcome given.
    pub fn is_settled(&self) -> bool {
        self.closing == Closing::No && matches!(self.status, Status::Rest | Status::Holding(_))
    }

    /// One step.
    pub fn on(&mut self, input: SuperviseIn, now: Time) -> Vec<SuperviseOut> {
        let mut out = Vec::new();
        self.note_death(now, &mut out);
        match input {
            SuperviseIn::Commit(commit) => self.motion_asked(Revision::Commit(commit), true, now, &mut out),
            SuperviseIn::Stream(agent, setpoints) => {
                self.motion_asked(Revision::Stream(agent, setpoints), true, now, &mut out);
            }
            SuperviseIn::Revise(id, revision) => {
                let open = self.with_book(|book| book.open.as_ref().is_some_and(|open| open.id == id));
                self.motion_asked(revision, open, now, &mut out);
            }
            SuperviseIn::Stop(agent) => {
                if self.is_moving() && self.owner().is_some_and(|a| a == agent) {
                    self.interrupt(Cause::Asked, Status::Stopping, now, &mut out);
                }
            }
            SuperviseIn::AgentDied(agent) => {
                if self.is_moving() && self.owner().is_some_and(|a| a == agent) {
                    self.roll_back(Cause::AgentDied, now, &mut out);
                }
            }
            SuperviseIn::Pulse(pulse) => self.pulse(pulse, now, &mut out),
            SuperviseIn::Tick => {
                self.sum_up(now, &mut out);
                let stale = self.newest.as_ref().is_none_or(|newest| now > newest.at + self.rules.fresh);
                let known = matches!(self.status, Status::Starting | Status::Holding(Hold::Stale));
                if stale && !known && !matches!(self.closing, Closing::Settle(_)) {
                    self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), now, &mut out);
                }
            }
            SuperviseIn::Fault(what) => {
                if self.status != Status::Holding(Hold::BoardFault) {
                    self.interrupt(Cause::BoardFault(what), Status::Holding(Hold::BoardFault), now, &mut out);
                }
            }
            SuperviseIn::Closed(token, cause, blamed) => self.closed(token, (cause, blamed), now, &mut out),
            SuperviseIn::Word(word) => self.word(word, now, &mut out),
            SuperviseIn::Recover => self.recover(now, &mut out),
            SuperviseIn::Yield => self.yields = true,
            SuperviseIn::Resume => {
                self.yields = false;
                if self.closing == Closing::Yielded {
                    self.closing = Closing::Settle(now);
                }
            }
            SuperviseIn::Shutdown => {
                self.shutdown = true;
                let closed = self.closing == Closing::Yielded;
                if closed || self.is_moving() || self.status == Status::Rest {
                    self.interrupt(Cause::Asked, Status::Holding(Hold::ShuttingDown), now, &mut out);
                }
            }
            SuperviseIn::Abandon => {
                self.shutdown = true;
                if self.closing != Closing::No || self.is_moving() {
                    self.interrupt(Cause::Asked, Status::Holding(Hold::ShuttingDown), now, &mut out);
                    self.end(None, &mut out);
                    self.closing = Closing::No;
                }
            }
        }
        if self.yields && self.is_at_border() {
            self.yields = false;
            self.close(Cause::Asked, &mut out);
            self.closing = Closing::Yielded;
            self.enter(Status::Starting, &mut out);
            out.push(SuperviseOut::Yielded);
        }
        out
    }

    /// Whether the robot rests with every outcome given, and nothing is left to be tried. One that no reading comes from any
    /// more was at rest when it was last seen.
    fn is_at_border(&self) -> bool {
        let lost = matches!(self.status, Status::Holding(Hold::Stale | Hold::BoardFault))
            && matches!(self.closing, Closing::Settle(_));
        let rests = self.newest.as_ref().is_some_and(|newest| newest.at_rest);
        let tells = self.token == self.gate.token() && !self.shutdown && self.retry.is_none();
        (self.is_settled() || lost) && rests && tells && self.with_book(|b| b.open.is_none())
    }

    fn is_moving(&self) -> bool {
        matches!(self.status, Status::Moving | Status::Escaping)
    }

    /// An agent asks for a motion, or for another one in the place of one that may be over.
    fn motion_asked(&mut self, asked: Revision, goes_on: bool, now: Time, out: &mut Vec<SuperviseOut>) {
        match asked {
            Revision::Commit(commit) => {
                let agent = commit.agent.clone();
                let verdict = if goes_on { self.commit(commit, now, out) } else { Err(Refusal::Over) };
                self.answer(&agent, verdict, now, out);
            }
            Revision::Stream(agent, setpoints) => {
                let verdict = if goes_on { self.stream(&agent, setpoints, now, out) } else { Err(Refusal::Over) };
                self.answer_setpoints(&agent, verdict, now, out);
            }
        }
    }

    fn owner(&self) -> Option<Arc<str>> {
        self.ledger.book().open.as_ref().map(|o| o.agent.clone())
    }

    fn enter(&mut self, status: Status, out: &mut Vec<SuperviseOut>) {
        self.ledger.book().status = status;
        if std::mem::replace(&mut self.status, status) != status || status == Status::Starting {
            out.push(SuperviseOut::Event(Event::State { robot: self.rules.robot.clone(), status }));
        }
    }

    /// Closes the filter and stops the robot.
    fn close(&mut self, cause: Cause, out: &mut Vec<SuperviseOut>) {
        (self.stream, self.forces) = (None, None);
        self.token = self.gate.close();
        let (robot, token) = (self.rules.robot.clone(), self.token);
        out.push(SuperviseOut::Event(Event::Disabled { robot, token, cause }));
        out.push(SuperviseOut::Command(token, Writer::Supervise, Command::Stop { motors: Vec::new() }));
    }

    /// Something ends the motion that is no matter for the reflex: close, stop, then measure.
    fn interrupt(&mut self, cause: Cause, status: Status, now: Time, out: &mut Vec<SuperviseOut>) {
        self.close(cause.clone(), out);
        self.give_cause(cause);
        self.closing = Closing::Settle(now + self.rules.reaction());
        self.stop = Stop::told(now);
        self.enter(status, out);
    }

    /// The cause that was there first stays.
    fn give_cause(&self, cause: Cause) {
        if let Some(open) = &mut self.ledger.book().open {
            open.cause.get_or_insert(cause);
        }
    }

    /// An actor of the controller died since we looked last: its successor knows nothing of the motion.
    fn note_death(&mut self, now: Time, out: &mut Vec<SuperviseOut>) {
        let died = self.ledger.book().died.take();
        let Some(actor) = died else { return };
        let status = if self.status == Status::Starting { Status::Starting } else { Status::Holding(Hold::Restarted) };
        self.interrupt(Cause::ActorDied(actor), status, now, out);
    }

    fn motion(&self) -> Option<Motion> {
        self.ledger.book().motion()
    }

    /// Locks the ledger for a moment.
    fn with_book<T>(&self, f: impl FnOnce(&mut Book) -> T) -> T {
        f(&mut self.ledger.book())
    }
}

#[cfg(test)]
mod tests;
