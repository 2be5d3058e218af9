//! How near locators come to what can be known, and what they cost: 200 simulated heads that learn from 100 views each, 15 % of which
//! show something else; jumps of encoders; time of a localization and of a fit, one core.
//!
//! ```text
//! cargo bench -p mobee-behaviors --bench locators
//! ```
#![allow(clippy::disallowed_methods)] // a measurement of the processor

#[path = "../../model/fast/benches/measure/mod.rs"]
mod measure;
mod simulated_head;

use measure::processor_time;
use mobee_behaviors::locators::calibrated::{Beginning, Calibrated};
use mobee_behaviors::locators::head::JOINTS;
use mobee_behaviors::locators::online::OnlineCalibration;
use mobee_behaviors::locators::view::KnownView;
use simulated_head::{SimulatedHead, learn, mean_square};

/// Heads, and what each learns from.
const WORLDS: u64 = 200;
const VIEWS: usize = 100;

fn main() {
    let all: Vec<_> = (0..WORLDS).map(|seed| learn(seed, VIEWS)).collect();
    let mut ratios: Vec<f64> = all.iter().map(|l| (l.error / l.bound).sqrt()).collect();
    let pooled = (ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len() as f64).sqrt();
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios[((ratios.len() - 1) as f64 * share) as usize];
    println!(
        "{WORLDS} heads, {VIEWS} views: error / bound {pooled:.3} pooled, {:.3} median, {:.3} 95 %, {:.3} most",
        at(0.5),
        at(0.95),
        at(1.0)
    );
    println!("failed fits (error above twice the bound): {}", ratios.iter().filter(|r| **r > 2.0).count());

    let (mut named, mut recovered, mut within) = (0, 0, Vec::new());
    for (i, of) in all.into_iter().take(45).enumerate() {
        let (mut head, joint) = (of.head, i % 9);
        head.model.theta[joint] += 2.0_f64.to_radians();
        let mut online = OnlineCalibration::new(of.calibrated);
        let mut first = None;
        for n in 1..=50 {
            if let Some(jump) = online.see(head.view(true)) {
                first = first.or(Some((n, jump.joint)));
            }
        }
        let test: Vec<KnownView> = (0..100).map(|_| head.view(false)).collect();
        let ratio = (mean_square(online.learned(), &test) / of.error).sqrt();
        named += usize::from(first.is_some_and(|f| f.1 == joint));
        recovered += usize::from(ratio < 1.3);
        within.extend(first.map(|f| f.0));
        if first.is_none_or(|f| f.1 != joint) || ratio >= 1.3 {
            let told = first.map(|f| JOINTS[f.1]);
            println!("  head {i}: {} jumped, told {told:?}, error {ratio:.2} of before", JOINTS[joint]);
        }
    }
    within.sort_unstable();
    println!(
        "jumps of 2 degrees: {named} of 45 named, {recovered} recovered after 50 views; noticed after {:?} views (median)",
        within.get(within.len() / 2)
    );

    let clock = std::time::Instant::now();
    let mut head = SimulatedHead::new(1);
    let known: Vec<KnownView> = (0..800).map(|_| head.view(true)).collect();
    let before = processor_time(clock);
    let learned = Calibrated::learn(&known, &Beginning::recorded(1), true).expect("it learns");
    println!("a fit to 800 views: {:.3} s", processor_time(clock) - before);
    let before = processor_time(clock);
    let mut online = OnlineCalibration::new(learned.clone());
    for k in known.iter().take(200) {
        online.see(*k);
    }
    println!("a view of an online calibration: {:.0} us", (processor_time(clock) - before) / 200.0 * 1e6);
    let ready = learned.ready();
    let before = processor_time(clock);
    let found = (0..20).flat_map(|_| &known).filter_map(|k| ready.locate(&k.view)).count();
    println!("a localization: {:.1} us", (processor_time(clock) - before) / found as f64 * 1e6);
}
