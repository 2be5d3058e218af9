use super::file::{LocatorFile, LocatorKind};
use super::folds::folds;
use super::rows::parse;
use super::score::judge;
use super::view::KnownView;

fn shared(name: &str) -> Option<Vec<KnownView>> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/vision/locator").join(name);
    let text = std::fs::read_to_string(&path).map_err(|e| println!("SKIPPED: {}: {e}", path.display())).ok()?;
    Some(parse(&text).expect("the recorded table").known)
}

#[test]
fn probe() {
    for name in ["katana_block_train.csv", "katana_reddot_train.csv"] {
        let Some(known) = shared(name) else { return };
        for kind in [LocatorKind::Calibrated] {
            for unclipped in [false, true] {
                let mut sums = vec![];
                for (train, test) in folds(&known, 0).expect("folds") {
                    let file = LocatorFile::train(kind, &train, String::new(), 0, &mut |_| ()).expect("learned");
                    let test: Vec<_> = test.into_iter().filter(|k| !unclipped || !k.view.is_clipped()).collect();
                    let s = judge(&file.ready(), &test);
                    sums.push((s.single, s.fused));
                }
                let n: usize = sums.iter().map(|s| s.0.n).sum();
                let m: usize = sums.iter().map(|s| s.1.n).sum();
                let mean = |f: &dyn Fn(&super::score::Errors) -> f64| {
                    sums.iter().map(|s| f(&s.0) * s.0.n as f64).sum::<f64>() / n as f64
                };
                let fused = |f: &dyn Fn(&super::score::Errors) -> f64| {
                    sums.iter().map(|s| f(&s.1) * s.1.n as f64).sum::<f64>() / m as f64
                };
                println!(
                    "{name} {} unclipped {unclipped}: n {n} single {:.1} {:.1} {:.1} inside {:.3}; fused {:.1} {:.1} inside {:.3}",
                    kind.name(),
                    mean(&|e| e.median_mm),
                    mean(&|e| e.mean_mm),
                    mean(&|e| e.p95_mm),
                    mean(&|e| e.inside_95),
                    fused(&|e| e.median_mm),
                    fused(&|e| e.mean_mm),
                    fused(&|e| e.inside_95)
                );
            }
        }
    }
}
