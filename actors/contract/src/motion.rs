//! Motions as transactions: targets and set-points of agents, refusals, and ends.

use crate::{Axis, Move, Pose};
use mobee_model::JointMotion;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::Duration;

/// Number of an accepted commit, counted per robot from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct CommitId(pub u64);

/// Target of a motion: positions of some motors, all arriving together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Indices into `Robot::motors`, each at most once.
    pub motors: Vec<usize>,
    /// Target positions of those motors, rad of encoder.
    pub q: Vec<f64>,
    /// Share of each motor's greatest speed that the motion may use, above 0 and up to 1.
    pub speed: f64,
}

impl Target {
    /// Whole configuration at this target, for a robot at `from`.
    pub fn pose(&self, from: &[f64]) -> Pose {
        let mut q = from.to_vec();
        for (m, v) in self.motors.iter().zip(&self.q) {
            if let Some(slot) = q.get_mut(*m) {
                *slot = *v;
            }
        }
        q.into()
    }

    /// Board command that moves a robot from `from` to this target with all motors in step, so that the path is a
    /// straight line in joint space: speed and acceleration of every motor are scaled by its share of the slowest
    /// motor's motion. A motor that the board does not have gets speed zero: the command is refused where it is
    /// checked.
    pub fn in_step(&self, from: &[f64], axes: &[Axis]) -> Move {
        // for each motor: its distance, and its greatest speed and acceleration
        let leg = |(m, q): (&usize, &f64)| match (from.get(*m), axes.get(*m)) {
            (Some(here), Some(axis)) => ((q - here).abs(), self.speed * axis.max_speed, axis.max_acceleration),
            _ => (0.0, 0.0, 0.0),
        };
        let legs: Vec<(f64, f64, f64)> = self.motors.iter().zip(&self.q).map(leg).collect();
        // for the slowest motor: seconds at full allowed speed, and the bound of the common time scale by the
        // accelerations
        let slowest = legs.iter().map(|(way, speed, _)| way / speed).fold(0.0, f64::max);
        let push = legs.iter().map(|(way, _, most)| way / most).fold(0.0, f64::max);
        let speed = legs.iter().map(|(way, speed, _)| if slowest > 0.0 { way / slowest } else { *speed }).collect();
        let acceleration = legs.iter().map(|(way, _, most)| if push > 0.0 { way / push } else { *most }).collect();
        Move {
            motors: self.motors.clone(),
            q: self.q.clone(),
            relative: false,
            speed: Some(speed),
            acceleration: Some(acceleration),
        }
    }
}

/// Set-points of a stream, for some motors; the others stay.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setpoints {
    /// Indices into `Robot::motors`, each at most once.
    pub motors: Vec<usize>,
    /// One value for each of these motors.
    pub values: Values,
}

/// Values of [`Setpoints`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Values {
    /// Positions, rad, followed directly ([`crate::ControlMode::PositionDirect`]).
    Position(Vec<f64>),
    /// Velocities, rad/s ([`crate::ControlMode::Velocity`]).
    Velocity(Vec<f64>),
}

/// End of a motion as reported to its agent. "Rolled back" is an outcome of the controller, and is never reported to
/// an agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionEnd {
    /// The robot rests at the target.
    Reached,
    /// The robot rests elsewhere, or the motion was refused.
    Failed,
}

/// A step of the motion to a robot's rest pose, at the end of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "step", rename_all = "snake_case")]
pub enum RestStep {
    /// The run ends, and the robot is moved to its rest pose.
    Begun,
    /// The robot rests there.
    Reached,
    /// The robot rests elsewhere and holds there.
    Missed {
        /// Reason.
        why: String,
    },
}

impl fmt::Display for RestStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RestStep::Begun => f.write_str("moves to its rest pose, as the run ends"),
            RestStep::Reached => f.write_str("rests at its rest pose"),
            RestStep::Missed { why } => write!(f, "did not reach its rest pose, and holds where it is: {why}"),
        }
    }
}

/// The single outcome of an accepted commit (I2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The robot rests at the target.
    Committed,
    /// The reflex moved the robot back to the safe pose, where it rests.
    RolledBack,
    /// Neither: the robot stopped on the way and holds.
    Faulted,
}

/// Reason for which a robot holds with its filter closed to ordinary commits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hold {
    /// Something touches the robot where it rests.
    InContact,
    /// The retreat was blocked by a new or deeper contact.
    RetreatBlocked,
    /// The history does not reach back to the safe pose.
    HistoryTooShort,
    /// The retreat was driven but the robot did not arrive or come to rest in time.
    RetreatMissed,
    /// The encoders have gone stale.
    Stale,
    /// An actor of the controller died and was restarted in mid-motion.
    Restarted,
    /// The board reports a fault.
    BoardFault,
    /// The board answers more slowly than its stated latency: everything computed from that latency is invalid.
    SlowBoard,
    /// A motor was moved while the robot rested, by no command of its filter.
    Displaced,
    /// The process ended in mid-motion, and the robot rests neither at its target nor at its safe pose. Nothing moves
    /// until a person requests `recover`.
    AfterCrash,
    /// A person halted the robot: nothing moves it until a person releases it.
    Halted,
    /// The run is ending.
    ShuttingDown,
}

impl fmt::Display for Hold {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Hold::InContact => "something touches the robot at rest",
            Hold::RetreatBlocked => "the retreat is blocked",
            Hold::HistoryTooShort => "the history does not reach back to the safe pose",
            Hold::RetreatMissed => "the retreat did not arrive",
            Hold::Stale => "the encoders are stale",
            Hold::Restarted => "a part of the controller was restarted in mid-motion",
            Hold::BoardFault => "the board reports a fault",
            Hold::SlowBoard => {
                "the board answers more slowly than its `latency_ms`: find out what slows it, or allow more and keep a wider margin"
            }
            Hold::Displaced => "the robot was moved at rest: by another program, by hand or by its weight",
            Hold::AfterCrash => "the process ended in mid-motion: ask to `recover`",
            Hold::Halted => "halted by a person: `mobee ctl release` lets it act again",
            Hold::ShuttingDown => "the run is ending",
        })
    }
}

/// Cause of a rollback, or of a closing of the filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// A pair got closer than its margin.
    Contact(Vec<mobee_model::Contact>),
    /// On its stopping path, the robot would get closer to these than the braking clearance: each at its least
    /// distance.
    Foreseen(Vec<mobee_model::Contact>),
    /// A motor does not follow its command: something that is not in the model holds it.
    Stall {
        /// Name of the motor.
        motor: String,
        /// Lag, rad of encoder.
        by: f64,
        /// Kind of the joint.
        #[serde(default, skip_serializing_if = "JointMotion::is_turn")]
        motion: JointMotion,
    },
    /// The board reports an external torque: something pushes a motor.
    ExternalTorque {
        /// Name of the motor.
        motor: String,
        /// Torque, N m (N for a prismatic joint), positive in the direction in which it pushes the joint.
        torque: f64,
        /// Kind of the joint.
        #[serde(default, skip_serializing_if = "JointMotion::is_turn")]
        motion: JointMotion,
    },
    /// A constraint of a body part does not hold.
    Constraint {
        /// Name of the part.
        part: String,
        /// Index of the clause within the part.
        clause: usize,
    },
    /// The board reports that the motion is done, and the robot is not at the target.
    TargetMissed,
    /// The agent that owned the motion died or was stopped.
    AgentDied,
    /// The encoders have gone stale.
    Stale,
    /// An actor of the controller died.
    ActorDied(String),
    /// The process ended in mid-motion.
    Crashed,
    /// The board reports a fault.
    BoardFault(String),
    /// A motor left its resting position, by more than the tolerance and without a command of the filter.
    Displaced {
        /// Name of the motor.
        motor: String,
        /// Displacement, rad of encoder.
        by: f64,
        /// Kind of the joint.
        #[serde(default, skip_serializing_if = "JointMotion::is_turn")]
        motion: JointMotion,
    },
    /// A person or the program requested it.
    Asked,
}

impl Cause {
    /// Kind of the cause in a word or two, for counting.
    pub fn word(&self) -> &'static str {
        match self {
            Cause::Contact(_) => "contact",
            Cause::Foreseen(_) => "contact foreseen",
            Cause::Stall { .. } => "stall",
            Cause::ExternalTorque { .. } => "external torque",
            Cause::Constraint { .. } => "constraint",
            Cause::TargetMissed => "target missed",
            Cause::AgentDied => "agent died",
            Cause::Stale => "stale readings",
            Cause::ActorDied(_) => "actor died",
            Cause::Crashed => "crash",
            Cause::BoardFault(_) => "board fault",
            Cause::Displaced { .. } => "displaced",
            Cause::Asked => "stopped on request",
        }
    }
}

/// Silence after which a stream that caused a contact is accepted again, counted from the opening of the filter.
pub const SILENCE: Duration = Duration::from_millis(500);

/// A normal answer to a commit that is not accepted; it changes nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(tag = "code", rename_all = "snake_case")]
pub enum Refusal {
    /// The filter is closed while the reflex acts.
    #[error("the filter is closed while the reflex acts")]
    Closed,
    /// The controller is not complete yet, or was restarted.
    #[error("the controller is not ready: {missing}")]
    NotReady {
        /// Condition that is awaited.
        missing: String,
    },
    /// The robot holds, and this commit is no escape.
    #[error("the robot holds: {reason}")]
    Holding {
        /// Reason of the hold.
        reason: Hold,
    },
    /// Another agent's motion is in progress, or commands come too quickly.
    #[error("another agent's motion is under way, or commands come too quickly")]
    Busy,
    /// The agent's last stream caused a contact, and it has not been silent for [`SILENCE`] since the filter opened
    /// again.
    #[error("the last stream ran into something, and its program has not been silent for half a second since")]
    Pushing,
    /// The motion to change has ended.
    #[error("the motion that it would change has ended")]
    Over,
    /// A position outside a motor's limits.
    #[error("motor {motor}: {q_deg:.3} {unit} is outside its limits {min_deg:.3} to {max_deg:.3} {unit}", unit = motion.unit())]
    Limits {
        /// Name of the motor.
        motor: String,
        /// Requested position, in degrees or millimeters.
        q_deg: f64,
        /// Lower limit, in the same unit.
        min_deg: f64,
        /// Upper limit, in the same unit.
        max_deg: f64,
        /// Kind of the joint, which determines the unit.
        #[serde(default, skip_serializing_if = "JointMotion::is_turn")]
        motion: JointMotion,
    },
    /// A number that is not finite.
    #[error("motor {motor}: the position is not a finite number")]
    NotFinite {
        /// Name of the motor.
        motor: String,
    },
    /// A set-point too far from the one before.
    #[error("motor {motor}: a set-point {by_deg:.3} {unit} away, {most_deg:.3} {unit} is the most it can follow at once", unit = motion.unit())]
    Jump {
        /// Name of the motor.
        motor: String,
        /// Distance, in degrees or millimeters.
        by_deg: f64,
        /// Greatest allowed distance, in the same unit.
        most_deg: f64,
        /// Kind of the joint, which determines the unit.
        #[serde(default, skip_serializing_if = "JointMotion::is_turn")]
        motion: JointMotion,
    },
    /// A share of the greatest speed outside (0, 1].
    #[error("speed {speed} is not a share of the greatest speed, above 0 and up to 1")]
    Speed {
        /// Requested value, as text (it may be NaN).
        speed: String,
    },
    /// A motor named twice, unknown, or lists of different length.
    #[error("the target is malformed: {what}")]
    Malformed {
        /// Problem.
        what: String,
    },
    /// The agent could not import the offered state.
    #[error("the state can't be taken over: {what}")]
    State {
        /// Problem.
        what: String,
    },
}

impl Refusal {
    /// Short name for users and programs to match on.
    pub fn code(&self) -> &'static str {
        match self {
            Refusal::Closed => "closed",
            Refusal::NotReady { .. } => "not_ready",
            Refusal::Holding { .. } => "holding",
            Refusal::Busy => "busy",
            Refusal::Pushing => "pushing",
            Refusal::Over => "over",
            Refusal::Limits { .. } => "limits",
            Refusal::NotFinite { .. } => "not_finite",
            Refusal::Jump { .. } => "jump",
            Refusal::Speed { .. } => "speed",
            Refusal::Malformed { .. } => "malformed",
            Refusal::State { .. } => "state",
        }
    }

    /// Remedy.
    pub fn remedy(&self) -> &'static str {
        match self {
            Refusal::Closed => "wait until the rollback has ended, then plan again from the robot's pose",
            Refusal::NotReady { .. } => "wait until the controller is complete and the encoders are fresh",
            Refusal::Holding { reason: Hold::Halted } => "release it: `mobee ctl release`",
            Refusal::Holding { .. } => {
                "commit an escape that only lessens the contacts, or clear the cause and `recover`"
            }
            Refusal::Busy => {
                "wait until the motion has ended, or stop its agent; send fewer than 250 commands a second"
            }
            Refusal::Pushing => "send nothing for half a second once the robot is back, then stream elsewhere",
            Refusal::Over => "see how it ended, then plan again",
            Refusal::Limits { .. } => "choose a position within the limits",
            Refusal::NotFinite { .. } => "check the planner for a division by zero",
            Refusal::Jump { .. } => "begin the stream where the robot is, and step no farther than its motors are fast",
            Refusal::Speed { .. } => "give a speed above 0 and up to 1",
            Refusal::Malformed { .. } => "name each motor once, with one position each",
            Refusal::State { .. } => "start the agent without the old state",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refused_limits_of_a_lift_are_in_millimeters() {
        let motor = "lift".to_owned();
        let motion = JointMotion::Slide;
        let refusal = Refusal::Limits { motor, q_deg: 900.0, min_deg: 0.0, max_deg: 350.0, motion };
        assert_eq!(refusal.to_string(), "motor lift: 900.000 mm is outside its limits 0.000 to 350.000 mm");
        let written = serde_json::to_value(&refusal).unwrap();
        assert_eq!(serde_json::from_value::<Refusal>(written).unwrap(), refusal);
        let old = serde_json::json!({"code": "jump", "motor": "pan", "by_deg": 9.0, "most_deg": 3.0});
        let old: Refusal = serde_json::from_value(old).unwrap();
        assert_eq!(
            old.to_string(),
            "motor pan: a set-point 9.000 deg away, 3.000 deg is the most it can follow at once"
        );
    }

    #[test]
    fn a_motor_that_the_board_does_not_have_stands_still_and_the_others_go() {
        let axis = Axis {
            name: "pan".into(),
            min: -1.0,
            max: 1.0,
            max_speed: 0.5,
            max_acceleration: 2.0,
            ..Default::default()
        };
        let target = Target { motors: vec![0, 7], q: vec![0.5, 0.5], speed: 0.5 };
        let motion = target.in_step(&[0.0], &[axis]);
        assert_eq!((motion.speed, motion.acceleration), (Some(vec![0.25, 0.0]), Some(vec![2.0, 0.0])));
    }
}
