//! I2: every accepted commit has exactly one outcome, and the safe pose is where the robot rests after a rollback (I3).

use crate::common::{Trial, ball};
use mobee_contract::{Outcome, Time};
use mobee_model::ObjectClass;
use mobee_runtime::system::{Control, Reason};
use mobee_sim::Fault;
use std::time::Duration;

#[test]
fn free_motions_are_committed() {
    let ran = Trial::default().run();
    assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
    assert_eq!(ran.outcomes(), [Outcome::Committed, Outcome::Committed], "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

#[test]
fn a_motion_into_an_obstacle_is_rolled_back() {
    let objects = vec![ball("ball", [0.0, 0.5, 0.2], ObjectClass::Obstacle)];
    let poses = vec![[30.0, 0.0, 0.0], [150.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
    let ran = Trial { objects, poses, speed: 0.1, ..Trial::default() }.run();
    assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
    assert_eq!(ran.outcomes(), [Outcome::Committed, Outcome::RolledBack, Outcome::Committed], "{}", ran.lines());
    assert_eq!(ran.end.counts.hard_contacts, 0);
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

#[test]
fn a_stop_ends_the_motion_with_an_outcome_at_rest() {
    let controls = vec![(Duration::from_millis(900), Control::Stop)];
    let ran = Trial { controls, poses: vec![[90.0, 0.0, 0.0]], ..Trial::default() }.run();
    assert_eq!(ran.end.reason, Reason::Interrupted);
    assert_eq!(ran.outcomes().len(), 1, "{}", ran.lines());
    let speeds = ran.hardware.speeds(ran.end.ended_at.max(Time::ZERO));
    assert!(speeds.iter().all(|v| *v == 0.0), "{speeds:?}");
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

#[test]
fn nobody_waits_at_the_end_for_a_robot_that_says_nothing() {
    let controls = vec![(Duration::from_secs(2), Control::Stop)];
    let trial = Trial { controls, poses: vec![[90.0, 0.0, 0.0]], ..Trial::default() };
    let ran = trial.run_with(|faults| {
        faults.plan(Fault::Silent, Time::from_secs(1.0), Time(u64::MAX));
    });
    assert_eq!(ran.outcomes().len(), 1, "{}", ran.lines());
    let ended = ran.end.ended_at.secs();
    assert!((4.0..4.7).contains(&ended), "{ended} s\n{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

#[test]
fn a_motion_that_outlasts_the_history_takes_its_safe_pose_along() {
    let objects = vec![ball("ball", [0.0, 0.5, 0.2], ObjectClass::Obstacle)];
    let poses = vec![[150.0, 0.0, 0.0]];
    let ran = Trial { objects, poses, speed: 0.1, history: 300, ..Trial::default() }.run();
    assert_eq!(ran.outcomes(), [Outcome::RolledBack], "{}", ran.lines());
    assert!(ran.lines().contains("SafePoseMoved"));
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}
