//! The encoders of the simulated robot: when they are read, and what they say.

use crate::{Plant, SimSettings};
use mobee_contract::{Sample, Time};
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Duration;

/// Encoders read at a steady rate with jitter, resolution and noise.
#[derive(Debug)]
pub struct Encoders {
    period: Duration,
    jitter: Duration,
    /// rad; 0 for none.
    resolution: f64,
    /// rad; 0 for none.
    noise: f64,
    random: ChaCha8Rng,
    /// The next reading's number, and when it is due.
    next: (u64, Time),
}

impl Encoders {
    /// Encoders whose first reading is due at once.
    pub fn new(settings: &SimSettings, seed: u64) -> Encoders {
        Encoders {
            period: settings.period().max(Duration::from_micros(1)),
            jitter: settings.jitter(),
            resolution: settings.resolution_deg.to_radians(),
            noise: settings.noise_deg.to_radians(),
            random: ChaCha8Rng::seed_from_u64(seed),
            next: (0, Time::ZERO),
        }
    }

    /// When the next reading is due.
    pub fn due(&self) -> Time {
        self.next.1
    }

    /// The newest reading that is due by `now`, passing over those that are due before it. Moves the plant on to the time of the reading.
    pub fn read(&mut self, plant: &mut Plant, now: Time) -> Option<Sample> {
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
        plant.advance(at);
        let (noise, resolution) = (self.noise, self.resolution);
        let read = |q: f64| {
            let q = if noise > 0.0 { q + noise * normal(self.random.next_u64()) } else { q };
            if resolution > 0.0 { (q / resolution).round() * resolution } else { q }
        };
        let q = plant.positions().map(read).collect();
        Some(Sample { seq, at: plant.now(), q, done: plant.done() })
    }

    /// Adds noise of this standard deviation (rad) to a reading.
    pub fn disturb(&mut self, q: f64, sigma: f64) -> f64 {
        q + sigma * normal(self.random.next_u64())
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

/// A number of about normal distribution with standard deviation one, never beyond 3.47: the sum of four even ones.
fn normal(bits: u64) -> f64 {
    let sum: u32 = (0..4).map(|i| (bits >> (16 * i)) as u32 & 0xffff).sum();
    // four even numbers over [0, 65536) have mean 131070 and variance 4 * 65536^2 / 12
    (f64::from(sum) - 131_070.0) / 37_837.23
}
