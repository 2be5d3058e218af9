use super::*;
use proptest::prelude::*;

fn input() -> impl Strategy<Value = (SwapIn, u64)> {
    let terms = (0_u64..5, 0_u64..5).prop_map(|(shadow, probation)| {
        let secs = Duration::from_secs;
        SwapIn::Offer(SwapPolicy { shadow: secs(shadow), probation: secs(probation), ..SwapPolicy::default() })
    });
    let other =
        prop::sample::select(vec![SwapIn::Boundary, SwapIn::Tick, SwapIn::Answered, SwapIn::TookOver, SwapIn::Broke]);
    (prop_oneof![terms, other], 0_u64..3)
}

proptest! {
    /// Every accepted swap ends once; a part takes over only at a boundary, and not before the end of its shadow time.
    #[test]
    fn every_swap_ends_once(inputs in prop::collection::vec(input(), 0..60)) {
        let mut core = SwapCore::default();
        let mut now = Time::ZERO;
        let mut open = false;
        let mut handing_over = false;
        let mut answered = false;
        for (input, passed) in inputs {
            now = now + Duration::from_secs(passed);
            // A shell reports this only after a handover.
            if input == SwapIn::TookOver && !handing_over {
                continue;
            }
            let before = core.phase();
            let out = core.on(input, now);
            match out {
                Some(SwapOut::Keep) => {
                    prop_assert!(!open);
                    open = true;
                }
                Some(SwapOut::Busy) => prop_assert!(open),
                Some(SwapOut::Discard | SwapOut::Revert | SwapOut::Settle) => {
                    prop_assert!(out != Some(SwapOut::Settle) || answered);
                    prop_assert!(open && core.phase() == Phase::Settled);
                    open = false;
                }
                Some(SwapOut::HandOver) => {
                    prop_assert!(input == SwapIn::Boundary);
                    prop_assert!(matches!(before, Phase::Shadow(until) if now >= until));
                }
                Some(SwapOut::Rehearse) => prop_assert!(matches!(before, Phase::Shadow(until) if now < until)),
                None => {}
            }
            answered = (answered && input != SwapIn::TookOver) || input == SwapIn::Answered;
            handing_over = out == Some(SwapOut::HandOver);
            prop_assert_eq!(open, core.phase() != Phase::Settled);
        }
    }
}

#[test]
fn what_breaks_in_the_shadow_is_discarded_and_what_breaks_later_is_reverted() {
    let mut core = SwapCore::default();
    let terms = SwapPolicy { shadow: Duration::from_secs(1), ..SwapPolicy::default() };
    assert_eq!(core.on(SwapIn::Offer(terms), Time::ZERO), Some(SwapOut::Keep));
    assert_eq!(core.on(SwapIn::Boundary, Time::ZERO), Some(SwapOut::Rehearse));
    assert_eq!(core.on(SwapIn::Broke, Time::ZERO), Some(SwapOut::Discard));
    assert_eq!(core.on(SwapIn::Offer(terms), Time::ZERO), Some(SwapOut::Keep));
    let later = Time::ZERO + Duration::from_secs(1);
    assert_eq!(core.on(SwapIn::Boundary, later), Some(SwapOut::HandOver));
    assert_eq!(core.on(SwapIn::TookOver, later), None);
    assert_eq!(core.on(SwapIn::Offer(terms), later), Some(SwapOut::Busy));
    assert_eq!(core.on(SwapIn::Broke, later), Some(SwapOut::Revert));
    assert_eq!(core.on(SwapIn::Broke, later), None);
}
