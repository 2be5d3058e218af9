//! The contract: types and traits shared by all parts. No behavior is defined here, only data, interfaces and their
//! meaning.
//!
//! ```text
//! agent ──Intent──> (actors) ──Commit──> supervise ──Command──> driver ──> robot
//!   ^                                        |                     |
//!   └──── MotionEnd, View ───────────────────┘      Sample <───────┘
//! ```
//!
//! * [`Agent`] is implemented by authors of planners; it receives a [`View`] and returns an [`Intent`].
//! * [`Driver`] is implemented by owners of a robot; it takes [`Command`]s and returns [`Sample`]s.
//! * [`Refusal`] is a normal answer, [`DriverFault`] a recoverable fault; a bug is a panic, for the supervisor.
//! * [`Event`] is an entry of a run's record, written to every [`Sink`] (journal, recorder).
//!
//! Units: radians, meters, seconds, f64. Times are [`Time`], nanoseconds since the run began.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

mod agent;
mod board;
mod credit;
mod entry;
mod event;
pub mod fit;
mod joints;
mod kinds;
mod motion;
pub mod picture;
mod private;
mod registry;
mod sensing;
mod service;
mod status;
mod swap;
mod time;
mod units;

pub use agent::*;
pub use board::*;
pub use credit::*;
pub use entry::*;
pub use event::*;
pub use joints::*;
pub use kinds::*;
pub use motion::*;
pub use private::*;
pub use registry::*;
pub use sensing::*;
pub use service::*;
pub use status::*;
pub use swap::*;
pub use time::*;
pub use units::MotorUnits;

pub use mobee_model::{nearest, suggestion};

use std::sync::Arc;

/// Configuration of a robot: motor positions in the order of `Robot::motors`, rad of encoder. Cheap to clone,
/// immutable.
pub type Pose = Arc<[f64]>;
