//! The runtime: driver, history, supervise, reflex, model, agent and journal as supervised actors.
//!
//! `mobee-controller` decides for the controller, and `mobee-behaviors` for the agents. This crate adds
//! mailboxes ([`shell`]), connections ([`wiring`]), time and supervision ([`runtime`]), runs ([`system`]),
//! their records ([`record`]), and the checker of these ([`check`]).

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod access;
pub mod check;
pub mod record;
pub mod runtime;
pub mod shell;
pub mod system;
pub mod wiring;
