//! Selects the violations that count against the robots, given the injected faults.

use super::faults::FaultAction;
use super::plan::Planned;
use mobee_driver_yarp::WireFault;
use mobee_journal::check::{SLOW_RETREAT, Violation};
use mobee_sim::Fault;
use std::time::Duration;

/// Time after a slow board within which a retreat that it delayed is over.
const DELAYED_RETREAT: Duration = Duration::from_secs(2);

/// True unless an injected fault excuses the violation.
///
/// * I20: if another program changes a board's references, the board is too fast before any driver can know. I30 judges it.
/// * I22: a board that becomes slow during a retreat delays it, and no journal shows that. The duration of the retreat is not
///   judged then, its path is.
/// * I34: lying encoders and lost readings let a robot touch things that it looks ahead for. It is judged without faults only.
pub fn counts(violation: &Violation, planned: &[Planned]) -> bool {
    let meddled = |p: &Planned| matches!(p.what, FaultAction::Wire { fault: WireFault::Meddled(_), .. });
    match violation.invariant {
        "I20" => !planned.iter().any(meddled),
        "I22" if violation.what.contains(SLOW_RETREAT) => !planned.iter().any(|p| delays(p, violation)),
        "I34" => planned.is_empty(),
        _ => true,
    }
}

/// True if a slow board can have delayed a retreat that ended at the violation.
fn delays(planned: &Planned, violation: &Violation) -> bool {
    let FaultAction::Board { fault: Fault::Slow { extra }, lasts, .. } = &planned.what else { return false };
    (planned.at..=planned.at + *lasts + *extra + DELAYED_RETREAT).contains(&violation.at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::Time;

    #[test]
    fn a_slow_board_excuses_the_duration_of_a_retreat_and_nothing_else() {
        let what = FaultAction::Board {
            robot: 0,
            kind: "F7",
            fault: Fault::Slow { extra: Duration::from_millis(200) },
            lasts: Duration::from_secs(1),
        };
        let planned = [Planned { at: Time::from_secs(5.0), what }];
        let counted = |invariant, secs: f64, what: &str| {
            let at = Time::from_secs(secs);
            counts(&Violation { invariant, line: 1, at, what: what.into() }, &planned)
        };
        let slow = format!("arm: {SLOW_RETREAT} 1.47 s on 0.40 s of its retreat");
        assert_eq!([4.9, 5.0, 8.2, 8.3].map(|secs| counted("I22", secs, &slow)), [true, false, false, true]);
        assert!(counted("I22", 6.0, "arm: is 1.52 deg beside the way that it came"));
        assert!(counted("I9", 6.0, &slow) && !counted("I34", 6.0, "a hard contact"));
    }
}
