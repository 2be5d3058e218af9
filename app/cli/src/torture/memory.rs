//! Detects growth of memory during a run.

use mobee_contract::Time;

/// Interval between samples, seconds of the run.
const SAMPLE_INTERVAL_S: f64 = 60.0;
/// Share of a run in which maps, queues and histories fill.
const WARMUP_SHARE: f64 = 0.25;
/// Minimum number of samples for a slope.
const MIN_SAMPLES: usize = 60;

/// The resident memory of the process over a run.
#[derive(Debug, Default)]
pub struct Memory {
    samples: Vec<(f64, f64)>,
}

impl Memory {
    /// Takes a sample if one is due. Does nothing without `/proc`.
    pub fn sample(&mut self, at: Time) {
        if self.samples.last().is_some_and(|(last, _)| at.secs() < last + SAMPLE_INTERVAL_S) {
            return;
        }
        let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let line = text.lines().find_map(|l| l.strip_prefix("RssAnon:"));
        let kilobytes = line.and_then(|l| l.split_whitespace().next()?.parse::<f64>().ok());
        self.samples.extend(kilobytes.map(|kb| (at.secs(), kb / 1e3)));
    }

    /// Growth after the warm-up, megabytes per hour of the run, by least squares. `None` for short runs.
    pub fn slope(&self) -> Option<f64> {
        let end = self.samples.last()?.0;
        let warm: Vec<_> = self.samples.iter().filter(|(at, _)| *at >= WARMUP_SHARE * end).collect();
        if warm.len() < MIN_SAMPLES {
            return None;
        }
        let n = warm.len() as f64;
        let mean = |of: fn(&(f64, f64)) -> f64| warm.iter().map(|s| of(s)).sum::<f64>() / n;
        let at = mean(|s| s.0);
        let mb = mean(|s| s.1);
        let (over, under) =
            warm.iter().fold((0.0, 0.0), |(o, u), (t, m)| (o + (t - at) * (m - mb), u + (t - at) * (t - at)));
        Some(3600.0 * over / under)
    }
}

#[cfg(test)]
mod tests {
    use super::Memory;

    #[test]
    fn the_slope_is_that_of_the_warm_part() {
        let grown = |t: f64| if t < 3600.0 { t } else { 3600.0 + 2.0 * (t - 3600.0) / 3600.0 };
        let samples = (0..240).map(|k| (f64::from(k) * 60.0, grown(f64::from(k) * 60.0))).collect();
        let slope = Memory { samples }.slope().unwrap();
        assert!((slope - 2.0).abs() < 1e-9, "{slope}");
        assert_eq!(Memory { samples: vec![(0.0, 1.0); 10] }.slope(), None);
    }
}
