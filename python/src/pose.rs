//! Poses: 4x4 matrices and quaternions, checked. No Python here.

use crate::failure::Failure;
use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Tolerance of a rotation matrix and of a quaternion's length: above the rounding of `float32`.
const TOLERANCE: f64 = 1e-4;
/// Larger coordinates are refused: their squares still fit.
const MAX_COORDINATE_M: f64 = 1e6;

const REMEDY: &str = "give a 4x4 matrix [[R, p], [0, 0, 0, 1]]: R a rotation, p in meters";

/// A pose from a 4x4 matrix in row order. What rounding made of the rotation is mended.
///
/// # Errors
/// Numbers that are not finite, too large, or no rotation.
pub(crate) fn from_matrix(what: &str, m: &[f64; 16]) -> Result<Isometry3<f64>, Failure> {
    let wrong = |code, message: &str| Err(Failure::new(code, message, REMEDY).at(what));
    if m.iter().any(|x| !x.is_finite()) {
        return wrong("not_finite", "the matrix has numbers that are not finite");
    }
    let last = [m[12], m[13], m[14], m[15] - 1.0];
    if last.iter().any(|x| x.abs() > TOLERANCE) {
        return wrong("pose", "the last row of the matrix is not [0, 0, 0, 1]");
    }
    let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
    let off = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    if off > TOLERANCE || rotation.determinant() <= 0.0 {
        return wrong("pose", "the upper left 3x3 of the matrix is not a rotation");
    }
    let position = position(what, [m[3], m[7], m[11]])?;
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Ok(Isometry3::from_parts(position, turn))
}

/// A position, meters.
///
/// # Errors
/// Numbers that are not finite or too large.
pub(crate) fn position(what: &str, p: [f64; 3]) -> Result<Translation3<f64>, Failure> {
    if p.iter().all(|x| x.abs() <= MAX_COORDINATE_M) {
        return Ok(Vector3::from(p).into());
    }
    let code = if p.iter().all(|x| x.is_finite()) { "pose" } else { "not_finite" };
    let message = format!("the position [{}, {}, {}] is out of bounds", p[0], p[1], p[2]);
    Err(Failure::new(code, message, "give meters, as finite numbers").at(what))
}

/// An orientation from a quaternion (x, y, z, w).
///
/// # Errors
/// Numbers that are not finite, or a length that is not 1.
pub(crate) fn from_quaternion(what: &str, [x, y, z, w]: [f64; 4]) -> Result<UnitQuaternion<f64>, Failure> {
    let q = Quaternion::new(w, x, y, z);
    let length = q.norm();
    if (length - 1.0).abs() <= TOLERANCE {
        return Ok(UnitQuaternion::from_quaternion(q));
    }
    let code = if length.is_finite() { "pose" } else { "not_finite" };
    let message = format!("the quaternion has length {length:.6}");
    Err(Failure::new(code, message, "give a unit quaternion, by q / np.linalg.norm(q)").at(what))
}

/// The 4x4 matrix of a pose, in row order.
pub(crate) fn matrix(pose: &Isometry3<f64>) -> [f64; 16] {
    let m = pose.to_homogeneous();
    std::array::from_fn(|i| m[(i / 4, i % 4)])
}
