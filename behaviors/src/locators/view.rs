//! What a locator is asked: what both eyes saw, and how the body was.

use super::head::JointAngles;
use nalgebra::{Matrix3, Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// What one eye saw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glimpse {
    /// The middle of it, pixels.
    pub center: [f64; 2],
    /// Left, top, width and height of what encloses it, pixels, if that is known.
    pub bounds: Option<[f64; 4]>,
    /// Whether the picture's border cuts it off.
    pub is_clipped: bool,
}

impl Glimpse {
    /// What encloses it, square pixels, if that is known.
    pub(super) fn area(&self) -> Option<f64> {
        self.bounds.map(|[_, _, width, height]| width * height)
    }
}

/// What both eyes saw of one object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StereoView {
    /// The left and the right eye.
    pub eyes: [Glimpse; 2],
    /// The joints, rad.
    pub encoders: JointAngles,
    /// Whether the joints were read at the instant of the exposure. In recorded tables they were read some time after.
    pub is_timed: bool,
}

impl StereoView {
    /// The middles that both eyes saw: left u and v, right u and v, pixels.
    pub fn pixels(&self) -> Vector4<f64> {
        let [l, r] = self.eyes.map(|e| e.center);
        Vector4::new(l[0], l[1], r[0], r[1])
    }

    /// The eye to which less than this share is to be seen of what the other one sees: 0 for the left one, 1 for the right one.
    pub(super) fn sees_less(&self, share: f64) -> Option<usize> {
        let [left, right] = [self.eyes[0].area()?, self.eyes[1].area()?];
        if left < share * right { Some(0) } else { (right < share * left).then_some(1) }
    }

    /// Whether the border cuts off what either eye saw.
    pub fn is_clipped(&self) -> bool {
        self.eyes.iter().any(|e| e.is_clipped)
    }
}

/// A view of an object whose place is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownView {
    /// What was seen.
    pub view: StereoView,
    /// Where it was, m, in the frame of whoever put it there.
    pub place: Vector3<f64>,
}

/// Where something is, and how sure that is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Where, m.
    pub place: Vector3<f64>,
    /// The covariance of that, square meters.
    pub covariance: Matrix3<f64>,
}

/// What a normal distribution in space has inside the ellipsoid of 95 %: the square of its radius in standard deviations.
pub const INSIDE_95: f64 = 7.814_727_903;

impl Estimate {
    /// The square of how many standard deviations `truth` is off.
    pub fn distance(&self, truth: &Vector3<f64>) -> f64 {
        let off = truth - self.place;
        self.covariance.cholesky().map_or(f64::INFINITY, |c| off.dot(&c.solve(&off)))
    }
}
