//! Who runs: supervision, driver, history, supervise, reflex, model, agent and journal as supervised actors.

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
