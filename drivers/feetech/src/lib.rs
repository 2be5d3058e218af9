//! Arms of Feetech STS3215 servos on a serial bus, such as the SO-100 and SO-101: `driver = { kind = "feetech", ... }`.
//!
//! ```text
//! drivers (one per life of a driver actor)      one bus thread, which outlives them
//!   command ──checked──> ArmCore <──every 10 ms──> sync write of goals, sync read of states ──> six servos
//!   lease ─────────────> ArmCore: at its end the trajectory brakes, and the servos hold
//!   sample <──────────── ArmCore
//! ```
//!
//! * Owns: the packets ([`packet`]), the bus ([`bus`]), the registers ([`registers`]), LeRobot's calibration files ([`calibration`]) and
//!   their making ([`ArmCalibrator`]), and the driver ([`FeetechHardware`], kind `feetech`).
//! * Accepts: `Command`s and leases of the driver contract. Emits: `Sample`s, with load as torque; faults with a name and a remedy.
//! * Promises: nothing that a servo stores is written, but by [`ArmCalibrator::store`]; goals are never more than `lead_deg` ahead of the readings, beyond the offset
//!   at which weight held the joint before the motion; torque is released only
//!   if the settings say so and the arm rests at `rest_deg`; a late answer is never taken for another; the same joint limits hold for
//!   every command.
//!
//! ```
//! use mobee_feetech::calibration::ArmCalibration;
//!
//! let text = r#"{ "pan": { "id": 1, "drive_mode": 0, "homing_offset": -12, "range_min": 741, "range_max": 3412 } }"#;
//! let calibration = ArmCalibration::parse(text).expect("a calibration");
//! assert_eq!(calibration.0["pan"].range_max, 3412);
//! ```

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod bus;
pub mod calibration;
mod calibrator;
mod core;
mod driver;
mod hardware;
mod identity;
mod joint;
pub mod packet;
pub mod registers;
mod settings;
mod worker;

pub use calibrator::ArmCalibrator;
pub use driver::FeetechDriver;
pub use hardware::{FEETECH, FeetechHardware};
pub use settings::{BusMotorSettings, FeetechSettings};
pub use worker::BusCycles;
