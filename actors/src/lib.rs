//! Who runs: supervision, driver, history, supervise, reflex, model, agent and journal as supervised actors.

pub mod check;
pub mod clock;
pub mod journal;
pub mod stream;
pub mod supervision;
pub mod tap;
