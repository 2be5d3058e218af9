//! Objects on a support plane: the known height of their centers determines the distance.

use super::pairing::Ray;
use super::view::Estimate;
use mobee_contract::KindError;
use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;

/// Distance from the plane, m, and in standard deviations, of which both must be exceeded for a
/// position to be rejected: the eyes then detected two different objects.
const MAX_HEIGHT_ERROR: (f64, f64) = (0.1, 4.0);

/// Standard deviation of a camera's orientation, rad: one degree.
const CAMERA_SIGMA_RAD: f64 = std::f64::consts::PI / 180.0;

/// Minimum slope of a ray that meets the plane (11 degrees).
const MIN_SLOPE: f64 = 0.2;

/// Objects on a horizontal support plane. The direction is what eyes measure best; the height
/// determines the distance.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Standing {
    /// Height of an object's center in the world, m.
    pub z_m: f64,
    /// Standard deviation of the height, mm.
    #[serde(default = "sd_mm")]
    pub sd_mm: f64,
    /// Distance from the visible near side of an object to its center, along the line of sight, mm.
    #[serde(default)]
    pub behind_mm: f64,
}

fn sd_mm() -> f64 {
    5.0
}

impl Standing {
    /// Checks the ranges of the numbers.
    ///
    /// # Errors
    /// The first number out of range, with its range.
    pub(super) fn check(&self) -> Result<(), KindError> {
        let ranges = [
            ("stands.z_m", self.z_m, -100.0, 100.0),
            ("stands.sd_mm", self.sd_mm, 0.1, 1000.0),
            ("stands.behind_mm", self.behind_mm, 0.0, 1000.0),
        ];
        match ranges.into_iter().find(|(_, n, least, most)| !(least..=most).contains(&n)) {
            Some((path, n, least, most)) => Err(KindError::new(
                path,
                format!("{n} is out of bounds"),
                format!("give a number from {least} to {most}"),
            )),
            None => Ok(()),
        }
    }

    /// Returns the larger of the two angles between an eye's ray and the point where the other
    /// eye's ray meets the plane, rad; `None` if a ray is parallel to the plane or leads away from
    /// it.
    pub(super) fn beside(&self, rays: &[Ray; 2]) -> Option<f64> {
        let [left, right] = rays;
        let beside = |(from, toward): &Ray, (other, its): &Ray| {
            Some(toward.angle(&(other + its * self.far((other, its))? - from)))
        };
        Some(f64::max(beside(left, right)?, beside(right, left)?))
    }

    /// Returns the distance along a ray to the plane, m; `None` if the ray is parallel to it or
    /// leads away from it.
    fn far(&self, (from, toward): (&Vector3<f64>, &Vector3<f64>)) -> Option<f64> {
        let far = (self.z_m - from.z) / toward.z;
        (toward.z.abs() > MIN_SLOPE && far > 0.0).then_some(far)
    }

    /// Locates an object on the plane from the ray of one eye; `None` if the ray is parallel to the
    /// plane or leads away from it.
    pub(super) fn on_ray(&self, (from, toward): &Ray) -> Option<Estimate> {
        let far = self.far((from, toward))?;
        // An angular error moves the intersection within the plane, a height error moves it along
        // the ray.
        let level = Matrix3::identity() - toward * Vector3::z().transpose() / toward.z;
        let along = toward * (self.sd_mm * 1e-3 / toward.z);
        let covariance = level * level.transpose() * (far * CAMERA_SIGMA_RAD).powi(2) + along * along.transpose();
        Some(Estimate { place: from + toward * far, covariance })
    }

    /// Combines an estimate with the height of the plane; `None` if the estimate is far above or
    /// below it.
    pub(super) fn place(&self, seen: &Estimate, rays: Option<[Ray; 2]>) -> Option<Estimate> {
        let Estimate { place, covariance } = *seen;
        let along = rays.map(|[left, right]| (left.1 + right.1).normalize()).unwrap_or_default();
        let place = place + along * (self.behind_mm * 1e-3);
        let off = self.z_m - place.z;
        let variance = covariance[(2, 2)];
        if off.abs() > MAX_HEIGHT_ERROR.0.max(MAX_HEIGHT_ERROR.1 * variance.sqrt()) {
            return None;
        }
        let gain = covariance.column(2) / (variance + (self.sd_mm * 1e-3).powi(2));
        let covariance = covariance - gain * covariance.row(2);
        Some(Estimate { place: place + gain * off, covariance: (covariance + covariance.transpose()) / 2.0 })
    }
}
