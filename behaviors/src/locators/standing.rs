//! What is known of objects that stand on a table: how high their middle is, and so how far away.

use super::pairing::Ray;
use super::view::Estimate;
use mobee_contract::KindError;
use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;

/// A place that is off the height where things stand by so much, m, and by so many standard deviations, is none: the eyes saw two
/// different things.
const OFF_HEIGHT: (f64, f64) = (0.1, 4.0);

/// A camera may be turned from where it is thought to be by so much, rad: by a degree.
const TURNED: f64 = std::f64::consts::PI / 180.0;

/// A ray with no more slope than this (11 degrees) goes along, not down.
const ALONG: f64 = 0.2;

/// Objects that stand on something level: what eyes are surest of is the direction, so that the height tells how far away they are.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Standing {
    /// The height of an object's middle in the world, m.
    pub z_m: f64,
    /// The standard deviation of that, mm.
    #[serde(default = "sd_mm")]
    pub sd_mm: f64,
    /// What is seen of an object is its near side. Its middle is so much farther from the eyes, mm.
    #[serde(default)]
    pub behind_mm: f64,
}

fn sd_mm() -> f64 {
    5.0
}

impl Standing {
    /// Whether its numbers can be.
    ///
    /// # Errors
    /// The first that can't, with its range.
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

    /// How far beside its own ray either eye has what the other one's ray meets at the height where things stand, at most, rad; `None` if
    /// that says nothing: a ray goes along there, or away.
    pub(super) fn beside(&self, rays: &[Ray; 2]) -> Option<f64> {
        let [left, right] = rays;
        let beside = |(from, toward): &Ray, (other, its): &Ray| {
            Some(toward.angle(&(other + its * self.far((other, its))? - from)))
        };
        Some(f64::max(beside(left, right)?, beside(right, left)?))
    }

    /// How far a ray goes to the height where things stand, m; `None` if it goes along there, or away.
    fn far(&self, (from, toward): (&Vector3<f64>, &Vector3<f64>)) -> Option<f64> {
        let far = (self.z_m - from.z) / toward.z;
        (toward.z.abs() > ALONG && far > 0.0).then_some(far)
    }

    /// Where an object is that stands there and that one eye alone sees; `None` if its ray goes along there, or away.
    pub(super) fn on_ray(&self, (from, toward): &Ray) -> Option<Estimate> {
        let far = self.far((from, toward))?;
        // an angle moves where the ray meets the height, and the height where it is met along the ray
        let level = Matrix3::identity() - toward * Vector3::z().transpose() / toward.z;
        let along = toward * (self.sd_mm * 1e-3 / toward.z);
        let covariance = level * level.transpose() * (far * TURNED).powi(2) + along * along.transpose();
        Some(Estimate { place: from + toward * far, covariance })
    }

    /// Where an object is that stands there, as far as a view tells; `None` if what it tells is far above or below that.
    pub(super) fn place(&self, seen: &Estimate, rays: Option<[Ray; 2]>) -> Option<Estimate> {
        let Estimate { place, covariance } = *seen;
        let along = rays.map(|[left, right]| (left.1 + right.1).normalize()).unwrap_or_default();
        let place = place + along * (self.behind_mm * 1e-3);
        let (off, variance) = (self.z_m - place.z, covariance[(2, 2)]);
        if off.abs() > OFF_HEIGHT.0.max(OFF_HEIGHT.1 * variance.sqrt()) {
            return None;
        }
        let gain = covariance.column(2) / (variance + (self.sd_mm * 1e-3).powi(2));
        let covariance = covariance - gain * covariance.row(2);
        Some(Estimate { place: place + gain * off, covariance: (covariance + covariance.transpose()) / 2.0 })
    }
}
