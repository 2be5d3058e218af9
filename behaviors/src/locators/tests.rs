use super::calibrated::{Beginning, Calibrated};
use super::folds::folds;
use super::rows::parse;
use super::view::{INSIDE_95, Known};

fn shared(name: &str) -> Option<Vec<Known>> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/vision/locator").join(name);
    let text = std::fs::read_to_string(&path).map_err(|e| println!("SKIPPED: {}: {e}", path.display())).ok()?;
    Some(parse(&text).expect("the recorded table").known)
}

fn tell(name: &str, mut errors: Vec<f64>, inside: usize) {
    errors.sort_by(f64::total_cmp);
    let n = errors.len();
    println!(
        "{name}: n {n} median {:.1} mean {:.1} 95% {:.1} inside {:.3}",
        1e3 * errors[n / 2],
        1e3 * errors.iter().sum::<f64>() / n as f64,
        1e3 * errors[n * 95 / 100],
        inside as f64 / n as f64
    );
}

#[test]
fn probe() {
    let Some(known) = shared("katana_block_train.csv") else { return };
    let (mut all, mut unclipped) = ((Vec::new(), 0), (Vec::new(), 0));
    for (train, test) in folds(&known, 0).expect("folds") {
        let began = std::time::Instant::now();
        let learned = Calibrated::train(&train, &Beginning::recorded(0), &mut |_| ()).expect("learned");
        println!("{:?} warp {} widening {} bw {} lag {:.2} clipped {:?} rest {:?}", began.elapsed(), learned.model.warp.is_some(), learned.widening, learned.workspace.bandwidth, learned.model.theta[41], learned.noise.clipped.map(f64::sqrt), learned.noise.resting.diagonal().map(f64::sqrt));
        let ready = learned.ready();
        let began = std::time::Instant::now();
        for k in &test {
            let e = ready.locate(&k.view).expect("located");
            let (off, inside) = ((e.place - k.place).norm(), e.distance(&k.place) <= INSIDE_95);
            all.0.push(off);
            all.1 += usize::from(inside);
            if !k.view.is_clipped() {
                unclipped.0.push(off);
                unclipped.1 += usize::from(inside);
            }
        }
        println!("{:?} each", began.elapsed() / test.len() as u32);
    }
    tell("all", all.0, all.1);
    tell("unclipped", unclipped.0, unclipped.1);
}
