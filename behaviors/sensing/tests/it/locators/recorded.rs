//! Recorded views of a block and a dot held by an arm: accuracy at held-out positions.

use mobee_sensing::locators::beginning::Beginning;
use mobee_sensing::locators::calibrated::Calibrated;
use mobee_sensing::locators::folds::{Fold, folds};
use mobee_sensing::locators::rows::parse;
use mobee_sensing::locators::view::{INSIDE_95, KnownView};

fn shared(name: &str) -> Option<Vec<KnownView>> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/vision/locator").join(name);
    let text = std::fs::read_to_string(&path).map_err(|e| println!("SKIPPED: {}: {e}", path.display())).ok()?;
    Some(parse(&text).expect("the recorded table").known)
}

#[test]
fn at_places_that_were_not_learned_a_calibrated_head_is_as_good_as_promised() {
    let Some(known) = shared("katana_block_train.csv") else { return };
    let (mut single, mut fused, mut inside, mut asked) = (Vec::new(), Vec::new(), 0, 0);
    for Fold { train, test } in folds(&known, 1).expect("folds") {
        let learned = Calibrated::train(&train, &Beginning::recorded(0), &mut |_| ()).expect("learned");
        assert!(learned.model.warp.is_some(), "places are warped");
        let ready = learned.ready();
        for k in &test {
            let found = ready.locate(&k.view).expect("located");
            asked += 1;
            inside += usize::from(found.distance(&k.place) <= INSIDE_95);
            if !k.view.is_clipped() {
                single.push(1e3 * (found.place - k.place).norm());
            }
        }
        let mut places: Vec<_> = test.iter().map(|k| k.place).collect();
        // The rows of a position are contiguous in the table.
        places.dedup();
        for place in places {
            let views: Vec<_> = test.iter().filter(|k| k.place == place).map(|k| k.view).collect();
            fused.push(1e3 * (ready.fuse(&views).expect("located").place - place).norm());
        }
    }
    single.sort_by(f64::total_cmp);
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    let (median, p95) = (single[single.len() / 2], single[single.len() * 95 / 100]);
    let share = f64::from(inside as u32) / f64::from(asked as u32);
    let told = format!("{median:.1} {:.1} {p95:.1}, fused {:.1}, inside {share:.3}", mean(&single), mean(&fused));
    println!("{told}");
    assert!(median < 24.0 && mean(&single) < 37.0 && p95 < 100.0 && mean(&fused) < 15.0, "{told}");
    assert!((0.93..=0.97).contains(&share), "{told}");
}
