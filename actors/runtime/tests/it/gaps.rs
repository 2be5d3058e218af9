//! Gaps in the readings, in mid-motion: the history bridges short ones by the commanded path, so that a contact afterwards is rolled back.

use crate::common::{Ran, Trial, ball};
use mobee_contract::{Event, Hold, Outcome, Status, Time};
use mobee_model::ObjectClass;
use mobee_runtime::system::Reason;
use mobee_sim::Fault;
use std::time::Duration;

/// Two motions of the first motor, the second one through a ball, if it is there. In that motion readings are missing for `gap` seconds.
fn trial(gap: f64, objects: bool, stall_deg: Option<f64>) -> Ran {
    let ball = ball("ball", [0.0, 0.5, 0.2], ObjectClass::Obstacle);
    let objects = if objects { vec![ball] } else { Vec::new() };
    let poses = vec![[-90.0, 0.0, 0.0], [150.0, 0.0, 0.0]];
    let limit = Duration::from_secs(30);
    let pause = Duration::from_secs(3);
    let trial = Trial { objects, poses, pause, speed: 0.5, stale_s: Some(1.0), stall_deg, limit, ..Trial::default() };
    trial.run_driven(|hardware| {
        let begins = in_second_motion(stall_deg);
        hardware.faults().plan(Fault::Silent, begins, begins + Duration::from_secs_f64(gap));
        Vec::new()
    })
}

/// Three seconds after the second motion of a run without any fault has begun.
fn in_second_motion(stall_deg: Option<f64>) -> Time {
    let poses = vec![[-90.0, 0.0, 0.0], [150.0, 0.0, 0.0]];
    let pause = Duration::from_secs(3);
    let ran = Trial { poses, pause, speed: 0.5, stale_s: Some(1.0), stall_deg, ..Trial::default() }.run();
    let begins = |(at, e): &(Time, std::sync::Arc<Event>)| matches!(**e, Event::Commit { .. }).then_some(*at);
    ran.events().iter().filter_map(begins).nth(1).expect("a second motion") + Duration::from_secs(3)
}

fn bridged(ran: &Ran) -> Vec<f64> {
    let secs = |e: &Event| match e {
        Event::Bridged { since, until, .. } => Some(until.since(*since).as_secs_f64()),
        _ => None,
    };
    ran.events().iter().filter_map(|(_, e)| secs(e)).collect()
}

#[test]
fn a_contact_after_a_bridged_gap_is_rolled_back() {
    let ran = trial(0.3, true, None);
    assert!(matches!(bridged(&ran).as_slice(), [secs] if (0.3..0.35).contains(secs)), "{}", ran.lines());
    assert_eq!(ran.outcomes()[..2], [Outcome::Committed, Outcome::RolledBack], "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

/// Beyond half a second, nothing is assumed of the path: the robot holds where it was stopped.
#[test]
fn a_contact_after_a_longer_gap_holds_the_robot() {
    let ran = trial(0.6, true, None);
    let holds = |e: &Event| matches!(e, Event::State { status: Status::Holding(Hold::HistoryTooShort), .. });
    assert_eq!(bridged(&ran), [0.0; 0], "{}", ran.lines());
    assert_eq!(ran.outcomes()[..2], [Outcome::Committed, Outcome::Faulted], "{}", ran.lines());
    assert!(ran.events().iter().any(|(_, e)| holds(e)), "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

/// The gap alone changes nothing, and is not taken for a stall.
#[test]
fn a_motion_with_a_gap_ends_at_its_target() {
    let ran = trial(0.3, false, Some(0.5));
    assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
    assert_eq!(ran.outcomes(), [Outcome::Committed; 2], "{}", ran.lines());
    assert_eq!((bridged(&ran).len(), ran.violations()), (1, vec![]), "{}", ran.lines());
}
