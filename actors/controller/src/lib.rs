//! The paper's Controller as pure state machines: History, Supervise and Reflex (Algorithms 4 to 6), and the values
//! they share.
//!
//! This crate depends on no actor library, clock, file, socket or agent. Each core takes inputs and the time, and
//! returns the actions to perform. `mobee-runtime` gives each core a mailbox.
//! |---|---|---|
//! | [`history`] | Algorithm 4 | records configurations, estimates the speed and detects gaps |
//! | [`supervise`] | Algorithm 5 | admits commits, maintains transactions, opens the filter |
//! | [`reflex`] | Algorithm 6 | closes the filter, stops the robot, retreats |
//! | [`joint_retreat`] | | retreats several robots on one clock |
//! | [`look_ahead`] | | predicts the configuration in which a robot would stop, and the contacts there |
//! | [`hold_offset`] | | offset of the commanded position from the target so that the joint rests at the target |
//! | [`load_model`] | | weight of an arm whose servos report their own load |
//! | [`effort`] | | detects pushed motors by the torques that the board reports |
//! | [`stall`] | | detects motors that do not follow their commands |
//! | [`simultaneous`] | | distances between robots at common instants |
//! | [`gate`], [`command_guard`] | | the filter: a fencing token, and the check of each command against it |
//! | [`ledger`] | | state that survives a restart of all of these |
//!
//! Units are SI, angles are in radians, unless a name states otherwise (`tolerance_deg`). A configuration has one value
//! per motor of the board, in the board's order. Two times are used: `sampled_at` is the time of a reading and dates
//! what the reading shows; `now` is the time of the step and spaces the commands. A reading may be delayed between the
//! two.
//!
//! The tests are in the crate: each states a promise, and `tools/mutants` checks that changing any operator breaks at
//! least one.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod command_guard;
pub mod effort;
pub mod fields;
pub mod gate;
pub mod history;
pub mod hold_offset;
pub mod joint_retreat;
pub mod kinds;
pub mod ledger;
pub mod load_model;
pub mod look_ahead;
pub mod pulse;
mod pushing;
pub mod reflex;
pub mod rules;
pub mod settings;
pub mod shared;
pub mod simultaneous;
pub mod stall;
pub mod stop;
pub mod supervise;
pub mod trajectory;

pub use fields::{FieldRules, FieldsSettings};
pub use kinds::{DEFAULT_KIND, RollbackSettings};
pub use rules::{DEEPER, FRESH_PERIODS, RELEASE, Rules, clamped, within};
pub use settings::{ControllerSettings, Drive};
pub use shared::Shared;
