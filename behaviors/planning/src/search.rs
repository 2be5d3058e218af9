//! Natural evolution strategies: minimizers that use only the values of a function.
//!
//! A normal distribution is sampled, the samples are ranked by the function, and the distribution
//! follows the natural gradient of the expected rank. Only ranks count, so the function may be
//! discontinuous, as with collisions, and any increasing transformation of it gives the same
//! search.
//!
//! ```text
//! mean, width ──sample──> points ──(caller)──> fitness ──update──> mean, width
//! ```
//!
//! [`Xnes`] adapts a full covariance and is invariant to rotations; [`Snes`] adapts one width per
//! axis, costs less, and needs fewer samples if the axes are meaningful, such as those of joints.
//! After Glasmachers et al., *Exponential Natural Evolution Strategies* (2010), and Wierstra et
//! al., *Natural Evolution Strategies* (2014); the paper cites their forerunner of 2008.

mod population;
mod snes;
#[cfg(test)]
mod tests;
mod xnes;

pub use snes::Snes;
pub use xnes::Xnes;

/// A minimizer that draws samples and is updated with their values.
pub trait EvolutionStrategy {
    /// Draws a generation.
    ///
    /// # Arguments
    /// * `points`: cleared first; the samples one after the other, each with as many numbers as the
    ///   mean.
    fn sample(&mut self, points: &mut Vec<f64>);

    /// Updates the distribution from the generation that was drawn last.
    ///
    /// # Arguments
    /// * `fitness`: one value per sample, in their order, the smaller the better; NaN is worst.
    fn update(&mut self, fitness: &[f64]);

    /// Returns the mean of the distribution.
    fn mean(&self) -> &[f64];

    /// Returns its width: the geometric mean over the axes of the standard deviation.
    fn width(&self) -> f64;
}

/// Returns the default number of samples in a generation: `4 + floor(3 ln d)` in `d` dimensions.
pub fn default_population(dimensions: usize) -> usize {
    4 + (3.0 * (dimensions.max(1) as f64).ln()).floor() as usize
}
