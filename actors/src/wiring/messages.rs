//! What the actors are told: the messages of their mailboxes.

use super::SwapRequest;
use mobee_contract::{Cause, Command, Commit, CommitId, MotionEnd, Setpoints, Verdict, Writer};
use mobee_controller::ledger::Underway;
use mobee_controller::reflex::ReflexReport;
use mobee_controller::supervise::Revision;
use mobee_model::Edit;
use ractor::RpcReplyPort;
use std::sync::Arc;

/// What a driver hears.
#[derive(Debug)]
pub enum DriverMsg {
    /// It is time to read the encoders.
    Poll,
    /// A command under a token.
    Command(u64, Writer, Command),
}

/// What a reflex hears.
#[derive(Debug)]
pub enum ReflexMsg {
    /// There are pulses.
    Pulses,
    /// Supervise closed the filter: take the robot back.
    RollBack(u64, Underway, bool),
}

/// What a supervise hears.
#[derive(Debug)]
pub enum SuperviseMsg {
    /// There are pulses.
    Pulses,
    /// An agent commits.
    Commit(Commit, RpcReplyPort<Verdict>),
    /// An agent streams set-points.
    Stream(Arc<str>, Setpoints, RpcReplyPort<Verdict>),
    /// An agent changes its motion, if that is still under way.
    Revise(CommitId, Revision, RpcReplyPort<Verdict>),
    /// The agent wants its motion to brake.
    Stop(Arc<str>),
    /// The agent died.
    AgentDied(Arc<str>),
    /// See whether the readings are fresh.
    Tick,
    /// The board reports a fault.
    Fault(String),
    /// A motor is much faster than it was commanded.
    TooFast(String),
    /// The reflex closed the filter.
    Closed(u64, Cause),
    /// The reflex tells how the retreat goes.
    ReflexReport(ReflexReport),
    /// Try the failed retreat again.
    Recover,
    /// Hold until released.
    Halt,
    /// Act again.
    Release,
    /// Close at the next boundary, answer, and wait to be exchanged.
    Yield(RpcReplyPort<()>),
    /// Open again: nothing is exchanged.
    Resume,
    /// Come to rest, and accept nothing more.
    Shutdown,
    /// End without waiting.
    Abandon(RpcReplyPort<()>),
}

/// What an agent's actor hears.
#[derive(Debug)]
pub enum AgentMsg {
    /// Ask the planner, if this is the newest of such messages.
    Ask(u64),
    /// Its motion has ended.
    Ended(CommitId, MotionEnd),
    /// The world has changed.
    Revise,
    /// It is time for the next set-point of the motion that is a stream.
    SetPoint(CommitId),
    /// Make no more motions: the run ends.
    Rest,
    /// Another planner is to take over.
    Swap(SwapRequest, RpcReplyPort<Result<(), String>>),
    /// See how far the swap is.
    Tick,
}

/// What the model hears.
#[derive(Debug)]
pub enum ModelMsg {
    /// There are pulses.
    Pulses,
    /// Change the world. The answer says why not, if not.
    Edit(Edit, Option<RpcReplyPort<Result<(), String>>>),
    /// A sensor has seen an object's middle here, meters in the world.
    Seen(String, [f64; 3]),
    /// A robot has other rules now.
    Margins,
}
