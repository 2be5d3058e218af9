//! How many are done in a second.

use crate::measure::processor_time;
use std::time::Instant;

/// Of processor time, measured over a tenth of a second at least.
pub fn rate(count: usize, mut run: impl FnMut()) -> f64 {
    let (start, mut runs) = (Instant::now(), 0);
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
