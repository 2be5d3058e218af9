//! A robot's own RPC: requests of an operator to its controller. The encoding of requests belongs to a
//! bridge, YARP's is `mobee_bridge_yarp::robot`.

use mobee_contract::{Filtered, Refusal, Status};

/// A request to a robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RobotRequest {
    /// The filter's state.
    Status,
    /// Lets the built-in agent act, or pauses it (at the end of its present motion) in favor of another.
    LetAgentAct(bool),
    /// Retries a failed retreat.
    Recover,
}

/// A robot's answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RobotReply {
    /// The filter's state.
    Status(Status),
    /// It is done.
    Done,
}

/// Reason why a robot does not execute a request.
#[derive(Clone, Debug, PartialEq)]
pub enum RobotRefusal {
    /// There is no such request.
    Unknown,
    /// The request states neither on nor off for the agent.
    OnOrOff,
    /// The filtered interface refused.
    Refused(Refusal),
    /// There is no retreat to retry; the text describes the remedy.
    NotRecovered(String),
}

/// Answers a request.
///
/// # Errors
/// The reason why it is not executed.
pub fn answer(request: RobotRequest, robot: &dyn Filtered) -> Result<RobotReply, RobotRefusal> {
    match request {
        RobotRequest::Status => return Ok(RobotReply::Status(robot.latest().status)),
        RobotRequest::LetAgentAct(act) => robot.let_agent_act(act).map_err(RobotRefusal::Refused)?,
        RobotRequest::Recover => robot.recover().map_err(RobotRefusal::NotRecovered)?,
    }
    Ok(RobotReply::Done)
}
