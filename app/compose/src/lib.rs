//! Composition of a running system from a configuration file: the library that a program embeds.
//!
//! ```text
//! configs/behaviors/explore.toml ──Source──> Config ──read──> Composition (everything built and checked)
//! ```
//!
//! It names no kind: agents, controllers, drivers, bridges, cameras, detectors and locators are registered by the crates
//! that a program links ([`kinds`]). It prints nothing and parses no command line. With the feature `miette`, complaints
//! are diagnostics with the place in the file.

// they register kinds
use mobee_agents as _;
use mobee_driver_yarp as _;
use mobee_sensing as _;

mod composition;
pub mod config;
pub mod kinds;
pub mod maps;
pub mod schema;

pub use composition::*;
