//! A long run in virtual time ends with every reading handled. It ends when its poses or its time are used up.

use crate::common::Trial;
use mobee_runtime::system::Reason;
use std::time::Duration;

#[test]
fn ten_simulated_minutes_lose_no_reading() {
    let poses = [[30.0, 20.0, 10.0], [-30.0, -20.0, -10.0]].repeat(200);
    let limit = Duration::from_secs(600);
    let ran = Trial { poses, speed: 0.2, limit, ..Trial::default() }.run();
    assert!(matches!(ran.end.reason, Reason::Time | Reason::Done));
    assert!(ran.end.counts.samples as f64 >= ran.end.ended_at.secs() * 99.0);
    assert_eq!(ran.violations(), []);
    eprintln!("{} readings in {}", ran.end.counts.samples, ran.end.ended_at);
}
