//! The same actors, unchanged, in real time: the safety chain on its own thread.

use crate::common::{Trial, ball};
use mobee_actors::clock::ClockKind;
use mobee_actors::system::Reason;
use mobee_contract::Outcome;
use mobee_model::ObjectClass;

#[test]
fn a_motion_into_an_obstacle_is_rolled_back_in_real_time() {
    let objects = vec![ball("ball", [0.5, 0.25, 0.2], ObjectClass::Obstacle)];
    let poses = vec![[60.0, 0.0, 0.0], [-5.0, 0.0, 0.0]];
    let ran = Trial { objects, poses, speed: 0.2, clock: ClockKind::Real, ..Trial::default() }.run();
    assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
    assert_eq!(ran.end.counts.commits, 2, "{}", ran.lines());
    assert!(ran.outcomes().contains(&Outcome::RolledBack), "{}", ran.lines());
}
