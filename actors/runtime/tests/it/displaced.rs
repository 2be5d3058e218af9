//! A robot that is not where it should be: a motor that gives way at rest, and one whose encoder says what no robot can.

use crate::common::Trial;
use mobee_contract::{Cause, Event, Hold, Status, Time};
use mobee_runtime::system::Reason;
use mobee_sim::Fault;
use std::time::Duration;

/// Waits for two seconds between its motions; nothing else happens to it.
fn trial() -> Trial {
    let poses = vec![[10.0, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
    Trial { poses, pause: Duration::from_secs(2), ..Trial::default() }
}

fn between(from: f64, until: f64) -> (Time, Time) {
    (Time::from_secs(from), Time::from_secs(until))
}

#[test]
fn a_motor_that_gives_way_at_rest_closes_the_filter_until_it_rests() {
    let ran = trial().run_with(|faults| {
        let (from, until) = between(1.5, 2.1);
        faults.plan(Fault::Sag { motor: 1, speed: 0.1 }, from, until);
    });
    let closed =
        |e: &Event| matches!(e, Event::Disabled { cause: Cause::Displaced { motor, .. }, .. } if motor == "elbow");
    let holds = |e: &Event| matches!(e, Event::State { status: Status::Holding(Hold::Displaced), .. });
    assert!(
        ran.events().iter().any(|(_, e)| closed(e)) && ran.events().iter().any(|(_, e)| holds(e)),
        "{}",
        ran.lines()
    );
    assert!(ran.end.counts.displaced >= 1, "{}", ran.end.counts.displaced);
    // it goes on from where it then rests
    assert_eq!((ran.end.reason, ran.end.counts.committed), (Reason::Done, 3), "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

#[test]
fn a_reading_that_no_robot_can_have_is_a_fault_with_a_name() {
    let ran = trial().run_with(|faults| {
        let (from, until) = between(1.5, 2.5);
        faults.plan(Fault::Offset { motor: 2, by: 2.2 }, from, until);
    });
    let told: Vec<String> = ran
        .events()
        .iter()
        .filter_map(|(_, e)| match &**e {
            Event::Disabled { cause: Cause::BoardFault(what), .. } => Some(what.clone()),
            _ => None,
        })
        .collect();
    assert!(
        matches!(&told[..], [what] if what.contains("wrist reads 126.") && what.contains("calibrate")),
        "once: {told:?}"
    );
    assert_eq!((ran.end.reason, ran.end.counts.committed), (Reason::Done, 3), "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}
