//! The state of a robot's filter.

use crate::Hold;
use serde::{Deserialize, Serialize};

/// The state of a robot's filter, as a status line shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "state", content = "reason", rename_all = "snake_case")]
pub enum Status {
    /// The controller is not complete yet.
    Starting,
    /// At rest with a safe pose, open to commits.
    Rest,
    /// A motion is in progress.
    Moving,
    /// An escape from contact is in progress.
    Escaping,
    /// Braking before the retreat.
    Stopping,
    /// Retracing the recorded path.
    Retreating,
    /// Back at the safe pose, coming to rest.
    Settling,
    /// Standing still for a reason; only escapes are accepted.
    Holding(Hold),
}

impl Status {
    /// Name of the state in one word, without its reason.
    pub fn word(self) -> &'static str {
        match self {
            Status::Starting => "starting",
            Status::Rest => "rest",
            Status::Moving => "moving",
            Status::Escaping => "escaping",
            Status::Stopping => "stopping",
            Status::Retreating => "retreating",
            Status::Settling => "settling",
            Status::Holding(_) => "holding",
        }
    }
}
