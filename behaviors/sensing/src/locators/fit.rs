//! Fit of a head model to views of known positions: robust Levenberg-Marquardt with priors.
//!
//! The fit minimizes, over the parameters, the sum over views of (nu + 4)/2 ln(1 + d^2/nu), where d
//! is the Mahalanobis norm of the residual of the four pixels (Student's t-distribution), plus half
//! the sum of the squared parameters in units of their prior deviations.

use super::model::HeadModel;
use super::noise::{Noise, ReadingOrigin};
use super::parameters::Prior;
use super::view::KnownView;
use nalgebra::{DMatrix, DVector, Matrix4, Vector4};

/// Degrees of freedom of Student's t-distribution.
const NU: f64 = 4.0;
/// Squared Mahalanobis norm assigned to a view that the model can't project at all.
const UNSEEN_SQUARE: f64 = 1e4;
/// Maximum number of steps.
const MAX_STEPS: usize = 25;
/// Minimum decrease of the cost for another step.
const MIN_DECREASE: f64 = 1e-3;

/// A view of a known position, with its explanation.
pub(super) struct Lesson<'a> {
    pub(super) known: &'a KnownView,
    pub(super) origin: ReadingOrigin,
}

/// Returns the residual of a view, pixels: observation minus prediction.
pub(super) fn off(model: &HeadModel, lesson: &Lesson) -> Option<Vector4<f64>> {
    let view = &lesson.known.view;
    let seen = model.look(&view.encoders, &lesson.origin.toward).see(&lesson.known.place)?;
    Some(view.pixels() - seen.pixels)
}

fn information(model: &HeadModel, lesson: &Lesson, noise: &Noise) -> Matrix4<f64> {
    let view = &lesson.known.view;
    let looking = model.look(&view.encoders, &lesson.origin.toward);
    let covariance = noise.of(view, &looking, &lesson.origin.toward, &lesson.known.place);
    covariance.try_inverse().unwrap_or_else(Matrix4::zeros)
}

fn cost(model: &HeadModel, lessons: &[Lesson], weights: &[Matrix4<f64>], priors: &[Prior]) -> f64 {
    let one = |(lesson, information): (&Lesson, &Matrix4<f64>)| {
        let square = off(model, lesson).map_or(UNSEEN_SQUARE, |r| r.dot(&(information * r)));
        0.5 * (NU + 4.0) * (square / NU).ln_1p()
    };
    let strange = |(t, p): (&f64, &Prior)| 0.5 * ((t - p.middle) / p.deviation).powi(2);
    lessons.iter().zip(weights).map(one).sum::<f64>() + model.theta.iter().zip(priors).map(strange).sum::<f64>()
}

/// Fits the parameters, starting from their current values. Returns the Hessian of the objective
/// there: the inverse of the parameters' covariance.
pub(super) fn fit(model: &mut HeadModel, lessons: &[Lesson], noise: &Noise, priors: &[Prior]) -> DMatrix<f64> {
    let weights: Vec<_> = lessons.iter().map(|l| information(model, l, noise)).collect();
    let mut now = cost(model, lessons, &weights, priors);
    let mut damping = 1e-3;
    let (mut curvature, mut gradient) = normal(model, lessons, &weights, priors);
    for _ in 0..MAX_STEPS {
        let damped = &curvature + DMatrix::from_diagonal(&(curvature.diagonal() * damping));
        let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else { break };
        let mut next = model.clone();
        next.theta.iter_mut().zip(step.iter()).for_each(|(t, s)| *t += s);
        let then = cost(&next, lessons, &weights, priors);
        // Written so that a cost of NaN is not a decrease.
        if then.partial_cmp(&now) != Some(std::cmp::Ordering::Less) {
            damping *= 10.0;
            if damping > 1e8 {
                break;
            }
            continue;
        }
        let gained = now - then;
        *model = next;
        now = then;
        damping = (damping * 0.1).max(1e-9);
        (curvature, gradient) = normal(model, lessons, &weights, priors);
        if gained < MIN_DECREASE {
            break;
        }
    }
    curvature
}

/// Computes the normal equations of a Gauss-Newton step: the Hessian of the weighted views and of
/// the priors, and the negative gradient.
fn normal(
    model: &HeadModel,
    lessons: &[Lesson],
    weights: &[Matrix4<f64>],
    priors: &[Prior],
) -> (DMatrix<f64>, DVector<f64>) {
    let n = model.theta.len();
    let mut rows: Vec<f64> = Vec::with_capacity(lessons.len() * 4 * n);
    let mut gradient = DVector::zeros(n);
    for (lesson, information) in lessons.iter().zip(weights) {
        let view = &lesson.known.view;
        let looking = model.look(&view.encoders, &lesson.origin.toward);
        let Some(seen) = looking.see(&lesson.known.place) else { continue };
        let Some(by) = looking.by_theta(&lesson.known.place) else { continue };
        let r = view.pixels() - seen.pixels;
        let weight = (NU + 4.0) / (NU + r.dot(&(information * r)));
        let Some(cholesky) = (information * weight).cholesky() else { continue };
        let whiten = cholesky.l().transpose();
        let r = whiten * r;
        for (i, d) in by.iter().enumerate() {
            let white = whiten * d;
            gradient[i] += white.dot(&r);
            rows.extend(white.iter());
        }
    }
    // Column-major: four numbers of a view for each parameter, all parameters of a view together.
    let views = rows.len() / (4 * n).max(1);
    let mut curvature = DMatrix::zeros(n, n);
    for view in 0..views {
        let block = nalgebra::DMatrixView::from_slice(&rows[view * 4 * n..(view + 1) * 4 * n], 4, n);
        curvature.gemm_tr(1.0, &block, &block, 1.0);
    }
    for (i, (t, p)) in model.theta.iter().zip(priors).enumerate() {
        curvature[(i, i)] += p.deviation.powi(-2);
        gradient[i] += (p.middle - t) / p.deviation.powi(2);
    }
    (curvature, gradient)
}

/// Estimates the covariance of residuals, most of which are normally distributed, some far off:
/// Student's t-distribution, by iterative reweighting.
pub(super) fn scatter(offs: &[Vector4<f64>]) -> Matrix4<f64> {
    let mut sizes: Vec<f64> = offs.iter().map(|o| o.norm_squared()).collect();
    sizes.sort_by(f64::total_cmp);
    let near = sizes.get(sizes.len() * 4 / 5).copied().unwrap_or(1.0);
    // Never less than a third of a pixel: rounded pixels are not more exact.
    let least = Matrix4::identity() * 0.1;
    let inner: Vec<_> = offs.iter().filter(|o| o.norm_squared() <= near).collect();
    let mut covariance =
        inner.iter().map(|o| *o * o.transpose()).sum::<Matrix4<f64>>() / inner.len().max(1) as f64 + least;
    for _ in 0..10 {
        let Some(cholesky) = covariance.cholesky() else { break };
        let weighted = |o: &Vector4<f64>| o * o.transpose() * ((NU + 4.0) / (NU + o.dot(&cholesky.solve(o))));
        covariance = offs.iter().map(weighted).sum::<Matrix4<f64>>() / offs.len().max(1) as f64 + least;
    }
    covariance
}

/// Estimates the covariance of the residuals within 18 squared standard deviations, iteratively.
pub(super) fn inner_scatter(offs: &[Vector4<f64>]) -> Matrix4<f64> {
    let mut covariance = scatter(offs) * 1.5;
    for _ in 0..6 {
        let Some(cholesky) = covariance.cholesky() else { break };
        let inner: Vec<_> = offs.iter().filter(|o| o.dot(&cholesky.solve(o)) < 18.0).collect();
        let sum = inner.iter().map(|o| *o * o.transpose()).sum::<Matrix4<f64>>();
        covariance = sum / inner.len().max(1) as f64 + Matrix4::identity() * 0.1;
    }
    covariance
}
