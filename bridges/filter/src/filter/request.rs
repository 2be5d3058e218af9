//! Requests to a part's board through the filter, and its replies.
//!
//! Joints are numbered from 0 in the part's own order. Positions are in degrees, as clients send them, so
//! that the values set can be reported to the last bit. For prismatic joints they are in millimeters,
//! independent of the protocol, whose bridge converts: every "deg" below is "mm" for such a joint.

use mobee_model::JointMotion;
use std::collections::BTreeSet;

/// A request to a part's board. Lists of values have one for each of the joints.
#[derive(Clone, Debug, PartialEq)]
pub enum BoardRequest {
    /// A query, which changes nothing: the board answers it, in its own protocol.
    Question(Question),
    /// A position move at the joints' reference speeds.
    Move {
        /// Joints.
        joints: Vec<usize>,
        /// Targets, deg; distances if `relative`.
        values: Vec<f64>,
        /// True if the values are relative to the present positions.
        relative: bool,
    },
    /// Velocities to hold until the next ones, deg/s.
    Velocity {
        /// Joints.
        joints: Vec<usize>,
        /// Velocities, deg/s.
        values: Vec<f64>,
    },
    /// Position setpoints to follow, deg.
    Direct {
        /// Joints.
        joints: Vec<usize>,
        /// Positions, deg.
        values: Vec<f64>,
    },
    /// Stop these joints.
    Stop(Vec<usize>),
    /// Reference speeds of position moves.
    Speed {
        /// Joints.
        joints: Vec<usize>,
        /// Speeds, deg/s.
        values: Vec<f64>,
    },
    /// Reference accelerations of position moves.
    Acceleration {
        /// Joints.
        joints: Vec<usize>,
        /// Accelerations, deg/s^2.
        values: Vec<f64>,
    },
    /// Control modes.
    Mode {
        /// Joints.
        joints: Vec<usize>,
        /// Modes.
        modes: Vec<ClientMode>,
    },
    /// Be stiff, which all joints are.
    BeStiff,
    /// An incomplete request.
    Incomplete,
    /// Any other request: one that could move or reconfigure the robot unsupervised, or an unknown one.
    Unknown,
}

/// A query, as far as the filter may have better information than the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Question {
    /// Motion done.
    Done(Vec<usize>),
    /// Their control modes.
    Modes(Vec<usize>),
    /// Their reference speeds.
    Speeds(Vec<usize>),
    /// Their reference accelerations.
    Accelerations(Vec<usize>),
    /// Any other query that is known to change nothing.
    Other,
}

/// A control mode that clients may set. The driver sets the real ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClientMode {
    /// Position moves along a trajectory of the board.
    Position,
    /// Position setpoints, followed directly.
    PositionDirect,
    /// Velocity setpoints.
    Velocity,
    /// Positions and velocities in turn.
    Mixed,
}

/// A board's short answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardReply {
    /// It is done, or has begun.
    Accepted,
    /// It is not done, or the filter is closed.
    Refused,
    /// The request is malformed.
    Malformed,
}

/// Correction of the board's answer to a [`Question`].
#[derive(Clone, Debug, PartialEq)]
pub enum KnownBetter {
    /// None: the answer is right.
    Nothing,
    /// The joints are not done, because the outcome of their motion is open.
    NotDone,
    /// Modes that clients have set for these joints. A mode that the board is in for reasons of its own
    /// (idle, fault, calibration) is reported unchanged.
    Modes(Vec<Option<ClientMode>>),
    /// References that clients have set for these joints, deg/s or deg/s^2, and the joint kinds.
    References(Vec<Option<(f64, JointMotion)>>),
}

/// A joint of a part's board as the filter stores and reports it: deg, deg/s, deg/s^2.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardAxis {
    /// Name of the joint.
    pub name: String,
    /// Joint kind, which determines the unit.
    pub motion: JointMotion,
    /// Lower limit.
    pub min: f64,
    /// Upper limit.
    pub max: f64,
    /// Greatest speed.
    pub max_speed: f64,
    /// Position.
    pub q: f64,
    /// Speed.
    pub speed: f64,
    /// Target of the last position move.
    pub target: f64,
    /// Last commanded velocity.
    pub velocity: f64,
    /// Last position setpoint.
    pub direct: f64,
    /// Reference speed of position moves.
    pub ref_speed: f64,
    /// Reference acceleration of position moves.
    pub ref_acc: f64,
    /// Control mode.
    pub mode: ClientMode,
    /// Motion done.
    pub done: bool,
    /// Settings that clients have set.
    pub set: ClientSet,
}

/// Flags of the settings of a joint that clients have set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClientSet {
    /// Its mode.
    pub mode: bool,
    /// Its reference speed.
    pub speed: bool,
    /// Its reference acceleration.
    pub acceleration: bool,
}

impl BoardRequest {
    /// True if joints and lists fit a board with this number of joints: each joint exists, is named once, and
    /// has a value.
    pub fn fits(&self, axes: usize) -> bool {
        let (joints, values) = match self {
            BoardRequest::Move { joints, values, .. }
            | BoardRequest::Velocity { joints, values }
            | BoardRequest::Direct { joints, values }
            | BoardRequest::Speed { joints, values }
            | BoardRequest::Acceleration { joints, values } => (joints, values.len()),
            BoardRequest::Mode { joints, modes } => (joints, modes.len()),
            BoardRequest::Stop(joints) => (joints, joints.len()),
            BoardRequest::Question(_) | BoardRequest::BeStiff | BoardRequest::Incomplete | BoardRequest::Unknown => {
                return true;
            }
        };
        let once: BTreeSet<usize> = joints.iter().copied().collect();
        values == joints.len() && once.len() == values && once.last().is_none_or(|most| *most < axes)
    }
}

impl BoardAxis {
    /// Creates a joint at rest in position mode, with a tenth of its greatest speed as reference.
    pub(super) fn at_rest(axis: &mobee_contract::Axis, motion: JointMotion, q: f64) -> BoardAxis {
        let q = q.to_degrees();
        let max_speed = axis.max_speed.to_degrees();
        BoardAxis {
            name: axis.name.clone(),
            motion,
            min: axis.min.to_degrees(),
            max: axis.max.to_degrees(),
            max_speed,
            q,
            speed: 0.0,
            target: q,
            velocity: 0.0,
            direct: q,
            ref_speed: 0.1 * max_speed,
            ref_acc: max_speed,
            mode: ClientMode::Position,
            done: true,
            set: ClientSet::default(),
        }
    }
}
