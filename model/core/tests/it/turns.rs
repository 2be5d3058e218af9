//! Promises: continuous motors take the shorter direction, within their limits; random poses are drawn from one turn.

use mobee_model::{Robot, parse_robot, write_robot};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

fn wheel(degrees: u32, continuous: bool) -> Robot {
    let text = format!(
        "<ZeroPositionKinematicTree robotName=\"wheel\"><bodypart name=\"p\">\
         <motor name=\"w\" minPos=\"-{degrees}\" maxPos=\"{degrees}\" continuous=\"{continuous}\">\
         <joint z=\"1\" minPos=\"-{degrees}\" maxPos=\"{degrees}\"><link x=\"0.1\" radius=\"0.02\"/></joint>\
         </motor></bodypart></ZeroPositionKinematicTree>"
    );
    parse_robot("wheel.xml", &text).unwrap().value
}

fn endless() -> Robot {
    wheel(36_000, true)
}

#[test]
fn from_170_to_minus_170_it_is_20_degrees() {
    let robot = endless();
    let (from, to) = (170_f64.to_radians(), (-170_f64).to_radians());
    assert!((robot.motors[0].way(from, to) - 20_f64.to_radians()).abs() < 1e-12);
    assert!((robot.nearest_equivalent(&[from], &[to])[0] - 190_f64.to_radians()).abs() < 1e-12);
    assert_eq!(robot.motors[0].range(), (-PI, PI));
    let (ended, full) = (wheel(180, false), (-180_f64).to_radians());
    assert!((ended.motors[0].way(from, to) + 340_f64.to_radians()).abs() < 1e-12, "one with an end goes back");
    assert_eq!(ended.motors[0].range(), (full, -full));
}

#[test]
fn a_motor_without_end_survives_a_file() {
    let again = parse_robot("again.xml", &write_robot(&endless())).unwrap();
    assert!(again.warnings.is_empty(), "{:?}", again.warnings);
    assert_eq!(again.value, endless());
}

proptest! {
    #[test]
    fn the_nearest_is_the_same_position_within_the_limits_and_none_is_nearer(from in -700.0..700.0f64, goal in -600.0..600.0f64) {
        let motor = &endless().motors[0];
        let at = motor.nearest_equivalent(from, goal);
        let turns = (at - goal) / TAU;
        prop_assert!((turns - turns.round()).abs() < 1e-9);
        prop_assert!((motor.min..=motor.max).contains(&at));
        for other in [at - TAU, at + TAU] {
            let within = (motor.min..=motor.max).contains(&other);
            prop_assert!(!within || (other - from).abs() >= (at - from).abs() - 1e-9);
        }
    }
}
