//! The promises of all drivers, checked for a driver in Python.

use crate::callback_line::CallbackHardware;
use crate::driver_line::PyDriverLine;
use crate::failure::Failure;
use crate::wait::background;
use mobee_conformance::{Bench, beside, suite};
use mobee_contract::{Driver, Hardware, Time};
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// Time at which a bench begins: a promise may look back.
const BEGIN: Time = Time(1_000_000_000);
/// Share of the readings that may be late or lost, as the machine is shared.
const DISTURBED: f64 = 0.5;

/// A driver in Python under test, by the wall clock.
struct CallbackBench {
    hardware: CallbackHardware,
    begun: Instant,
}

impl Bench for CallbackBench {
    fn connect(&mut self) -> Result<Box<dyn Driver>, String> {
        self.hardware.connect().map_err(|e| e.to_string())
    }

    fn now(&self) -> Time {
        BEGIN + self.begun.elapsed()
    }

    #[expect(clippy::disallowed_methods, reason = "a driver in Python lives in real time")]
    fn wait_until(&mut self, then: Time) {
        std::thread::sleep(then.since(self.now()));
    }

    fn disturbed(&self) -> f64 {
        DISTURBED
    }
}

/// The names of all promises of a driver.
#[pyfunction]
pub(crate) fn promises() -> Vec<&'static str> {
    suite().iter().map(|promise| promise.name).collect()
}

/// Checks one promise with a fresh driver at the other end of a line: None, or the violation; and by how much threads of this machine woke up
/// late meanwhile, s.
#[pyfunction]
#[expect(clippy::disallowed_methods, reason = "a driver in Python lives in real time")]
pub(crate) fn keep_promise(py: Python<'_>, line: &PyDriverLine, promise: String) -> PyResult<(Option<String>, f64)> {
    let line = line.own()?.clone();
    let known = suite().into_iter().find(|known| known.name == promise);
    let Some(known) = known else {
        let remedy = "give one of mobee.conformance.PROMISES";
        return Err(Failure::new("promise", format!("there is no promise {promise:?}"), remedy).at("promise").into());
    };
    let hardware = line.attach_alone().map_err(|e| Failure::new("axes", e.what, e.help).at(e.path))?;
    let work = move || {
        let mut bench = CallbackBench { hardware, begun: Instant::now() };
        beside(|| (known.check)(&mut bench).err())
    };
    let (seen, late) = background(py, None, move |_, _| Ok(work()))?;
    Ok((seen, Duration::as_secs_f64(&late.most)))
}
