//! Simulated and recorded robots, and simulated and recorded cameras ([`eyes`]).
//!
//! ```text
//! settings ──> SimHardware ──connect──> SimDriver (one per life of a driver actor)
//!                  │                        │ command, lease, sample
//!                  └── one simulated board: Plant (motors) + encoders + injected faults
//! ```
//!
//! * Owns: the simulated robot ([`SimHardware`], kind `sim`), its pure [`Plant`], its injectable faults
//!   ([`SimFaults`]), recorded robots ([`ReplayHardware`], kind `replay`), cameras (kinds `simulated`, `folder` and
//!   `recorded`), the
//!   frames that a run records ([`eyes::KeptFrames`]), the locator that only needs the places of the cameras
//!   (kind `pose`), and the estimate of reaction and braking path ([`stopping_path`]). `mobee-conformance`
//!   states the promises of each driver.
//! * Accepts: `Command`s and leases of the driver contract. Emits: `Sample`s.
//! * Promises: position, speed and acceleration limits are never exceeded; nothing moves without a lease; the plant outlives
//!   its drivers; the same seed and the same calls give the same readings.
//!
//! ```
//! use mobee_contract::{Axis, Command, Driver, Hardware, Move, Time};
//! use mobee_sim::{SimHardware, SimSettings};
//! use std::time::Duration;
//!
//! let axis = Axis { name: "elbow".into(), min: 0.0, max: 1.8, max_speed: 1.7, max_acceleration: 3.5, ..Default::default() };
//! let hardware = SimHardware::with_axes(vec![axis], &[0.5], &SimSettings::default(), 7);
//! let mut driver = hardware.connect()?;
//! driver.lease(Time::ZERO, Time::from_secs(10.0));
//! let there = Move { motors: vec![0], q: vec![1.0], relative: false, speed: Some(vec![1.0]), acceleration: None };
//! driver.command(Time::ZERO, &Command::Move(there))?;
//! let sample = driver.sample(Time::from_secs(5.0))?.expect("a reading every 10 ms");
//! assert!(sample.done[0] && (sample.q[0] - 1.0).abs() < 0.001);
//! # Ok::<(), mobee_contract::DriverFault>(())
//! ```

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

pub mod eyes;
pub mod replay;
mod sim;

pub use replay::ReplayHardware;
pub use sim::{
    ArmBody, ArmParts, ArmPhysics, ArmProfile, DoneRule, Fault, FaultId, Garbage, Imitated, Physics, PhysicsEngine,
    Plant, Pushes, SIM, Servo, ServoSettings, SimDriver, SimFaults, SimHardware, SimSettings, StepClock, StopRule,
    StoppingPath, UnknownBox, path, stopping_path,
};
