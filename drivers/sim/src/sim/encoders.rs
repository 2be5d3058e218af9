//! Encoders of the simulated robot: the times of readings, and their errors.

use crate::SimSettings;
use mobee_contract::{Pose, Time};
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Duration;

/// Encoders read at a steady rate with jitter, resolution and noise.
#[derive(Debug)]
pub struct Encoders {
    period: Duration,
    jitter: Duration,
    /// Resolution, rad; 0 for none.
    resolution: f64,
    /// Noise, rad; 0 for none.
    noise: f64,
    random: ChaCha8Rng,
    /// Number and time of the next reading.
    next: (u64, Time),
}

impl Encoders {
    /// Creates encoders whose first reading is due at once.
    pub fn new(settings: &SimSettings, seed: u64) -> Encoders {
        Encoders {
            period: settings.period().max(Duration::from_micros(1)),
            jitter: settings.jitter(),
            resolution: settings.resolution().to_radians(),
            noise: settings.noise().to_radians(),
            random: ChaCha8Rng::seed_from_u64(seed),
            next: (0, Time::ZERO),
        }
    }

    /// Time of the next reading.
    pub fn due(&self) -> Time {
        self.next.1
    }

    /// Number and time of the newest reading that is due by `now`; skips earlier ones.
    pub fn take(&mut self, now: Time) -> Option<(u64, Time)> {
        let (mut seq, mut at) = self.next;
        if at > now {
            return None;
        }
        let newest = now.0 / self.period_ns();
        if newest > seq {
            seq = newest;
            at = self.time_of(seq).min(now);
        }
        self.next = (seq + 1, self.time_of(seq + 1));
        Some((seq, at))
    }

    /// Reads the motors, rad.
    pub fn read(&mut self, motors: impl Iterator<Item = f64>) -> Pose {
        let noise = self.noise;
        let resolution = self.resolution;
        let read = |q: f64| {
            let q = if noise > 0.0 { q + noise * normal(self.random.next_u32()) } else { q };
            if resolution > 0.0 { nearest(q / resolution) * resolution } else { q }
        };
        motors.map(read).collect()
    }

    /// Adds noise of this standard deviation (rad) to a reading.
    pub fn disturb(&mut self, q: f64, sigma: f64) -> f64 {
        q + sigma * normal(self.random.next_u32())
    }

    fn period_ns(&self) -> u64 {
        u64::try_from(self.period.as_nanos()).unwrap_or(u64::MAX).max(1)
    }

    fn time_of(&mut self, seq: u64) -> Time {
        let nominal = Time(seq.saturating_mul(self.period_ns()));
        if self.jitter.is_zero() {
            return nominal;
        }
        // within [-1, 1)
        let share = self.random.next_u32() as f64 / f64::from(1u32 << 31) - 1.0;
        let off = self.jitter.mul_f64(share.abs());
        if share < 0.0 { nominal - off } else { nominal + off }
    }
}

/// Approximately normal number of standard deviation one, within 3.47: the sum of four uniform ones.
fn normal(bits: u32) -> f64 {
    let sum: u32 = bits.to_le_bytes().map(u32::from).iter().sum();
    // the sum of four uniform numbers of 0 to 255 has mean 510 and variance 4 (256^2 - 1) / 12
    (f64::from(sum) - 510.0) / 147.799_413
}

/// Rounds to the nearest whole number, up to 2^51. Costs a tenth of `f64::round`, which a run would need some
/// 20 million times.
fn nearest(x: f64) -> f64 {
    const SHIFT: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52
    (x + SHIFT) - SHIFT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_rounds() {
        for (x, want) in [(0.2, 0.0), (0.51, 1.0), (-3.7, -4.0), (-3.2, -3.0), (123_456.6, 123_457.0)] {
            assert_eq!(nearest(x), want);
        }
    }

    #[test]
    fn noise_has_mean_zero_and_deviation_one() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let n = 100_000;
        let all: Vec<f64> = (0..n).map(|_| normal(random.next_u32())).collect();
        let mean = all.iter().sum::<f64>() / f64::from(n);
        let variance = all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(n);
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03, "{mean} {variance}");
        assert!(all.iter().all(|x| x.abs() <= 3.47));
    }
}
