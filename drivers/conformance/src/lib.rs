//! Promises of all drivers, as checks that can be run against any driver.
//!
//! A [`Bench`] connects to one board and advances time, virtual or real; [`failures`] checks every [`DriverPromise`] on a fresh bench:
//!
//! ```
//! use mobee_contract::{Axis, Driver, Hardware, Time};
//! use mobee_conformance as conformance;
//! use mobee_sim::{SimHardware, SimSettings};
//!
//! struct Sim(SimHardware, Time);
//! impl conformance::Bench for Sim {
//!     fn connect(&mut self) -> Result<Box<dyn Driver>, String> {
//!         self.0.connect().map_err(|e| e.to_string())
//!     }
//!     fn now(&self) -> Time {
//!         self.1
//!     }
//!     fn wait_until(&mut self, then: Time) {
//!         self.1 = self.1.max(then);
//!     }
//! }
//! let axis = |name: &str| Axis { name: name.into(), min: -1.0, max: 1.0, max_speed: 1.7, max_acceleration: 3.5, ..Default::default() };
//! let failures = conformance::failures(&mut || {
//!     let hardware = SimHardware::with_axes(vec![axis("a"), axis("b")], &[0.0, 0.2], &SimSettings::default(), 1);
//!     Box::new(Sim(hardware, Time::ZERO))
//! });
//! assert_eq!(failures, []);
//! ```
//! [`servos`] are a counterpart for drivers of servo arms: simulated STS3215 servos on a pseudo-terminal.
//!
//! The board needs two motors with some degrees of free room around their rest positions. On a real robot the suite moves up to three motors,
//! each by 8 degrees at up to 10 deg/s, and to both its limits: make sure that the path is free.

#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::unreachable, clippy::indexing_slicing)
)]

mod beside;
mod leases;
mod motions;
mod readings;
mod refusals;
#[cfg(unix)]
pub mod servos;
mod streams;
mod trial;
mod velocities;

pub use beside::{Lateness, beside};

use mobee_contract::{Driver, Time};

/// A board under test, with its clock.
pub trait Bench {
    /// Creates a driver for the board; called again for the same board by promises about restarts.
    ///
    /// # Errors
    /// The reason why there is none.
    fn connect(&mut self) -> Result<Box<dyn Driver>, String>;
    /// The time now.
    fn now(&self) -> Time;
    /// Advances time: jumps there, or waits.
    fn wait_until(&mut self, then: Time);
    /// Share of the readings that may be late or lost because the bench shares its machine; zero in virtual
    /// time.
    fn disturbed(&self) -> f64 {
        0.0
    }
}

/// One promise of the driver contract.
#[derive(Clone, Copy, Debug)]
pub struct DriverPromise {
    /// The promise.
    pub name: &'static str,
    /// Tests a board; the error describes the violation.
    pub check: fn(&mut dyn Bench) -> Result<(), String>,
}

/// All promises.
pub fn suite() -> Vec<DriverPromise> {
    let lists = [
        readings::PROMISES,
        refusals::PROMISES,
        motions::PROMISES,
        streams::PROMISES,
        velocities::PROMISES,
        leases::PROMISES,
    ];
    lists.concat()
}

/// Tests a fresh bench for every promise. Returns the broken ones, with the violations.
pub fn failures(fresh: &mut dyn FnMut() -> Box<dyn Bench>) -> Vec<(&'static str, String)> {
    let check = |p: DriverPromise| (p.check)(fresh().as_mut()).err().map(|seen| (p.name, seen));
    suite().into_iter().filter_map(check).collect()
}
