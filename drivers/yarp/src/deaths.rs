//! Tests: death of each task that can stop the robot.

#![allow(clippy::disallowed_methods, reason = "real sockets live in real time")]

use super::crew::poison;
use crate::net::Rig;
use mobee_contract::Hardware;
use std::time::Duration;
use tokio::time::Instant;

/// A task dies while the robot moves under a lease that is renewed. Drivers are notified at once, the robot
/// settles long before its target, and once all tasks are back it moves again.
fn survived(who: &str) {
    // a panic that prints its backtrace holds up its thread for seconds
    std::panic::set_hook(Box::new(|_| {}));
    let rig = Rig::new();
    let mut driver = rig.hardware.connect().unwrap();
    rig.under_way(&mut driver);
    let died = Instant::now();
    poison::kill(who);
    rig.wait(&format!("word of the death of {who}"), |now| {
        driver.lease(now, now + Duration::from_millis(500));
        driver.sample(now).is_err().then_some(())
    });
    let noticed = died.elapsed();
    let rest = rig.rests();
    assert!(rest[0] < 30.0 && rest[2] < 30.0, "{who} died, and the robot went on to {rest:?}");
    let mut driver = rig.wait("all to be back", |_| rig.hardware.connect().ok());
    rig.under_way(&mut driver);
    eprintln!("{who}: drivers heard of it after {noticed:?}; the robot came to rest at {:.1} deg", rest[0]);
}

#[test]
fn a_hand() {
    survived("hand at /two/trunk");
}

#[test]
fn a_reader() {
    survived("reader of /two/arm");
}

#[test]
fn a_connection() {
    survived("connection to /two/trunk");
}

#[test]
fn a_brake() {
    survived("brake of /two/arm");
}

#[test]
fn the_watch_over_the_lease() {
    survived("watch over the lease");
}

#[test]
fn the_thread_of_the_boards() {
    survived("thread yarp two");
}

#[test]
fn the_thread_of_the_brakes() {
    survived("thread yarp stop two");
}
