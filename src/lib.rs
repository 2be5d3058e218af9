//! MoBeE: the Modular Behavioral Environment for humanoids and other robots, as a framework of supervised actors.
//!
//! This crate is the program, and the library for programs that embed it or add kinds to it: the subcommands
//! (`mobee-cli`), and the composition of a running system from a configuration file (`mobee-compose`). The other parts
//! are separate crates; see ARCHITECTURE.md.

pub use mobee_cli::*;
pub use mobee_compose as compose;
pub use mobee_compose::{config, kinds, schema};
