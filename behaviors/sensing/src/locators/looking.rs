//! Stereo projection by a head in one configuration, and its derivatives with respect to position,
//! joints and parameters.

use super::head::{EyePose, JointAngles};
use super::lens::Lens;
use super::model::HeadModel;
use super::pairing::Ray;
use super::parameters::*;
use nalgebra::{Matrix3, Matrix4x3, SMatrix, Vector3, Vector4};

/// Derivatives of the pixels with respect to each joint, pixels/rad.
pub(super) type ByJoint = SMatrix<f64, 4, 9>;

/// The head model in one configuration.
#[derive(Clone, Debug)]
pub(super) struct HeadView<'a> {
    pub(super) model: &'a HeadModel,
    pub(super) q: JointAngles,
    pub(super) toward: JointAngles,
    pub(super) eyes: [EyePose; 2],
    pub(super) mounts: [Turned; 2],
    pub(super) lenses: [Lens; 2],
    pub(super) frame: Turned,
    pub(super) origin: Vector3<f64>,
    pub(super) warp: Vec<Vector3<f64>>,
}

/// Stereo projection of a position.
#[derive(Clone, Copy, Debug)]
pub(super) struct StereoProjection {
    /// Left u and v, right u and v, pixels.
    pub(super) pixels: Vector4<f64>,
    /// Their derivatives with respect to the position, pixels/m.
    pub(super) by_place: Matrix4x3<f64>,
}

impl HeadView<'_> {
    /// Transforms a position to the root frame; returns the result and its derivative.
    fn root(&self, place: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let mut moved = *place;
        let mut by = Matrix3::identity();
        if let Some(warp) = &self.model.warp {
            let (terms, by_place) = warp.terms(place);
            for ((w, t), d) in self.warp.iter().zip(terms).zip(by_place) {
                moved += w * t;
                by += w * Vector3::from(d).transpose();
            }
        }
        let rotation = self.model.frame.rotation * self.frame.all;
        (rotation * moved + self.origin, rotation * by)
    }

    /// Projects a position to both images; `None` if it is not in front of both cameras.
    pub(super) fn see(&self, place: &Vector3<f64>) -> Option<StereoProjection> {
        let (root, by) = self.root(place);
        let mut seen = StereoProjection { pixels: Vector4::zeros(), by_place: Matrix4x3::zeros() };
        for e in 0..2 {
            let eye = &self.eyes[e];
            let point = self.mounts[e].all.tr_mul(&eye.camera_from_root(&root));
            let (pixel, by_point) = self.lenses[e].project(&point)?;
            seen.pixels.fixed_rows_mut::<2>(2 * e).copy_from(&pixel);
            let camera_from_root = self.mounts[e].all.transpose() * eye.root_from_camera.transpose();
            seen.by_place.fixed_rows_mut::<2>(2 * e).copy_from(&(by_point * (camera_from_root * by)));
        }
        Some(seen)
    }

    /// Computes the derivatives of the pixels with respect to the joints.
    pub(super) fn by_joint(&self, place: &Vector3<f64>) -> Option<ByJoint> {
        let (root, _) = self.root(place);
        let mut by = ByJoint::zeros();
        for (e, side) in [(0, 1.0), (1, -1.0)] {
            let back = self.mounts[e].all.transpose();
            let (_, by_point) = self.lenses[e].project(&(back * self.eyes[e].camera_from_root(&root)))?;
            for (j, moved) in self.eyes[e].by_joint(&root, side).into_iter().enumerate() {
                by.fixed_view_mut::<2, 1>(2 * e, j).copy_from(&(by_point * (back * moved)));
            }
        }
        Some(by)
    }

    /// Computes the derivatives of the four pixels with respect to each parameter.
    pub(super) fn by_theta(&self, place: &Vector3<f64>) -> Option<Vec<Vector4<f64>>> {
        let mut by = vec![Vector4::zeros(); self.model.theta.len()];
        let joints = self.by_joint(place)?;
        let column = |j: usize| Vector4::from(joints.column(j));
        for j in 0..9 {
            by[OFFSETS + j] = column(j);
            by[GAINS + j] = column(j) * self.q[j];
        }
        for (i, (joint, lever)) in levers(&self.q).into_iter().enumerate() {
            by[SAGS + i] = column(joint) * lever;
        }
        let gains = self.model.part::<9>(GAINS);
        let sags = self.model.part::<3>(SAGS);
        let toward = &self.toward;
        let mut turned: JointAngles = std::array::from_fn(|j| toward[j] * (1.0 + gains[j]));
        turned[0] += sags[0] * self.q[0].cos() * toward[0];
        turned[1] += sags[1] * self.q[1].cos() * toward[1];
        turned[3] += sags[2] * (self.q[0] + self.q[3]).cos() * (toward[0] + toward[3]);
        by[LAG] = joints * SMatrix::<f64, 9, 1>::from(turned);
        let (root, _) = self.root(place);
        let mut by_root = Matrix4x3::zeros();
        for e in 0..2 {
            let eye = &self.eyes[e];
            let unturned = eye.camera_from_root(&root);
            let back = self.mounts[e].all.transpose();
            let point = back * unturned;
            let (_, by_point) = self.lenses[e].project(&point)?;
            by_root.fixed_rows_mut::<2>(2 * e).copy_from(&(by_point * back * eye.root_from_camera.transpose()));
            let from = EYES + EYE * e;
            let mut set = |i: usize, moved: nalgebra::Vector2<f64>| {
                by[from + i].fixed_rows_mut::<2>(2 * e).copy_from(&moved);
            };
            for (i, axis) in self.mounts[e].axes.iter().enumerate() {
                set(i, by_point * back * unturned.cross(axis));
            }
            let lens = &self.lenses[e];
            let (pixel, _) = lens.project(&point)?;
            let f = 1.0 + self.model.part::<EYE>(from)[3];
            set(3, (pixel - nalgebra::Vector2::from(lens.center)) / f);
            set(4, nalgebra::Vector2::x());
            set(5, nalgebra::Vector2::y());
            set(6, lens.by_k1(&point));
        }
        let turned = self.model.frame.rotation * self.frame.all;
        let arm = self.model.frame.rotation.tr_mul(&(root - self.origin));
        for (i, axis) in self.frame.axes.iter().enumerate() {
            by[FRAME + i] = by_root * (self.model.frame.rotation * axis.cross(&arm));
            by[FRAME + 3 + i] = by_root.column(i).into();
        }
        if let Some(warp) = &self.model.warp {
            let (terms, _) = warp.terms(place);
            let by_moved = by_root * turned;
            for (i, t) in terms.into_iter().enumerate() {
                for k in 0..3 {
                    by[RIGID + 3 * i + k] = by_moved.column(k) * t;
                }
            }
        }
        Some(by)
    }

    /// Computes the ray of each eye to its pixels, in the frame of the positions, ignoring the
    /// warp.
    pub(super) fn rays(&self, pixels: &Vector4<f64>) -> [Ray; 2] {
        let turned = (self.model.frame.rotation * self.frame.all).transpose();
        [0, 1].map(|e| {
            let ray = self.lenses[e].ray(&pixels.fixed_rows::<2>(2 * e).into());
            let direction = (self.eyes[e].root_from_camera * (self.mounts[e].all * ray)).normalize();
            (turned * (self.eyes[e].center - self.origin), turned * direction)
        })
    }

    /// Triangulates: returns the point closest to both rays, m, in the frame of the positions,
    /// ignoring the warp; `None` if the rays are parallel or meet behind the eyes.
    pub(super) fn midpoint(&self, pixels: &Vector4<f64>) -> Option<Vector3<f64>> {
        let mut sum = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for e in 0..2 {
            let ray = self.lenses[e].ray(&pixels.fixed_rows::<2>(2 * e).into());
            let direction = (self.eyes[e].root_from_camera * (self.mounts[e].all * ray)).normalize();
            let across = Matrix3::identity() - direction * direction.transpose();
            sum += across;
            right += across * self.eyes[e].center;
        }
        let root = sum.cholesky()?.solve(&right);
        let is_before = self.eyes.iter().all(|eye| eye.camera_from_root(&root).z > 0.0);
        let place = (self.model.frame.rotation * self.frame.all).tr_mul(&(root - self.origin));
        (is_before && root.norm() < 100.0).then_some(place)
    }
}
