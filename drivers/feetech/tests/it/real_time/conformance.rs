//! The driver keeps every promise of the driver contract, over a pseudo-terminal and in real time.

use crate::arm::Arm;
use mobee_conformance::{Bench, DriverPromise, beside};
use mobee_contract::{Driver, Hardware, Time};
use std::sync::Mutex;
use std::time::Duration;

impl Bench for Arm {
    fn connect(&mut self) -> Result<Box<dyn Driver>, String> {
        self.hardware.connect().map_err(|e| e.to_string())
    }
    fn now(&self) -> Time {
        Arm::now(self)
    }
    fn wait_until(&mut self, then: Time) {
        self.pause(then.since(Arm::now(self)));
    }
    fn disturbed(&self) -> f64 {
        0.5
    }
}

/// A longer time than this without a processor is a disturbance.
const STALL: Duration = Duration::from_millis(5);
/// Attempts on a disturbed machine.
const ATTEMPTS: u32 = 20;
/// Promises that are checked at once: most of each is waiting.
const AT_ONCE: usize = 4;

/// A promise in real time. What fails while the machine was busy shows nothing of the driver: it is tried again.
fn attempt(promise: DriverPromise) -> Option<String> {
    let mut seen = String::new();
    for _ in 0..ATTEMPTS {
        let (held, late) = beside(|| (promise.check)(&mut Arm::new()));
        match held {
            Ok(()) => return None,
            Err(what) => seen = format!("{}: {what} (threads woke up late by up to {:?})", promise.name, late.most),
        }
        eprintln!("{seen}");
        if late.most < STALL {
            break;
        }
    }
    Some(seen)
}

#[test]
fn an_arm_of_servos_keeps_every_promise() {
    let all = Mutex::new(mobee_conformance::suite());
    let failures = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..AT_ONCE {
            scope.spawn(|| {
                loop {
                    let Some(promise) = all.lock().unwrap().pop() else { return };
                    failures.lock().unwrap().extend(attempt(promise));
                }
            });
        }
    });
    assert_eq!(failures.into_inner().unwrap(), Vec::<String>::new());
}
