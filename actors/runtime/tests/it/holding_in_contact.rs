//! Something is put onto the resting robot: it holds, and gets away by escapes that only lessen the contact.

use crate::common::{Trial, ball};
use mobee_contract::{Event, Hold, Status, Time};
use mobee_model::{Edit, ObjectClass};
use mobee_runtime::system::{CueTrigger, Reason, ScriptStep};
use std::time::Duration;

#[test]
fn an_obstacle_put_onto_the_arm_is_escaped() {
    let put = Edit::Add(ball("brick", [0.5, 0.07, 0.2], ObjectClass::Obstacle));
    let script = vec![ScriptStep { when: CueTrigger::At(Time::from_secs(0.9)), edit: put }];
    let poses = vec![[0.0, 0.0, 0.0], [-30.0, 0.0, 0.0]];
    let ran = Trial { script, poses, pause: Duration::from_secs(2), ..Trial::default() }.run();
    assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
    let held = |e: &Event| matches!(e, Event::State { status: Status::Holding(Hold::InContact), .. });
    assert!(ran.events().iter().any(|(_, e)| held(e)), "{}", ran.lines());
    assert_eq!(ran.end.counts.escapes, 1, "{}", ran.lines());
    assert_eq!(ran.end.counts.hard_contacts, 0, "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}
