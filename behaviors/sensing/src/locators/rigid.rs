//! Robust estimation of the rigid motion that maps one set of points to another.

use super::parameters::PlaceFrame;
use nalgebra::{Matrix3, Vector3};
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;

/// Number of triples that are tried.
const TRIALS: usize = 100;

/// Computes the least-squares motion from the first to the second of each pair (Kabsch).
fn least_squares<'a>(pairs: impl Iterator<Item = &'a (Vector3<f64>, Vector3<f64>)> + Clone) -> Option<PlaceFrame> {
    let n = pairs.clone().count() as f64;
    let (from, to) = pairs.clone().fold((Vector3::zeros(), Vector3::zeros()), |(f, t), p| (f + p.0, t + p.1));
    let from = from / n;
    let to = to / n;
    let spread: Matrix3<f64> = pairs.map(|p| (p.1 - to) * (p.0 - from).transpose()).sum();
    let svd = spread.svd(true, true);
    let u = svd.u?;
    let v_t = svd.v_t?;
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let rotation = u * mirror * v_t;
    Some(PlaceFrame { rotation, origin: to - rotation * from })
}

fn off(frame: &PlaceFrame, pair: &(Vector3<f64>, Vector3<f64>)) -> f64 {
    (frame.rotation * pair.0 + frame.origin - pair.1).norm()
}

/// Returns the motion with the least median error, refined on the pairs close to it, and that
/// median, m; `None` for fewer than three pairs, or if they are collinear.
pub(super) fn rigid(pairs: &[(Vector3<f64>, Vector3<f64>)], rng: &mut ChaCha8Rng) -> Option<(PlaceFrame, f64)> {
    if pairs.len() < 3 {
        return None;
    }
    let middle = |frame: &PlaceFrame| {
        let mut all: Vec<f64> = pairs.iter().map(|p| off(frame, p)).collect();
        let half = all.len() / 2;
        *all.select_nth_unstable_by(half, f64::total_cmp).1
    };
    let trial = |_| {
        let triple: Vec<_> = sample(rng, pairs.len(), 3).into_iter().filter_map(|i| pairs.get(i)).collect();
        let frame = least_squares(triple.iter().copied())?;
        Some((middle(&frame), frame))
    };
    let (mut reach, mut best) =
        (0..TRIALS).filter_map(trial).min_by(|a, b| a.0.total_cmp(&b.0)).filter(|b| b.0.is_finite())?;
    for _ in 0..5 {
        best = least_squares(pairs.iter().filter(|p| off(&best, p) <= 2.5 * reach.max(1e-6)))?;
        reach = middle(&best);
    }
    Some((best, reach))
}
