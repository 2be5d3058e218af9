//! Who runs: driver, history, supervise, reflex, model, agent and journal as supervised actors.
//!
//! What the controller decides is in `mobee-controller`, what agents want in `mobee-behaviors`; here they get mailboxes ([`shell`]), what
//! connects them ([`wiring`]), time and supervision ([`runtime`]), a run around them ([`system`]), what it leaves behind ([`record`]), and
//! who judges that ([`check`]).

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
