//! Exponential natural evolution strategy: a full covariance.

use super::EvolutionStrategy;
use super::population::Population;
use nalgebra::{DMatrix, DVector, DVectorView, SymmetricEigen};

/// xNES: invariant to shifts, scales and rotations of the space. A generation costs the third power of the dimensions.
#[derive(Clone, Debug)]
pub struct Xnes {
    population: Population,
    mean: DVector<f64>,
    /// Samples are `mean + width * shape * z`; the shape has determinant one.
    width: f64,
    shape: DMatrix<f64>,
    /// Learning rate of width and shape; that of the mean is 1.
    rate: f64,
}

impl Xnes {
    /// Creates a search with the initial mean `mean` and the same width in all directions.
    ///
    /// # Arguments
    /// As for [`super::Snes::new`].
    pub fn new(mean: Vec<f64>, width: f64, population: usize, seed: u64) -> Xnes {
        let shape = DMatrix::identity(mean.len(), mean.len());
        Xnes::with_shape(mean, width, shape, population, seed)
    }

    /// Creates a search with an anisotropic initial distribution.
    ///
    /// # Arguments
    /// * `shape`: a square matrix of determinant one; samples are `mean + width * shape * z`.
    ///
    /// # Panics
    /// If the matrix is not square with the dimension of the mean.
    pub fn with_shape(mean: Vec<f64>, width: f64, shape: DMatrix<f64>, population: usize, seed: u64) -> Xnes {
        let d = mean.len();
        assert_eq!(shape.shape(), (d, d), "a shape of {d} dimensions");
        let n = d.max(1) as f64;
        let rate = (9.0 + 3.0 * n.ln()) / (5.0 * n * n.sqrt());
        Xnes { population: Population::new(d, population, seed), mean: DVector::from_vec(mean), width, shape, rate }
    }
}

impl EvolutionStrategy for Xnes {
    fn sample(&mut self, points: &mut Vec<f64>) {
        points.clear();
        for z in self.population.draw() {
            let x = &self.mean + self.width * (&self.shape * DVectorView::from_slice(z, z.len()));
            points.extend(x.iter());
        }
    }

    fn update(&mut self, fitness: &[f64]) {
        let d = self.mean.len();
        let mut to_mean = DVector::zeros(d);
        let mut to_shape = DMatrix::zeros(d, d);
        for (utility, z) in self.population.ranked(fitness) {
            let z = DVectorView::from_slice(z, d);
            to_mean.axpy(utility, &z, 1.0);
            to_shape.ger(utility, &z, &z, 1.0);
        }
        // The utilities sum to zero, so the identity matrices in the gradient cancel.
        let to_width = to_shape.trace() / d.max(1) as f64;
        for i in 0..d {
            to_shape[(i, i)] -= to_width;
        }
        self.mean += self.width * (&self.shape * to_mean);
        self.width *= (0.5 * self.rate * to_width).exp();
        self.shape *= exponential(to_shape * (0.5 * self.rate));
    }

    fn mean(&self) -> &[f64] {
        self.mean.as_slice()
    }

    fn width(&self) -> f64 {
        self.width
    }
}

/// Computes the exponential of a symmetric matrix.
fn exponential(matrix: DMatrix<f64>) -> DMatrix<f64> {
    let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(matrix);
    let grown = DMatrix::from_diagonal(&eigenvalues.map(f64::exp));
    &eigenvectors * grown * eigenvectors.transpose()
}
