//! A person halts the robot while the system runs, and releases it.

use crate::common::{Ran, Trial, ball};
use mobee_contract::{Cause, Event, Hold, Outcome, Status, Time};
use mobee_journal::check::check_events;
use mobee_model::{Object, ObjectClass};
use mobee_runtime::system::{Control, Reason};
use std::sync::Arc;
use std::time::Duration;

fn at(secs: f64, control: Control) -> (Duration, Control) {
    (Duration::from_secs_f64(secs), control)
}

fn halted(from: f64, to: f64, more: Vec<(Duration, Control)>, objects: Vec<Object>) -> Ran {
    let mut controls = vec![at(from, Control::Halt("arm".into())), at(to, Control::Release("arm".into()))];
    controls.extend(more);
    controls.sort_by_key(|(at, _)| *at);
    let poses = vec![[60.0, 40.0, -30.0], [0.0, 0.0, 0.0], [-40.0, -30.0, 20.0]];
    Trial { poses, controls, objects, ..Trial::default() }.run()
}

/// What happened from the halt to the release.
fn meanwhile(ran: &Ran) -> Vec<Arc<Event>> {
    let events = ran.events();
    let place = |is: fn(&Event) -> bool| events.iter().position(|(_, e)| is(e)).expect("it happened");
    let from = place(|e| matches!(e, Event::Halted { .. }));
    let to = place(|e| matches!(e, Event::Released { .. }));
    events[from..to].iter().map(|(_, e)| e.clone()).collect()
}

#[test]
fn a_halted_robot_does_nothing_until_it_is_released() {
    let kill = |name: &str| Control::Kill(format!("arm/{name}"));
    let deaths = ["agent", "reflex", "history", "driver", "supervise"];
    let deaths: Vec<_> = deaths.iter().zip(5..).map(|(name, s)| at(f64::from(s), kill(name))).collect();
    for more in [Vec::new(), deaths] {
        let ran = halted(1.0, 20.0, more, Vec::new());
        let events = meanwhile(&ran);
        let cause = events.iter().find_map(|e| match &**e {
            Event::Outcome { outcome, cause, .. } => Some((*outcome, cause.clone())),
            _ => None,
        });
        assert_eq!(cause, Some((Outcome::Faulted, Some(Cause::Asked))), "{}", ran.lines());
        let acts = |e: &Event| matches!(e, Event::Commit { .. } | Event::Enabled { .. } | Event::RetreatBegan { .. });
        assert!(!events.iter().any(|e| acts(e)), "{}", ran.lines());
        assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
        assert!(ran.end.counts.committed >= 2, "the agent goes on: {}", ran.lines());
        assert_eq!(ran.violations(), [], "{}", ran.lines());
    }
}

/// In the middle of a retreat: it stops, and the robot holds.
#[test]
fn a_halted_retreat_stops_and_holds() {
    let objects = || vec![ball("ball", [0.46, 0.38, 0.2], ObjectClass::Obstacle)];
    let free = halted(100.0, 101.0, Vec::new(), objects());
    let began = free.events().iter().find_map(|(at, e)| matches!(**e, Event::RetreatBegan { .. }).then_some(*at));
    let began = began.unwrap_or_else(|| panic!("no retreat\n{}", free.lines())).since(Time::ZERO).as_secs_f64();
    let ran = halted(began + 0.1, began + 10.0, Vec::new(), objects());
    let events = meanwhile(&ran);
    let holds = |e: &Event| matches!(e, Event::State { status: Status::Holding(Hold::Halted), .. });
    assert!(events.iter().any(|e| holds(e)), "{}", ran.lines());
    assert!(events.iter().any(|e| matches!(**e, Event::Outcome { outcome: Outcome::Faulted, .. })), "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

/// A filter that opens while the robot is halted is found in the journal (I1).
#[test]
fn an_open_filter_of_a_halted_robot_is_a_broken_invariant() {
    let ran = halted(1.0, 5.0, Vec::new(), Vec::new());
    let without = ran.events().into_iter().filter(|(_, e)| !matches!(**e, Event::Released { .. }));
    let found = check_events(without.collect::<Vec<_>>());
    assert!(found.iter().any(|v| v.to_string().contains("opened while the robot was halted")), "{found:?}");
}
