//! Position of an object at rest from several simultaneous views. The estimates of single views are
//! not combined, because the prior would then count once for each view.

use super::looking::HeadView;
use super::model::HeadModel;
use super::noise::{Noise, ReadingOrigin};
use super::posterior::{Explained, Mixture, Shares};
use super::view::{Estimate, StereoView};
use super::workspace::Expected;
use nalgebra::{Matrix3, Vector3, Vector4};

/// Maximum number of steps of the search.
const MAX_STEPS: usize = 20;
/// Length of a step below which the search ends, m.
const MIN_STEP_M: f64 = 1e-5;

/// A view with all its explanations.
struct Explanations<'a> {
    pixels: Vector4<f64>,
    of: Vec<(HeadView<'a>, f64, Vec<Explained>)>,
    ln_nothing: f64,
}

/// Likelihood of all views near a position: their information on it, the gradient of their fit, and
/// the negative log-likelihood.
struct ViewLikelihood {
    information: Matrix3<f64>,
    gradient: Vector3<f64>,
    cost: f64,
}

/// Estimates a position from these views and their explanations, starting from a first guess;
/// `None` only if the numerics fail.
pub(super) fn locate_together(
    model: &HeadModel,
    views: &[(StereoView, Vec<ReadingOrigin>)],
    (noise, shares): (&Noise, &Shares),
    expected: &[Expected],
    guess: Vector3<f64>,
) -> Option<Estimate> {
    let explained = |(view, origins): &(StereoView, Vec<ReadingOrigin>)| {
        let of = |origin: &ReadingOrigin| {
            let looking = model.look(&view.encoders, &origin.toward);
            let covariance = noise.of(view, &looking, &origin.toward, &guess);
            (looking, origin.ln_share, shares.explanations(&covariance))
        };
        Explanations { pixels: view.pixels(), of: origins.iter().map(of).collect(), ln_nothing: shares.ln_nothing() }
    };
    let views: Vec<_> = views.iter().map(explained).collect();
    let wide = expected.first()?;
    let mut place = guess;
    let total = |near: &ViewLikelihood, place: &Vector3<f64>| {
        let from = place - wide.middle;
        near.cost + 0.5 * from.dot(&(wide.information * from))
    };
    let mut near = look(&views, &place);
    let mut damping = 1e-6;
    for _ in 0..MAX_STEPS {
        let curvature = near.information + wide.information;
        let gradient = near.gradient + wide.information * (wide.middle - place);
        let damped = curvature + Matrix3::from_diagonal(&(curvature.diagonal() * damping));
        let step = damped.cholesky()?.solve(&gradient);
        let next = place + step;
        let there = look(&views, &next);
        if total(&there, &next) <= total(&near, &place) {
            place = next;
            near = there;
            damping *= 0.1;
            if step.norm() < MIN_STEP_M {
                break;
            }
        } else {
            damping = (damping * 10.0).max(1e-3);
        }
    }
    let mut mixture = Mixture::default();
    mixture.expect(expected, place, &near.information, &near.gradient, 0.0);
    mixture.estimate()
}

fn look(views: &[Explanations], place: &Vector3<f64>) -> ViewLikelihood {
    let mut all = ViewLikelihood { information: Matrix3::zeros(), gradient: Vector3::zeros(), cost: 0.0 };
    for view in views {
        let mut likely: Vec<(f64, Matrix3<f64>, Vector3<f64>)> =
            vec![(view.ln_nothing, Matrix3::zeros(), Vector3::zeros())];
        for (looking, ln_share, explained) in &view.of {
            let Some(seen) = looking.see(place) else { continue };
            let off = view.pixels - seen.pixels;
            for one in explained {
                let by = one.information * seen.by_place;
                let misfit = off.dot(&(one.information * off));
                let ln = ln_share + one.ln_weight - 0.5 * misfit;
                likely.push((ln, seen.by_place.tr_mul(&by), by.tr_mul(&off)));
            }
        }
        let most = likely.iter().map(|l| l.0).fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = likely.iter().map(|l| (l.0 - most).exp()).sum();
        for (ln, information, gradient) in likely {
            let weight = (ln - most).exp() / sum;
            all.information += information * weight;
            all.gradient += gradient * weight;
        }
        all.cost -= most + sum.ln();
    }
    all
}
