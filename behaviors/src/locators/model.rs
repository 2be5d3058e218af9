//! The kinematic model of a seeing head, with everything that may be off from what its drawings say: where both eyes see a place.
//!
//! Parameters are a plain vector, because the fit wants one; `parameters.rs` says where each is, and how far it is believed to be off.

use super::head::{HeadKind, JointAngles};
use super::lens::Lens;
use super::looking::Looking;
use super::parameters::*;
use nalgebra::{Matrix4, Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// The model: what the drawings say, and by how much they are off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadModel {
    /// The chain.
    pub head: HeadKind,
    /// The cameras, left and right, before the fit.
    pub lenses: [Lens; 2],
    /// The frame of the places, before the fit.
    pub frame: PlaceFrame,
    /// What may be off in the places; none: they are believed.
    pub warp: Option<Warp>,
    /// The parameters: offsets of the nine joints, rad, and gains, parts of one; sag, rad; for the left and then the right eye turns of
    /// its mount about x, y and z, rad, by what part the focal length is longer, how far the center is off, pixels, and k1; turns of the
    /// places' frame, rad, and its shift, m; the lag; and if there is a warp, its coefficients, m.
    pub theta: Vec<f64>,
}

impl HeadModel {
    /// A model as the drawings say.
    pub fn nominal(head: HeadKind, lenses: [Lens; 2], frame: PlaceFrame) -> HeadModel {
        HeadModel { head, lenses, frame, warp: None, theta: vec![0.0; RIGID] }
    }

    /// Whether it has all its numbers, and these can be.
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

    /// By what part of the way back to where joints rested the picture is older than the reading.
    pub(super) fn lag(&self) -> f64 {
        self.part::<1>(LAG)[0]
    }

    /// Where both eyes see a place, in the frame of the places, with joints that read so, rad: left u and v, right u and v, pixels;
    /// `None` if it is not before both.
    pub fn pixels(&self, joints: &JointAngles, place: &Vector3<f64>) -> Option<Vector4<f64>> {
        Some(self.look(joints, &[0.0; 9]).see(place)?.pixels)
    }

    /// The offsets of the joints, rad.
    pub fn offsets(&self) -> JointAngles {
        self.part(OFFSETS)
    }

    /// The model with joints that read `read` and had come from where they rested, `toward` that, rad.
    pub(super) fn look(&self, read: &JointAngles, toward: &JointAngles) -> Looking<'_> {
        let (offsets, gains, lag) = (self.offsets(), self.part::<9>(GAINS), self.lag());
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
            let ([_, _, _, f, cx, cy, k1], mut lens) = (eye(e), self.lenses[e]);
            lens.focal = lens.focal.map(|n| n * (1.0 + f));
            lens.center = [lens.center[0] + cx, lens.center[1] + cy];
            lens.distortion[0] += k1;
            lens
        };
        let frame = self.part::<6>(FRAME);
        Looking {
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

/// A covariance that can be inverted: its inverse and the logarithm of its determinant.
pub(super) fn invert(covariance: &Matrix4<f64>) -> Option<(Matrix4<f64>, f64)> {
    let cholesky = covariance.cholesky()?;
    let ln_det = 2.0 * cholesky.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
    Some((cholesky.inverse(), ln_det))
}
