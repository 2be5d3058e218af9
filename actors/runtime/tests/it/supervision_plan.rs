//! The strategies of OTP, on the pure plan.

use mobee_contract::Time;
use mobee_runtime::supervision::{Input, Intensity, Restart, RestartPlan, RestartStep, Strategy};
use proptest::prelude::*;
use std::time::Duration;

const BUDGET: Intensity = Intensity { restarts: 3, period: Duration::from_secs(5) };

fn running(strategy: Strategy, policies: Vec<Restart>) -> RestartPlan {
    let mut plan = RestartPlan::new(strategy, BUDGET, policies);
    for step in plan.on(Input::Begin, Time::ZERO) {
        apply(&mut plan, step);
    }
    plan
}

fn apply(plan: &mut RestartPlan, step: RestartStep) {
    match step {
        RestartStep::Start(i) => drop(plan.on(Input::Started(i), Time::ZERO)),
        RestartStep::Stop(i) => drop(plan.on(Input::Stopped(i), Time::ZERO)),
        RestartStep::GiveUp => {}
    }
}

fn fail(plan: &mut RestartPlan, child: usize, at: f64) -> Vec<RestartStep> {
    plan.on(Input::Died { child, failed: true }, Time::from_secs(at))
}

#[test]
fn one_for_one_restarts_the_dead_alone() {
    let mut plan = running(Strategy::OneForOne, vec![Restart::Permanent; 3]);
    assert_eq!(fail(&mut plan, 1, 1.0), [RestartStep::Start(1)]);
}

#[test]
fn one_for_all_stops_in_reverse_and_starts_in_order() {
    let mut plan = running(Strategy::OneForAll, vec![Restart::Permanent; 3]);
    assert_eq!(
        fail(&mut plan, 1, 1.0),
        [
            RestartStep::Stop(2),
            RestartStep::Stop(0),
            RestartStep::Start(0),
            RestartStep::Start(1),
            RestartStep::Start(2)
        ]
    );
}

#[test]
fn rest_for_one_leaves_the_elder_alone() {
    let mut plan = running(Strategy::RestForOne, vec![Restart::Permanent; 4]);
    assert_eq!(
        fail(&mut plan, 1, 1.0),
        [
            RestartStep::Stop(3),
            RestartStep::Stop(2),
            RestartStep::Start(1),
            RestartStep::Start(2),
            RestartStep::Start(3)
        ]
    );
}

#[test]
fn the_budget_ends_within_its_period() {
    let mut plan = running(Strategy::OneForOne, vec![Restart::Permanent; 2]);
    for at in [1.0, 2.0, 3.0] {
        for step in fail(&mut plan, 0, at) {
            apply(&mut plan, step);
        }
    }
    assert_eq!(fail(&mut plan, 0, 5.9), [RestartStep::Stop(1), RestartStep::GiveUp]);
}

#[test]
fn deaths_far_apart_never_end_the_budget() {
    let mut plan = running(Strategy::OneForOne, vec![Restart::Permanent; 2]);
    for k in 0..100 {
        let steps = fail(&mut plan, 0, 2.0 * f64::from(k));
        assert_eq!(steps, [RestartStep::Start(0)], "death {k}");
        apply(&mut plan, steps[0]);
    }
}

#[test]
fn policies_decide_who_comes_back() {
    let policies = vec![Restart::Permanent, Restart::Transient, Restart::Temporary];
    let mut plan = running(Strategy::OneForOne, policies);
    assert_eq!(plan.on(Input::Died { child: 0, failed: false }, Time::ZERO), [RestartStep::Start(0)]);
    assert_eq!(plan.on(Input::Died { child: 1, failed: false }, Time::ZERO), []);
    assert_eq!(fail(&mut plan, 2, 0.0), []);
}

#[test]
fn a_transient_child_that_ended_stays_down_when_others_restart() {
    let mut plan = running(Strategy::OneForAll, vec![Restart::Permanent, Restart::Transient]);
    plan.on(Input::Died { child: 1, failed: false }, Time::ZERO);
    assert_eq!(fail(&mut plan, 0, 0.0), [RestartStep::Start(0)]);
}

#[test]
fn a_start_that_fails_is_tried_again_and_the_rest_is_not_forgotten() {
    let mut plan = RestartPlan::new(Strategy::RestForOne, BUDGET, vec![Restart::Permanent; 3]);
    assert_eq!(
        plan.on(Input::Begin, Time::ZERO),
        [RestartStep::Start(0), RestartStep::Start(1), RestartStep::Start(2)]
    );
    plan.on(Input::Started(0), Time::ZERO);
    assert_eq!(fail(&mut plan, 1, 0.0), [RestartStep::Start(1), RestartStep::Start(2)]);
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
                let first_start = steps.iter().position(|s| matches!(s, RestartStep::Start(_))).unwrap_or(steps.len());
                let last_stop = steps.iter().rposition(|s| matches!(s, RestartStep::Stop(_))).map_or(0, |i| i + 1);
                prop_assert!(last_stop <= first_start);
                let mut next = Vec::new();
                for step in steps {
                    match step {
                        RestartStep::Stop(i) => {
                            prop_assert!(plan.is_up(i));
                            plan.on(Input::Stopped(i), at);
                        }
                        RestartStep::Start(i) if failing > 0 => {
                            failing -= 1;
                            next = plan.on(Input::Died { child: i, failed: true }, at);
                            break;
                        }
                        RestartStep::Start(i) => {
                            prop_assert!(!plan.is_up(i));
                            plan.on(Input::Started(i), at);
                        }
                        RestartStep::GiveUp => gave_up = true,
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
