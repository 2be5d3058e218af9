//! The strategies of OTP, on the pure plan.

use mobee_actors::runtime::supervision::{Input, Intensity, Plan, Restart, Step, Strategy};
use mobee_contract::Time;
use proptest::prelude::*;
use std::time::Duration;

const BUDGET: Intensity = Intensity { restarts: 3, period: Duration::from_secs(5) };

fn running(strategy: Strategy, policies: Vec<Restart>) -> Plan {
    let mut plan = Plan::new(strategy, BUDGET, policies);
    for step in plan.on(Input::Begin, Time::ZERO) {
        apply(&mut plan, step);
    }
    plan
}

fn apply(plan: &mut Plan, step: Step) {
    match step {
        Step::Start(i) => drop(plan.on(Input::Started(i), Time::ZERO)),
        Step::Stop(i) => drop(plan.on(Input::Stopped(i), Time::ZERO)),
        Step::GiveUp => {}
    }
}

fn fail(plan: &mut Plan, child: usize, at: f64) -> Vec<Step> {
    plan.on(Input::Died { child, failed: true }, Time::from_secs(at))
}

#[test]
fn one_for_one_restarts_the_dead_alone() {
    let mut plan = running(Strategy::OneForOne, vec![Restart::Permanent; 3]);
    assert_eq!(fail(&mut plan, 1, 1.0), [Step::Start(1)]);
}

#[test]
fn one_for_all_stops_in_reverse_and_starts_in_order() {
    let mut plan = running(Strategy::OneForAll, vec![Restart::Permanent; 3]);
    assert_eq!(fail(&mut plan, 1, 1.0), [Step::Stop(2), Step::Stop(0), Step::Start(0), Step::Start(1), Step::Start(2)]);
}

#[test]
fn rest_for_one_leaves_the_elder_alone() {
    let mut plan = running(Strategy::RestForOne, vec![Restart::Permanent; 4]);
    assert_eq!(fail(&mut plan, 1, 1.0), [Step::Stop(3), Step::Stop(2), Step::Start(1), Step::Start(2), Step::Start(3)]);
}

#[test]
fn the_budget_ends_within_its_period() {
    let mut plan = running(Strategy::OneForOne, vec![Restart::Permanent; 2]);
    for at in [1.0, 2.0, 3.0] {
        for step in fail(&mut plan, 0, at) {
            apply(&mut plan, step);
        }
    }
    assert_eq!(fail(&mut plan, 0, 5.9), [Step::Stop(1), Step::GiveUp]);
}

#[test]
fn deaths_far_apart_never_end_the_budget() {
    let mut plan = running(Strategy::OneForOne, vec![Restart::Permanent; 2]);
    for k in 0..100 {
        let steps = fail(&mut plan, 0, 2.0 * f64::from(k));
        assert_eq!(steps, [Step::Start(0)], "death {k}");
        apply(&mut plan, steps[0]);
    }
}

#[test]
fn policies_decide_who_comes_back() {
    let policies = vec![Restart::Permanent, Restart::Transient, Restart::Temporary];
    let mut plan = running(Strategy::OneForOne, policies);
    assert_eq!(plan.on(Input::Died { child: 0, failed: false }, Time::ZERO), [Step::Start(0)]);
    assert_eq!(plan.on(Input::Died { child: 1, failed: false }, Time::ZERO), []);
    assert_eq!(fail(&mut plan, 2, 0.0), []);
}

#[test]
fn a_transient_child_that_ended_stays_down_when_others_restart() {
    let mut plan = running(Strategy::OneForAll, vec![Restart::Permanent, Restart::Transient]);
    plan.on(Input::Died { child: 1, failed: false }, Time::ZERO);
    assert_eq!(fail(&mut plan, 0, 0.0), [Step::Start(0)]);
}

#[test]
fn a_start_that_fails_is_tried_again_and_the_rest_is_not_forgotten() {
    let mut plan = Plan::new(Strategy::RestForOne, BUDGET, vec![Restart::Permanent; 3]);
    assert_eq!(plan.on(Input::Begin, Time::ZERO), [Step::Start(0), Step::Start(1), Step::Start(2)]);
    plan.on(Input::Started(0), Time::ZERO);
    assert_eq!(fail(&mut plan, 1, 0.0), [Step::Start(1), Step::Start(2)]);
}

fn any_strategy() -> impl proptest::strategy::Strategy<Value = Strategy> {
    prop_oneof![Just(Strategy::OneForOne), Just(Strategy::OneForAll), Just(Strategy::RestForOne)]
}

proptest! {
    /// Whatever dies: the elders of the dead are left alone unless all restart, no stop follows a start, and afterwards
    /// all permanent children run or the group has given up with none running.
    #[test]
    fn after_any_deaths_all_run_or_none(
        strategy in any_strategy(),
        n in 1_usize..6,
        deaths in prop::collection::vec((0_usize..6, 0.0..3.0_f64, 0_u8..4), 1..30),
    ) {
        let mut plan = running(strategy, vec![Restart::Permanent; n]);
        let mut now = 0.0;
        for (child, wait, failing_starts) in deaths {
            let child = child % n;
            now += wait;
            let at = Time::from_secs(now);
            let mut failing = failing_starts;
            let mut steps = plan.on(Input::Died { child, failed: true }, at);
            let mut gave_up = false;
            while !steps.is_empty() {
                let first_start = steps.iter().position(|s| matches!(s, Step::Start(_))).unwrap_or(steps.len());
                let last_stop = steps.iter().rposition(|s| matches!(s, Step::Stop(_))).map_or(0, |i| i + 1);
                prop_assert!(last_stop <= first_start);
                let mut next = Vec::new();
                for step in steps {
                    match step {
                        Step::Stop(i) => {
                            prop_assert!(plan.is_up(i));
                            plan.on(Input::Stopped(i), at);
                        }
                        Step::Start(i) if failing > 0 => {
                            failing -= 1;
                            next = plan.on(Input::Died { child: i, failed: true }, at);
                            break;
                        }
                        Step::Start(i) => {
                            prop_assert!(!plan.is_up(i));
                            plan.on(Input::Started(i), at);
                        }
                        Step::GiveUp => gave_up = true,
                    }
                }
                steps = next;
            }
            let up = (0..n).filter(|i| plan.is_up(*i)).count();
            prop_assert_eq!(up, if gave_up { 0 } else { n });
            if gave_up {
                prop_assert!(plan.restarts(at) > BUDGET.restarts);
                break;
            }
        }
    }
}
