//! Fifty seeds of the whole system under random faults: any actor killed, the connection lost, obstacles put anywhere,
//! under the checker of all invariants. After the last fault has healed, motions end and the filter opens (I15).

use crate::common::{Ran, Trial, ball};
use mobee_contract::Time;
use mobee_model::{Edit, ObjectClass};
use mobee_runtime::system::{Control, Reason, RunCounts};
use mobee_sim::Fault;
use rand::{Rng, SeedableRng};
use std::time::Duration;

const ACTORS: [&str; 6] = ["arm/driver", "arm/history", "arm/supervise", "arm/reflex", "arm/agent", "model"];

fn one(seed: u64) -> RunCounts {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut pose = || [rng.random_range(-160.0..160.0), rng.random_range(-110.0..110.0), rng.random_range(-80.0..80.0)];
    let poses = (0..6).map(|_| pose()).collect();
    let mut at = Duration::from_millis(500);
    let mut controls = Vec::new();
    let mut names = 0;
    for _ in 0..10 {
        at += Duration::from_millis(rng.random_range(100..5000));
        let fault = match rng.random_range(0..4) {
            0 | 1 => Control::Kill(ACTORS[rng.random_range(0..ACTORS.len())].into()),
            2 => {
                names += 1;
                let place = [rng.random_range(-0.6..0.6), rng.random_range(-0.6..0.6), rng.random_range(0.1..0.3)];
                Control::Edit(Edit::Add(ball(&format!("ball{names}"), place, ObjectClass::Obstacle)))
            }
            _ => Control::Recover("arm".into()),
        };
        controls.push((at, fault));
    }
    // the last fault heals: the obstacles go
    controls.push((at + Duration::from_secs(2), Control::Edit(Edit::Clear)));
    controls.push((at + Duration::from_secs(4), Control::Recover("arm".into())));
    let lost = (Time::ZERO + Duration::from_millis(rng.random_range(500..20_000)), rng.random_range(50..3000));
    let trial = Trial { poses, speed: 0.1, seed, controls, limit: Duration::from_secs(600), ..Trial::default() };
    let ran = trial.run_with(|faults| {
        faults.plan(Fault::Lost, lost.0, lost.0 + Duration::from_millis(lost.1));
    });
    let head = |ran: &Ran| ran.lines().chars().rev().take(12_000).collect::<String>().chars().rev().collect::<String>();
    assert_eq!(ran.end.reason, Reason::Done, "seed {seed}\n{}", head(&ran));
    assert_eq!(ran.end.counts.commits, ran.end.counts.outcomes(), "seed {seed}\n{}", head(&ran));
    assert_eq!(ran.violations(), [], "seed {seed}\n{}", head(&ran));
    ran.end.counts
}

#[test]
fn fifty_seeds_hold_all_invariants() {
    let all: Vec<RunCounts> = (0..50).map(one).collect();
    let sum = |of: fn(&RunCounts) -> u64| all.iter().map(of).sum::<u64>();
    // faults that hit nothing would prove nothing
    let (rolled_back, restarts, faulted) = (sum(|c| c.rolled_back), sum(|c| c.restarts), sum(|c| c.faulted));
    let (escapes, stopped) = (sum(|c| c.escapes), sum(|c| c.retreats_stopped));
    eprintln!(
        "{rolled_back} rolled back, {faulted} faulted, {restarts} restarts, {escapes} escapes, {stopped} retreats stopped"
    );
    assert!(rolled_back > 20 && restarts > 100 && faulted > 20 && escapes > 0);
}
