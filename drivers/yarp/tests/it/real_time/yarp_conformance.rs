//! The driver of robots behind YARP keeps every promise of the driver contract, over real sockets and in real time.

#![allow(clippy::disallowed_methods, reason = "real sockets live in real time")]

use crate::net::Net;
use mobee_conformance::{Bench, DriverPromise, beside};
use mobee_contract::{Driver, Hardware, Time};
use mobee_driver_yarp::YarpHardware;
use std::sync::Mutex;
use std::time::Duration;

/// A robot of two boards behind a name server of its own.
struct Real {
    hardware: YarpHardware,
    begun: tokio::time::Instant,
    _net: Net,
}

impl Real {
    fn new() -> Real {
        let net = Net::start();
        let hardware = YarpHardware::on(&net.network(), &net.settings(), &net.robot).unwrap();
        Real { hardware, begun: tokio::time::Instant::now(), _net: net }
    }
}

impl Bench for Real {
    fn connect(&mut self) -> Result<Box<dyn Driver>, String> {
        self.hardware.connect().map_err(|e| e.to_string())
    }
    fn now(&self) -> Time {
        Time(self.begun.elapsed().as_nanos() as u64 + 1_000_000_000)
    }
    fn wait_until(&mut self, then: Time) {
        std::thread::sleep(then.since(self.now()));
    }
    fn disturbed(&self) -> f64 {
        0.5
    }
}

/// A longer time than this without a processor is a disturbance.
const STALL: Duration = Duration::from_millis(5);
/// Attempts on a disturbed machine.
const ATTEMPTS: u32 = 20;

/// A promise in real time. What is seen while the machine was taken away tells nothing of the driver: it is tried again, so often
/// that on a machine that is never quiet it must hold once.
fn attempt(promise: DriverPromise) -> Option<String> {
    let mut seen = String::new();
    for _ in 0..ATTEMPTS {
        let (held, late) = beside(|| (promise.check)(&mut Real::new()));
        let stalled = late.most;
        match held {
            Ok(()) => return None,
            Err(what) => seen = format!("{}: {what} (threads woke up late by up to {stalled:?})", promise.name),
        }
        eprintln!("{seen}");
        if stalled < STALL {
            break;
        }
    }
    Some(seen)
}

#[test]
fn the_robot_behind_yarp_keeps_every_promise() {
    let all = Mutex::new(mobee_conformance::suite());
    let failures = Mutex::new(Vec::new());
    // most of each promise is waiting
    std::thread::scope(|scope| {
        for _ in 0..6 {
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
