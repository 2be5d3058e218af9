//! The driver of robots behind YARP keeps every promise of the driver contract, over real sockets and in real time.

#![allow(clippy::disallowed_methods, reason = "real sockets live in real time")]

use crate::net::Net;
use mobee_contract::{Driver, Hardware, Time};
use mobee_drivers::YarpHardware;
use mobee_drivers::conformance::{self, Bench, Promise};
use std::sync::Mutex;

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
}

/// A promise in real time on a machine that others use too: it must hold once in three attempts.
fn attempt(promise: Promise) -> Option<String> {
    let mut seen = None;
    for _ in 0..3 {
        match (promise.check)(&mut Real::new()) {
            Ok(()) => return None,
            Err(what) => {
                eprintln!("{}: {what}", promise.name);
                seen = Some(format!("{}: {what}", promise.name));
            }
        }
    }
    seen
}

#[test]
fn the_robot_behind_yarp_keeps_every_promise() {
    let all = Mutex::new(conformance::suite());
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
