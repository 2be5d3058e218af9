//! The driver of robots behind YARP keeps every promise of the driver contract in virtual time, too: it is the one that torture lets loose
//! on wires that are slow, lossy and lying.

use crate::net;
use mobee_contract::{Context, Driver, Hardware, Time};
use mobee_drivers::YarpSim;
use mobee_drivers::conformance::{self, Bench};
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
        let runtime = Builder::new_current_thread().enable_all().start_paused(true).build().unwrap();
        let runtime: &'static Runtime = Box::leak(Box::new(runtime));
        let sim = YarpSim::new(&net::settings(), &Context { robot: Arc::new(net::robot()), seed: 1 }).unwrap();
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
