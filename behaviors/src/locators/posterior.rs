//! What is known of a place once it was seen: every explanation of the view (both eyes right, the head's pose wrong, an eye deceived)
//! with every expectation, each a normal distribution about its own best place; the answer has the mean and the covariance of all.

use super::looking::Looking;
use super::model::{HeadModel, invert};
use super::noise::{Noise, Origin};
use super::view::{Estimate, StereoView};
use super::workspace::Expected;
use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// How often a view is explained by what.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shares {
    /// The pose of the head was another one: both eyes are off together.
    pub astray: f64,
    /// One eye saw something else; for each eye.
    pub one_eye: f64,
    /// Both did.
    pub both_eyes: f64,
}

/// How far a picture is off if the head's pose was another one, pixels.
const ASTRAY: f64 = 60.0;
/// How likely something else is seen at just this pixel, as a logarithm: evenly over 640x480 pixels, where a normal distribution has
/// 1/2 pi as a factor.
const LN_ELSEWHERE: f64 = 1.838 - 12.635;
/// Steps of the search for the best place; it ends before if they get shorter than this, m.
const STEPS: (usize, f64) = (12, 1e-4);

/// One explanation of the pixels: their information matrix, and the logarithm of what it weighs before the pixels are looked at.
pub(super) struct Explained {
    pub(super) information: Matrix4<f64>,
    pub(super) ln_weight: f64,
}

impl Shares {
    /// Whether they can be.
    pub(super) fn is_sound(&self) -> bool {
        let all = [self.astray, self.one_eye, self.both_eyes];
        all.iter().all(|s| (1e-6..0.3).contains(s))
    }

    /// What may explain pixels that scatter so.
    pub(super) fn explanations(&self, covariance: &Matrix4<f64>) -> Vec<Explained> {
        let right = 1.0 - self.astray - 2.0 * self.one_eye - self.both_eyes;
        let whole = |share: f64, covariance: &Matrix4<f64>| {
            let (information, ln_det) = invert(covariance)?;
            Some(Explained { information, ln_weight: share.ln() - 0.5 * ln_det })
        };
        let together = Matrix4::from_fn(|i, j| if i % 2 == j % 2 { ASTRAY.powi(2) } else { 0.0 });
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

    /// What it weighs that both eyes saw something else, on the scale of the explanations.
    pub(super) fn ln_nothing(&self) -> f64 {
        self.both_eyes.ln() + 2.0 * LN_ELSEWHERE
    }
}

/// Likely places: a mixture of normal distributions.
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

    /// Adds what is expected together with what was seen: pixels' information on the place about `place`, and the gradient of their fit.
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

    /// Its mean and covariance.
    pub(super) fn estimate(&self) -> Option<Estimate> {
        let most = self.parts.iter().map(|p| p.0).max_by(f64::total_cmp)?;
        let (mut sum, mut place, mut square) = (0.0, Vector3::zeros(), Matrix3::zeros());
        let reference = self.parts.first()?.1;
        for (ln_weight, middle, covariance) in self.parts.iter().filter(|p| p.0 > most - 20.0) {
            let (weight, off) = ((ln_weight - most).exp(), middle - reference);
            sum += weight;
            place += off * weight;
            square += (covariance + off * off.transpose()) * weight;
        }
        let mean = place / sum;
        Some(Estimate { place: reference + mean, covariance: square / sum - mean * mean.transpose() })
    }
}

/// What is known of the place of what was seen; `None` only if numbers fail.
pub(super) fn locate(
    model: &HeadModel,
    view: &StereoView,
    origins: &[Origin],
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

/// A place that pixels and the wide expectation agree on, and there: the pixels' information on it, the gradient of their fit, and how
/// badly they fit, in squares of standard deviations.
pub(super) struct Likeliest {
    pub(super) place: Vector3<f64>,
    pub(super) information: Matrix3<f64>,
    pub(super) gradient: Vector3<f64>,
    pub(super) misfit: f64,
}

/// The best place under the wide expectation, by damped Gauss-Newton steps.
pub(super) fn best_place(
    looking: &Looking,
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
    for _ in 0..STEPS.0 {
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
                (place, seen, off, damping) = (next, s, pixels - s.pixels, damping * 0.2);
                if length < STEPS.1 {
                    break;
                }
            }
            None => damping *= 16.0,
        }
    }
    let by = information * seen.by_place;
    let (misfit, gradient) = (off.dot(&(information * off)), by.tr_mul(&off));
    Some(Likeliest { place, information: seen.by_place.tr_mul(&by), gradient, misfit })
}
