//! Natural evolution strategies: minimizers that need nothing of a function but its values.
//!
//! A normal distribution is sampled, the samples are ranked by what the function says of them, and the distribution
//! follows the natural gradient of the expected rank. Only ranks count, so a function may jump, as one does that
//! collides, and whatever grows with it is searched alike.
//!
//! ```text
//! mean, width ──sample──> points ──(caller)──> fitness ──update──> mean, width
//! ```
//!
//! [`Xnes`] learns a full covariance and does not mind how the axes lie; [`Snes`] learns one width per axis, costs less,
//! and needs fewer samples where the axes mean something, as those of joints do. After Glasmachers et al., *Exponential
//! Natural Evolution Strategies* (2010), and Wierstra et al., *Natural Evolution Strategies* (2014); the paper cites
//! their forerunner of 2008.

mod population;
mod snes;
#[cfg(test)]
mod tests;
mod xnes;

pub use snes::Snes;
pub use xnes::Xnes;

/// A search that samples and is told how good the samples are; it minimizes.
pub trait EvolutionStrategy {
    /// Draws a generation.
    ///
    /// # Arguments
    /// * `points`: emptied first; the samples one after the other, each with as many numbers as the mean has.
    fn sample(&mut self, points: &mut Vec<f64>);

    /// Learns from the generation that was drawn last.
    ///
    /// # Arguments
    /// * `fitness`: one number per sample, in their order, the smaller the better; what is not a number is worst.
    fn update(&mut self, fitness: &[f64]);

    /// The middle of the distribution.
    fn mean(&self) -> &[f64];

    /// Its width: the standard deviation along an axis, averaged geometrically over the axes.
    fn width(&self) -> f64;
}

/// How many samples a generation has by default: `4 + floor(3 ln d)` in `d` dimensions.
pub fn default_population(dimensions: usize) -> usize {
    4 + (3.0 * (dimensions.max(1) as f64).ln()).floor() as usize
}
