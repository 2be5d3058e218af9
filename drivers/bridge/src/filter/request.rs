//! What a part's board can be asked through the filter, and what it answers.
//!
//! Joints count from 0 in the part's own order. Positions are in degrees here, as clients say them: what they have set is shown to them
//! again to the last bit. Where a joint slides they are in millimeters, whatever a protocol counts in: its bridge converts, and so every
//! "deg" below is "mm" for such a joint.

use mobee_model::JointMotion;
use std::collections::BTreeSet;

/// A request to a part's board. Lists of values have one for each of the joints.
#[derive(Clone, Debug, PartialEq)]
pub enum BoardRequest {
    /// A question that changes nothing: the board answers it, in its own protocol.
    Question(Question),
    /// A position move at the joints' reference speeds.
    Move {
        /// Which joints.
        joints: Vec<usize>,
        /// Where to, deg; distances if `relative`.
        values: Vec<f64>,
        /// Whether the values count from where the joints are.
        relative: bool,
    },
    /// Velocities to go at until others come, deg/s.
    Velocity {
        /// Which joints.
        joints: Vec<usize>,
        /// How fast, deg/s.
        values: Vec<f64>,
    },
    /// Positions to be at, followed as they come, deg.
    Direct {
        /// Which joints.
        joints: Vec<usize>,
        /// Where, deg.
        values: Vec<f64>,
    },
    /// Stop these joints.
    Stop(Vec<usize>),
    /// Reference speeds of position moves.
    Speed {
        /// Which joints.
        joints: Vec<usize>,
        /// How fast, deg/s.
        values: Vec<f64>,
    },
    /// Reference accelerations of position moves.
    Acceleration {
        /// Which joints.
        joints: Vec<usize>,
        /// How much, deg/s^2.
        values: Vec<f64>,
    },
    /// Control modes.
    Mode {
        /// Which joints.
        joints: Vec<usize>,
        /// Which modes.
        modes: Vec<ClientMode>,
    },
    /// Be stiff, as all joints are.
    BeStiff,
    /// Less than a request.
    Incomplete,
    /// All else: what could move or reconfigure the robot in a way that nobody watches, and what nobody knows.
    Unknown,
}

/// A question, as far as the filter may know better than the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Question {
    /// Whether these joints have done their motion.
    Done(Vec<usize>),
    /// Their control modes.
    Modes(Vec<usize>),
    /// Their reference speeds.
    Speeds(Vec<usize>),
    /// Their reference accelerations.
    Accelerations(Vec<usize>),
    /// Anything else that is known to change nothing.
    Other,
}

/// A control mode that clients may set. The driver sets the real ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClientMode {
    /// Position moves along a trajectory of the board's own.
    Position,
    /// Position set-points followed directly.
    PositionDirect,
    /// Velocity set-points.
    Velocity,
    /// Positions and velocities by turns.
    Mixed,
}

/// A board's short answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardReply {
    /// It is done, or begun.
    Accepted,
    /// It is not done, or the filter is closed.
    Refused,
    /// This is no request.
    Malformed,
}

/// What the filter knows better than the board's answer to a [`Question`].
#[derive(Clone, Debug, PartialEq)]
pub enum KnownBetter {
    /// Nothing: the answer is right as it is.
    Nothing,
    /// The joints are not done, whatever the board thinks: the outcome of their motion is open.
    NotDone,
    /// The modes that clients have set, of the joints asked about. One that the board is in for reasons of its own (idle, fault,
    /// calibration) is shown as it is.
    Modes(Vec<Option<ClientMode>>),
    /// The references that clients have set, of the joints asked about, deg/s or deg/s^2, and how each joint moves.
    References(Vec<Option<(f64, JointMotion)>>),
}

/// A joint of a part's board as the filter keeps and shows it: deg, deg/s, deg/s^2.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardAxis {
    /// The joint's name.
    pub name: String,
    /// How it moves, and so what it counts.
    pub motion: JointMotion,
    /// Lower limit.
    pub min: f64,
    /// Upper limit.
    pub max: f64,
    /// Greatest speed.
    pub max_speed: f64,
    /// Where it is.
    pub q: f64,
    /// How fast it is.
    pub speed: f64,
    /// Target of the last position move.
    pub target: f64,
    /// Last commanded velocity.
    pub velocity: f64,
    /// Last position set-point.
    pub direct: f64,
    /// Reference speed of position moves.
    pub ref_speed: f64,
    /// Reference acceleration of position moves.
    pub ref_acc: f64,
    /// Control mode.
    pub mode: ClientMode,
    /// Motion done.
    pub done: bool,
    /// Which of these clients have set.
    pub set: ClientSet,
}

/// Which settings of a joint clients have set.
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
    /// Whether joints and lists fit a board with so many joints: each is one of its, named once, and has its value.
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
    /// A joint at rest in position mode, with a tenth of its greatest speed as reference.
    pub(super) fn at_rest(axis: &mobee_contract::Axis, motion: JointMotion, q: f64) -> BoardAxis {
        let (q, max_speed) = (q.to_degrees(), axis.max_speed.to_degrees());
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
