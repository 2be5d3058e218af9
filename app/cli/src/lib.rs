//! The subcommands of the program, and runs of compositions with their folder, journal and recording.
//!
//! ```text
//! configs/behaviors/explore.toml ──mobee-compose──> Composition ──run──> runs/explore-TIME/
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
pub mod ctl;
pub mod detector;
pub mod doctor;
pub mod eyes;
pub mod inspect;
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
mod signals;
pub mod sim;
pub mod torture;
pub mod view;
pub mod yarp;
