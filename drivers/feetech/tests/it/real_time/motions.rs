//! Motions, stops and cycle times at the wire's own pace.

use crate::arm::Arm;
use mobee_contract::{Command, Driver, Move};
use std::time::Duration;

/// One count, rad.
const COUNT: f64 = std::f64::consts::TAU / 4095.0;

fn to(driver: &mut dyn Driver, arm: &Arm, q: &[f64], speed: f64) {
    let motors: Vec<usize> = (0..q.len()).collect();
    let now = arm.now();
    driver.lease(now, now + Duration::from_millis(200));
    let go = Move { speed: Some(vec![speed; q.len()]), acceleration: None, motors, q: q.to_vec(), relative: false };
    driver.command(now, &Command::Move(go)).expect("a move");
}

/// At the wire's own pace a cycle takes a third of its period, nothing is lost, and nothing that a servo stores is written.
#[test]
fn cycles_fit_their_period() {
    let arm = Arm::new();
    let mut driver = arm.connect();
    let mut home = arm.until_done(driver.as_mut()).pop().unwrap().q.to_vec();
    for q in [0.3, -0.3, 0.3, 0.0] {
        home[..5].fill(q);
        to(driver.as_mut(), &arm, &home, 0.8);
        let last = arm.until_done(driver.as_mut()).pop().unwrap();
        assert!(last.q.iter().zip(&home).all(|(a, b)| (a - b).abs() <= 2.0 * COUNT), "{:?}", last.q);
    }
    let cycles = arm.hardware.cycles();
    println!("{cycles:?}");
    assert!(cycles.cycles > 200 && cycles.median < Duration::from_millis(8), "{cycles:?}");
    assert_eq!(arm.terminal.with(|world| world.servos().map(|s| s.stored_writes).sum::<u64>()), 0);
}

/// A stop at full speed: the joint goes on for the braking path, the lag and one period; and a loaded joint does not sink while it holds.
#[test]
fn a_stop_is_short_and_a_loaded_joint_holds() {
    let arm = Arm::new();
    arm.terminal.with(|world| world.servo(1).unwrap().sag = 20.0);
    let mut driver = arm.connect();
    let start = arm.until_done(driver.as_mut()).pop().unwrap().q.to_vec();
    let mut there = start.clone();
    there[0] = 0.5;
    to(driver.as_mut(), &arm, &there, 10.0);
    let at = arm.until(driver.as_mut(), Duration::from_secs(5), |read| read.unwrap().filter(|s| s.q[0] > 0.2));
    let at = at.expect("under way").q[0];
    let now = arm.now();
    driver.command(now, &Command::Stop { motors: vec![] }).unwrap();
    let rest = arm.until_done(driver.as_mut()).pop().unwrap().q[0];
    println!("stop distance {:.2} deg", (rest - at).to_degrees());
    // v^2 / 2a = 4.5 deg at 60 deg/s, lag 0.03 s and two periods
    assert!((rest - at).to_degrees() < 8.5, "{:.2} deg", (rest - at).to_degrees());
    let mut lowest = rest;
    for _ in 0..20 {
        driver.command(arm.now(), &Command::Stop { motors: vec![] }).unwrap();
        arm.until(driver.as_mut(), Duration::from_millis(100), |read| {
            lowest = read.unwrap().map_or(lowest, |s| lowest.min(s.q[0]));
            None::<()>
        });
    }
    assert!(rest - lowest <= 2.0 * COUNT, "it sank by {:.2} deg", (rest - lowest).to_degrees());
}

/// A blocked joint is pushed with no more than the lead: no overload, and the load shows as a torque from outside.
#[test]
fn a_blocked_motion_pushes_no_harder_than_the_lead() {
    let arm = Arm::new();
    arm.terminal.with(|world| world.servo(1).unwrap().block = Some(2150.0));
    let mut driver = arm.connect();
    let mut there = arm.until_done(driver.as_mut()).pop().unwrap().q.to_vec();
    there[0] = 0.5;
    to(driver.as_mut(), &arm, &there, 0.5);
    let mut most = 0.0f64;
    arm.until(driver.as_mut(), Duration::from_secs(4), |read| {
        most = read.expect("no fault").map_or(most, |s| most.max(-s.external[0]));
        None::<()>
    });
    let (load, ahead) = arm.terminal.with(|world| {
        let servo = world.servo(1).unwrap();
        (servo.load(), f64::from(servo.goal()) - servo.position())
    });
    println!("load {load:.0}/1000, goal ahead by {:.2} deg, torque {most:.2} N m", ahead * COUNT.to_degrees());
    assert!(ahead * COUNT.to_degrees() <= 3.1 && load < 300.0 && most > 0.5, "{ahead} counts, {load}, {most} N m");
    // a stop leaves it where it is, though its trajectory was fast
    driver.command(arm.now(), &Command::Stop { motors: vec![] }).unwrap();
    let sample = arm.until_done(driver.as_mut()).pop().unwrap();
    assert!(sample.done[0]);
    // and it leaves what blocked it
    there[0] = 0.0;
    to(driver.as_mut(), &arm, &there, 0.5);
    arm.until(driver.as_mut(), Duration::from_millis(1500), |_| None::<()>);
    let servo = arm.terminal.with(|world| world.servo(1).unwrap().clone());
    println!(
        "goal {}, position {:.2}, load {:.0}, status {}",
        servo.goal(),
        servo.position(),
        servo.load(),
        servo.status()
    );
    assert!((servo.position() - 2048.0).abs() < 3.0, "{} counts", servo.position());
}
