//! What may be off in a head: where each parameter is in the vector, and how far it is believed to be off before anything was seen.

use super::head::JointAngles;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Where parameters are in the vector, without those of the warp.
pub(super) const OFFSETS: usize = 0;
pub(super) const GAINS: usize = 9;
pub(super) const SAGS: usize = 18;
pub(super) const EYES: usize = 21;
pub(super) const EYE: usize = 7;
pub(super) const FRAME: usize = 35;
pub(super) const LAG: usize = 41;
/// How many there are without a warp, and with one.
pub(super) const RIGID: usize = 42;
pub(super) const WARPED: usize = RIGID + 3 * TERMS;
pub(super) const TERMS: usize = 9;

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
    /// The terms, and how each moves with the place.
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

/// Three turns about x, y and z after one another, and the axes that they turn about.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turned {
    pub(super) all: Matrix3<f64>,
    pub(super) axes: [Vector3<f64>; 3],
}

impl Turned {
    /// By these angles, rad.
    pub(super) fn new(angles: &[f64]) -> Turned {
        let angle = |i: usize| angles.get(i).copied().unwrap_or_default().sin_cos();
        let ((sa, ca), (sb, cb), (sc, cc)) = (angle(0), angle(1), angle(2));
        let x = Matrix3::new(1.0, 0.0, 0.0, 0.0, ca, -sa, 0.0, sa, ca);
        let y = Matrix3::new(cb, 0.0, sb, 0.0, 1.0, 0.0, -sb, 0.0, cb);
        let z = Matrix3::new(cc, -sc, 0.0, sc, cc, 0.0, 0.0, 0.0, 1.0);
        let xy = x * y;
        Turned { all: xy * z, axes: [Vector3::x(), x * Vector3::y(), xy * Vector3::z()] }
    }
}

/// Joints that gravity bends, and how much it pulls there: torso pitch and roll, neck pitch.
pub(super) fn levers(q: &JointAngles) -> [(usize, f64); 3] {
    [(0, q[0].sin()), (1, q[1].sin()), (3, (q[0] + q[3]).sin())]
}
