//! MoBeE: the Modular Behavioral Environment for humanoids and other robots, as a framework of supervised actors.
//!
//! This crate is the program: the command line, and the composition of a running system from a configuration file.
//! The other parts are separate crates; see ARCHITECTURE.md.
//!
//! ```text
//! configs/behaviors/explore.toml ──config──> Config ──compose──> Setup ──run──> runs/explore-TIME/
//! ```

// registers itself as a driver
#[cfg(feature = "feetech")]
use mobee_feetech as _;
// registers itself as a physics engine
#[cfg(feature = "mujoco")]
use mobee_mujoco as _;

#[macro_use]
pub mod terminal;

pub mod agent;
mod arms;
pub mod bench;
pub mod calibrate;
pub mod check;
pub mod cli;
pub mod compose;
pub mod config;
pub mod ctl;
pub mod detector;
pub mod doctor;
pub mod eyes;
pub mod inspect;
pub mod kinds;
pub mod locator;
pub mod model_compare;
pub mod model_convert;
pub mod model_eval;
pub mod model_info;
pub mod model_view;
mod narrate;
pub mod new;
pub mod new_crate;
pub mod new_robot;
pub mod plan;
mod remote_sensor;
pub mod replay;
pub mod roadmap;
pub mod robot_import;
pub mod run;
pub mod schema;
mod signals;
pub mod sim;
pub mod torture;
pub mod view;
pub mod yarp;
