//! Where a head's cameras are: the iCub's chain from the root over torso, neck and eyes, in Denavit-Hartenberg parameters.

use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The joints of the chain, from the root on, as the motors of `configs/robots/icub.xml` are called. Version and vergence are what
/// both eyes share: the left one pans by version plus half the vergence, the right one by version minus that.
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

/// Values of all [`JOINTS`], rad.
pub type JointAngles = [f64; 9];

/// Which head it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeadKind {
    /// The first generation, as in the paper's years.
    #[default]
    V1,
    /// The second one (2.10), with a longer neck.
    V2,
}

/// A camera, and the joints that carry it.
#[derive(Clone, Debug, PartialEq)]
pub struct EyePose {
    /// From the camera's frame (z along the optical axis, x to the right, y down) to the root's.
    pub root_from_camera: Matrix3<f64>,
    /// Where it is, m, in the root's frame.
    pub center: Vector3<f64>,
    /// Axis and a point of it for each of the eight joints that carry it, in the root's frame; the last is its pan.
    pub axes: [(Vector3<f64>, Vector3<f64>); 8],
}

/// One link: a and d in m, alpha in quarter turns, what is added to the joint's value in quarter turns.
type Link = (f64, f64, i8, i8);

impl HeadKind {
    fn links(self) -> [Link; 8] {
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

    /// Where the left and the right eye are at these joint values, rad.
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
    (a, d, alpha, more): Link,
    value: f64,
) {
    *axis = (rotation.column(2).into(), *at);
    // quarter turns are exact: no sine of them is ever asked for
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
    /// A point of the root's frame in the camera's, m.
    pub fn camera_from_root(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.root_from_camera.tr_mul(&(point - self.center))
    }

    /// How that moves with each of the [`JOINTS`], m/rad; `side` is 1 for the left eye, -1 for the right one.
    pub fn by_joint(&self, point: &Vector3<f64>, side: f64) -> [Vector3<f64>; 9] {
        let by_axis =
            |(axis, origin): &(Vector3<f64>, Vector3<f64>)| self.root_from_camera.tr_mul(&(point - origin).cross(axis));
        let [a, b, c, d, e, f, g, pan] = self.axes.each_ref().map(by_axis);
        [a, b, c, d, e, f, g, pan, 0.5 * side * pan]
    }
}
