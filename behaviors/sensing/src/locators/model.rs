//! Kinematic model of a head with cameras, including its deviations from the nominal kinematics.
//!
//! The parameters are a plain vector, as the fit requires; `parameters.rs` defines the index and
//! the prior of each.

use super::head::{HeadKind, JointAngles};
use super::lens::Lens;
use super::looking::HeadView;
use super::parameters::*;
use nalgebra::{Matrix4, Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// A head model: nominal kinematics, and the deviations from them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadModel {
    /// Kinematic chain of the head.
    pub head: HeadKind,
    /// Left and right camera before the fit.
    pub lenses: [Lens; 2],
    /// Frame of the positions before the fit.
    pub frame: PlaceFrame,
    /// Systematic error of the positions; `None`: they are exact.
    pub warp: Option<Warp>,
    /// Parameters: offsets of the nine joints, rad, and relative gain errors; sag, rad; for the
    /// left, then the right eye: rotations of its mount about x, y and z, rad, relative error of
    /// the focal length, offset of the principal point, pixels, and error of k1; rotations of the
    /// frame of the positions, rad, and its translation, m; the lag; with a warp, its coefficients,
    /// m.
    pub theta: Vec<f64>,
}

impl HeadModel {
    /// Creates a model with nominal kinematics.
    pub fn nominal(head: HeadKind, lenses: [Lens; 2], frame: PlaceFrame) -> HeadModel {
        HeadModel { head, lenses, frame, warp: None, theta: vec![0.0; RIGID] }
    }

    /// Returns whether all numbers are present and valid.
    pub(super) fn is_whole(&self) -> bool {
        let expected = if self.warp.is_some() { WARPED } else { RIGID };
        let spread = self.warp.is_none_or(|w| {
            w.center.iter().chain(&w.spread).all(|n| n.is_finite()) && w.spread.iter().all(|s| *s > 0.0)
        });
        let frame = self.frame.rotation.iter().chain(&self.frame.origin).all(|n| n.is_finite());
        let theta = self.theta.len() == expected && self.theta.iter().all(|t| t.is_finite());
        theta && frame && spread && self.lenses.iter().all(Lens::is_sound)
    }

    pub(super) fn part<const N: usize>(&self, from: usize) -> [f64; N] {
        let mut part = [0.0; N];
        part.iter_mut().zip(self.theta.iter().skip(from)).for_each(|(p, t)| *p = *t);
        part
    }

    /// Returns the lag of the image behind the encoder reading, as a share of the distance to the
    /// rest positions of the joints.
    pub(super) fn lag(&self) -> f64 {
        self.part::<1>(LAG)[0]
    }

    /// Projects a position, in the frame of the positions, for these joint readings, rad. Returns
    /// left u and v, right u and v, pixels; `None` if it is not in front of both cameras.
    pub fn pixels(&self, joints: &JointAngles, place: &Vector3<f64>) -> Option<Vector4<f64>> {
        Some(self.look(joints, &[0.0; 9]).see(place)?.pixels)
    }

    /// Returns the offsets of the joints, rad.
    pub fn offsets(&self) -> JointAngles {
        self.part(OFFSETS)
    }

    /// Evaluates the model for joints that read `read` and came from rest positions at a distance
    /// of `toward`, rad.
    pub(super) fn look(&self, read: &JointAngles, toward: &JointAngles) -> HeadView<'_> {
        let offsets = self.offsets();
        let gains = self.part::<9>(GAINS);
        let lag = self.lag();
        let mut q = [0.0; 9];
        for (i, value) in q.iter_mut().enumerate() {
            *value = read[i] + lag * toward[i];
        }
        let mut true_q = q;
        for (i, value) in true_q.iter_mut().enumerate() {
            *value += gains[i] * q[i] + offsets[i];
        }
        for ((joint, lever), sag) in levers(&q).into_iter().zip(self.part::<3>(SAGS)) {
            true_q[joint] += sag * lever;
        }
        let eye = |e: usize| self.part::<EYE>(EYES + EYE * e);
        let lens = |e: usize| {
            let [_, _, _, f, cx, cy, k1] = eye(e);
            let mut lens = self.lenses[e];
            lens.focal = lens.focal.map(|n| n * (1.0 + f));
            lens.center = [lens.center[0] + cx, lens.center[1] + cy];
            lens.distortion[0] += k1;
            lens
        };
        let frame = self.part::<6>(FRAME);
        HeadView {
            model: self,
            q,
            toward: *toward,
            eyes: self.head.eyes(&true_q),
            mounts: [Turned::new(&eye(0)[..3]), Turned::new(&eye(1)[..3])],
            lenses: [lens(0), lens(1)],
            frame: Turned::new(&frame[..3]),
            origin: self.frame.origin + Vector3::new(frame[3], frame[4], frame[5]),
            warp: self.theta.get(RIGID..).unwrap_or_default().chunks_exact(3).map(Vector3::from_column_slice).collect(),
        }
    }
}

/// Inverts a covariance; returns the inverse and the logarithm of the determinant.
pub(super) fn invert(covariance: &Matrix4<f64>) -> Option<(Matrix4<f64>, f64)> {
    let cholesky = covariance.cholesky()?;
    let ln_det = 2.0 * cholesky.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
    Some((cholesky.inverse(), ln_det))
}
