//! Camera projection: a pinhole with lens distortion.

use mobee_contract::Intrinsics;
use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Minimum distance of a point in front of the camera, m.
const MIN_DISTANCE_M: f64 = 0.02;

/// A pinhole camera with Brown-Conrady distortion, in OpenCV's convention.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Horizontal and vertical focal length, pixels.
    pub focal: [f64; 2],
    /// Principal point, pixels.
    pub center: [f64; 2],
    /// k1, k2 (radial), p1, p2 (tangential).
    pub distortion: [f64; 4],
}

impl From<Intrinsics> for Lens {
    fn from(of: Intrinsics) -> Lens {
        Lens { focal: of.focal, center: of.center, distortion: of.distortion }
    }
}

impl Lens {
    /// Returns the left and right camera of a real iCub of the first generation, from its
    /// configuration files: 640x480 pixels.
    pub fn icub() -> [Lens; 2] {
        let eye = |focal, center, k1| Lens { focal, center, distortion: [k1, 0.08, 0.0, 0.0] };
        [eye([443.6, 444.75], [344.9, 207.65], -0.32), eye([446.31, 448.45], [313.73, 224.47], -0.32)]
    }

    /// Returns whether the parameters are valid.
    pub fn is_sound(&self) -> bool {
        let numbers = self.focal.iter().chain(&self.center).chain(&self.distortion);
        numbers.into_iter().all(|n| n.is_finite()) && self.focal.iter().all(|f| *f > 0.0)
    }

    /// Projects a point of the camera frame, m; returns the pixel and its derivative, pixels/m;
    /// `None` if the point is not in front of the camera.
    pub fn project(&self, p: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let near = Vector2::new(p.x, p.y) / p.z;
        let (bent, by) = self.bend(&near);
        let f = Matrix2::from_diagonal(&Vector2::from(self.focal));
        let pinhole = Matrix2x3::new(1.0, 0.0, -near.x, 0.0, 1.0, -near.y) / p.z;
        (p.z > MIN_DISTANCE_M).then(|| (f * bent + Vector2::from(self.center), f * by * pinhole))
    }

    /// Distorts normalized image coordinates; returns the result and its derivative.
    fn bend(&self, n: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let [k1, k2, p1, p2] = self.distortion;
        let r2 = n.norm_squared();
        let g = 1.0 + r2 * (k1 + r2 * k2);
        let dg = 2.0 * (k1 + 2.0 * k2 * r2);
        let x = n.x;
        let y = n.y;
        let bent = g * n
            + Vector2::new(2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
        let xy = dg * x * y + 2.0 * (p1 * x + p2 * y);
        let by = Matrix2::new(
            g + dg * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            xy,
            xy,
            g + dg * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (bent, by)
    }

    /// Returns the derivative of the pixel with respect to k1, pixels.
    pub fn by_k1(&self, p: &Vector3<f64>) -> Vector2<f64> {
        let n = Vector2::new(p.x, p.y) / p.z;
        Vector2::from(self.focal).component_mul(&n) * n.norm_squared()
    }

    /// Returns the direction of a pixel's ray in the camera frame, not normalized.
    pub fn ray(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let bent = (pixel - Vector2::from(self.center)).component_div(&Vector2::from(self.focal));
        let mut n = bent;
        // Newton steps. Where a strong distortion folds back there is no solution, and the last
        // iterate is returned.
        for _ in 0..6 {
            let (at, by) = self.bend(&n);
            let Some(inverse) = by.try_inverse() else { break };
            let step = inverse * (bent - at);
            if step.norm() < 1.0 {
                n += step;
            } else {
                break;
            }
        }
        Vector3::new(n.x, n.y, 1.0)
    }
}
