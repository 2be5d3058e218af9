//! The kinematic model of a seeing head, with everything that may be off from what its drawings say: where both eyes see a place.
//!
//! Parameters are a plain vector, because the fit wants one; [`Parameter`] says where each is, and how far it is believed to be off.

use super::head::{EyePose, HeadKind, JointAngles};
use super::lens::Lens;
use nalgebra::{Matrix3, Matrix4, Matrix4x3, SMatrix, Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// How pixels move with each joint, pixels/rad.
pub type ByJoint = SMatrix<f64, 4, 9>;

/// Where parameters are in the vector, without those of the warp.
pub(super) const OFFSETS: usize = 0;
const GAINS: usize = 9;
const SAGS: usize = 18;
const EYES: usize = 21;
const EYE: usize = 7;
const FRAME: usize = 35;
pub(super) const LAG: usize = 41;
/// How many there are without a warp, and with one.
pub(super) const RIGID: usize = 42;
pub(super) const WARPED: usize = RIGID + 3 * TERMS;
const TERMS: usize = 9;

/// What is believed of a parameter before anything was seen: its middle and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prior {
    pub(super) middle: f64,
    pub(super) deviation: f64,
}

/// The priors of all parameters: encoders 3 degrees (vergence 6) and 3 %, sag 1 degree, mounts 3 degrees, focal length 10 %, center 20 pixels, k1 0.15,
/// the frame 6 degrees and 0.3 m (it was found roughly before), lag 0.5 of a step (`has_rests`; else there is none), warp 3 mm.
pub(super) fn priors(has_rests: bool, has_warp: bool) -> Vec<Prior> {
    let degree = 1.0_f64.to_radians();
    let mut all = vec![Prior { middle: 0.0, deviation: 3.0 * degree }; WARPED];
    let mut set = |from: usize, deviations: &[f64]| {
        all.iter_mut().skip(from).zip(deviations).for_each(|(p, d)| p.deviation = *d);
    };
    set(OFFSETS + 8, &[6.0 * degree]);
    set(GAINS, &[0.03; 9]);
    set(SAGS, &[degree; 3]);
    for eye in 0..2 {
        set(EYES + EYE * eye, &[3.0 * degree, 3.0 * degree, 3.0 * degree, 0.1, 20.0, 20.0, 0.15]);
    }
    set(FRAME, &[6.0 * degree, 6.0 * degree, 6.0 * degree, 0.3, 0.3, 0.3]);
    set(LAG, &[if has_rests { 0.5 } else { 1e-9 }]);
    set(RIGID, &[0.003; 3 * TERMS]);
    if has_rests && let Some(lag) = all.get_mut(LAG) {
        lag.middle = 0.5;
    }
    all.truncate(if has_warp { WARPED } else { RIGID });
    all
}

/// Where places are told: how their frame lies in the root's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaceFrame {
    /// From the places' frame to the root's.
    pub rotation: Matrix3<f64>,
    /// Its origin in the root's frame, m.
    pub origin: Vector3<f64>,
}

/// Where whoever put the objects there was off, smoothly: quadratic in the place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Warp {
    /// The middle of the places, m.
    pub center: Vector3<f64>,
    /// How far they spread, m.
    pub spread: Vector3<f64>,
}

impl Warp {
    fn terms(&self, place: &Vector3<f64>) -> ([f64; TERMS], [[f64; 3]; TERMS]) {
        let n = (place - self.center).component_div(&self.spread);
        let [x, y, z] = [n.x, n.y, n.z];
        let [a, b, c] = [1.0 / self.spread.x, 1.0 / self.spread.y, 1.0 / self.spread.z];
        let terms = [x, y, z, x * x, x * y, x * z, y * y, y * z, z * z];
        let by_place = [
            [a, 0.0, 0.0],
            [0.0, b, 0.0],
            [0.0, 0.0, c],
            [2.0 * x * a, 0.0, 0.0],
            [y * a, x * b, 0.0],
            [z * a, 0.0, x * c],
            [0.0, 2.0 * y * b, 0.0],
            [0.0, z * b, y * c],
            [0.0, 0.0, 2.0 * z * c],
        ];
        (terms, by_place)
    }
}

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

/// The model for one posture.
#[derive(Clone, Debug)]
pub(super) struct Looking<'a> {
    model: &'a HeadModel,
    q: JointAngles,
    toward: JointAngles,
    eyes: [EyePose; 2],
    mounts: [Turned; 2],
    lenses: [Lens; 2],
    frame: Turned,
    origin: Vector3<f64>,
    warp: Vec<Vector3<f64>>,
}

/// What both eyes see of a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Left u and v, right u and v, pixels.
    pub(super) pixels: Vector4<f64>,
    /// How these move with the place, pixels/m.
    pub(super) by_place: Matrix4x3<f64>,
}

/// Three turns about x, y and z after one another, and the axes that they turn about.
#[derive(Clone, Copy, Debug)]
struct Turned {
    all: Matrix3<f64>,
    axes: [Vector3<f64>; 3],
}

impl Turned {
    fn new(angles: &[f64]) -> Turned {
        let angle = |i: usize| angles.get(i).copied().unwrap_or_default().sin_cos();
        let ((sa, ca), (sb, cb), (sc, cc)) = (angle(0), angle(1), angle(2));
        let x = Matrix3::new(1.0, 0.0, 0.0, 0.0, ca, -sa, 0.0, sa, ca);
        let y = Matrix3::new(cb, 0.0, sb, 0.0, 1.0, 0.0, -sb, 0.0, cb);
        let z = Matrix3::new(cc, -sc, 0.0, sc, cc, 0.0, 0.0, 0.0, 1.0);
        let xy = x * y;
        Turned { all: xy * z, axes: [Vector3::x(), x * Vector3::y(), xy * Vector3::z()] }
    }
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

    fn part<const N: usize>(&self, from: usize) -> [f64; N] {
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

/// Joints that gravity bends, and how much it pulls there: torso pitch and roll, neck pitch.
fn levers(q: &JointAngles) -> [(usize, f64); 3] {
    [(0, q[0].sin()), (1, q[1].sin()), (3, (q[0] + q[3]).sin())]
}

impl Looking<'_> {
    /// A place in the root's frame, and how that moves with the place.
    fn root(&self, place: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let (mut moved, mut by) = (*place, Matrix3::identity());
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

    /// What the eyes see of a place; `None` if it is not before both.
    pub(super) fn see(&self, place: &Vector3<f64>) -> Option<Seen> {
        let (root, by) = self.root(place);
        let mut seen = Seen { pixels: Vector4::zeros(), by_place: Matrix4x3::zeros() };
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

    /// How the pixels of a place move with the joints.
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

    /// How the pixels of a place move with each parameter; four numbers for each, in their order.
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
        let (gains, sags, toward) = (self.model.part::<9>(GAINS), self.model.part::<3>(SAGS), &self.toward);
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

    /// Where the two rays pass each other nearest, m, in the frame of the places (a warp is left out); `None` if they are parallel or
    /// meet behind the eyes.
    pub(super) fn midpoint(&self, pixels: &Vector4<f64>) -> Option<Vector3<f64>> {
        let (mut sum, mut right) = (Matrix3::zeros(), Vector3::zeros());
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

/// A covariance that can be inverted: its inverse and the logarithm of its determinant.
pub(super) fn invert(covariance: &Matrix4<f64>) -> Option<(Matrix4<f64>, f64)> {
    let cholesky = covariance.cholesky()?;
    let ln_det = 2.0 * cholesky.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
    Some((cholesky.inverse(), ln_det))
}
