//! Something that no model knows holds a motor in mid-motion.

use crate::common::{Ran, Trial};
use mobee_contract::{Cause, Event, Hold, Outcome, Status, Time};
use mobee_runtime::system::Reason;
use mobee_sim::Fault;
use std::time::Duration;

fn trial(stall_deg: Option<f64>) -> Trial {
    let poses = vec![[60.0, 40.0, -30.0], [0.0, 0.0, 0.0], [-40.0, -30.0, 20.0], [0.0, 0.0, 0.0]];
    Trial { poses, stall_deg, ..Trial::default() }
}

/// Holds a motor from its first motion after `at` on, for so long.
fn held(trial: Trial, motor: usize, at: f64, secs: f64) -> Ran {
    trial.run_with(|faults| {
        let fault = Fault::Blocked { motor, after: Duration::from_millis(300) };
        faults.plan(fault, Time::from_secs(at), Time::from_secs(at + secs));
    })
}

fn stalls(ran: &Ran) -> Vec<(Time, String)> {
    let of = |(at, e): &(Time, std::sync::Arc<Event>)| match &**e {
        Event::Disabled { cause: Cause::Stall { motor, .. }, .. } => Some((*at, motor.clone())),
        _ => None,
    };
    ran.events().iter().filter_map(of).collect()
}

#[test]
fn a_motor_that_is_held_closes_the_filter_and_is_taken_back() {
    for (motor, name) in ["pan", "elbow", "wrist"].into_iter().enumerate() {
        let ran = held(trial(Some(0.5)), motor, 0.2, 4.0);
        let stalls = stalls(&ran);
        assert!(stalls.len() == 1 && stalls[0].1 == name, "{stalls:?}\n{}", ran.lines());
        assert_eq!(ran.outcomes()[0], Outcome::RolledBack, "{}", ran.lines());
        // the other motions lead elsewhere, or come when it is over
        assert_eq!((ran.end.reason, ran.end.counts.rolled_back), (Reason::Done, 1), "{}", ran.lines());
        assert_eq!(ran.violations(), [], "{}", ran.lines());
    }
}

#[test]
fn without_the_setting_it_is_pushed_on_until_the_board_says_that_it_is_done() {
    let ran = held(trial(None), 0, 0.2, 4.0);
    assert_eq!(stalls(&ran), []);
    let cause = ran.events().iter().find_map(|(at, e)| match &**e {
        Event::Disabled { cause, .. } => Some((*at, cause.clone())),
        _ => None,
    });
    let quick = stalls(&held(trial(Some(0.5)), 0, 0.2, 4.0))[0].0;
    assert!(
        matches!(cause, Some((at, Cause::TargetMissed)) if at > quick + Duration::from_secs(1)),
        "{cause:?}, {quick}"
    );
}

#[test]
fn motions_that_nothing_holds_are_not_stopped() {
    for speed in [0.02, 0.1, 0.5, 1.0] {
        let ran = Trial { speed, limit: Duration::from_secs(400), ..trial(Some(0.2)) }.run();
        assert_eq!((ran.end.counts.committed, ran.end.counts.rolled_back), (4, 0), "{speed}: {}", ran.lines());
    }
}

/// What holds a motor on its way back as well leaves the robot where it is, and says so: the retreat was not followed.
#[test]
fn a_retreat_that_is_held_stops_and_holds() {
    let ran = trial(Some(0.5)).run_with(|faults| {
        let fault = |after| Fault::Blocked { motor: 0, after: Duration::from_millis(after) };
        let until = Time::from_secs(20.0);
        faults.plan(fault(300), Time::from_secs(0.2), Time::from_secs(1.35));
        // from the retreat's beginning on
        faults.plan(fault(50), Time::from_secs(1.4), until);
    });
    let holds = |e: &Event| matches!(e, Event::State { status: Status::Holding(Hold::RetreatMissed), .. });
    assert!(!stalls(&ran).is_empty(), "{}", ran.lines());
    assert!(ran.events().iter().any(|(_, e)| holds(e)), "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

/// What stopped it is gone: it is told of, so that a false stop is known as one.
#[test]
fn a_motor_that_passes_where_it_stalled_is_told_of() {
    let again = vec![[60.0, 40.0, -30.0], [60.0, 40.0, -30.0]];
    let ran = held(Trial { poses: again, pause: Duration::from_secs(5), ..trial(Some(0.5)) }, 1, 0.2, 4.0);
    let told = |e: &Event| matches!(e, Event::Warning { text } if text.contains("elbow passes where it stalled"));
    assert_eq!(ran.outcomes(), [Outcome::RolledBack, Outcome::Committed], "{}", ran.lines());
    assert_eq!(ran.events().iter().filter(|(_, e)| told(e)).count(), 1, "{}", ran.lines());
}
