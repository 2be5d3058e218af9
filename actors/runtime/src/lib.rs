//! The runtime: driver, history, supervise, reflex, model, agent and sensors as supervised actors.
//!
//! `mobee-controller` decides for the controller, and the crates under `behaviors/` for the agents and sensors. This
//! crate adds mailboxes ([`shell`]), connections ([`wiring`]), time ([`clock`]), bounded streams ([`stream`]),
//! supervision ([`supervision`]), exchange of parts ([`swap`]), the threads of a run's records ([`tap`]), and runs
//! ([`system`]). `mobee-journal` defines the records.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod access;
pub(crate) mod attempt;
pub mod clock;
pub mod load;
pub mod shell;
pub mod stream;
pub mod supervision;
pub mod swap;
pub mod system;
pub mod tap;
pub mod wiring;
