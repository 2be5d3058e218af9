//! Results of queries.

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use crate::arrays::array;

/// Two shapes that touch, or are nearer than a given distance.
///
/// Attributes
/// ----------
/// a, b : str
///     Names of the shapes: ``robot:link#number`` or ``object#number``; a robot's shape comes first.
/// distance : float
///     Signed distance, meters; negative is penetration depth.
/// points : ndarray (2, 3)
///     The nearest (or deepest) points on `a` and on `b`, world frame, meters.
#[pyclass(name = "Contact", module = "mobee", frozen)]
pub(crate) struct PyContact {
    #[pyo3(get)]
    pub a: String,
    #[pyo3(get)]
    pub b: String,
    #[pyo3(get)]
    pub distance: f64,
    pub points: [f64; 6],
}

#[pymethods]
impl PyContact {
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, self.points.to_vec(), &[2, 3])
    }

    fn __repr__(&self) -> String {
        format!("Contact({:?}, {:?}, distance={:.6})", self.a, self.b, self.distance)
    }
}

/// An edge on which every configuration is free: proved, not sampled. True in a condition.
#[pyclass(name = "Free", module = "mobee", frozen)]
pub(crate) struct PyFree;

#[pymethods]
impl PyFree {
    fn __bool__(&self) -> bool {
        true
    }

    fn __repr__(&self) -> &'static str {
        "Free()"
    }
}

/// An edge with a configuration on it that is not free. False in a condition.
///
/// Attributes
/// ----------
/// at : float
///     The place as a share of the way from 0 to 1: ``q0 + at * (q1 - q0)``. The edge before it is free, but for stretches on which nothing
///     moves a millimeter.
/// by : tuple[str, str] or None
///     The two shapes that are too near; None for a joint limit or a constraint of the robot's file.
#[pyclass(name = "Blocked", module = "mobee", frozen, get_all)]
pub(crate) struct PyBlocked {
    pub at: f64,
    pub by: Option<(String, String)>,
}

#[pymethods]
impl PyBlocked {
    fn __bool__(&self) -> bool {
        false
    }

    fn __repr__(&self) -> String {
        match &self.by {
            Some((a, b)) => format!("Blocked(by=({a:?}, {b:?}), at={:.6})", self.at),
            None => format!("Blocked(by=None, at={:.6})", self.at),
        }
    }
}

/// An edge of which neither was proved: somewhere a pair is nearer to the clearance than 0.1 mm, and no contact was found. Treat it as
/// blocked. False in a condition.
///
/// Attributes
/// ----------
/// at : float
///     The first such place, as a share of the way from 0 to 1.
#[pyclass(name = "Unproved", module = "mobee", frozen, get_all)]
pub(crate) struct PyUnproved {
    pub at: f64,
}

#[pymethods]
impl PyUnproved {
    fn __bool__(&self) -> bool {
        false
    }

    fn __repr__(&self) -> String {
        format!("Unproved(at={:.6})", self.at)
    }
}

/// A solution of inverse kinematics.
///
/// Attributes
/// ----------
/// q : ndarray (dof,)
///     The configuration, rad or m.
/// position_error : float
///     Distance of the frame's origin from its goal, meters.
/// angle_error : float
///     By how much the frame is turned away from its goal, rad; 0 if any orientation would do.
#[pyclass(name = "Ik", module = "mobee", frozen)]
pub(crate) struct PyIk {
    pub q: Vec<f64>,
    #[pyo3(get)]
    pub position_error: f64,
    #[pyo3(get)]
    pub angle_error: f64,
}

#[pymethods]
impl PyIk {
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, self.q.clone(), &[self.q.len()])
    }

    fn __repr__(&self) -> String {
        let q: Vec<String> = self.q.iter().map(|q| format!("{q:.4}")).collect();
        format!(
            "Ik(q=[{}], position_error={:.2e}, angle_error={:.2e})",
            q.join(", "),
            self.position_error,
            self.angle_error
        )
    }
}
