//! Common part of all strategies: samples of the standard normal distribution, and utilities by
//! rank.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// A generation: samples `z ~ N(0, I)`, and the utilities of their ranks.
#[derive(Clone, Debug)]
pub(super) struct Population {
    random: ChaCha8Rng,
    /// Utility of each rank, the best first; they sum to zero.
    utilities: Vec<f64>,
    dimensions: usize,
    /// The samples, one after the other.
    z: Vec<f64>,
    /// Samples by rank.
    order: Vec<usize>,
}

impl Population {
    pub(super) fn new(dimensions: usize, size: usize, seed: u64) -> Population {
        let size = size.max(2);
        let z = vec![0.0; dimensions * size];
        let order = (0..size).collect();
        Population { random: ChaCha8Rng::seed_from_u64(seed), utilities: utilities(size), dimensions, z, order }
    }

    /// Draws new samples.
    pub(super) fn draw(&mut self) -> impl Iterator<Item = &[f64]> {
        for pair in self.z.chunks_mut(2) {
            // Box-Muller: two uniform numbers give two normal ones.
            let (u, v): (f64, f64) = (self.random.random(), self.random.random());
            let radius = (-2.0 * (1.0 - u).ln()).sqrt();
            for (z, part) in pair.iter_mut().zip([(TAU * v).cos(), (TAU * v).sin()]) {
                *z = radius * part;
            }
        }
        self.z.chunks_exact(self.dimensions.max(1))
    }

    /// Returns the samples drawn last, the best first, each with its utility.
    pub(super) fn ranked(&mut self, fitness: &[f64]) -> impl Iterator<Item = (f64, &[f64])> {
        let worth = |i: &usize| fitness.get(*i).copied().filter(|f| !f.is_nan()).unwrap_or(f64::INFINITY);
        self.order.sort_by(|a, b| worth(a).total_cmp(&worth(b)).then(a.cmp(b)));
        let z = &self.z;
        let d = self.dimensions;
        let sample = move |i: &usize| z.get(i * d..(i + 1) * d).unwrap_or_default();
        self.utilities.iter().copied().zip(self.order.iter().map(sample))
    }
}

/// Returns `max(0, ln(n/2 + 1) - ln k)` for each rank `k`, scaled to sum to one, minus `1/n`.
fn utilities(size: usize) -> Vec<f64> {
    let n = size as f64;
    let raw: Vec<f64> = (1..=size).map(|k| ((n / 2.0 + 1.0).ln() - (k as f64).ln()).max(0.0)).collect();
    let sum: f64 = raw.iter().sum();
    raw.into_iter().map(|u| u / sum - 1.0 / n).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn utilities_fall_with_the_rank_and_sum_to_zero() {
        for size in [2, 8, 16, 17] {
            let all = utilities(size);
            assert!(all.iter().sum::<f64>().abs() < 1e-12 && all.windows(2).all(|w| w[0] >= w[1]), "{all:?}");
        }
        // By hand, for four: ln 3 / (ln 3 + ln 1.5) - 1/4.
        assert!((utilities(4)[0] - 0.480_43).abs() < 1e-4, "{:?}", utilities(4));
    }

    #[test]
    fn samples_have_mean_zero_and_variance_one_and_what_is_no_number_is_worst() {
        let mut population = Population::new(3, 20_000, 1);
        let all: Vec<f64> = population.draw().flatten().copied().collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let variance = all.iter().map(|z| z * z).sum::<f64>() / all.len() as f64;
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
        let mut three = Population::new(1, 3, 1);
        let drawn: Vec<f64> = three.draw().flatten().copied().collect();
        let ranked: Vec<f64> = three.ranked(&[-f64::NAN, 2.0, 1.0]).map(|(_, z)| z[0]).collect();
        assert_eq!(ranked, [drawn[2], drawn[1], drawn[0]]);
    }
}
