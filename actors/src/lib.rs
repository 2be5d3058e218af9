//! Who runs: supervision, driver, history, supervise, reflex, model, agent and journal as supervised actors.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod access;
mod attempt;
pub mod check;
pub mod clock;
pub mod controller;
pub mod convoy;
pub mod course;
pub mod driver;
pub mod gate;
pub mod history;
pub mod journal;
pub mod ledger;
pub mod pulse;
pub mod reflex;
pub mod ring;
pub mod shell;
pub mod stop;
pub mod stream;
pub mod supervise;
pub mod supervision;
pub mod swap;
pub mod system;
pub mod tap;
pub mod track;
pub mod wiring;
