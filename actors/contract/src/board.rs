//! The driver contract: a robot's board as MoBeE commands and reads it.

use crate::{Pose, Time};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// One motor as its board knows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Axis {
    /// The motor's name, as in the robot model.
    pub name: String,
    /// Lower limit, rad.
    pub min: f64,
    /// Upper limit, rad.
    pub max: f64,
    /// Greatest speed, rad/s.
    pub max_speed: f64,
    /// Greatest acceleration, rad/s^2.
    pub max_acceleration: f64,
}

/// What a board can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Board {
    /// The motors, in the order of `Robot::motors`.
    pub axes: Vec<Axis>,
    /// Time between two encoder samples.
    pub period: Duration,
    /// Greatest delay from a command to its effect, as far as it is known.
    pub latency: Duration,
    /// Whether it takes position-direct set-points; the retreat streams them, else it uses thinned way-points.
    pub position_direct: bool,
}

/// How a motor takes its set-points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlMode {
    /// Takes no command and holds.
    Idle,
    /// Position moves along a trajectory of the board's own.
    Position,
    /// Position set-points followed directly.
    PositionDirect,
    /// Velocity set-points, each good for a short time only.
    Velocity,
}

/// A position move of one, some or all motors. All lists have the length of `motors`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Move {
    /// Indices of the motors.
    pub motors: Vec<usize>,
    /// Targets (rad), or distances if `relative`. Targets outside a motor's limits are refused.
    pub q: Vec<f64>,
    /// Whether `q` counts from where the motor is when the command is given.
    pub relative: bool,
    /// Reference speeds, rad/s; `None` keeps those set before. The board lowers what exceeds its greatest.
    pub speed: Option<Vec<f64>>,
    /// Reference accelerations, rad/s^2; `None` keeps those set before.
    pub acceleration: Option<Vec<f64>>,
}

/// How fast a board's joints were in its first moves, by the reference speeds that they were told.
#[derive(Clone, Debug, PartialEq)]
pub struct Paces {
    /// Where the board is, such as the first part of its port names.
    pub board: String,
    /// Speeds as they were seen by those that were told, 1 where they are equal, one for each stretch of way that was timed.
    pub seen: Vec<f64>,
    /// Whether the board goes by speeds, as far as is known.
    pub fair: bool,
}

/// What a board can be told.
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
        /// Their positions, rad. Recorded readings may be streamed: one that exceeds a limit by no more than the noise of an
        /// encoder (0.1 deg) is taken for the limit.
        q: Vec<f64>,
    },
    /// Velocities to go at from now on, within the limits of position, until the next command or the board's own
    /// watchdog. Puts its motors into [`ControlMode::Velocity`] first.
    Velocity {
        /// Indices of the motors.
        motors: Vec<usize>,
        /// Velocities, rad/s.
        speed: Vec<f64>,
    },
    /// Brakes these motors (all if empty) to a standstill at their greatest deceleration.
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
    /// What it is, for the journal; set-points are told there as streams, and are of none of these kinds.
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

/// What a command is, without its values. Set-points are told as streams: see [`crate::Event::Streamed`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CommandKind {
    /// A move of the board's own.
    Move,
    /// A stop.
    Stop,
    /// Other control modes.
    Mode,
    /// Other reference speeds and accelerations.
    Reference,
}

impl CommandKind {
    /// As people read it.
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Counts readings; a gap means lost ones.
    pub seq: u64,
    /// When the encoders were read.
    pub at: Time,
    /// Motor positions, rad.
    pub q: Pose,
    /// Motion done, per motor: it rests, and no command given before `at` is still going to move it.
    pub done: Vec<bool>,
}

/// How long a board took to answer of late: the round trips of what it was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnswerTime {
    /// Half of the answers took no longer.
    pub median: Duration,
    /// Nine of ten answers took no longer: what the filter goes by. A machine that was held up once is no slow board.
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

/// How a motor was found, before it was told anything. What a board does not tell is `None`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AsFound {
    /// Index of the motor.
    pub motor: usize,
    /// Its control mode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mode: Option<ControlMode>,
    /// Whether it gave way to forces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compliant: Option<bool>,
    /// Its reference speed, rad/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Its reference acceleration, rad/s^2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acceleration: Option<f64>,
}

/// Limits of position, rad, least and greatest.
pub type Limits = (f64, f64);

/// Which motors a board allows less than the robot's model does, in words: for each its name, the model's limits and the board's.
/// `None` if there are none.
pub fn narrowed<'a>(motors: impl Iterator<Item = (&'a str, Limits, Limits)>) -> Option<String> {
    // what rounding to degrees takes off is not worth a word
    let slack = 0.05_f64.to_radians();
    let one = |(name, model, board): (&str, Limits, Limits)| {
        let span = |(min, max): Limits| format!("{:.1}..{:.1}", min.to_degrees(), max.to_degrees());
        let is_less = board.0 > model.0 + slack || board.1 < model.1 - slack;
        is_less.then(|| format!("{name} {} of {}", span(board), span(model)))
    };
    let all: Vec<String> = motors.filter_map(one).collect();
    (!all.is_empty()).then(|| format!("its boards allow less than the model, in deg: {}", all.join(", ")))
}

/// Recoverable trouble with a board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum DriverFault {
    /// No connection; it may come back.
    #[error("the board does not answer")]
    Lost,
    /// The command does not fit the board; it changed nothing.
    #[error("the board refuses: {0}")]
    Refused(String),
    /// The board itself reports a fault.
    #[error("the board reports a fault: {0}")]
    Hardware(String),
}

/// A robot's hardware, real or simulated, as its driver actor sees it.
///
/// No call blocks: a driver that talks to a network does so on threads of its own. `now` never runs backwards.
/// A driver is made anew after a crash of its actor; the board behind it lives on, as hardware does.
pub trait Driver: Send {
    /// What the board can do.
    fn board(&self) -> &Board;
    /// Gives a command. An error means that nothing of it was done. Commands take effect in the order given, each
    /// within the board's latency. Moves and set-points are refused without a lease.
    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault>;
    /// The newest reading, if there is one that was not given before. Readings that nobody fetched in time are lost.
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault>;
    /// When to ask for the next sample; later than `now` if the newest was fetched at `now`.
    fn next_sample(&self, now: Time) -> Time;
    /// Lets the board move until then; at the end of its lease it brakes by itself. Without a lease it never moves,
    /// and what it was doing is not taken up again under the next one. The newest lease counts; it holds at once.
    fn lease(&mut self, now: Time, until: Time);
    /// How long the board took to answer of late; `None` if it is not asked, or not known yet. While it is longer than
    /// [`Board::latency`] the filter does not open.
    fn answer_time(&self) -> Option<AnswerTime> {
        None
    }
    /// What it found out of the board and people should know, said once: it becomes a warning.
    fn news(&mut self) -> Option<String> {
        None
    }
    /// How the motors were found, of a board whose references and modes outlive whoever sets them; it is given back so.
    fn found(&self) -> Vec<AsFound> {
        Vec::new()
    }
    /// Whether its moves are made of set-points of its own, which come late now and then and are caught up with, and not by the board.
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
        let motors = [
            ("pitch", (-22.0, 84.0), (-10.0, 70.0)),
            ("roll", (-39.0, 39.0), (-39.04, 39.0)),
            ("yaw", (-59.0, 59.0), (-58.97, 70.0)),
        ];
        let told = |motors: &[(&'static str, Limits, Limits)]| {
            narrowed(motors.iter().map(|(name, model, board)| (*name, rad(*model), rad(*board))))
        };
        assert_eq!(
            told(&motors).as_deref(),
            Some("its boards allow less than the model, in deg: pitch -10.0..70.0 of -22.0..84.0")
        );
        assert_eq!(told(&motors[1..]), None);
    }
}
