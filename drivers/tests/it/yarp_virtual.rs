//! The driver of robots behind YARP keeps every promise of the driver contract in virtual time, too: it is the one that torture lets loose
//! on wires that are slow, lossy and lying.

#![allow(clippy::disallowed_methods, reason = "the clock of a paused runtime is a virtual one")]

use crate::net;
use mobee_contract::{Command, Context, Driver, Hardware, Time};
use mobee_drivers::conformance::{self, Bench};
use mobee_drivers::{Moves, YarpDriverSettings, YarpSim};
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::{Builder, EnterGuard, Runtime};
use tokio::time::Instant;

struct Virtual {
    runtime: &'static Runtime,
    /// Drivers are called from outside of tasks, but by the runtime's clock.
    _inside: EnterGuard<'static>,
    sim: YarpSim,
    begun: Instant,
}

impl Virtual {
    fn new() -> Virtual {
        Virtual::of(&net::settings())
    }

    fn of(settings: &YarpDriverSettings) -> Virtual {
        let runtime = Builder::new_current_thread().enable_all().start_paused(true).build().unwrap();
        let runtime: &'static Runtime = Box::leak(Box::new(runtime));
        let sim = YarpSim::new(settings, &Context { robot: Arc::new(net::robot()), seed: 1 }).unwrap();
        let _inside = runtime.enter();
        Virtual { runtime, _inside, sim, begun: Instant::now() }
    }
}

impl Bench for Virtual {
    fn connect(&mut self) -> Result<Box<dyn Driver>, String> {
        let (sim, begun) = (&self.sim, self.begun);
        self.runtime.block_on(async {
            loop {
                match sim.connect() {
                    Ok(driver) => return Ok(driver),
                    Err(fault) if begun.elapsed() > Duration::from_secs(100) => return Err(fault.to_string()),
                    Err(_) => tokio::time::sleep(Duration::from_millis(10)).await,
                }
            }
        })
    }

    fn now(&self) -> Time {
        Time(self.begun.elapsed().as_nanos() as u64 + 1_000_000_000)
    }

    fn wait_until(&mut self, then: Time) {
        let pause = then.since(self.now());
        self.runtime.block_on(tokio::time::sleep(pause));
    }
}

#[test]
fn the_robot_behind_a_simulated_wire_keeps_every_promise() {
    assert_eq!(conformance::failures(&mut || Box::new(Virtual::new())), []);
}

/// Boards like iCub_SIM's, whose own moves are as fast as they are far, do what any board can by set-points.
#[test]
fn a_robot_like_icub_sim_keeps_every_promise_by_set_points() {
    let settings = YarpDriverSettings { moves: Moves::SetPoints, ..net::settings() };
    assert_eq!(conformance::failures(&mut || Box::new(Virtual::of(&settings))), []);
}

/// The encoders' noise hides how slowly a motor goes: it counts as moving as long as it was told a speed, and no longer.
#[test]
fn a_motor_that_was_told_a_speed_is_not_done() {
    let mut bench = Virtual::new();
    let mut driver = bench.connect().unwrap();
    let mut seen = Vec::new();
    for k in 0..300 {
        let now = bench.now();
        driver.lease(now, now + Duration::from_millis(500));
        if k % 15 == 0 && k <= 210 {
            let speed = if k < 200 { 0.3_f64.to_radians() } else { 0.0 };
            driver.command(now, &Command::Velocity { motors: vec![3], speed: vec![speed] }).unwrap();
        }
        seen.extend(driver.sample(now).unwrap().map(|sample| (k, sample.done)));
        bench.wait_until(now + Duration::from_millis(10));
    }
    let done = |from: u32, to: u32, motor: usize| {
        let all = seen.iter().filter(|(k, _)| (from..to).contains(k)).map(|(_, done)| done[motor]);
        all.collect::<Vec<_>>()
    };
    assert!(done(20, 200, 3).len() > 80 && !done(20, 200, 3).contains(&true), "{:?}", done(20, 200, 3));
    assert!(done(250, 300, 3).len() > 20 && !done(250, 300, 3).contains(&false));
    assert!(!done(0, 300, 4).contains(&false), "the others rest");
}
