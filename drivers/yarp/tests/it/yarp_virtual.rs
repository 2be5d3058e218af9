//! The driver of robots behind YARP keeps every promise of the driver contract in virtual time, too: it is the one that torture lets loose
//! on wires that are slow, lossy and lying.

#![allow(clippy::disallowed_methods, reason = "the clock of a paused runtime is a virtual one")]

use crate::net;
use mobee_conformance::Bench;
use mobee_contract::{Command, Context, Driver, DriverFault, Hardware, Move, Time};
use mobee_driver_yarp::{Moves, YarpDriverSettings, YarpSim};
use mobee_sim::Imitated;
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
        let context = Context { robot: Arc::new(net::robot()), seed: 1 };
        Virtual::with(YarpSim::new(settings, &context).unwrap())
    }

    /// Boards whose reference speeds are gains.
    fn like_icub_sim(settings: &YarpDriverSettings) -> Virtual {
        let context = Context { robot: Arc::new(net::robot()), seed: 1 };
        Virtual::with(YarpSim::with_boards(settings, &context, Some(Imitated::ICubSim)).unwrap())
    }

    fn with(sim: YarpSim) -> Virtual {
        let runtime = Builder::new_current_thread().enable_all().start_paused(true).build().unwrap();
        let runtime: &'static Runtime = Box::leak(Box::new(runtime));
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
    assert_eq!(mobee_conformance::failures(&mut || Box::new(Virtual::new())), []);
}

/// Boards count meters where a motor slides. A factor of a thousand anywhere, in a reading, a move, a set-point, a velocity, a limit or a
/// reference, would break one promise or another; by moves of the boards and by set-points.
#[test]
fn a_robot_that_slides_keeps_every_promise() {
    for moves in [Moves::Position, Moves::SetPoints] {
        let (mut robot, settings) = net::sliding();
        // the suite goes to both limits at 10 mm/s, and waits half a minute for it
        (robot.motors[0].min, robot.motors[0].max) = (-60_f64.to_radians(), 60_f64.to_radians());
        let settings = YarpDriverSettings { moves, ..settings };
        let context = Context { robot: Arc::new(robot), seed: 1 };
        let bench = || Virtual::with(YarpSim::with_boards(&settings, &context, None).unwrap());
        assert_eq!(mobee_conformance::failures(&mut || Box::new(bench())), []);
    }
}

/// Boards like iCub_SIM's, whose own moves are as fast as they are far, do what any board can by set-points.
#[test]
fn a_robot_like_icub_sim_keeps_every_promise_by_set_points() {
    let settings = YarpDriverSettings { moves: Moves::SetPoints, ..net::settings() };
    assert_eq!(mobee_conformance::failures(&mut || Box::new(Virtual::of(&settings))), []);
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

/// Moves the trunk's elbow between two places, each time as long as it takes; what the driver complains of, and how long each move took, s.
fn back_and_forth(bench: &mut Virtual, driver: &mut dyn Driver, moves: usize) -> (Vec<String>, Vec<f64>) {
    let (mut faults, mut took) = (Vec::new(), Vec::new());
    for to in [65.0, 60.0_f64].into_iter().cycle().take(moves) {
        let begun = bench.now();
        let speed = Some(vec![10_f64.to_radians()]);
        let one = Move { motors: vec![1], q: vec![to.to_radians()], relative: false, speed, acceleration: None };
        driver.lease(begun, begun + Duration::from_secs(1));
        if let Err(DriverFault::Hardware(fault)) = driver.command(begun, &Command::Move(one)) {
            faults.push(fault);
        }
        let rests = |bench: &mut Virtual, driver: &mut dyn Driver| loop {
            let now = bench.now();
            driver.lease(now, now + Duration::from_secs(1));
            match driver.sample(now) {
                Ok(Some(sample)) if now > begun + Duration::from_millis(200) && !sample.done.contains(&false) => {
                    break Ok(now.since(begun).as_secs_f64());
                }
                Ok(_) => {}
                Err(fault) => break Err(fault.to_string()),
            }
            bench.wait_until(now + Duration::from_millis(5));
        };
        match rests(bench, driver) {
            Ok(secs) => took.push(secs),
            Err(fault) => faults.push(fault),
        }
        let now = bench.now();
        driver.command(now, &Command::Stop { motors: vec![] }).unwrap();
        bench.wait_until(now + Duration::from_secs(2));
        faults.extend(driver.sample(bench.now()).err().map(|fault| fault.to_string()));
    }
    (faults, took)
}

/// Reference speeds that are gains are noticed within a few moves, said once, and set-points take their place.
#[test]
fn moves_change_over_to_set_points_where_reference_speeds_mean_no_speeds() {
    let mut bench = Virtual::like_icub_sim(&net::settings());
    let mut driver = bench.connect().unwrap();
    assert!(!driver.leads());
    // the first way is a long one, and stopped again and again: it is much too fast
    let (faults, _) = back_and_forth(&mut bench, driver.as_mut(), 8);
    let fast = faults.iter().filter(|what| what.contains("end the program")).count();
    assert!((1..=6).contains(&fast) && fast == faults.len(), "twice for each of three moves: {faults:?}");
    let news = driver.news().unwrap();
    assert!(news.contains("/two/trunk moved at 2.6 to 3.") && news.contains("set-points from now on"), "{news}");
    assert_eq!(driver.news(), None, "it is said once");
    assert!(driver.leads(), "moves are its own now");
    let (faults, took) = back_and_forth(&mut bench, driver.as_mut(), 4);
    assert_eq!(faults, Vec::<String>::new());
    // five degrees at four fifths of ten a second
    assert!(took.len() == 4 && took.iter().all(|s| (0.6..1.3).contains(s)), "{took:?}");
    drop(driver);
    assert!(bench.connect().unwrap().leads(), "who connects anew need not find out again");
}

/// Where set-points can't be had, nothing moves that nobody can lead.
#[test]
fn moves_are_refused_where_neither_speeds_nor_set_points_can_be_had() {
    let settings = YarpDriverSettings { position_direct: false, ..net::settings() };
    let mut bench = Virtual::like_icub_sim(&settings);
    let mut driver = bench.connect().unwrap();
    let (faults, took) = back_and_forth(&mut bench, driver.as_mut(), 8);
    let refused = faults.iter().rev().take_while(|what| what.contains("without position_direct")).count();
    assert!(!driver.leads() && refused >= 4 && took.len() >= refused - 1, "{took:?} {faults:?}");
}

/// Boards that go by speeds are believed, however they ease in and out.
#[test]
fn boards_that_go_by_speeds_are_left_to_make_their_moves() {
    let mut bench = Virtual::new();
    let mut driver = bench.connect().unwrap();
    let (faults, took) = back_and_forth(&mut bench, driver.as_mut(), 10);
    assert_eq!((faults, took.len(), driver.leads()), (vec![], 10, false));
}
