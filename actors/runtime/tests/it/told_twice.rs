//! Told once to stop, a run waits for its robots to come to rest; told twice, it ends at once.

use crate::common::Trial;
use mobee_contract::Time;
use mobee_runtime::system::{Control, Reason};
use mobee_sim::Fault;
use std::time::Duration;

/// How long a run with a robot that says nothing goes on: whether it rests can't be known.
fn ends_after(wishes: Vec<Control>) -> Duration {
    let silent = |faults: &mobee_sim::SimFaults| {
        faults.start(Fault::Silent);
    };
    let ran = Trial::default().run_all(silent, |tell| {
        wishes.into_iter().for_each(|wish| tell.try_send(wish).unwrap());
        Vec::new()
    });
    assert_eq!(ran.end.reason, Reason::Interrupted);
    assert_eq!(ran.violations(), []);
    ran.end.ended_at.since(Time::ZERO)
}

#[test]
fn a_second_wish_is_heard_while_the_first_is_fulfilled() {
    let once = ends_after(vec![Control::Stop]);
    let seconds = |n| Duration::from_secs(n);
    assert!(
        once >= seconds(2) && once < seconds(3),
        "a robot that may still move is waited for, not for ever: {once:?}"
    );
    assert!(ends_after(vec![Control::Stop, Control::Abort]) < Duration::from_secs(1));
}
