//! Prior distribution of object positions: near the positions of the training data, and anywhere
//! around them.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Maximum number of stored positions: more cost time and add little.
const MAX_PLACES: usize = 64;
/// Weight of the wide component.
const WIDE_WEIGHT: f64 = 0.1;
/// Factor of the covariance of the training positions.
const COVARIANCE_FACTOR: f64 = 1.5;

/// A mixture of normal distributions: a narrow one about each training position, and a wide one
/// about all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Workspace {
    /// Means of the narrow ones, m.
    pub places: Vec<Vector3<f64>>,
    /// Their standard deviation, m.
    pub bandwidth: f64,
    /// Mean of the wide one, m.
    pub center: Vector3<f64>,
    /// Covariance of the wide one, m^2.
    pub covariance: Matrix3<f64>,
}

/// A weighted normal distribution of the mixture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    pub(super) middle: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    /// Inverse of the covariance.
    pub(super) information: Matrix3<f64>,
    /// Logarithm of the square root of the covariance's determinant.
    pub(super) ln_root: f64,
    /// Logarithm of its weight, minus `ln_root`.
    pub(super) ln_weight: f64,
}

impl Expected {
    /// Creates a weighted normal distribution; `None` if the covariance is not positive definite.
    pub(super) fn normal(middle: Vector3<f64>, covariance: Matrix3<f64>, weight: f64) -> Option<Expected> {
        let cholesky = covariance.cholesky()?;
        let ln_root = cholesky.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let information = cholesky.inverse();
        Some(Expected { middle, covariance, information, ln_root, ln_weight: weight.ln() - ln_root })
    }
}

/// Returns the distinct positions in the order of their first occurrence.
pub(super) fn distinct(places: impl Iterator<Item = Vector3<f64>>) -> Vec<Vector3<f64>> {
    let mut found: Vec<Vector3<f64>> = Vec::new();
    for place in places {
        if !found.iter().any(|f| (f - place).norm() < 1e-6) {
            found.push(place);
        }
    }
    found
}

impl Workspace {
    /// Creates the prior from training positions. The bandwidth maximizes the likelihood of each
    /// position given the others.
    pub fn new(places: impl Iterator<Item = Vector3<f64>>) -> Workspace {
        let all = distinct(places);
        let n = all.len().max(1) as f64;
        let center = all.iter().sum::<Vector3<f64>>() / n;
        let scatter = all.iter().map(|p| (p - center) * (p - center).transpose()).sum::<Matrix3<f64>>();
        // At least 3 cm along each axis, so that coplanar positions do not exclude everything else.
        let covariance = scatter * (COVARIANCE_FACTOR / n) + Matrix3::identity() * 9e-4;
        let kept: Vec<_> = all.iter().step_by(all.len().div_ceil(MAX_PLACES).max(1)).copied().collect();
        let mut space = Workspace { places: kept, bandwidth: 0.05, center, covariance };
        let likelihood = |bandwidth: f64| {
            let trial = Workspace { bandwidth, ..space.clone() };
            let others = |place: &Vector3<f64>| {
                let narrow = trial.places.iter().filter(|p| (*p - place).norm() > 1e-6);
                let density = |p: &Vector3<f64>| {
                    (-0.5 * (p - place).norm_squared() / bandwidth.powi(2)).exp() / bandwidth.powi(3)
                };
                (narrow.map(density).sum::<f64>() / n + 1e-9).ln()
            };
            trial.places.iter().map(others).sum::<f64>()
        };
        let candidates = [0.03, 0.04, 0.05, 0.065, 0.08, 0.1, 0.13, 0.16, 0.2];
        let best = candidates.into_iter().max_by(|a, b| likelihood(*a).total_cmp(&likelihood(*b)));
        space.bandwidth = best.unwrap_or(0.05);
        space
    }

    /// Returns whether the prior is valid.
    pub(super) fn is_sound(&self) -> bool {
        let places = self.places.iter().chain([&self.center]).all(|p| p.iter().all(|n| n.is_finite()));
        places && self.bandwidth.is_finite() && self.bandwidth > 0.0 && self.covariance.cholesky().is_some()
    }

    /// Returns all components, the wide one first.
    pub(super) fn parts(&self) -> Vec<Expected> {
        let narrow = Matrix3::identity() * self.bandwidth.powi(2);
        let each = (1.0 - WIDE_WEIGHT) / self.places.len().max(1) as f64;
        let wide = Expected::normal(self.center, self.covariance, WIDE_WEIGHT);
        wide.into_iter().chain(self.places.iter().filter_map(|p| Expected::normal(*p, narrow, each))).collect()
    }
}
