//! Poses as arguments: a 4x4 array, or a position with a quaternion whose order is in its name.

use crate::arrays::fixed;
use crate::failure::Failure;
use crate::pose;
use nalgebra::{Isometry3, UnitQuaternion};
use pyo3::prelude::*;

const MATRIX: &str = "give a 4x4 array, or position=(x, y, z) with quat_xyzw= or quat_wxyz=";

/// The arguments of a pose.
pub(crate) struct PoseArguments<'a, 'py> {
    /// Its name in messages.
    pub what: &'static str,
    pub pose: Option<&'a Bound<'py, PyAny>>,
    pub position: Option<&'a Bound<'py, PyAny>>,
    pub quat_xyzw: Option<&'a Bound<'py, PyAny>>,
    pub quat_wxyz: Option<&'a Bound<'py, PyAny>>,
}

/// The given parts of a pose.
pub(crate) struct PoseParts {
    /// The pose, if it has a position; not turned where no orientation was given.
    pub pose: Option<Isometry3<f64>>,
    /// The orientation, if it was given.
    pub turn: Option<UnitQuaternion<f64>>,
}

impl PoseArguments<'_, '_> {
    /// Position and orientation, each if it is given.
    ///
    /// # Errors
    /// Shapes, numbers that are no pose, or a thing given twice.
    pub fn parts(&self) -> PyResult<PoseParts> {
        let turn = self.orientation()?;
        if let Some(matrix) = self.pose {
            if self.position.is_some() || turn.is_some() {
                let message = format!("{} is given twice", self.what);
                return Err(Failure::new("twice", message, MATRIX).at(self.what).into());
            }
            let whole = pose::from_matrix(self.what, &fixed::<16>(self.what, matrix, &[4, 4], MATRIX)?)?;
            return Ok(PoseParts { pose: Some(whole), turn: Some(whole.rotation) });
        }
        let Some(position) = self.position else { return Ok(PoseParts { pose: None, turn }) };
        let at = fixed::<3>("position", position, &[3], "give (x, y, z), meters")?;
        let at = pose::position("position", at)?;
        Ok(PoseParts { pose: Some(Isometry3::from_parts(at, turn.unwrap_or_default())), turn })
    }

    fn orientation(&self) -> PyResult<Option<UnitQuaternion<f64>>> {
        let read = |what: &str, value: &Bound<'_, PyAny>| fixed::<4>(what, value, &[4], "give four numbers");
        match (self.quat_xyzw, self.quat_wxyz) {
            (Some(_), Some(_)) => {
                let remedy = "give one of quat_xyzw and quat_wxyz";
                Err(Failure::new("twice", "the orientation is given twice", remedy).at("quat_wxyz").into())
            }
            (Some(q), None) => Ok(Some(pose::from_quaternion("quat_xyzw", read("quat_xyzw", q)?)?)),
            (None, Some(q)) => {
                let [w, x, y, z] = read("quat_wxyz", q)?;
                Ok(Some(pose::from_quaternion("quat_wxyz", [x, y, z, w])?))
            }
            (None, None) => Ok(None),
        }
    }
}

/// Base of each robot of a scene; without an argument all are at the origin.
///
/// # Errors
/// Another number of poses than of robots, or a faulty one.
pub(crate) fn bases_of(bases: Option<&Bound<'_, PyAny>>, robots: usize) -> PyResult<Vec<Isometry3<f64>>> {
    let Some(bases) = bases else { return Ok(vec![Isometry3::identity(); robots]) };
    let one = |pose: &Bound<'_, PyAny>| {
        let argument =
            PoseArguments { what: "bases", pose: Some(pose), position: None, quat_xyzw: None, quat_wxyz: None };
        Ok::<_, PyErr>(argument.parts()?.pose.unwrap_or_default())
    };
    if robots == 1
        && let Ok(base) = one(bases)
    {
        return Ok(vec![base]);
    }
    let mut all = Vec::new();
    for base in bases.try_iter()?.take(robots + 1) {
        all.push(one(&base?)?);
    }
    if all.len() != robots {
        let message = format!("bases has another number of poses than there are robots, {robots}");
        return Err(Failure::new("shape", message, "give a 4x4 array for each robot").at("bases").into());
    }
    Ok(all)
}
