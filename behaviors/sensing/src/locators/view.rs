//! Input of a locator: detections of both eyes, and joint positions.

use super::head::JointAngles;
use nalgebra::{Matrix3, Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// Detection of an object by one eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glimpse {
    /// Center, pixels.
    pub center: [f64; 2],
    /// Left, top, width and height of its bounding box, pixels, if known.
    pub bounds: Option<[f64; 4]>,
    /// It is clipped by the image border.
    pub is_clipped: bool,
}

impl Glimpse {
    /// Area of the bounding box, square pixels, if known.
    pub(super) fn area(&self) -> Option<f64> {
        self.bounds.map(|[_, _, width, height]| width * height)
    }
}

/// Detections of one object by both eyes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StereoView {
    /// Left and right eye.
    pub eyes: [Glimpse; 2],
    /// Joint positions, rad.
    pub encoders: JointAngles,
    /// The joints were read at the instant of the exposure. In recorded tables they were read some
    /// time after.
    pub is_timed: bool,
}

impl StereoView {
    /// Returns the centers in both images: left u and v, right u and v, pixels.
    pub fn pixels(&self) -> Vector4<f64> {
        let [l, r] = self.eyes.map(|e| e.center);
        Vector4::new(l[0], l[1], r[0], r[1])
    }

    /// Returns the eye with less than this share of the other eye's area: 0 for the left one, 1 for
    /// the right one.
    pub(super) fn sees_less(&self, share: f64) -> Option<usize> {
        let [left, right] = [self.eyes[0].area()?, self.eyes[1].area()?];
        if left < share * right { Some(0) } else { (right < share * left).then_some(1) }
    }

    /// Returns whether the image border clips the object in either eye.
    pub fn is_clipped(&self) -> bool {
        self.eyes.iter().any(|e| e.is_clipped)
    }
}

/// A view of an object at a known position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownView {
    /// The view.
    pub view: StereoView,
    /// Position of the object, m, in the frame of the recorded positions.
    pub place: Vector3<f64>,
}

/// Estimated position of an object.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Mean, m.
    pub place: Vector3<f64>,
    /// Covariance, m^2.
    pub covariance: Matrix3<f64>,
}

/// Squared Mahalanobis radius of the ellipsoid that contains 95 % of a normal distribution in
/// space.
pub const INSIDE_95: f64 = 7.814_727_903;

impl Estimate {
    /// Returns the squared Mahalanobis distance of `truth`; infinite if the covariance is not
    /// positive definite.
    pub fn distance(&self, truth: &Vector3<f64>) -> f64 {
        let off = truth - self.place;
        self.covariance.cholesky().map_or(f64::INFINITY, |c| off.dot(&c.solve(&off)))
    }
}
