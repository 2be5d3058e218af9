//! Measurement of a rate per second.

use crate::measure::processor_time;
use std::time::Instant;

/// Items per second of processor time, measured over at least a tenth of a second.
pub fn rate(count: usize, mut run: impl FnMut()) -> f64 {
    let start = Instant::now();
    let mut runs = 0;
    let begin = processor_time(start);
    loop {
        run();
        runs += 1;
        let spent = processor_time(start) - begin;
        if spent > 0.1 {
            return (runs * count) as f64 / spent;
        }
    }
}
