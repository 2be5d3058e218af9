//! The driver contract: a robot's board as MoBeE commands and reads it.

use crate::{MotorUnits, Pose, Time};
use mobee_model::JointMotion;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// One motor as described by its board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Axis {
    /// The motor's name, as in the robot model.
    pub name: String,
    /// Lower limit, rad of encoder.
    pub min: f64,
    /// Upper limit, rad of encoder.
    pub max: f64,
    /// Maximum speed, rad/s of encoder.
    pub max_speed: f64,
    /// Maximum acceleration, rad/s^2 of encoder.
    pub max_acceleration: f64,
    /// What its encoder counts, for people.
    #[serde(default, skip_serializing_if = "JointMotion::is_turn")]
    pub motion: JointMotion,
    /// The smallest difference that its readings show, rad of encoder: one count of a coarse encoder, or the spread of a noisy one. 0: fine
    /// enough for a rest to show within eight readings.
    #[serde(default)]
    pub resolution: f64,
    /// By how much its joint may rest beside the commanded position, rad of encoder: the greatest load over the stiffness of a servo without
    /// an integral term. 0: the board itself brings it there.
    #[serde(default)]
    pub hold_error: f64,
    /// The greatest distance by which a push from outside moves its joint from the commanded position before its torque gives way, rad of
    /// encoder: greatest torque over stiffness. 0: not known, or nothing worth mention.
    #[serde(default)]
    pub deflection: f64,
    /// By how much its joint may go beyond the board's own path while it brakes as hard as it can, rad of encoder: inertia times acceleration
    /// over stiffness. 0: not known, or nothing worth mention.
    #[serde(default)]
    pub overshoot: f64,
    /// The external torque in [`Sample::external`] above which something pushes it, N m (N where it slides). 0: the board reports none.
    /// [`Axis::UNRATED`]: it reports torques, and its driver can't tell which of them is a contact.
    #[serde(default)]
    pub contact_effort: f64,
}

impl Axis {
    /// The [`contact_effort`](Axis::contact_effort) of a board that reports torques of unknown meaning, N m: no arm reaches it, so a contact by
    /// torque is watched only with a threshold of the settings.
    pub const UNRATED: f64 = 1e12;
}

/// What a board can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Board {
    /// The motors, in the order of `Robot::motors`.
    pub axes: Vec<Axis>,
    /// Time between two encoder samples.
    pub period: Duration,
    /// Maximum known delay from a command to its effect.
    pub latency: Duration,
    /// Whether it accepts position-direct set-points; the retreat streams them, otherwise it uses thinned way-points.
    pub position_direct: bool,
}

impl Board {
    /// What its motors count, for sentences.
    pub fn units(&self) -> MotorUnits {
        MotorUnits::of_axes(&self.axes)
    }
}

/// How a motor interprets its set-points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlMode {
    /// Accepts no command and holds.
    Idle,
    /// Position moves along the board's own trajectory.
    Position,
    /// Position set-points followed directly.
    PositionDirect,
    /// Velocity set-points, each valid for a short time.
    Velocity,
}

/// A position move of one, some or all motors. All lists have the length of `motors`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Move {
    /// Indices of the motors.
    pub motors: Vec<usize>,
    /// Targets (rad), or distances if `relative`. Targets outside a motor's limits are refused.
    pub q: Vec<f64>,
    /// Whether `q` is relative to the motor's position when the command is given.
    pub relative: bool,
    /// Reference speeds, rad/s; `None` keeps those set before. The board reduces what exceeds its maximum.
    pub speed: Option<Vec<f64>>,
    /// Reference accelerations, rad/s^2; `None` keeps those set before.
    pub acceleration: Option<Vec<f64>>,
}

/// How fast a board's joints moved in its first moves, relative to the commanded reference speeds.
#[derive(Clone, Debug, PartialEq)]
pub struct Paces {
    /// The board's address, such as the prefix of its port names.
    pub board: String,
    /// Measured over commanded speed (1 if equal), one for each stretch that was timed.
    pub seen: Vec<f64>,
    /// Whether the board honors reference speeds, as far as is known.
    pub fair: bool,
    /// Whether it accepted a reference acceleration, and was then found to have another of its own.
    pub own_acceleration: bool,
}

/// The commands of a board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Command {
    /// A position move. Puts its motors into [`ControlMode::Position`] first.
    Move(Move),
    /// Set-points for these motors, to be followed at once; no other motor is touched. Refused unless all of them are in
    /// [`ControlMode::PositionDirect`] (or will be, by a mode command given before).
    Direct {
        /// Indices of the motors.
        motors: Vec<usize>,
        /// Their positions, rad. Recorded readings may be streamed: one that exceeds a limit by no more than encoder
        /// noise (0.1 deg) counts as the limit.
        q: Vec<f64>,
    },
    /// Velocities from now on, within the position limits, until the next command or the board's own
    /// watchdog. Puts its motors into [`ControlMode::Velocity`] first.
    Velocity {
        /// Indices of the motors.
        motors: Vec<usize>,
        /// Velocities, rad/s.
        speed: Vec<f64>,
    },
    /// Brakes these motors (all if empty) to a standstill at their maximum deceleration.
    Stop {
        /// Indices of the motors.
        motors: Vec<usize>,
    },
    /// Sets reference speeds and accelerations of these motors, rad/s and rad/s^2.
    Reference {
        /// Indices of the motors.
        motors: Vec<usize>,
        /// Speeds.
        speed: Vec<f64>,
        /// Accelerations.
        acceleration: Vec<f64>,
    },
    /// Sets the control mode of these motors, and of no other.
    Mode {
        /// Indices of the motors, at least one.
        motors: Vec<usize>,
        /// The mode.
        mode: ControlMode,
    },
}

impl Command {
    /// Its kind, for the journal; set-points are recorded there as streams and have none of these kinds.
    pub fn kind(&self) -> Option<CommandKind> {
        match self {
            Command::Move(_) => Some(CommandKind::Move),
            Command::Stop { .. } => Some(CommandKind::Stop),
            Command::Mode { .. } => Some(CommandKind::Mode),
            Command::Reference { .. } => Some(CommandKind::Reference),
            Command::Direct { .. } | Command::Velocity { .. } => None,
        }
    }
}

/// The kind of a command, without its values. Set-points are recorded as streams: see [`crate::Event::Streamed`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CommandKind {
    /// One of the board's own moves.
    Move,
    /// A stop.
    Stop,
    /// Other control modes.
    Mode,
    /// Other reference speeds and accelerations.
    Reference,
}

impl CommandKind {
    /// The word shown to users.
    pub fn word(self) -> &'static str {
        match self {
            CommandKind::Move => "move",
            CommandKind::Stop => "stop",
            CommandKind::Mode => "mode",
            CommandKind::Reference => "reference",
        }
    }
}

/// One reading of all encoders.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Counts readings; a gap means that readings were lost.
    pub seq: u64,
    /// When the encoders were read.
    pub at: Time,
    /// Motor positions, rad.
    pub q: Pose,
    /// Motion done, per motor: it rests, and no command given before `at` will still move it.
    pub done: Vec<bool>,
    /// Per motor the torque from outside that the board reports or its driver derives from load or current, N m (N where it slides), in the
    /// direction in which it pushes the joint; empty where nothing is reported. The weight that the arm's own controller compensates, and
    /// the torque of its own motion, are none of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub external: Vec<f64>,
    /// The greatest force with which the robot has pushed anything since the reading before, N. Only a simulation knows it; nothing that
    /// moves the robot may use it. 0: none, or not known.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub contact_n: f64,
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

/// A board's recent response times: round trips of requests, each counted by the time since the one before, as a slow board answers
/// less often.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnswerTime {
    /// Half of the answers took no longer.
    pub median: Duration,
    /// Nine of ten answers took no longer: the filter uses this, since a machine that stalled once is not a slow board.
    pub most: Duration,
    /// The longest.
    pub greatest: Duration,
}

impl std::fmt::Display for AnswerTime {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [median, most, greatest] = [self.median, self.most, self.greatest].map(|d| d.as_secs_f64() * 1e3);
        write!(f, "answers in {median:.1} ms, nine of ten in {most:.1} ms, all in {greatest:.1} ms")
    }
}

/// How a motor was found, before any command. What a board does not report is `None`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AsFound {
    /// Index of the motor.
    pub motor: usize,
    /// Its control mode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mode: Option<ControlMode>,
    /// Whether it was compliant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compliant: Option<bool>,
    /// Its reference speed, rad/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Its reference acceleration, rad/s^2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acceleration: Option<f64>,
}

/// Position limits, rad of encoder: lower and upper.
pub type JointLimits = (f64, f64);

/// The motors for which a board's limits are narrower than the robot model's, in words: for each its name, how it moves, the model's
/// limits and the board's. `None` if there are none.
pub fn narrowed<'a>(motors: impl Iterator<Item = (&'a str, JointMotion, JointLimits, JointLimits)>) -> Option<String> {
    // differences due to rounding to degrees are not reported
    let slack = 0.05_f64.to_radians();
    let mut all = [(JointMotion::Turn, Vec::new()), (JointMotion::Slide, Vec::new())];
    for (name, motion, model, board) in motors.filter(|(_, _, m, b)| b.0 > m.0 + slack || b.1 < m.1 - slack) {
        let span = |(min, max): JointLimits| format!("{:.1}..{:.1}", min.to_degrees(), max.to_degrees());
        let of_its_kind = all.iter_mut().filter(|(kind, _)| *kind == motion);
        of_its_kind.for_each(|(_, list)| list.push(format!("{name} {} of {}", span(board), span(model))));
    }
    let told = all.iter().filter(|(_, list)| !list.is_empty());
    let told: Vec<String> = told.map(|(kind, list)| format!("in {}: {}", kind.unit(), list.join(", "))).collect();
    (!told.is_empty()).then(|| format!("its boards allow less than the model, {}", told.join("; ")))
}

/// A recoverable failure of a board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum DriverFault {
    /// No connection; it may come back.
    #[error("the board does not answer")]
    Lost,
    /// The board refused the command, which changed nothing.
    #[error("the board refuses: {0}")]
    Refused(String),
    /// The board itself reports a fault.
    #[error("the board reports a fault: {0}")]
    Hardware(String),
    /// A motor is much faster than it was commanded: something pushes it, or another program drives it. In a motion it counts as a contact.
    #[error("{0}")]
    TooFast(String),
}

/// A robot's hardware, real or simulated, as its driver actor sees it.
///
/// No call blocks: a driver that uses a network does so on its own threads. `now` never runs backwards.
/// A driver is created anew after a crash of its actor; the board behind it persists, as hardware does.
pub trait Driver: Send {
    /// What the board can do.
    fn board(&self) -> &Board;
    /// Gives a command. An error means that none of it was carried out. Commands take effect in the order given, each
    /// within the board's latency. Moves and set-points are refused without a lease.
    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault>;
    /// The newest reading, unless it was returned before. Readings that are not fetched in time are lost.
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault>;
    /// When to ask for the next sample; later than `now` if the newest was fetched at `now`.
    fn next_sample(&self, now: Time) -> Time;
    /// Lets the board move until then; when the lease expires it brakes by itself. Without a lease it never moves,
    /// and an interrupted motion is not resumed under the next lease. The newest lease counts, at once.
    fn lease(&mut self, now: Time, until: Time);
    /// The board's recent response times; `None` if not measured, or not known yet. While they are longer than
    /// [`Board::latency`] the filter does not open.
    fn answer_time(&self) -> Option<AnswerTime> {
        None
    }
    /// Findings about the board that users should know, reported once each, as a warning.
    fn news(&mut self) -> Option<String> {
        None
    }
    /// How the motors were found, for a board whose references and modes outlive the program that sets them; they are restored.
    fn found(&self) -> Vec<AsFound> {
        Vec::new()
    }
    /// Whether the driver makes its moves of set-points instead of leaving them to the board; motors catch up with late set-points.
    fn leads(&self) -> bool {
        false
    }
    /// The control modes as the board last reported them: a switch shows only once it is in force.
    fn modes(&self) -> Vec<ControlMode>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_that_a_board_narrows_are_told() {
        let rad = |(min, max): (f64, f64)| (min.to_radians(), max.to_radians());
        let (turns, slides) = (JointMotion::Turn, JointMotion::Slide);
        let motors = [
            ("lift", slides, (0.0, 350.0), (0.0, 300.0)),
            ("pitch", turns, (-22.0, 84.0), (-10.0, 70.0)),
            ("roll", turns, (-39.0, 39.0), (-39.04, 39.0)),
            ("yaw", turns, (-59.0, 59.0), (-58.97, 70.0)),
        ];
        let told = |motors: &[(&'static str, JointMotion, JointLimits, JointLimits)]| {
            narrowed(motors.iter().map(|(name, motion, model, board)| (*name, *motion, rad(*model), rad(*board))))
        };
        let pitch = "its boards allow less than the model, in deg: pitch -10.0..70.0 of -22.0..84.0";
        let both = format!("{pitch}; in mm: lift 0.0..300.0 of 0.0..350.0");
        assert_eq!(told(&motors).as_deref(), Some(both.as_str()));
        assert_eq!(told(&motors[1..]).as_deref(), Some(pitch));
        assert_eq!(told(&motors[2..]), None);
    }
}
