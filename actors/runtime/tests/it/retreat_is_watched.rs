//! I9: an obstacle that appears during the retreat stops the retreat at once; the robot holds, and gets out by an escape.

use crate::common::{Ran, Trial, ball};
use mobee_contract::{Event, Hold, Outcome, Status};
use mobee_model::{Edit, ObjectClass};
use mobee_runtime::system::{Control, Reason};
use std::time::Duration;

/// The first ball ends the motion at about 8.5 s; the second is put behind the arm while it goes back.
fn blocked(more: Vec<(Duration, Control)>) -> Ran {
    let objects = vec![ball("first", [0.0, 0.5, 0.2], ObjectClass::Obstacle)];
    let mut controls = Vec::new();
    let put = Edit::Add(ball("second", [0.5, 0.12, 0.2], ObjectClass::Obstacle));
    controls.push((Duration::from_millis(15_500), Control::Edit(put)));
    controls.extend(more);
    let poses = vec![[150.0, 0.0, 0.0], [60.0, 0.0, 0.0]];
    Trial { objects, poses, speed: 0.1, controls, ..Trial::default() }.run()
}

#[test]
fn a_blocked_retreat_stops_and_holds() {
    let ran = blocked(Vec::new());
    let held = |e: &Event| matches!(e, Event::State { status: Status::Holding(Hold::RetreatBlocked), .. });
    assert!(ran.events().iter().any(|(_, e)| held(e)), "{}", ran.lines());
    assert_eq!(ran.outcomes().first(), Some(&Outcome::Faulted), "{}", ran.lines());
    assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
    assert_eq!(ran.end.counts.hard_contacts, 0, "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}
