//! The paper's ControllerSettings, pure: History, Supervise and Reflex (Algorithms 4 to 6) as state machines, and what they share.
//!
//! Nothing here knows an actor library, a clock, a file or a socket, nor any agent: cores take inputs and the time, and give what
//! they want done. `mobee-actors` gives each a mailbox.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod command_guard;
pub mod fields;
pub mod gate;
pub mod history;
pub mod joint_retreat;
pub mod kinds;
pub mod ledger;
pub mod pulse;
pub mod reflex;
pub mod rules;
pub mod settings;
pub mod shared;
pub mod stop;
pub mod supervise;
pub mod trajectory;

pub use fields::{FieldRules, FieldsSettings};
pub use kinds::{DEFAULT_KIND, RollbackSettings};
pub use rules::{DEEPER, FRESH_PERIODS, RELEASE, Rules, clamped, distance, within};
pub use settings::{ControllerSettings, Drive};
pub use shared::Shared;
