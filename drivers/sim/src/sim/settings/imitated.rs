//! Measured behavior of real boards that a simulated robot can imitate.

use mobee_contract::Axis;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A robot to imitate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Imitated {
    /// The simulator iCub_SIM of icub-main 2: the speed of position moves grows with their distance, moves
    /// are done within a degree, some limits differ from the robot's, joints have no names, accelerations
    /// can't be set, and 48 states arrive per second.
    #[serde(rename = "iCub_SIM")]
    ICubSim,
}

/// Time between two states of iCub_SIM, at 48 per second.
const PUBLISHES: Duration = Duration::from_micros(20_833);

/// Limits of iCub_SIM that differ from the model's, deg, by the end of the motor's name.
const LIMITS: [(&str, f64, f64); 12] = [
    ("torso_pitch", -10.0, 70.0),
    ("neck_pitch", -40.0, 30.0),
    ("neck_roll", -70.0, 60.0),
    ("neck_yaw", -55.0, 55.0),
    ("eyes_tilt", -35.0, 15.0),
    ("eyes_vers", -50.0, 52.0),
    ("eyes_verg", 0.0, 90.0),
    ("shoulder_pitch", -95.0, 10.0),
    ("elbow", 15.5, 106.0),
    ("wrist_prosup", -90.0, 90.0),
    ("wrist_pitch", -90.0, 0.0),
    ("wrist_yaw", -20.0, 40.0),
];

impl Imitated {
    /// Time between two states of a board.
    pub fn publishes(self) -> Duration {
        match self {
            Imitated::ICubSim => PUBLISHES,
        }
    }

    /// Axis with the limits of the imitated robot.
    pub fn axis(self, axis: Axis) -> Axis {
        match LIMITS.iter().find(|(name, ..)| axis.name.ends_with(name)) {
            Some((_, min, max)) => Axis { min: min.to_radians(), max: max.to_radians(), ..axis },
            None => axis,
        }
    }

    /// Name of the board's joint with this index.
    pub fn joint(self, number: usize) -> String {
        match self {
            Imitated::ICubSim => format!("JOINT{number}"),
        }
    }
}
