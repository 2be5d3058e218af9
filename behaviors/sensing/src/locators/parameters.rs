//! Parameters of a head model: the index of each in the vector, and its prior.

use super::head::JointAngles;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Indices of the parameters in the vector, without those of the warp.
pub(super) const OFFSETS: usize = 0;
pub(super) const GAINS: usize = 9;
pub(super) const SAGS: usize = 18;
pub(super) const EYES: usize = 21;
pub(super) const EYE: usize = 7;
pub(super) const FRAME: usize = 35;
pub(super) const LAG: usize = 41;
/// Number of parameters without a warp.
pub(super) const RIGID: usize = 42;
/// Number of parameters with a warp.
pub(super) const WARPED: usize = RIGID + 3 * TERMS;
/// Number of terms of a warp.
pub(super) const TERMS: usize = 9;

/// Prior of a parameter: its mean and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prior {
    pub(super) middle: f64,
    pub(super) deviation: f64,
}

/// Returns the priors of all parameters. Standard deviations: encoder offsets 3 degrees (vergence
/// 6), gains 3 %, sag 1 degree, mounts 3 degrees, focal length 10 %, principal point 20 pixels, k1
/// 0.15, the frame 6 degrees and 0.3 m (it was estimated before), lag 0.5 of a step (without
/// `has_rests` there is no lag), warp 3 mm.
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

/// Frame of the positions relative to the root frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaceFrame {
    /// Rotation from the frame of the positions to the root frame.
    pub rotation: Matrix3<f64>,
    /// Origin of the frame of the positions in the root frame, m.
    pub origin: Vector3<f64>,
}

/// Systematic, smooth error of the given positions: quadratic in the position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Warp {
    /// Mean of the positions, m.
    pub center: Vector3<f64>,
    /// Standard deviation of the positions along each axis, m.
    pub spread: Vector3<f64>,
}

impl Warp {
    /// Computes the terms, and the derivative of each with respect to the position.
    pub(super) fn terms(&self, place: &Vector3<f64>) -> ([f64; TERMS], [[f64; 3]; TERMS]) {
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

/// Three successive rotations about x, y and z, and their axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turned {
    pub(super) all: Matrix3<f64>,
    pub(super) axes: [Vector3<f64>; 3],
}

impl Turned {
    /// Creates the rotations from their angles, rad.
    pub(super) fn new(angles: &[f64]) -> Turned {
        let angle = |i: usize| angles.get(i).copied().unwrap_or_default().sin_cos();
        let (sa, ca) = angle(0);
        let (sb, cb) = angle(1);
        let (sc, cc) = angle(2);
        let x = Matrix3::new(1.0, 0.0, 0.0, 0.0, ca, -sa, 0.0, sa, ca);
        let y = Matrix3::new(cb, 0.0, sb, 0.0, 1.0, 0.0, -sb, 0.0, cb);
        let z = Matrix3::new(cc, -sc, 0.0, sc, cc, 0.0, 0.0, 0.0, 1.0);
        let xy = x * y;
        Turned { all: xy * z, axes: [Vector3::x(), x * Vector3::y(), xy * Vector3::z()] }
    }
}

/// Returns the joints that sag under gravity, and the lever of gravity at each: torso pitch and
/// roll, neck pitch.
pub(super) fn levers(q: &JointAngles) -> [(usize, f64); 3] {
    [(0, q[0].sin()), (1, q[1].sin()), (3, (q[0] + q[3]).sin())]
}
