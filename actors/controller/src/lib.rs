//! The paper's Controller, pure: History, Supervise and Reflex (Algorithms 4 to 6) as state machines, and what they
//! share.
//!
//! Nothing here knows an actor library, a clock, a file or a socket, nor any agent: cores take inputs and the time, and
//! give what they want done. `mobee-actors` gives each a mailbox.
//!
//! | | paper | |
//! |---|---|---|
//! | [`history`] | Algorithm 4 | records poses, tells speed and gaps |
//! | [`supervise`] | Algorithm 5 | takes commits, keeps transactions, opens the filter |
//! | [`reflex`] | Algorithm 6 | closes the filter, stops the robot, takes it back |
//! | [`joint_retreat`] | | leads several robots back on one clock |
//! | [`look_ahead`] | | where a robot would come to rest, and what is in the way there |
//! | [`hold_offset`] | | how far beside its target a motor is commanded, so that its joint rests there |
//! | [`effort`] | | motors that something pushes, by the torques that the board reports |
//! | [`stall`] | | motors that do not follow what they were told |
//! | [`simultaneous`] | | how near robots come to each other at common instants |
//! | [`gate`], [`command_guard`] | | the filter itself: a fencing token, and who asks for it |
//! | [`ledger`] | | what survives the death of all of these |
//!
//! Units are those of the SI, angles in radians, unless a name says otherwise (`tolerance_deg`); poses are one number
//! per motor of the board, in its order. Two clocks meet here: `sampled_at` is when a reading was taken, and judges
//! what it shows; `now` is when a core is stepped, and spaces what is written. A reading may be held up between the
//! two.
//!
//! The tests are in the crate: each states a promise, and `tools/mutants` asks whether a change of any operator would
//! break one.

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
pub use rules::{DEEPER, FRESH_PERIODS, RELEASE, Rules, clamped, distance, play, within};
pub use settings::{ControllerSettings, Drive};
pub use shared::Shared;
