//! Separable natural evolution strategy: one width per axis.

use super::EvolutionStrategy;
use super::population::Population;

/// SNES: linear in the number of dimensions. Invariant to shifts and to the scale of each axis, not to rotations.
#[derive(Clone, Debug)]
pub struct Snes {
    population: Population,
    mean: Vec<f64>,
    /// Standard deviation along each axis.
    widths: Vec<f64>,
    /// Learning rate of the widths; that of the mean is 1.
    rate: f64,
    gradients: Vec<(f64, f64)>,
}

impl Snes {
    /// Creates a search with the initial mean `mean`.
    ///
    /// # Arguments
    /// * `width`: standard deviation along every axis.
    /// * `population`: number of samples in a generation, at least 2; see
    ///   [`super::default_population`].
    /// * `seed`: equal seeds draw equal samples.
    pub fn new(mean: Vec<f64>, width: f64, population: usize, seed: u64) -> Snes {
        let d = mean.len();
        let n = d.max(1) as f64;
        let rate = (3.0 + n.ln()) / 5.0;
        Snes {
            population: Population::new(d, population, seed),
            widths: vec![width; d],
            rate: rate / n.sqrt(),
            gradients: vec![(0.0, 0.0); d],
            mean,
        }
    }
}

impl EvolutionStrategy for Snes {
    fn sample(&mut self, points: &mut Vec<f64>) {
        points.clear();
        for z in self.population.draw() {
            points.extend(z.iter().zip(&self.mean).zip(&self.widths).map(|((z, m), s)| m + s * z));
        }
    }

    fn update(&mut self, fitness: &[f64]) {
        self.gradients.fill((0.0, 0.0));
        for (utility, z) in self.population.ranked(fitness) {
            for ((to_mean, to_width), z) in self.gradients.iter_mut().zip(z) {
                *to_mean += utility * z;
                *to_width += utility * (z * z - 1.0);
            }
        }
        for ((m, s), (to_mean, to_width)) in self.mean.iter_mut().zip(&mut self.widths).zip(&self.gradients) {
            *m += *s * to_mean;
            *s *= (0.5 * self.rate * to_width).exp();
        }
    }

    fn mean(&self) -> &[f64] {
        &self.mean
    }

    fn width(&self) -> f64 {
        (self.widths.iter().map(|s| s.ln()).sum::<f64>() / self.widths.len().max(1) as f64).exp()
    }
}
