//! Messages to the actors.

use super::SwapRequest;
use mobee_contract::{Cause, Command, Commit, CommitId, MotionEnd, Setpoints, Verdict, Writer};
use mobee_controller::ledger::Underway;
use mobee_controller::reflex::ReflexReport;
use mobee_controller::supervise::Revision;
use mobee_model::Edit;
use ractor::RpcReplyPort;
use std::sync::Arc;

/// Message to a driver.
#[derive(Debug)]
pub enum DriverMsg {
    /// The encoders must be read.
    Poll,
    /// A command under a token.
    Command(u64, Writer, Command),
}

/// Message to a reflex.
#[derive(Debug)]
pub enum ReflexMsg {
    /// Pulses are queued.
    Pulses,
    /// Roll the motion back: supervise has closed the filter.
    RollBack(u64, Underway, bool),
}

/// Message to a supervise.
#[derive(Debug)]
pub enum SuperviseMsg {
    /// Pulses are queued.
    Pulses,
    /// An agent commits.
    Commit(Commit, RpcReplyPort<Verdict>),
    /// An agent streams set-points.
    Stream(Arc<str>, Setpoints, RpcReplyPort<Verdict>),
    /// An agent changes its motion, if that is still open.
    Revise(CommitId, Revision, RpcReplyPort<Verdict>),
    /// The agent requests that its motion brakes.
    Stop(Arc<str>),
    /// The agent died.
    AgentDied(Arc<str>),
    /// Check that the readings are fresh.
    Tick,
    /// The board reports a fault.
    Fault(String),
    /// A motor is much faster than it was commanded.
    TooFast(String),
    /// The reflex closed the filter.
    Closed(u64, Cause),
    /// The reflex reports the progress of the retreat.
    ReflexReport(ReflexReport),
    /// Try the failed retreat again.
    Recover,
    /// Hold until released.
    Halt,
    /// Release a halted robot.
    Release,
    /// Close the filter at the next boundary, reply, and wait for an exchange.
    Yield(RpcReplyPort<()>),
    /// Open the filter again: no exchange takes place.
    Resume,
    /// Bring the robot to rest, and accept no more commits.
    Shutdown,
    /// End without waiting.
    Abandon(RpcReplyPort<()>),
}

/// Message to an agent's actor.
#[derive(Debug)]
pub enum AgentMsg {
    /// Request the next intent from the planner, if this is the newest of such messages.
    Ask(u64),
    /// Its motion has ended.
    Ended(CommitId, MotionEnd),
    /// The world has changed.
    Revise,
    /// The next set-point of the stream is due.
    SetPoint(CommitId),
    /// Make no more motions: the run ends.
    Rest,
    /// Replace the planner by another one.
    Swap(SwapRequest, RpcReplyPort<Result<(), String>>),
    /// Check the progress of the swap.
    Tick,
}

/// Message to the model.
#[derive(Debug)]
pub enum ModelMsg {
    /// Pulses are queued.
    Pulses,
    /// Change the world. The reply has the reason for a refusal.
    Edit(Edit, Option<RpcReplyPort<Result<(), String>>>),
    /// A sensor has seen an object's center here, meters in the world frame.
    Seen(String, [f64; 3]),
    /// A robot's controller has other parameters now.
    Margins,
}
