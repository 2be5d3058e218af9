//! Accuracy of each kind at recorded positions that it was not trained on (five parts of the
//! positions, each evaluated by a model trained on the other four); distance of a calibrated head
//! from the information bound, and its cost: 200 simulated heads, each trained on 100 views, of
//! which 15 % show something else; jumps of encoders; time of a localization and of a fit, one
//! core.
//!
//! ```text
//! cargo bench -p mobee-sensing --bench locators
//! ```
#![allow(clippy::disallowed_methods)] // a measurement of the processor

#[path = "../../../model/fast/benches/measure/mod.rs"]
mod measure;
mod simulated_head;

use measure::{processor_time, sorted};
use mobee_sensing::locators::beginning::Beginning;
use mobee_sensing::locators::calibrated::Calibrated;
use mobee_sensing::locators::file::{LocatorFile, LocatorKind};
use mobee_sensing::locators::folds::{Fold, folds};
use mobee_sensing::locators::head::JOINTS;
use mobee_sensing::locators::online::OnlineCalibration;
use mobee_sensing::locators::rows::parse;
use mobee_sensing::locators::score::PlaceAnswers;
use mobee_sensing::locators::view::KnownView;
use simulated_head::{SimulatedHead, learn, mean_square};
use std::path::Path;

/// Number of heads, and of training views of each.
const WORLDS: u64 = 200;
const VIEWS: usize = 100;

/// Evaluates each kind on the recorded views, if they exist, with whole positions held out.
fn recorded(name: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/vision/locator").join(name);
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("SKIPPED: {} is not there", path.display());
        return;
    };
    let known = parse(&text).expect("a table").known;
    println!("{name}: median, mean, 95 % in mm, share in the region of 95 %");
    for kind in LocatorKind::ALL {
        let (mut all, mut unclipped) = (PlaceAnswers::default(), PlaceAnswers::default());
        for Fold { train, test } in folds(&known, 0).expect("folds") {
            let file = LocatorFile::train(kind, &train, String::new(), &Beginning::recorded(0), &mut |_| ())
                .expect("it learns");
            let ready = file.ready();
            all.ask(&ready, &test);
            let test: Vec<KnownView> = test.into_iter().filter(|k| !k.view.is_clipped()).collect();
            unclipped.ask(&ready, &test);
        }
        let (all, unclipped) = (all.score(), unclipped.score());
        let rows = [
            ("one view", all.single),
            ("unclipped", unclipped.single),
            ("together", all.fused),
            ("unclipped", unclipped.fused),
        ];
        for (of, e) in rows {
            println!(
                "  {:12}{of:10}{:4} of {:4}{:7.1}{:7.1}{:7.1}{:7.3}",
                kind.name(),
                e.located,
                e.n,
                e.median_mm,
                e.mean_mm,
                e.p95_mm,
                e.inside_95
            );
        }
    }
}

fn main() {
    recorded("katana_block_train.csv");
    recorded("katana_reddot_train.csv");
    let all: Vec<_> = (0..WORLDS).map(|seed| learn(seed, VIEWS)).collect();
    let ratios: Vec<f64> = all.iter().map(|l| (l.error / l.bound).sqrt()).collect();
    let pooled = (ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len() as f64).sqrt();
    let ratios = sorted(ratios);
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
