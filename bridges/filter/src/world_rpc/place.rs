//! Conversion of the RPC's numbers to poses.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Pose with this position and the same rotation.
pub(super) fn at(pose: &Isometry3<f64>, [x, y, z]: [f64; 3]) -> Isometry3<f64> {
    Isometry3::from_parts(Vector3::new(x, y, z).into(), pose.rotation)
}

/// Pose with the rotation Rx Ry Rz of three angles in degrees.
pub(super) fn turned(pose: &Isometry3<f64>, degrees: [f64; 3]) -> Isometry3<f64> {
    let [rx, ry, rz] = degrees.map(f64::to_radians);
    let turn = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let rotation = turn(Vector3::x_axis(), rx) * turn(Vector3::y_axis(), ry) * turn(Vector3::z_axis(), rz);
    Isometry3::from_parts(pose.translation, rotation)
}

/// Pose with this rotation matrix, given row by row; `None` if it is not a rotation.
pub(super) fn with_matrix(pose: &Isometry3<f64>, rows: [f64; 9]) -> Option<Isometry3<f64>> {
    let matrix = Matrix3::from_row_slice(&rows);
    let skew = (matrix * matrix.transpose() - Matrix3::identity()).abs().max();
    // written so that NaN fails; tolerant, because people type three digits
    let rotates = skew < 0.01 && matrix.determinant() > 0.0;
    rotates.then(|| {
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&matrix));
        Isometry3::from_parts(pose.translation, rotation)
    })
}

/// Pose from the iCub simulator's numbers: position in its frame, and angles in degrees about fixed axes. The
/// simulator's cylinders lie along another axis than ours.
pub(super) fn from_simulator(name: &str, [px, py, pz, rx, ry, rz]: [f64; 6]) -> Isometry3<f64> {
    let turn = |axis, degrees: f64| UnitQuaternion::from_axis_angle(&axis, degrees.to_radians());
    let mut rotation = turn(Vector3::y_axis(), -rx) * (turn(Vector3::z_axis(), ry) * turn(Vector3::x_axis(), -rz));
    let kind = name.split(|c: char| c.is_ascii_digit()).next().unwrap_or_default();
    if kind == "cyl" || kind == "scyl" {
        rotation *= turn(Vector3::z_axis(), 90.0);
    }
    Isometry3::from_parts(Vector3::new(-(pz + 0.026), -px, py - 0.5976).into(), rotation)
}
