//! A way back whose robot is held up.

use super::retreat::Retreat;
use crate::controller::Rules;
use crate::convoy::tests::{PERIOD, recorded, rules};
use crate::convoy::{Answer, Convoy};
use mobee_contract::{Command, Sample, Time};
use std::sync::Arc;

/// A way of 90 degrees at 30 deg/s, backwards.
fn way_back(rules: &Arc<Rules>) -> (Convoy, Retreat) {
    let (convoy, now) = (Convoy::default(), Time::from_secs(5.0));
    convoy.enroll(recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (4.0, 90.0), (5.0, 90.0)], 0.5), now);
    let Answer::Go(way) = convoy.ask(0, now) else { panic!("there is a way") };
    (convoy, Retreat::new(0, way, rules, now))
}

/// The greatest way between what is written and where the robot is, degrees, until it is back, and how long it was waited for at
/// most; it does not move between these times, s.
fn apart(stands: (f64, f64)) -> (f64, f64) {
    let rules = rules(true);
    let (convoy, mut retreat) = way_back(&rules);
    let (mut now, mut q, mut apart, mut waited) = (Time::from_secs(5.0), 90_f64.to_radians(), 0.0_f64, 0.0_f64);
    for seq in 0..1000 {
        now = now + PERIOD;
        let held = (stands.0..stands.1).contains(&now.secs());
        let sample = Sample { seq, at: now, q: vec![q].into(), done: vec![false] };
        let Ok(command) = retreat.step(&convoy, &sample, now, &rules) else { panic!("nobody was lost") };
        if let Some(Command::Direct { q: to, .. }) = command {
            apart = apart.max((to[0] - q).abs().to_degrees());
            q = if held { q } else { to[0] };
        }
        waited = waited.max(retreat.waits(now).as_secs_f64());
        if retreat.is_over() {
            assert!(q.abs() < 1e-9, "it is back");
            return (apart, waited);
        }
    }
    (apart, waited)
}

#[test]
fn a_robot_that_is_held_up_is_waited_for_and_never_gone_after_straight() {
    assert!(apart((0.0, 0.0)).0 < 0.5);
    let (far, waited) = apart((6.0, 7.0));
    assert!(far < 2.5, "it was sent {far:.1} degrees in one step");
    assert!((0.8..1.0).contains(&waited), "it was waited for {waited} s");
    let (far, waited) = apart((6.0, 100.0));
    assert!(far < 2.5 && waited > 5.0, "{far:.1} degrees, {waited} s");
}
