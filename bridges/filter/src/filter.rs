//! The port filter: a control board for each part, which any program commands like the robot's own, but
//! safely.
//!
//! The core is pure: it decides on requests and is informed of their outcome. Its requests and replies are
//! types ([`BoardRequest`], [`BoardReply`]); their encoding belongs to a bridge, YARP's is the module
//! `mobee_bridge_yarp::board`.
//!
//! A request to a robot that is still starting waits for it, at most two seconds. After that:
//!
//! | Request | While open | While closed |
//! |---|---|---|
//! | query that is known to change nothing | to the board, the reply byte for byte; for a simulated robot from its state | refused |
//! | move | a commit: absolute, finite, within limits, at the joint's reference speed; a joint beyond a limit may stay there | refused |
//! | velocities, direct positions | a stream, which ends when it falls silent | refused, dropped |
//! | stop | brakes; if other joints keep moving: holds these at their positions | refused |
//! | reference speeds and accelerations | stored and reported; this part's moves use them, up to the greatest speed allowed | refused |
//! | control modes, stiffness | stored and reported; the driver sets the real ones | refused |
//! | incomplete request | malformed | refused |
//! | all others: limits, encoders, torque, PWM, PID, calibration, amplifiers, other modes, unknown requests | refused | refused |
//!
//! A reply is the board's own unless the filter has better information. Joints are not done while the outcome
//! of their motion is open; a client whose joints have arrived does not wait for other clients in the same
//! transaction, because gaze may stream all day. Modes and references are the client's where it has set them.
//! A connection whose motion failed is refused once, for any request, so that a slow client can't take a
//! rolled-back motion for a finished one; a refusal received while the filter was closed counts. A stream has
//! no replies: after a failure it is ignored until it has been silent for half a second, or its client's RPC
//! connection has received the refusal. A stream none of whose motors took part in the contact continues when
//! the filter opens.

mod lines;
mod motions;
mod request;
#[cfg(test)]
mod tests;

pub use request::{BoardAxis, BoardReply, BoardRequest, ClientMode, ClientSet, KnownBetter, Question};

use lines::ConnectionStates;
use mobee_contract::{Board, Commit, CommitId, Hold, MotionEnd, Setpoints, Status, Time, Verdict};
use mobee_model::Robot;
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

/// Distance to the target at which a joint counts as arrived for a client that shares the transaction with
/// others, deg.
const ARRIVED: f64 = 0.5;

/// State of the robot when a request arrives.
pub struct RobotSnapshot<'a> {
    /// Time of the request.
    pub now: Time,
    /// State of the filter.
    pub status: Status,
    /// Configuration of the robot, rad.
    pub q: &'a [f64],
    /// Outcome of a motion.
    pub end_of: &'a dyn Fn(CommitId) -> Option<MotionEnd>,
    /// Motors that made a motion fail, if known.
    pub to_blame: &'a dyn Fn(CommitId) -> Option<BTreeSet<usize>>,
}

/// True if this state blocks all commands of agents. A robot that holds after a failed retreat, or in
/// contact, accepts escapes, so that agents can free it.
pub fn closed(status: Status) -> bool {
    match status {
        Status::Rest | Status::Moving | Status::Escaping => false,
        Status::Starting | Status::Stopping | Status::Retreating | Status::Settling => true,
        Status::Holding(hold) => {
            !matches!(hold, Hold::InContact | Hold::RetreatBlocked | Hold::HistoryTooShort | Hold::RetreatMissed)
        }
    }
}

/// Decision on a request.
#[derive(Clone, Debug, PartialEq)]
pub enum FilterDecision {
    /// Reply without further action.
    Reply(BoardReply),
    /// Query, to be passed to the board unchanged, or answered from [`FilterCore::board`] if the board has no
    /// protocol of its own. The answer is then corrected by [`FilterCore::knows_better`].
    Question(Question),
    /// A commit to make; its verdict goes to [`FilterCore::accepted`].
    Commit(Commit),
    /// Setpoints to stream; their verdict goes to [`FilterCore::accepted`].
    Stream(Setpoints),
    /// Brake, then reply [`BoardReply::Accepted`].
    Stop,
}

/// Connection of a client to one of the boards.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardClient<'a> {
    /// Index of the part in the robot.
    pub part: usize,
    /// Number of the connection.
    pub connection: u64,
    /// Name that the client gave.
    pub from: &'a str,
    /// True if the client waits for a reply. Otherwise it is never informed of a refusal.
    pub listens: bool,
}

/// Board of one part, as the filter emulates it.
struct PartBoard {
    motors: Range<usize>,
    axes: Vec<BoardAxis>,
}

/// Pure core of one robot's filter.
pub struct FilterCore {
    agent: Arc<str>,
    /// Share of a motor's greatest speed that clients may use.
    speed: f64,
    parts: Vec<PartBoard>,
    lines: ConnectionStates,
    sensed: Option<Time>,
}

impl FilterCore {
    /// Creates a filter for all parts of a robot at the configuration `q` (rad), whose clients may use this
    /// share of each motor's greatest speed.
    pub fn new(name: &str, robot: &Robot, board: &Board, q: &[f64], speed: f64) -> FilterCore {
        let axis = |(i, axis): (usize, &mobee_contract::Axis)| {
            let motion = robot.motors.get(i).map(|motor| motor.motion).unwrap_or_default();
            BoardAxis::at_rest(axis, motion, q.get(i).copied().unwrap_or_default())
        };
        let axes: Vec<BoardAxis> = board.axes.iter().enumerate().map(axis).collect();
        let part = |part: &mobee_model::Part| PartBoard {
            motors: part.motors.clone(),
            axes: axes.get(part.motors.clone()).unwrap_or_default().to_vec(),
        };
        FilterCore {
            agent: format!("{name}/filter").into(),
            speed,
            parts: robot.parts.iter().map(part).collect(),
            lines: ConnectionStates::default(),
            sensed: None,
        }
    }

    /// Name of the agent under which its motions are committed.
    pub fn agent(&self) -> Arc<str> {
        self.agent.clone()
    }

    /// Stores the reference speeds and accelerations of a real board (deg/s, deg/s^2; mm for prismatic
    /// joints), read once at the start.
    pub fn learn(&mut self, part: usize, speeds: &[f64], accelerations: &[f64]) {
        let Some(part) = self.parts.get_mut(part) else { return };
        for (axis, speed) in part.axes.iter_mut().zip(speeds) {
            axis.ref_speed = *speed;
        }
        for (axis, acceleration) in part.axes.iter_mut().zip(accelerations) {
            axis.ref_acc = *acceleration;
        }
    }

    /// Decides on a request.
    pub fn request(&mut self, client: &BoardClient, request: &BoardRequest, seen: &RobotSnapshot) -> FilterDecision {
        self.lines.update(client, seen);
        if closed(seen.status) || self.lines.failed(client) {
            return FilterDecision::Reply(self.fail(client));
        }
        match request {
            BoardRequest::Incomplete => FilterDecision::Reply(BoardReply::Malformed),
            BoardRequest::Question(question) => FilterDecision::Question(question.clone()),
            order => self.order(client, order, seen).unwrap_or(FilterDecision::Reply(BoardReply::Refused)),
        }
    }

    /// True if a motion of this client has failed and the client has not been informed yet.
    pub fn has_failed(&mut self, client: &BoardClient, seen: &RobotSnapshot) -> bool {
        self.lines.update(client, seen);
        self.lines.failed(client)
    }

    /// Decides on a streamed command; `None` if there is nothing to do.
    pub fn streamed(
        &mut self,
        client: &BoardClient,
        request: &BoardRequest,
        seen: &RobotSnapshot,
    ) -> Option<FilterDecision> {
        self.lines.update(client, seen);
        // recorded while the filter is closed, too: a client that never paused has not been silent
        let deaf = self.lines.deaf(client, seen.now);
        if deaf || closed(seen.status) {
            return None;
        }
        match request {
            BoardRequest::Move { .. } | BoardRequest::Velocity { .. } | BoardRequest::Direct { .. } => {
                self.order(client, request, seen)
            }
            _ => None,
        }
    }

    /// Decides on a request that would change something; `None` refuses it.
    fn order(&mut self, client: &BoardClient, request: &BoardRequest, seen: &RobotSnapshot) -> Option<FilterDecision> {
        let part = self.parts.get(client.part).filter(|part| request.fits(part.axes.len()))?;
        match request {
            BoardRequest::Move { joints, values, relative } => {
                let mut values = values.clone();
                if *relative {
                    for (value, joint) in values.iter_mut().zip(joints) {
                        *value += seen.q.get(part.motors.start + joint)?.to_degrees();
                    }
                }
                self.moves(client, joints, &values)
            }
            BoardRequest::Velocity { joints, values } => self.velocities(client, joints, values),
            BoardRequest::Direct { joints, values } => self.directs(client, joints, values),
            BoardRequest::Stop(joints) => self.stop(client, joints, seen),
            // never passed on, because the board would apply them to the next motion of any client
            BoardRequest::Speed { joints, values } => self.refer(client.part, joints, values, |axis, speed| {
                (axis.ref_speed, axis.set.speed) = (speed, true);
            }),
            BoardRequest::Acceleration { joints, values } => self.refer(client.part, joints, values, |axis, acc| {
                (axis.ref_acc, axis.set.acceleration) = (acc, true);
            }),
            BoardRequest::Mode { joints, modes } => self.store(client.part, joints, modes, |axis, mode| {
                (axis.mode, axis.set.mode) = (*mode, true);
            }),
            BoardRequest::BeStiff => Some(FilterDecision::Reply(BoardReply::Accepted)),
            BoardRequest::Question(_) | BoardRequest::Incomplete | BoardRequest::Unknown => None,
        }
    }

    /// Stores a setting of some joints.
    fn store<T>(
        &mut self,
        part: usize,
        joints: &[usize],
        values: &[T],
        put: impl Fn(&mut BoardAxis, &T),
    ) -> Option<FilterDecision> {
        let part = self.parts.get_mut(part)?;
        for (joint, value) in joints.iter().zip(values) {
            put(part.axes.get_mut(*joint)?, value);
        }
        Some(FilterDecision::Reply(BoardReply::Accepted))
    }

    /// Stores references. As on real boards, the sign is ignored.
    fn refer(
        &mut self,
        part: usize,
        joints: &[usize],
        values: &[f64],
        put: fn(&mut BoardAxis, f64),
    ) -> Option<FilterDecision> {
        values.iter().all(|v| v.is_finite()).then_some(())?;
        self.store(part, joints, values, |axis, v| put(axis, v.abs()))
    }

    /// Records the verdict on a commit or a stream, and returns the reply.
    pub fn accepted(
        &mut self,
        client: &BoardClient,
        step: &FilterDecision,
        verdict: &Verdict,
        seen: &RobotSnapshot,
    ) -> BoardReply {
        if let Ok(id) = verdict {
            let motors = match step {
                FilterDecision::Commit(commit) => commit.target.motors.as_slice(),
                FilterDecision::Stream(setpoints) => setpoints.motors.as_slice(),
                _ => &[],
            };
            self.lines.moves(client, *id, motors);
            self.show(client.part, step);
        }
        if closed(seen.status) {
            return self.fail(client);
        }
        if verdict.is_ok() { BoardReply::Accepted } else { BoardReply::Refused }
    }

    /// Corrections to the answer of a query.
    ///
    /// # Errors
    /// The reply that replaces the answer.
    pub fn knows_better(
        &mut self,
        client: &BoardClient,
        question: &Question,
        seen: &RobotSnapshot,
    ) -> Result<KnownBetter, BoardReply> {
        self.lines.update(client, seen);
        if closed(seen.status) || self.lines.failed(client) {
            return Err(self.fail(client));
        }
        let Some(part) = self.parts.get(client.part) else { return Err(BoardReply::Refused) };
        let axes = |joints: &[usize]| joints.iter().map(|j| part.axes.get(*j)).collect::<Vec<_>>();
        let references = |joints: &[usize], of: fn(&BoardAxis) -> Option<f64>| {
            let known = |axis: Option<&BoardAxis>| axis.and_then(|axis| Some((of(axis)?, axis.motion)));
            KnownBetter::References(axes(joints).into_iter().map(known).collect())
        };
        Ok(match question {
            Question::Done(joints) => {
                let moving = self.under_way(seen);
                let open = joints.iter().any(|j| moving.contains(&(part.motors.start + j)));
                if open { KnownBetter::NotDone } else { KnownBetter::Nothing }
            }
            Question::Modes(joints) => {
                let mode = |axis: Option<&BoardAxis>| axis.filter(|axis| axis.set.mode).map(|axis| axis.mode);
                KnownBetter::Modes(axes(joints).into_iter().map(mode).collect())
            }
            Question::Speeds(joints) => references(joints, |axis| axis.set.speed.then_some(axis.ref_speed)),
            Question::Accelerations(joints) => references(joints, |axis| axis.set.acceleration.then_some(axis.ref_acc)),
            Question::Other => KnownBetter::Nothing,
        })
    }

    /// Joints of a part, as stored and reported.
    pub fn board(&self, part: usize) -> &[BoardAxis] {
        self.parts.get(part).map(|part| part.axes.as_slice()).unwrap_or_default()
    }

    /// Motors whose motion has an open outcome, even if the board reports them as done. A client whose motors
    /// have all arrived does not wait for the other clients in the same transaction.
    fn under_way(&self, seen: &RobotSnapshot) -> BTreeSet<usize> {
        self.lines.under_way(seen, |motor| {
            let part = self.parts.iter().find(|part| part.motors.contains(&motor));
            let axis = part.and_then(|part| part.axes.get(motor - part.motors.start));
            axis.zip(seen.q.get(motor)).is_some_and(|(axis, q)| (q.to_degrees() - axis.target).abs() <= ARRIVED)
        })
    }

    /// Adds a reading of the whole robot.
    pub fn sense(&mut self, at: Time, q: &[f64], status: Status) {
        let secs = self.sensed.map(|last| at.since(last).as_secs_f64());
        self.sensed = Some(at);
        let under_way = !matches!(status, Status::Rest | Status::Holding(_) | Status::Starting);
        for part in &mut self.parts {
            for (axis, q) in part.axes.iter_mut().zip(q.get(part.motors.clone()).unwrap_or_default()) {
                let q = q.to_degrees();
                let speed = match secs {
                    Some(secs) if secs > 1e-4 => (q - axis.q) / secs,
                    _ => axis.speed,
                };
                (axis.q, axis.speed) = (q, speed);
                axis.done = !under_way || speed.abs() < 0.5;
            }
        }
    }

    /// Removes a connection that has ended.
    pub fn gone(&mut self, connection: u64) {
        self.lines.gone(connection);
    }

    /// Refuses, and records that the client has been informed if it waits for replies.
    fn fail(&mut self, client: &BoardClient) -> BoardReply {
        if client.listens {
            self.lines.inform_family(client);
        }
        BoardReply::Refused
    }
}
