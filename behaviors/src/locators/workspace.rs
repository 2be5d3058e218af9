//! Where objects are expected before anything is seen: about the places where they were in training, and anywhere around.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Places that are kept: more cost time and tell little more.
const PLACES: usize = 64;
/// How much of the expectation is the wide one.
const WIDE: f64 = 0.1;
/// By what factor the covariance of the training places is widened.
const WIDENED: f64 = 1.5;

/// A mixture of normal distributions: a narrow one about each training place, and a wide one about all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Workspace {
    /// Where the narrow ones are, m.
    pub places: Vec<Vector3<f64>>,
    /// Their standard deviation, m.
    pub bandwidth: f64,
    /// The middle of the wide one, m.
    pub center: Vector3<f64>,
    /// The covariance of the wide one, square meters.
    pub covariance: Matrix3<f64>,
}

/// One normal distribution of the mixture, weighted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    pub(super) middle: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    /// The inverse of that.
    pub(super) information: Matrix3<f64>,
    /// The logarithm of the square root of the covariance's determinant.
    pub(super) ln_root: f64,
    /// The logarithm of its weight, less `ln_root`.
    pub(super) ln_weight: f64,
}

impl Expected {
    /// A weighted normal distribution; `None` if its covariance is none.
    pub(super) fn normal(middle: Vector3<f64>, covariance: Matrix3<f64>, weight: f64) -> Option<Expected> {
        let cholesky = covariance.cholesky()?;
        let ln_root = cholesky.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let information = cholesky.inverse();
        Some(Expected { middle, covariance, information, ln_root, ln_weight: weight.ln() - ln_root })
    }
}

/// Different places, in the order of their first mention.
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
    /// What these places let expect. The bandwidth is the one under which each of them is likeliest, given the others.
    pub fn new(places: impl Iterator<Item = Vector3<f64>>) -> Workspace {
        let all = distinct(places);
        let n = all.len().max(1) as f64;
        let center = all.iter().sum::<Vector3<f64>>() / n;
        let scatter = all.iter().map(|p| (p - center) * (p - center).transpose()).sum::<Matrix3<f64>>();
        // at least 3 cm each way, so that places in a plane do not forbid everything else
        let covariance = scatter * (WIDENED / n) + Matrix3::identity() * 9e-4;
        let kept: Vec<_> = all.iter().step_by(all.len().div_ceil(PLACES).max(1)).copied().collect();
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

    /// Whether such an expectation can be.
    pub(super) fn is_sound(&self) -> bool {
        let places = self.places.iter().chain([&self.center]).all(|p| p.iter().all(|n| n.is_finite()));
        places && self.bandwidth.is_finite() && self.bandwidth > 0.0 && self.covariance.cholesky().is_some()
    }

    /// All of its parts, the wide one first.
    pub(super) fn parts(&self) -> Vec<Expected> {
        let narrow = Matrix3::identity() * self.bandwidth.powi(2);
        let each = (1.0 - WIDE) / self.places.len().max(1) as f64;
        let wide = Expected::normal(self.center, self.covariance, WIDE);
        wide.into_iter().chain(self.places.iter().filter_map(|p| Expected::normal(*p, narrow, each))).collect()
    }
}
