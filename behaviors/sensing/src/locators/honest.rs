//! Calibration of covariances at held-out positions, so that their 95 % regions contain 95 % of the
//! positions.

use super::tracker::fuse;
use super::view::{Estimate, INSIDE_95, KnownView, StereoView};
use super::workspace::distinct;
use nalgebra::{Matrix3, Vector3};

/// Returns the factor of the covariances that makes 95 % of these squared Mahalanobis distances
/// fall inside the 95 % regions; 1 for an empty list.
pub(super) fn widening(mut squares: Vec<f64>) -> f64 {
    squares.sort_by(f64::total_cmp);
    let at_95 = squares.get(squares.len() * 95 / 100).copied().filter(|s| s.is_finite());
    (at_95.unwrap_or(INSIDE_95) / INSIDE_95).clamp(0.05, 1e4)
}

/// Returns the covariance, m^2, to be added to that of all views of a position together so that 95
/// % of positions fall inside the 95 % regions: the error that these views share. Its shape is that
/// of the errors of most positions.
pub(super) fn common(fused: &[(Estimate, Vector3<f64>)]) -> Matrix3<f64> {
    let square = |(e, place): &(Estimate, Vector3<f64>)| (e.place - place) * (e.place - place).transpose();
    let mut sizes: Vec<f64> = fused.iter().map(|f| square(f).trace()).collect();
    sizes.sort_by(f64::total_cmp);
    let most = sizes.get(sizes.len() * 9 / 10).copied().unwrap_or_default();
    let inner: Vec<_> = fused.iter().map(square).filter(|s| s.trace() <= most).collect();
    let shape = inner.iter().sum::<Matrix3<f64>>() / inner.len().max(1) as f64;
    let inside = |part: &f64| {
        let wider = |e: &Estimate| Estimate { place: e.place, covariance: e.covariance + shape * *part };
        let right = fused.iter().filter(|(e, place)| wider(e).distance(place) <= INSIDE_95).count();
        20 * right >= 19 * fused.len()
    };
    shape * (0..80).map(|i| 0.1 * f64::from(i)).find(inside).unwrap_or(8.0)
}

/// Groups views by their positions.
pub(super) fn places_of(known: &[KnownView]) -> Vec<(Vector3<f64>, Vec<StereoView>)> {
    let views = |place: Vector3<f64>| {
        let here = known.iter().filter(|k| (k.place - place).norm() < 1e-6);
        (place, here.map(|k| k.view).collect())
    };
    distinct(known.iter().map(|k| k.place)).into_iter().map(views).collect()
}

/// Estimates each position from all of its views by `locate`, and pairs the estimate with the
/// position.
pub(super) fn fused(
    known: &[KnownView],
    locate: &dyn Fn(&StereoView) -> Option<Estimate>,
) -> Vec<(Estimate, Vector3<f64>)> {
    let one = |(place, views): (Vector3<f64>, Vec<StereoView>)| {
        let each: Vec<Estimate> = views.iter().filter_map(locate).collect();
        Some((fuse(&each, &Matrix3::zeros())?, place))
    };
    places_of(known).into_iter().filter_map(one).collect()
}
