//! Swapping a part while the robot runs: the part, and the steps of the swap.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A part that can be swapped while the robot runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SwapPart {
    /// The planner.
    Agent,
    /// The settings of History, Supervise and Reflex.
    Controller,
    /// The driver of the board.
    Driver,
    /// Bridge through which external programs move robots.
    Bridge,
    /// Detector of regions in a camera's frames.
    Detector,
    /// Locator of the regions found by detectors.
    Locator,
}

impl fmt::Display for SwapPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SwapPart::Agent => "agent",
            SwapPart::Controller => "controller",
            SwapPart::Driver => "driver",
            SwapPart::Bridge => "bridge",
            SwapPart::Detector => "detector",
            SwapPart::Locator => "locator",
        })
    }
}

/// A step of a swap. Every offered swap ends in exactly one of `Refused`, `Reverted` and `Settled`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "step", rename_all = "snake_case")]
pub enum SwapStep {
    /// The new part is built and checked, and waits for its turn.
    Offered {
        /// Description of the part.
        what: String,
        /// Duration for which it only observes, seconds.
        shadow: f64,
        /// Duration of its probation after taking over, seconds.
        probation: f64,
    },
    /// It has taken over: a part of a robot at a transaction boundary, a part beside the robots at once.
    TookOver {
        /// Time from the boundary, or the end of the old part's work, until the new part is in place, seconds.
        gap: f64,
        /// Hash of the roadmap that was handed over, if there is one: equal before and after.
        map: Option<String>,
    },
    /// It was refused, and the old part continues unaffected.
    Refused {
        /// Reason.
        why: String,
    },
    /// It failed on probation, and the old part is back.
    Reverted {
        /// Reason.
        why: String,
    },
    /// Its probation is over; the old part is gone.
    Settled,
}

impl SwapStep {
    /// Returns whether this step ends the swap.
    pub fn is_last(&self) -> bool {
        matches!(self, SwapStep::Refused { .. } | SwapStep::Reverted { .. } | SwapStep::Settled)
    }
}

impl fmt::Display for SwapStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SwapStep::Offered { what, shadow, .. } if *shadow > 0.0 => {
                write!(f, "{what} is built and checked, and looks on for {shadow} s")
            }
            SwapStep::Offered { what, .. } => write!(f, "{what} is built and checked, and waits for its moment"),
            SwapStep::TookOver { gap, .. } => write!(f, "took over within {:.3} ms, and is on probation", gap * 1e3),
            SwapStep::Refused { why } => write!(f, "not taken, the old one goes on: {why}"),
            SwapStep::Reverted { why } => write!(f, "the old one is back: {why}"),
            SwapStep::Settled => f.write_str("settled: its probation is over"),
        }
    }
}
