//! Camera poses of a head: the iCub's chain from the root over torso, neck and eyes, in
//! Denavit-Hartenberg parameters.

use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Joints of the chain, from the root on, with the motor names of `configs/robots/icub.xml`.
/// Version and vergence are shared by both eyes: the left eye pans by version plus half the
/// vergence, the right eye by version minus half the vergence.
pub const JOINTS: [&str; 9] = [
    "torso_pitch",
    "torso_roll",
    "torso_yaw",
    "neck_pitch",
    "neck_roll",
    "neck_yaw",
    "eyes_tilt",
    "eyes_vers",
    "eyes_verg",
];

/// Positions of all [`JOINTS`], rad.
pub type JointAngles = [f64; 9];

/// Generation of the head.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeadKind {
    /// First generation, as at the time of the paper.
    #[default]
    V1,
    /// Second generation (2.10), with a longer neck.
    V2,
}

/// Pose of a camera, and the joints that carry it.
#[derive(Clone, Debug, PartialEq)]
pub struct EyePose {
    /// Rotation from the camera frame (z along the optical axis, x to the right, y down) to the
    /// root frame.
    pub root_from_camera: Matrix3<f64>,
    /// Position of the camera, m, root frame.
    pub center: Vector3<f64>,
    /// Axis and a point on it, root frame, for each of the eight joints that carry the camera; the
    /// last is its pan.
    pub axes: [(Vector3<f64>, Vector3<f64>); 8],
}

/// One link: a and d in m, alpha in quarter turns, and the joint offset in quarter turns.
type DhLink = (f64, f64, i8, i8);

impl HeadKind {
    fn links(self) -> [DhLink; 8] {
        let (waist, shoulders, neck, rise, eyes) = match self {
            HeadKind::V1 => ((0.00231, -0.1933), 0.033, 0.001, -0.054, 0.0825),
            HeadKind::V2 => ((0.0053, -0.2233), 0.011, 0.0, -0.051, 0.08052),
        };
        [
            (0.032, 0.0, 1, 0),
            (0.0, -0.0055, 1, -1),
            (waist.0, waist.1, -1, -1),
            (shoulders, 0.0, 1, 1),
            (0.0, neck, -1, -1),
            (rise, eyes, -1, 1),
            (0.0, -0.034, -1, 0),
            (0.0, 0.0, 1, -1),
        ]
    }

    /// Computes the poses of the left and right eye at these joint positions, rad.
    pub fn eyes(self, q: &JointAngles) -> [EyePose; 2] {
        let mut rotation = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
        let mut at = Vector3::zeros();
        let mut axes = [(Vector3::zeros(), Vector3::zeros()); 8];
        let links = self.links();
        for ((link, axis), value) in links.iter().zip(&mut axes).zip(q).take(6) {
            step(&mut rotation, &mut at, axis, *link, *value);
        }
        [1.0, -1.0].map(|side| {
            let (mut rotation, mut at, mut axes) = (rotation, at, axes);
            let pans = [q[6], q[7] + 0.5 * side * q[8]];
            for ((link, axis), value) in links.iter().zip(&mut axes).skip(6).zip(pans) {
                step(&mut rotation, &mut at, axis, (link.0, side * link.1, link.2, link.3), value);
            }
            EyePose { root_from_camera: rotation, center: at, axes }
        })
    }
}

fn step(
    rotation: &mut Matrix3<f64>,
    at: &mut Vector3<f64>,
    axis: &mut (Vector3<f64>, Vector3<f64>),
    (a, d, alpha, more): DhLink,
    value: f64,
) {
    *axis = (rotation.column(2).into(), *at);
    // Quarter turns are exact: their sine is never computed.
    let (s, c) = value.sin_cos();
    let (s, c) = match more {
        1 => (c, -s),
        -1 => (-c, s),
        _ => (s, c),
    };
    let t = f64::from(alpha);
    *at += *rotation * Vector3::new(a * c, a * s, d);
    *rotation *= Matrix3::new(c, 0.0, s * t, s, 0.0, -c * t, 0.0, t, 0.0);
}

impl EyePose {
    /// Transforms a point from the root frame to the camera frame, m.
    pub fn camera_from_root(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.root_from_camera.tr_mul(&(point - self.center))
    }

    /// Computes the derivatives of the same with respect to each of the [`JOINTS`], m/rad; `side`
    /// is 1 for the left eye, -1 for the right one.
    pub fn by_joint(&self, point: &Vector3<f64>, side: f64) -> [Vector3<f64>; 9] {
        let by_axis =
            |(axis, origin): &(Vector3<f64>, Vector3<f64>)| self.root_from_camera.tr_mul(&(point - origin).cross(axis));
        let [a, b, c, d, e, f, g, pan] = self.axes.each_ref().map(by_axis);
        [a, b, c, d, e, f, g, pan, 0.5 * side * pan]
    }
}
