//! Posterior distribution of a position: a mixture over every explanation of the view (both eyes
//! right, the head's pose wrong, one eye wrong) and every component of the prior, each a normal
//! distribution about its own mode. The estimate has the mean and the covariance of the mixture.

use super::looking::HeadView;
use super::model::{HeadModel, invert};
use super::noise::{Noise, ReadingOrigin};
use super::view::{Estimate, StereoView};
use super::workspace::Expected;
use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// Probabilities of the explanations of a view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shares {
    /// The head's pose differs from the reading: both eyes are off together.
    pub astray: f64,
    /// One eye detected something else; for each eye.
    pub one_eye: f64,
    /// Both eyes detected something else.
    pub both_eyes: f64,
}

/// Standard deviation of the pixels if the head's pose differs from the reading, pixels.
const ASTRAY_SIGMA_PX: f64 = 60.0;
/// Log-density of a wrong detection at a pixel: uniform over 640x480 pixels, relative to a normal
/// distribution without its factor 1/(2 pi).
const LN_ELSEWHERE: f64 = 1.838 - 12.635;
/// Maximum number of steps of the search for the mode.
const MAX_STEPS: usize = 12;
/// Length of a step below which the search ends, m.
const MIN_STEP_M: f64 = 1e-4;

/// An explanation of the pixels: their information matrix, and the logarithm of its prior weight.
pub(super) struct Explained {
    pub(super) information: Matrix4<f64>,
    pub(super) ln_weight: f64,
}

impl Shares {
    /// Returns whether the probabilities are valid.
    pub(super) fn is_sound(&self) -> bool {
        let all = [self.astray, self.one_eye, self.both_eyes];
        all.iter().all(|s| (1e-6..0.3).contains(s))
    }

    /// Returns the explanations of pixels with this covariance.
    pub(super) fn explanations(&self, covariance: &Matrix4<f64>) -> Vec<Explained> {
        let right = 1.0 - self.astray - 2.0 * self.one_eye - self.both_eyes;
        let whole = |share: f64, covariance: &Matrix4<f64>| {
            let (information, ln_det) = invert(covariance)?;
            Some(Explained { information, ln_weight: share.ln() - 0.5 * ln_det })
        };
        let together = Matrix4::from_fn(|i, j| if i % 2 == j % 2 { ASTRAY_SIGMA_PX.powi(2) } else { 0.0 });
        let eye = |e: usize| {
            let block = covariance.fixed_view::<2, 2>(2 * e, 2 * e).into_owned();
            let cholesky = block.cholesky()?;
            let mut information = Matrix4::zeros();
            information.fixed_view_mut::<2, 2>(2 * e, 2 * e).copy_from(&cholesky.inverse());
            let ln_root = cholesky.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
            Some(Explained { information, ln_weight: self.one_eye.ln() - ln_root + LN_ELSEWHERE })
        };
        [whole(right, covariance), whole(self.astray, &(covariance + together)), eye(0), eye(1)]
            .into_iter()
            .flatten()
            .collect()
    }

    /// Returns the logarithm of the weight of both eyes being wrong, on the scale of the
    /// explanations.
    pub(super) fn ln_nothing(&self) -> f64 {
        self.both_eyes.ln() + 2.0 * LN_ELSEWHERE
    }
}

/// Distribution of a position: a mixture of normal distributions.
#[derive(Default)]
pub(super) struct Mixture {
    parts: Vec<(f64, Vector3<f64>, Matrix3<f64>)>,
}

impl Mixture {
    fn add(&mut self, ln_weight: f64, middle: Vector3<f64>, covariance: Matrix3<f64>) {
        if ln_weight.is_finite() {
            self.parts.push((ln_weight, middle, covariance));
        }
    }

    /// Adds the products of a likelihood with all components of the prior. The likelihood is given
    /// by its information on the position about `place` and its gradient there.
    pub(super) fn expect(
        &mut self,
        expected: &[Expected],
        place: Vector3<f64>,
        information: &Matrix3<f64>,
        gradient: &Vector3<f64>,
        ln_weight: f64,
    ) {
        for part in expected {
            let off = part.middle - place;
            let Some(all) = (information + part.information).cholesky() else { continue };
            let toward = gradient + part.information * off;
            let step = all.solve(&toward);
            let ln_root = all.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
            let misfit = off.dot(&(part.information * off)) - toward.dot(&step);
            self.add(ln_weight + part.ln_weight - ln_root - 0.5 * misfit, place + step, all.inverse());
        }
    }

    /// Returns mean and covariance.
    pub(super) fn estimate(&self) -> Option<Estimate> {
        let most = self.parts.iter().map(|p| p.0).max_by(f64::total_cmp)?;
        let mut sum = 0.0;
        let mut place = Vector3::zeros();
        let mut square = Matrix3::zeros();
        let reference = self.parts.first()?.1;
        for (ln_weight, middle, covariance) in self.parts.iter().filter(|p| p.0 > most - 20.0) {
            let weight = (ln_weight - most).exp();
            let off = middle - reference;
            sum += weight;
            place += off * weight;
            square += (covariance + off * off.transpose()) * weight;
        }
        let mean = place / sum;
        Some(Estimate { place: reference + mean, covariance: square / sum - mean * mean.transpose() })
    }
}

/// Estimates the position of an object from one view; `None` only if the numerics fail.
pub(super) fn locate(
    model: &HeadModel,
    view: &StereoView,
    origins: &[ReadingOrigin],
    (noise, shares): (&Noise, &Shares),
    expected: &[Expected],
) -> Option<Estimate> {
    let wide = expected.first()?;
    let pixels = view.pixels();
    let mut mixture = Mixture::default();
    for origin in origins {
        let looking = model.look(&view.encoders, &origin.toward);
        let near = |place: &Vector3<f64>| {
            let off = place - wide.middle;
            off.dot(&(wide.information * off)) < 25.0
        };
        let start = looking.midpoint(&pixels).filter(near).unwrap_or(wide.middle);
        let covariance = noise.of(view, &looking, &origin.toward, &start);
        for explained in shares.explanations(&covariance) {
            let Some(best) = best_place(&looking, &pixels, &explained.information, wide, start) else { continue };
            let ln_weight = origin.ln_share + explained.ln_weight - 0.5 * best.misfit;
            mixture.expect(expected, best.place, &best.information, &best.gradient, ln_weight);
        }
    }
    for part in expected {
        mixture.add(shares.ln_nothing() + part.ln_weight + part.ln_root, part.middle, part.covariance);
    }
    mixture.estimate()
}

/// Mode under the wide component of the prior, and there: the pixels' information on the position,
/// the gradient of their fit, and their squared Mahalanobis distance.
pub(super) struct Likeliest {
    pub(super) place: Vector3<f64>,
    pub(super) information: Matrix3<f64>,
    pub(super) gradient: Vector3<f64>,
    pub(super) misfit: f64,
}

/// Finds the mode under the wide component of the prior by damped Gauss-Newton steps.
pub(super) fn best_place(
    looking: &HeadView,
    pixels: &Vector4<f64>,
    information: &Matrix4<f64>,
    wide: &Expected,
    start: Vector3<f64>,
) -> Option<Likeliest> {
    let cost = |place: &Vector3<f64>, off: &Vector4<f64>| {
        let from = place - wide.middle;
        off.dot(&(information * off)) + from.dot(&(wide.information * from))
    };
    let mut place = start;
    let mut seen = looking.see(&place)?;
    let mut off = pixels - seen.pixels;
    let mut damping = 1e-4;
    for _ in 0..MAX_STEPS {
        let by = information * seen.by_place;
        let curvature = seen.by_place.tr_mul(&by) + wide.information;
        let gradient = by.tr_mul(&off) + wide.information * (wide.middle - place);
        let damped = curvature + Matrix3::from_diagonal(&(curvature.diagonal() * damping));
        let mut step = damped.cholesky()?.solve(&gradient);
        let length = step.norm();
        if length > 0.3 {
            step *= 0.3 / length;
        }
        let next = place + step;
        let better = looking.see(&next).filter(|s| cost(&next, &(pixels - s.pixels)) <= cost(&place, &off));
        match better {
            Some(s) => {
                place = next;
                seen = s;
                off = pixels - seen.pixels;
                damping *= 0.2;
                if length < MIN_STEP_M {
                    break;
                }
            }
            None => damping *= 16.0,
        }
    }
    let by = information * seen.by_place;
    let misfit = off.dot(&(information * off));
    let gradient = by.tr_mul(&off);
    Some(Likeliest { place, information: seen.by_place.tr_mul(&by), gradient, misfit })
}
