//! A robot's own RPC: what a person at it may want of its controller. How requests are written is a bridge's matter, YARP's is the
//! module `yarp::robot`.

use mobee_contract::{Filtered, Refusal, Status};

/// A request to a robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RobotRequest {
    /// The filter's state.
    Status,
    /// Let the built-in agent make motions, or make it pause (at the end of its present one) for another.
    LetAgentAct(bool),
    /// Try a failed retreat again.
    Recover,
}

/// A robot's answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RobotReply {
    /// The filter's state.
    Status(Status),
    /// It is done.
    Done,
}

/// Why a robot does not do what it was asked.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum RobotRefusal {
    /// There is no such request.
    Unknown,
    /// The agent can be let act, or not: the request says neither.
    OnOrOff,
    /// The filtered interface refused.
    Refused(Refusal),
    /// There is no retreat to try again: what would help.
    NotRecovered(String),
}

/// Answers a request.
///
/// # Errors
/// Why it is not done.
pub(crate) fn answer(request: RobotRequest, robot: &dyn Filtered) -> Result<RobotReply, RobotRefusal> {
    match request {
        RobotRequest::Status => return Ok(RobotReply::Status(robot.latest().status)),
        RobotRequest::LetAgentAct(act) => robot.let_agent_act(act).map_err(RobotRefusal::Refused)?,
        RobotRequest::Recover => robot.recover().map_err(RobotRefusal::NotRecovered)?,
    }
    Ok(RobotReply::Done)
}
