//! Stops of boards that answer late or do not obey at once, and readings that are older than they look.

#![allow(clippy::disallowed_methods, reason = "real sockets live in real time")]

use crate::net::Rig;
use mobee_conformance::{Lateness, beside};
use mobee_contract::{Command, Driver, DriverFault, Hardware, Sample};
use mobee_yarp::board::Set;
use mobee_yarp::{Bottle, Carrier, Dialect, RpcClient};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::SeqCst;
use std::time::Duration;
use tokio::time::Instant;

const STOP: Command = Command::Stop { motors: Vec::new() };
const TRUNK: usize = 0;

/// The threads that a stop wakes up on its way: the driver's, the board's, and the one that looks whether it has come.
const WAKINGS: u32 = 3;

/// How long a stop takes from the driver to the board while the board answers an order, and what is left of that beside a control, ms;
/// the medians of some.
fn stop_latency(late_ms: u64) -> (f64, f64) {
    let robot = Rig::new();
    let trunk = &robot.net.ways[TRUNK];
    let mut driver = robot.hardware.connect().unwrap();
    trunk.late.store(late_ms, SeqCst);
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    let stop = |_| {
        let (took, late) = one_stop(&robot, &mut driver);
        (ms(took), ms(late.apart_from(took, WAKINGS)))
    };
    let (took, left): (Vec<f64>, Vec<f64>) = (0..7).map(stop).unzip();
    let median = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    (median(took), median(left))
}

fn one_stop(robot: &Rig, driver: &mut Box<dyn Driver>) -> (Duration, Lateness) {
    let trunk = &robot.net.ways[TRUNK];
    robot.reading(driver, "rest", |s| s.done.iter().all(|d| *d));
    let begun = Instant::now();
    let target = if robot.net.truth()[0] > 0.0 { -30.0 } else { 30.0 };
    driver.command(robot.now(), &robot.yaw(target, 10.0)).unwrap();
    let refers = |(_, set): &(Instant, Set)| matches!(set, Set::Speed(..));
    robot.keep(driver, "the order under way", |_| trunk.since(begun).iter().any(refers).then_some(()));
    beside(|| {
        let told = Instant::now();
        driver.command(robot.now(), &STOP).unwrap();
        robot.keep(driver, "the stop", |_| trunk.stopped(told)).duration_since(told)
    })
}

#[test]
fn a_stop_does_not_wait_for_the_answer_that_is_under_way() {
    for late in [0, 100, 200] {
        let (took, left) = stop_latency(late);
        let what = format!(
            "a board that answers in {late} ms hears a stop after {took:.1} ms, {left:.1} ms without the machine's share"
        );
        eprintln!("{what}");
        assert!(left < 50.0, "{what}");
    }
}

#[test]
fn a_stop_without_effect_is_said_again() {
    let robot = Rig::new();
    let mut driver = robot.hardware.connect().unwrap();
    robot.under_way(&mut driver);
    robot.net.ways.iter().for_each(|way| way.deaf.store(5, SeqCst));
    driver.command(robot.now(), &STOP).unwrap();
    let rest = robot.reading(&mut driver, "rest", |s| s.done.iter().all(|d| *d));
    assert!(rest.q[0].to_degrees() < 40.0, "it went on to its target: {:?}", rest.q);
}

/// The age of a reading, s, by a motor that moves at 10 deg/s.
fn age(robot: &Rig, sample: &Sample) -> f64 {
    robot.now().since(sample.at).as_secs_f64()
}

#[test]
fn a_steady_delay_is_no_offset_of_a_clock() {
    let robot = Rig::new();
    let mut driver = robot.hardware.connect().unwrap();
    robot.reading(&mut driver, "a reading", |s| age(&robot, s) < 0.1);
    robot.net.ways.iter().for_each(|way| way.old.store(900, SeqCst));
    robot.reading(&mut driver, "a late reading", |s| age(&robot, s) > 0.5);
    // and it stays late, for longer than it takes to believe in another clock
    let end = Instant::now() + Duration::from_secs(2);
    while Instant::now() < end {
        let late = robot.reading(&mut driver, "a late reading", |_| true);
        assert!(age(&robot, &late) > 0.5, "a reading of 0.9 s ago counts as {:.3} s old", age(&robot, &late));
    }
}

#[test]
fn references_that_somebody_else_sets_meanwhile_are_seen_before_the_move() {
    let robot = Rig::new();
    let mut driver = robot.hardware.connect().unwrap();
    robot.reading(&mut driver, "a reading", |_| true);
    let (address, over) = (robot.net.network(), AtomicBool::new(false));
    let rounds: Vec<Round> = std::thread::scope(|scope| {
        scope.spawn(|| {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(async {
                let mut line = RpcClient::connect(&address, "/other", "/two/trunk/rpc:i", Carrier::Tcp).await.unwrap();
                let fast = Bottle::parse("[set] [vels] (100.0 100.0)", Dialect::V3).unwrap();
                while !over.load(SeqCst) {
                    line.call(&fast).await.unwrap();
                }
            });
        });
        let _over = Over(&over);
        (0..6).map(|_| round(&robot, &mut driver)).collect()
    });
    eprintln!("{rounds:?}");
    for round in &rounds {
        match round {
            Round::Told(why) => assert!(why.contains("end th"), "no remedy: {why}"),
            Round::Arrived(secs) => assert!(*secs > 1.5, "told to go at 10 deg/s it was there after {secs:.1} s"),
        }
    }
    assert!(rounds.iter().any(|round| matches!(round, Round::Told(_))), "nobody noticed");
}

/// Ends the other program, even if the test fails.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, SeqCst);
    }
}

/// What became of a move at 10 deg/s to the other side: a round whose move was not made leaves the trunk where it was.
#[derive(Debug)]
enum Round {
    Told(String),
    Arrived(f64),
}

fn round(robot: &Rig, driver: &mut Box<dyn Driver>) -> Round {
    let to = if robot.net.truth()[0] > 0.0 { -40.0 } else { 40.0 };
    let (begun, now) = (Instant::now(), robot.now());
    driver.lease(now, now + Duration::from_millis(500));
    driver.command(now, &robot.yaw(to, 10.0)).unwrap();
    let round = robot.wait("an end of the move", |now| {
        driver.lease(now, now + Duration::from_millis(500));
        match driver.sample(now) {
            Err(DriverFault::Hardware(why) | DriverFault::TooFast(why)) => Some(Round::Told(why)),
            Err(other) => panic!("{other}"),
            Ok(sample) => {
                let there = sample.is_some_and(|s| (s.q[0].to_degrees() - to).abs() < 0.5);
                there.then(|| Round::Arrived(begun.elapsed().as_secs_f64()))
            }
        }
    });
    let _ = driver.command(robot.now(), &STOP);
    robot.rests();
    // what was told of the braking is heard
    let _ = driver.sample(robot.now());
    round
}
