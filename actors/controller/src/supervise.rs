//! Supervise (Algorithm 5): the filtered interface for the commands of agents, and the owner of transactions.
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
//! For any other event (stale encoders, a death, a stop): close, stop, wait for fresh readings at rest, and give the
//! open transaction the outcome that the measured configuration shows. Then, if nothing touches the robot, open
//! again: a robot should not need a person to free it.
//!
//! The paper's Algorithm 5 passes a command on while the filter is open and records the pose as safe. The transaction
//! is added here: each accepted commit ends exactly once (I2), by a measured configuration and not by the commanded
//! one, whatever dies in the meantime.

mod check;
mod commit;
mod cooldown;
mod credit;
mod displaced;
mod end;
mod forces;
mod halt;
mod rollback;
mod stalled;
mod stream;
mod streaming;

use crate::Rules;
use crate::effort::EffortWatch;
use crate::gate::Gate;
use crate::ledger::TransactionState;
use crate::ledger::Underway;
use crate::pulse::Pulse;
use crate::pushing::PushWatch;
use crate::reflex::ReflexReport;
use crate::shared::Shared;
use crate::stall::{StallWatch, TrackedCommands};
use crate::stop::Stop;
use credit::Credits;
use mobee_contract::{
    Cause, Command, Commit, CommitId, Event, Hold, MotionEnd, Pose, Refusal, Setpoints, Status, Time, Verdict, Writer,
    distance,
};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Change of a motion in progress. It differs from a commit: it must not begin a motion again that has ended by the
/// time it arrives.
#[derive(Debug)]
pub enum Revision {
    /// Changes the target.
    Commit(Commit),
    /// Continues the stream.
    Stream(Arc<str>, Setpoints),
}

/// Input of Supervise. A single enum, so that a run is a list of inputs with their times, which tests can generate.
#[derive(Debug)]
pub enum SuperviseIn<'a> {
    /// An agent commits. Answered by [`SuperviseOut::Verdict`].
    Commit(Commit),
    /// An agent streams set-points. Answered by [`SuperviseOut::Verdict`].
    Stream(Arc<str>, Setpoints),
    /// An agent changes its motion, if that is still in progress. Answered by [`SuperviseOut::Verdict`].
    Revise(CommitId, Revision),
    /// The agent requests its motion to brake.
    Stop(Arc<str>),
    /// The agent died.
    AgentDied(Arc<str>),
    /// A reading has passed the whole chain.
    Pulse(&'a Pulse),
    /// Time passed.
    Tick,
    /// The board reports a fault.
    Fault(String),
    /// A motor is much faster than it was commanded.
    TooFast(String),
    /// The reflex closed the filter; the last value: the motors that caused the contact, if they are known.
    Closed(u64, Cause, Option<BTreeSet<usize>>),
    /// Progress of the retreat.
    ReflexReport(ReflexReport),
    /// A person requests a retry of the failed retreat.
    Recover,
    /// A person stops the robot: it holds until `Release`, whatever happens in between. The ledger has recorded it
    /// already.
    Halt,
    /// A person releases a halted robot. The ledger has recorded it already.
    Release,
    /// A part of the controller is to be swapped: close at the next boundary, and report it by
    /// [`SuperviseOut::Yielded`].
    Yield,
    /// The swap was cancelled: open again.
    Resume,
    /// The run ends: come to rest, and accept nothing more.
    Shutdown,
    /// The run ends without waiting: the open transaction gets its outcome by the newest reading, however old.
    Abandon,
}

/// Action requested by Supervise.
#[derive(Clone, Debug, PartialEq)]
pub enum SuperviseOut {
    /// Answer the commit.
    Verdict(Verdict),
    /// Send this command to the driver.
    Command(u64, Writer, Command),
    /// Allow the driver to move until then.
    Lease(Time),
    /// Request a retreat from the reflex; the filter is closed under this token.
    RollBack {
        /// Token of the closing.
        token: u64,
        /// Motion to roll back.
        motion: Underway,
        /// True if this is a retry.
        again: bool,
    },
    /// Report that the filter is closed at a boundary.
    Yielded,
    /// Notify the agent that its motion has ended.
    Ended(Arc<str>, CommitId, MotionEnd),
    /// Publish this event.
    Event(Event),
}

/// Stored part of a reading.
#[derive(Clone, Debug)]
struct StoredReading {
    /// Time of the reading: it dates the contents, and the lease is counted from it. The time of its arrival is
    /// `SuperviseStep::now`.
    sampled_at: Time,
    /// Positions of the motors, rad.
    q: Pose,
    /// Greatest speed of a motor, rad/s.
    speed: f64,
    /// True if that counts as rest, by the rules at the time of arrival.
    at_rest: bool,
    /// True if there is nothing that the reflex would act upon.
    free: bool,
}

/// Pending end of a closing.
#[derive(Clone, Debug, PartialEq)]
enum Closing {
    /// Nothing is pending: the filter is open, or the robot holds with the outcome given.
    No,
    /// Measure the configuration once the readings are fresh and the robot rests; not before this time.
    Settle(Time),
    /// The reflex is acting and will report.
    Reflex,
    /// A part of the controller is being swapped: nothing happens until that is done, or `Resume`.
    Yielded,
}

/// State of the open transaction's motion, in addition to the ledger. Dropped as a whole when the filter closes, and
/// created with each transaction.
#[derive(Clone, Debug, Default)]
struct MotionState {
    /// Start of the board's own moves.
    started: Option<ExpectedProgress>,
    /// Stream of set-points.
    stream: Option<streaming::OpenStream>,
    /// Forces that generate the set-points of a motion under forces.
    forces: Option<forces::Forces>,
    /// Time since which the board has reported "done" away from the target.
    done_since: Option<Time>,
    /// Time and number of repeated commands to the target, after the board had left it.
    held: Option<(Time, u32)>,
    /// Commands that the motors track, for the detection of stalls.
    tracked: TrackedCommands,
}

/// Expected progress of a commit since it was accepted or last amended.
#[derive(Clone, Copy, Debug)]
struct ExpectedProgress {
    /// Time of the command, by the clock.
    at: Time,
    /// Distance of the motor with the longest way, rad.
    distance_to_go: f64,
    /// Expected duration, s.
    expected: f64,
}

impl ExpectedProgress {
    /// Mean speed of the motor with the longest way, rad/s.
    fn mean_speed(self) -> f64 {
        // A commit to the present configuration takes no time at all.
        self.distance_to_go / self.expected.max(1e-3)
    }
}

/// One step of Supervise. It is created for each input and dropped with it, so that nothing is carried over by
/// accident. It holds the values shared with the robot's other actors, the time, and the requested actions.
struct SuperviseStep<'a> {
    rules: &'a Rules,
    gate: &'a Gate,
    book: &'a mut TransactionState,
    now: Time,
    out: Vec<SuperviseOut>,
}

impl<'a> SuperviseStep<'a> {
    /// Begins a step at this time, without actions.
    fn new(shared: &'a mut Shared, now: Time) -> SuperviseStep<'a> {
        SuperviseStep { rules: shared.rules, gate: shared.gate, book: shared.book, now, out: Vec::new() }
    }

    /// Publishes an event.
    fn emit(&mut self, event: Event) {
        self.out.push(SuperviseOut::Event(event));
    }

    /// Sends a command to the driver under this token, with an agent or Supervise as the writer.
    fn command(&mut self, token: u64, writer: Writer, command: Command) {
        self.out.push(SuperviseOut::Command(token, writer, command));
    }

    /// Safe pose of a robot that rests at `q`: the last one if the robot is close to it, so that many rollbacks to
    /// one vertex do not drift with encoder noise.
    fn safe_pose(&mut self, q: &Pose) -> Pose {
        let retained = self.book.safe.clone().filter(|safe| distance(safe, q) <= self.rules.tolerance);
        let safe = retained.unwrap_or_else(|| q.clone());
        self.book.safe = Some(safe.clone());
        safe
    }

    /// Agent that committed the open transaction.
    fn owner(&self) -> Option<Arc<str>> {
        self.book.open.as_ref().map(|open| open.agent.clone())
    }

    /// Sets the cause for the failure of the open transaction. The first cause stays: later ones are often its
    /// consequences, such as a board's fault after a collision.
    fn give_cause(&mut self, cause: Cause) {
        if let Some(open) = &mut self.book.open {
            open.cause.get_or_insert(cause);
        }
    }

    fn robot(&self) -> String {
        self.rules.robot.clone()
    }
}

/// State machine of Supervise. Its transactions are in the ledger, which is passed to each step.
#[derive(Clone, Debug)]
pub struct SuperviseCore {
    /// Last token that Supervise has seen: if the gate has another one, the reflex, or the death of an actor, has
    /// closed it.
    token: u64,
    /// State of the filter, as the ledger shows it to other components.
    status: Status,
    /// Condition that is awaited before the filter may open.
    closing: Closing,
    /// Last stop sent.
    stop: Stop,
    /// Newest reading.
    newest: Option<StoredReading>,
    /// Resting positions of motors that are not commanded.
    resting: displaced::Resting,
    /// Failed retreat, for a retry.
    retry: Option<Underway>,
    /// State of the open transaction's motion.
    motion: MotionState,
    /// Agent whose stream caused a contact, and is rejected for now.
    cooldown: Option<cooldown::StreamCooldown>,
    /// Motors that may be in another control mode than that of position moves.
    modes: BTreeSet<usize>,
    /// Hold that a halted robot returns to after its release, if that hold does not end by itself.
    held: Option<Hold>,
    /// True if to close at the next boundary.
    yields: bool,
    /// True if the run ends: nothing is accepted any more.
    shutdown: bool,
    /// Credit of commits and journaled refusals.
    credits: Credits,
    /// Stall detection, if it is enabled.
    stall: Option<StallWatch>,
    /// Monitor of the external torques that the board reports.
    effort: EffortWatch,
    /// Reports the force with which a simulated robot pushes.
    push: PushWatch,
}

impl SuperviseCore {
    /// Starts closed: nothing moves until the readings are fresh, the robot rests, and the open transaction that a
    /// predecessor may have left has its outcome (I10). Returns the first actions.
    pub fn new(shared: &mut Shared, now: Time) -> (SuperviseCore, Vec<SuperviseOut>) {
        let step = &mut SuperviseStep::new(shared, now);
        let token = step.gate.token();
        let named = step.book.open.as_ref().map(|o| o.named.clone());
        let open = named.is_some();
        let mut core = SuperviseCore {
            token,
            status: Status::Starting,
            closing: Closing::Settle(now),
            stop: Stop::sent(now),
            newest: None,
            resting: displaced::Resting::default(),
            retry: None,
            motion: MotionState::default(),
            cooldown: None,
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
            // A crash of the process has been recorded as the cause already, if there was one.
            core.interrupt(Cause::ActorDied("supervise".into()), Status::Holding(Hold::Restarted), step);
        } else {
            core.enter(Status::Starting, step);
        }
        halt::journal_at_start(step);
        (core, std::mem::take(&mut step.out))
    }

    /// State of the filter.
    pub fn status(&self) -> Status {
        self.status
    }

    /// Returns whether the robot rests with every outcome given.
    pub fn is_settled(&self) -> bool {
        self.closing == Closing::No && matches!(self.status, Status::Rest | Status::Holding(_))
    }

    /// Performs one step at the time `now`. Returns the requested actions in the order in which they must be
    /// performed; a verdict comes first.
    pub fn on(&mut self, input: SuperviseIn, now: Time, shared: &mut Shared) -> Vec<SuperviseOut> {
        let step = &mut SuperviseStep::new(shared, now);
        // First of all: a commit that arrives after a death is decided with the filter closed.
        self.note_death(step);
        self.note_agent_death(step);
        match input {
            SuperviseIn::Commit(commit) => self.handle_request(Revision::Commit(commit), true, step),
            SuperviseIn::Stream(agent, setpoints) => {
                self.handle_request(Revision::Stream(agent, setpoints), true, step);
            }
            SuperviseIn::Revise(id, revision) => {
                let open = step.book.open.as_ref().is_some_and(|open| open.id == id);
                self.handle_request(revision, open, step);
            }
            SuperviseIn::Stop(agent) => self.stop_motion(&agent, step),
            SuperviseIn::AgentDied(agent) => {
                step.book.note_agent_death(&agent);
                self.note_agent_death(step);
            }
            SuperviseIn::Pulse(pulse) => self.pulse(pulse, step),
            SuperviseIn::Tick => {
                self.summarize_refusals(step);
                self.check_readings(step);
            }
            SuperviseIn::Fault(what) => {
                // A faulty board reports its fault at each query: once is enough.
                if self.status != Status::Holding(Hold::BoardFault) {
                    self.interrupt(Cause::BoardFault(what), Status::Holding(Hold::BoardFault), step);
                }
            }
            SuperviseIn::TooFast(what) => self.handle_excess_speed(what, step),
            SuperviseIn::Closed(token, cause, blamed) => self.closed(token, (cause, blamed), step),
            SuperviseIn::ReflexReport(report) => self.on_report(report, step),
            SuperviseIn::Recover => self.recover(step),
            SuperviseIn::Halt => self.halt(step),
            SuperviseIn::Release => self.release(step),
            SuperviseIn::Yield => self.yields = true,
            SuperviseIn::Resume => {
                self.yields = false;
                // Not open at once: the part under trial may have moved something.
                if self.closing == Closing::Yielded {
                    self.closing = Closing::Settle(now);
                }
            }
            SuperviseIn::Shutdown => self.shut_down(step),
            SuperviseIn::Abandon => self.abandon(step),
        }
        if self.yields && self.is_at_boundary(step) {
            self.yields = false;
            self.close(Cause::Asked, step);
            self.closing = Closing::Yielded;
            self.enter(Status::Starting, step);
            step.out.push(SuperviseOut::Yielded);
        }
        self.track_commands(step);
        std::mem::take(&mut step.out)
    }

    /// Stops the motion of this agent on its request.
    fn stop_motion(&mut self, agent: &str, step: &mut SuperviseStep) {
        let own = step.owner().is_some_and(|a| *a == *agent);
        if own && self.is_moving() {
            self.interrupt(Cause::Asked, Status::Stopping, step);
        } else if own {
            // The filter was closed for another reason first: the journal shows that the agent aborted its motion
            // (I23).
            self.report_refusal(agent, &Err(Refusal::Closed), step);
        }
    }

    /// Interrupts a motion without fresh readings. Only a tick can detect this: missing readings cause no step.
    fn check_readings(&mut self, step: &mut SuperviseStep) {
        let stale = self.newest.as_ref().is_none_or(|newest| step.now > newest.sampled_at + step.rules.fresh);
        let known = matches!(self.status, Status::Starting | Status::Holding(Hold::Stale));
        if stale && !known && !matches!(self.closing, Closing::Settle(_)) {
            self.interrupt(Cause::Stale, Status::Holding(Hold::Stale), step);
        }
    }

    /// Handles a motor that is faster than commanded. A motor pushed by an obstacle is fast as well: in a motion it is
    /// rolled back; a robot driven at rest is no contact.
    fn handle_excess_speed(&mut self, what: String, step: &mut SuperviseStep) {
        if self.is_moving() && self.token == step.gate.token() {
            self.roll_back(Cause::BoardFault(what), step);
        } else if self.status != Status::Holding(Hold::BoardFault) && self.closing != Closing::Reflex {
            self.interrupt(Cause::BoardFault(what), Status::Holding(Hold::BoardFault), step);
        }
    }

    /// Ends the robot's motions in order: it comes to rest, and remains there.
    fn shut_down(&mut self, step: &mut SuperviseStep) {
        self.shutdown = true;
        let closed = self.closing == Closing::Yielded;
        if closed || self.is_moving() || self.status == Status::Rest {
            self.interrupt(Cause::Asked, Status::Holding(Hold::ShuttingDown), step);
        }
    }

    /// Ends the robot's motions without waiting for rest: the outcome is that shown by the newest reading.
    fn abandon(&mut self, step: &mut SuperviseStep) {
        self.shutdown = true;
        if self.closing != Closing::No || self.is_moving() {
            self.interrupt(Cause::Asked, Status::Holding(Hold::ShuttingDown), step);
            self.end(None, step);
            self.closing = Closing::No;
        }
    }

    /// Returns whether the robot rests with every outcome given, and no retry is pending. A robot without further
    /// readings was at rest in the last one.
    fn is_at_boundary(&self, step: &SuperviseStep) -> bool {
        let lost = matches!(self.status, Status::Holding(Hold::Stale | Hold::BoardFault))
            && matches!(self.closing, Closing::Settle(_));
        let rests = self.newest.as_ref().is_some_and(|newest| newest.at_rest);
        let is_current = self.token == step.gate.token() && !self.shutdown && self.retry.is_none();
        (self.is_settled() || lost) && rests && is_current && step.book.open.is_none()
    }

    /// Returns whether an agent's motion is in progress, with the filter open by the last known token.
    fn is_moving(&self) -> bool {
        matches!(self.status, Status::Moving | Status::Escaping)
    }

    /// Handles an agent's request for a motion, or for a change of one that may have ended.
    fn handle_request(&mut self, request: Revision, is_open: bool, step: &mut SuperviseStep) {
        match request {
            Revision::Commit(commit) => {
                let agent = commit.agent.clone();
                let verdict = if is_open { self.commit(commit, step) } else { Err(Refusal::Over) };
                self.answer(&agent, verdict, step);
            }
            Revision::Stream(agent, setpoints) => {
                let verdict = if is_open { self.stream(&agent, setpoints, step) } else { Err(Refusal::Over) };
                self.answer_setpoints(&agent, verdict, step);
            }
        }
    }

    /// Enters a state of the filter and journals the change; `Starting` is journaled each time, since each is another
    /// start.
    fn enter(&mut self, status: Status, step: &mut SuperviseStep) {
        step.book.status = status;
        if std::mem::replace(&mut self.status, status) != status || status == Status::Starting {
            step.emit(Event::State { robot: step.robot(), status });
        }
    }

    /// Closes the filter, then stops all motors, in any mode. The order matters: commands that agents wrote before
    /// the stop must not pass after it (I1).
    fn close(&mut self, cause: Cause, step: &mut SuperviseStep) {
        self.note_stop(step);
        self.motion = MotionState::default();
        self.token = step.gate.close();
        let robot = step.robot();
        let token = self.token;
        step.emit(Event::Disabled { robot, token, cause });
        step.command(token, Writer::Supervise, Command::Stop { motors: Vec::new() });
    }

    /// Ends the motion for a reason that needs no retreat: close, stop, then measure. A reading shows the effect of
    /// the stop a reaction time later at the earliest; before, a robot that is about to move on may look at rest.
    fn interrupt(&mut self, cause: Cause, status: Status, step: &mut SuperviseStep) {
        self.close(cause.clone(), step);
        step.give_cause(cause);
        self.closing = Closing::Settle(step.now + step.rules.reaction());
        self.stop = Stop::sent(step.now);
        self.enter(status, step);
    }

    /// Handles the death of an actor of the controller since the last step: its successor has no state of the motion.
    fn note_death(&mut self, step: &mut SuperviseStep) {
        let died = step.book.died.take();
        let Some(actor) = died else { return };
        // A robot that was never supervised is started, not restarted.
        let status = if self.status == Status::Starting { Status::Starting } else { Status::Holding(Hold::Restarted) };
        self.interrupt(Cause::ActorDied(actor), status, step);
    }
}

#[cfg(test)]
mod tests;
