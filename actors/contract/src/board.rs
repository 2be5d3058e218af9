//! The driver contract: commands to a robot's board, and its readings.

use crate::{MotorUnits, Pose, Time};
use mobee_model::JointMotion;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Motor as described by its board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Axis {
    /// Name of the motor, as in the robot model.
    pub name: String,
    /// Lower limit, rad of encoder.
    pub min: f64,
    /// Upper limit, rad of encoder.
    pub max: f64,
    /// Maximum speed, rad/s of encoder.
    pub max_speed: f64,
    /// Maximum acceleration, rad/s^2 of encoder.
    pub max_acceleration: f64,
    /// Kind of the joint, which determines the units shown to people.
    #[serde(default, skip_serializing_if = "JointMotion::is_turn")]
    pub motion: JointMotion,
    /// Smallest difference between its readings, rad of encoder: one count of a coarse encoder, or the spread of a
    /// noisy one. 0: fine enough for a rest to show within eight readings.
    #[serde(default)]
    pub resolution: f64,
    /// Greatest error between its joint at rest and the commanded position, rad of encoder: the greatest load divided
    /// by the stiffness of a servo without an integral term. 0: the board itself corrects the error.
    #[serde(default)]
    pub hold_error: f64,
    /// Greatest distance by which an external push moves its joint from the commanded position before the motor's
    /// torque is exceeded, rad of encoder: greatest torque divided by stiffness. 0: unknown, or negligible.
    #[serde(default)]
    pub deflection: f64,
    /// Greatest distance by which its joint overshoots the board's own path at maximum deceleration, rad of encoder:
    /// inertia times acceleration divided by stiffness. 0: unknown, or negligible.
    #[serde(default)]
    pub overshoot: f64,
    /// External torque in [`Sample::external`] from which it counts as pushed, N m (N for a prismatic joint). 0: the
    /// board reports none. [`Axis::UNRATED`]: it reports torques, but its driver has no threshold for a contact.
    #[serde(default)]
    pub contact_effort: f64,
    /// True if a stop makes the position that its encoder reads the commanded one: a joint that sags under its load then
    /// sinks below that position.
    #[serde(default)]
    pub stop_sinks: bool,
}

impl Axis {
    /// [`contact_effort`](Axis::contact_effort) of a board that reports torques of unknown meaning, N m: no arm
    /// reaches it, so torques are watched only with a threshold from the settings.
    pub const UNRATED: f64 = 1e12;
}

/// Properties of a board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Board {
    /// Motors, in the order of `Robot::motors`.
    pub axes: Vec<Axis>,
    /// Time between two encoder samples.
    pub period: Duration,
    /// Maximum known delay from a command to its effect.
    pub latency: Duration,
    /// True if it accepts position-direct set-points. If so, the retreat streams them; else it uses simplified
    /// way-points.
    pub position_direct: bool,
}

impl Board {
    /// Units of its motors, for texts.
    pub fn units(&self) -> MotorUnits {
        MotorUnits::of_axes(&self.axes)
    }
}

/// Interpretation of a motor's set-points.
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
    /// True if `q` is relative to the motor's position at the time of the command.
    pub relative: bool,
    /// Reference speeds, rad/s; `None` leaves the previous ones. The board reduces values beyond its maximum.
    pub speed: Option<Vec<f64>>,
    /// Reference accelerations, rad/s^2; `None` leaves the previous ones.
    pub acceleration: Option<Vec<f64>>,
}

/// Speed of a board's joints in its first moves, relative to the commanded reference speeds.
#[derive(Clone, Debug, PartialEq)]
pub struct Paces {
    /// Address of the board, such as the prefix of its port names.
    pub board: String,
    /// Ratios of measured to commanded speed, one for each timed segment.
    pub seen: Vec<f64>,
    /// True if the board honors reference speeds, as far as is known.
    pub fair: bool,
    /// True if it accepted a reference acceleration, and was then found to have another of its own.
    pub own_acceleration: bool,
}

/// Command to a board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Command {
    /// A position move. Puts its motors into [`ControlMode::Position`] first.
    Move(Move),
    /// Set-points for these motors, to be followed at once; no other motor is affected. Refused unless all of them
    /// are in [`ControlMode::PositionDirect`], or will be by an earlier mode command.
    Direct {
        /// Indices of the motors.
        motors: Vec<usize>,
        /// Positions, rad. Recorded readings may be streamed: one that exceeds a limit by no more than encoder noise
        /// (0.1 deg) counts as the limit.
        q: Vec<f64>,
    },
    /// Velocities from now on, within the position limits, until the next command, or until the board's own watchdog
    /// expires. Puts its motors into [`ControlMode::Velocity`] first.
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
    /// Kind of the command, for the journal; set-points are journaled as streams and have no kind.
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

/// Kind of a command, without its values. Set-points are journaled as streams: see [`crate::Event::Streamed`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CommandKind {
    /// Position move of the board.
    Move,
    /// Stop.
    Stop,
    /// Change of control modes.
    Mode,
    /// Change of reference speeds and accelerations.
    Reference,
}

impl CommandKind {
    /// Word shown to users.
    pub fn word(self) -> &'static str {
        match self {
            CommandKind::Move => "move",
            CommandKind::Stop => "stop",
            CommandKind::Mode => "mode",
            CommandKind::Reference => "reference",
        }
    }
}

/// Reading of all encoders.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Number of the reading; a gap means that readings were lost.
    pub seq: u64,
    /// Time at which the encoders were read.
    pub at: Time,
    /// Motor positions, rad.
    pub q: Pose,
    /// Per motor, whether its motion is done: it rests, and no command given before `at` will still move it.
    pub done: Vec<bool>,
    /// External torque of each motor, as reported by the board or derived from load or current by its driver, N m (N
    /// for a prismatic joint), positive in the direction in which it pushes the joint. Empty if nothing is reported.
    /// Excludes the weight that the arm's own controller compensates, and the torque of its own motion.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub external: Vec<f64>,
    /// Greatest force with which the robot has pushed anything since the previous reading, N. Available only in
    /// simulation; no control code may use it. 0: none, or unknown.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub contact_n: f64,
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

/// Recent response times of a board: round trips of requests, each weighted by the time since the previous one, as a
/// slow board answers less often.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnswerTime {
    /// Median.
    pub median: Duration,
    /// 90th percentile. The filter uses this, since a machine that stalled once is not a slow board.
    pub most: Duration,
    /// Maximum.
    pub greatest: Duration,
}

impl std::fmt::Display for AnswerTime {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [median, most, greatest] = [self.median, self.most, self.greatest].map(|d| d.as_secs_f64() * 1e3);
        write!(f, "answers in {median:.1} ms, nine of ten in {most:.1} ms, all in {greatest:.1} ms")
    }
}

/// State of a motor before the first command. Values that a board does not report are `None`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AsFound {
    /// Index of the motor.
    pub motor: usize,
    /// Control mode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mode: Option<ControlMode>,
    /// True if it was compliant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compliant: Option<bool>,
    /// Reference speed, rad/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Reference acceleration, rad/s^2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acceleration: Option<f64>,
}

/// Position limits, rad of encoder: lower and upper.
pub type JointLimits = (f64, f64);

/// Describes the motors for which a board's limits are narrower than the robot model's: name, joint kind, the board's
/// limits and the model's. `None` if there are none.
pub fn narrowed<'a>(motors: impl Iterator<Item = (&'a str, JointMotion, JointLimits, JointLimits)>) -> Option<String> {
    // Differences due to rounding to degrees are not reported.
    let slack = 0.05_f64.to_radians();
    let mut all = [(JointMotion::Turn, Vec::new()), (JointMotion::Slide, Vec::new())];
    for (name, motion, model, board) in motors.filter(|(_, _, m, b)| b.0 > m.0 + slack || b.1 < m.1 - slack) {
        let span = |(min, max): JointLimits| format!("{:.1}..{:.1}", min.to_degrees(), max.to_degrees());
        let of_its_kind = all.iter_mut().filter(|(kind, _)| *kind == motion);
        of_its_kind.for_each(|(_, list)| list.push(format!("{name} {} of {}", span(board), span(model))));
    }
    let narrower = all.iter().filter(|(_, list)| !list.is_empty());
    let texts: Vec<String> = narrower.map(|(kind, list)| format!("in {}: {}", kind.unit(), list.join(", "))).collect();
    (!texts.is_empty()).then(|| format!("its boards allow less than the model, {}", texts.join("; ")))
}

/// Recoverable failure of a board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum DriverFault {
    /// No connection; it may be restored.
    #[error("the board does not answer")]
    Lost,
    /// The board refused the command, which changed nothing.
    #[error("the board refuses: {0}")]
    Refused(String),
    /// The board itself reports a fault.
    #[error("the board reports a fault: {0}")]
    Hardware(String),
    /// A motor is much faster than commanded: something pushes it, or another program drives it. In a motion it
    /// counts as a contact.
    #[error("{0}")]
    TooFast(String),
}

/// Hardware of a robot, real or simulated, as used by its driver actor.
///
/// No call blocks: a driver that uses a network does so on its own threads. `now` never decreases. After a crash of
/// its actor, a driver is created again; the board behind it persists, as hardware does.
pub trait Driver: Send {
    /// Properties of the board.
    fn board(&self) -> &Board;
    /// Executes a command. On an error, no part of it was executed. Commands take effect in the given order, each
    /// within the board's latency. Moves and set-points are refused without a lease.
    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault>;
    /// Newest reading, unless it was returned before. Readings that are not fetched in time are lost.
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault>;
    /// Time at which to fetch the next sample; later than `now` if the newest was fetched at `now`.
    fn next_sample(&self, now: Time) -> Time;
    /// Allows the board to move until then; when the lease expires it brakes by itself. Without a lease it never
    /// moves, and an interrupted motion is not resumed under the next lease. A new lease replaces the previous one at
    /// once.
    fn lease(&mut self, now: Time, until: Time);
    /// Recent response times of the board; `None` if not measured, or not yet. While they exceed [`Board::latency`],
    /// the filter does not open.
    fn answer_time(&self) -> Option<AnswerTime> {
        None
    }
    /// Returns a finding about the board that users should read, as a warning; each is returned once.
    fn news(&mut self) -> Option<String> {
        None
    }
    /// State of the motors before the first command, for a board whose references and modes outlive the program that
    /// sets them. It is restored at the end.
    fn found(&self) -> Vec<AsFound> {
        Vec::new()
    }
    /// Returns whether the driver converts moves to set-points instead of leaving them to the board; motors catch up
    /// with late set-points.
    fn leads(&self) -> bool {
        false
    }
    /// Control modes as last reported by the board: a switch shows only once it is in force.
    fn modes(&self) -> Vec<ControlMode>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_that_a_board_narrows_are_reported() {
        let rad = |(min, max): (f64, f64)| (min.to_radians(), max.to_radians());
        let turns = JointMotion::Turn;
        let slides = JointMotion::Slide;
        let motors = [
            ("lift", slides, (0.0, 350.0), (0.0, 300.0)),
            ("pitch", turns, (-22.0, 84.0), (-10.0, 70.0)),
            ("roll", turns, (-39.0, 39.0), (-39.04, 39.0)),
            ("yaw", turns, (-59.0, 59.0), (-58.97, 70.0)),
        ];
        let describe = |motors: &[(&'static str, JointMotion, JointLimits, JointLimits)]| {
            narrowed(motors.iter().map(|(name, motion, model, board)| (*name, *motion, rad(*model), rad(*board))))
        };
        let pitch = "its boards allow less than the model, in deg: pitch -10.0..70.0 of -22.0..84.0";
        let both = format!("{pitch}; in mm: lift 0.0..300.0 of 0.0..350.0");
        assert_eq!(describe(&motors).as_deref(), Some(both.as_str()));
        assert_eq!(describe(&motors[1..]).as_deref(), Some(pitch));
        assert_eq!(describe(&motors[2..]), None);
    }
}
