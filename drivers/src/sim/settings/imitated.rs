//! Robots that a simulated one can be told to behave like, as measured on them.

use mobee_contract::Axis;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A robot to behave like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Imitated {
    /// The simulator iCub_SIM of icub-main 2: position moves are as fast as they are far, done within a degree, some limits are others
    /// than the robot's, joints have no names, accelerations can't be set, and 48 states come a second.
    #[serde(rename = "iCub_SIM")]
    ICubSim,
}

/// Time between two states of iCub_SIM: 48 a second.
const PUBLISHES: Duration = Duration::from_micros(20_833);

/// Limits of iCub_SIM where they are others than the model's, deg: motors whose names end so.
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

    /// An axis as it is there.
    pub fn axis(self, axis: Axis) -> Axis {
        match LIMITS.iter().find(|(name, ..)| axis.name.ends_with(name)) {
            Some((_, min, max)) => Axis { min: min.to_radians(), max: max.to_radians(), ..axis },
            None => axis,
        }
    }

    /// What the board calls its joint of this number.
    pub fn joint(self, number: usize) -> String {
        match self {
            Imitated::ICubSim => format!("JOINT{number}"),
        }
    }
}
