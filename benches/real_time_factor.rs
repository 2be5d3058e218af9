//! Real-time factor: a minute of the exploring iCub (complete system, journal included), compared with its bound: the
//! simulated robot alone, sampled at the same rate. The throughput counts simulated seconds: `elem/s` is the real-time
//! factor.
//!
//! `cargo bench --bench real_time_factor`

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mobee::compose::compose;
use mobee::config::Config;
use mobee_contract::Time;
use std::path::Path;
use std::time::Duration;

/// The behavior that runs.
const FILE: &str = "configs/behaviors/explore.toml";
/// Settings of a run of one minute.
const MINUTE: [&str; 2] = ["for_s=60", "record.enabled=false"];

fn plant_alone() -> u64 {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(FILE);
    let (config, source) = Config::load(&file, &[]).expect("it loads");
    let robots = compose(config, &source).expect("it composes").robots;
    let mut driver = robots[0].hardware.connect().expect("simulated");
    let mut now = Time::ZERO;
    let mut samples = 0;
    while now < Time::from_secs(60.0) {
        driver.lease(now, now + Duration::from_millis(100));
        samples += u64::from(driver.sample(now).expect("simulated").is_some());
        now = driver.next_sample(now).max(now + Duration::from_millis(1));
    }
    samples
}

fn minute(c: &mut Criterion) {
    let mut group = c.benchmark_group("a minute of exploring");
    group.sample_size(10).throughput(Throughput::Elements(60));
    group
        .bench_function("whole system", |b| b.iter(|| mobee::run::example(FILE, &MINUTE).expect("it runs").end.counts));
    group.bench_function("simulated robot alone", |b| b.iter(plant_alone));
    group.finish();
}

criterion_group!(benches, minute);
criterion_main!(benches);
