//! The words all parts speak. No behavior lives here: only what may be said, by whom, and what it means.
//!
//! ```text
//! agent ──Intent──> (actors) ──Commit──> supervise ──Command──> driver ──> robot
//!   ^                                        |                     |
//!   └──── MotionEnd, View ───────────────────┘      Sample <───────┘
//! ```
//!
//! * [`Agent`] is written by people who plan; it sees a [`View`] and answers with an [`Intent`].
//! * [`Driver`] is written by people who own a robot; it takes [`Command`]s and gives [`Sample`]s.
//! * [`Refusal`] is a normal answer, [`DriverFault`] recoverable trouble; a bug is a panic, for the supervisor.
//! * [`Event`] is what a run leaves behind, told to every [`Sink`] (journal, recorder).
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

/// A robot's motor positions in the order of `Robot::motors`, rad of encoder. Cheap to clone, never changed.
pub type Pose = Arc<[f64]>;
