//! The shapes of obstacles: `mobee.Box`, `Sphere`, `Cylinder`, `Capsule`, `Hull` and `Mesh`.

use crate::arrays::{fixed, points};
use crate::failure::Failure;
use crate::wait::background;
use mobee_import::{FitOptions, fit_link, load_mesh};
use mobee_model::{Hull, Mesh, Object, ObjectClass, Primitive, Scene, Shape};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use pyo3::prelude::*;
use std::f64::consts::FRAC_PI_2;
use std::path::PathBuf;

/// Most corners and triangles of a mesh, and points of a hull.
const MAX_MESH: usize = 1_000_000;
const MAX_HULL: usize = 112;

/// A solid for `World.add`: one of Box, Sphere, Cylinder, Capsule, Hull, Mesh.
#[pyclass(name = "Shape", module = "mobee", frozen, subclass)]
pub(crate) struct PyShape {
    pub primitives: Vec<Primitive>,
    text: String,
}

#[pymethods]
impl PyShape {
    fn __repr__(&self) -> &str {
        &self.text
    }
}

impl PyShape {
    /// One primitive about the origin.
    fn one(shape: Shape, rotation: UnitQuaternion<f64>, text: String) -> PyResult<Self> {
        let pose = Isometry3::from_parts(Vector3::zeros().into(), rotation);
        let shape = PyShape { primitives: vec![Primitive { shape, pose }], text };
        // sizes are checked here, not where the shape is used
        checked(&object(&shape.text, &shape, Isometry3::identity()))?;
        Ok(shape)
    }
}

/// The model's shapes stand along y, those of Python along z as in a URDF.
fn along_z() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2)
}

/// A box about its origin.
///
/// Parameters
/// ----------
/// size : array (3,)
///     Full edge lengths along x, y, z, meters.
#[pyclass(name = "Box", module = "mobee", frozen, extends = PyShape)]
pub(crate) struct PyBox;

#[pymethods]
impl PyBox {
    #[new]
    fn new(size: &Bound<'_, PyAny>) -> PyResult<PyClassInitializer<Self>> {
        let size = fixed::<3>("size", size, &[3], "give three edge lengths, meters")?;
        let text = format!("Box({}, {}, {})", size[0], size[1], size[2]);
        let shape = PyShape::one(Shape::Box { size: size.into() }, UnitQuaternion::identity(), text)?;
        Ok(PyClassInitializer::from(shape).add_subclass(PyBox))
    }
}

/// A ball about its origin.
///
/// Parameters
/// ----------
/// radius : float
///     Meters.
#[pyclass(name = "Sphere", module = "mobee", frozen, extends = PyShape)]
pub(crate) struct PySphere;

#[pymethods]
impl PySphere {
    #[new]
    fn new(radius: f64) -> PyResult<PyClassInitializer<Self>> {
        let text = format!("Sphere({radius})");
        let shape = PyShape::one(Shape::Sphere { radius }, UnitQuaternion::identity(), text)?;
        Ok(PyClassInitializer::from(shape).add_subclass(PySphere))
    }
}

/// A cylinder along z about its origin.
///
/// Parameters
/// ----------
/// radius, length : float
///     Meters.
#[pyclass(name = "Cylinder", module = "mobee", frozen, extends = PyShape)]
pub(crate) struct PyCylinder;

#[pymethods]
impl PyCylinder {
    #[new]
    fn new(radius: f64, length: f64) -> PyResult<PyClassInitializer<Self>> {
        let text = format!("Cylinder({radius}, {length})");
        let shape = PyShape::one(Shape::Cylinder { radius, height: length }, along_z(), text)?;
        Ok(PyClassInitializer::from(shape).add_subclass(PyCylinder))
    }
}

/// A capsule along z about its origin.
///
/// Parameters
/// ----------
/// radius : float
///     Meters.
/// length : float
///     Between the centers of its two end balls, meters: the whole is longer by two radii.
#[pyclass(name = "Capsule", module = "mobee", frozen, extends = PyShape)]
pub(crate) struct PyCapsule;

#[pymethods]
impl PyCapsule {
    #[new]
    fn new(radius: f64, length: f64) -> PyResult<PyClassInitializer<Self>> {
        let text = format!("Capsule({radius}, {length})");
        let shape = PyShape::one(Shape::Capsule { radius, height: length }, along_z(), text)?;
        Ok(PyClassInitializer::from(shape).add_subclass(PyCapsule))
    }
}

/// The convex hull of points, as simple shapes around it: never smaller, and larger by `overshoot` at most where `shapes` suffice.
///
/// Parameters
/// ----------
/// points : array (N, 3)
///     Meters, 112 points at most.
/// overshoot : float
///     Largest distance by which the shapes stick out, meters.
/// shapes : int
///     Most shapes, 1 to 64.
///
/// Attributes
/// ----------
/// overshoot : float
///     Distance by which they stick out, meters.
#[pyclass(name = "Hull", module = "mobee", frozen, extends = PyShape, get_all)]
pub(crate) struct PyHull {
    overshoot: f64,
}

#[pymethods]
impl PyHull {
    #[new]
    #[pyo3(signature = (points, *, overshoot=0.01, shapes=12))]
    fn new(
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        overshoot: f64,
        shapes: usize,
    ) -> PyResult<PyClassInitializer<Self>> {
        let points = self::points("points", points, MAX_HULL)?;
        let count = points.len();
        let (primitives, overshoot) = fitted(py, overshoot, shapes, move || {
            let hull = Hull::new(points.into_iter().map(Into::into).collect(), 0.0);
            hull.map(|hull| hull.mesh())
                .map_err(|why| Failure::new("mesh", format!("the hull {why}"), "give other points"))
        })?;
        let shape = PyShape { primitives, text: format!("Hull({count} points, overshoot={overshoot:.4})") };
        Ok(PyClassInitializer::from(shape).add_subclass(PyHull { overshoot }))
    }
}

/// A triangle mesh, as simple shapes around it: never smaller, and larger by `overshoot` at most where `shapes` suffice.
///
/// Parameters
/// ----------
/// source : str or os.PathLike, or array (N, 3)
///     An STL, OBJ, COLLADA or binary glTF file, or the corners, meters.
/// triangles : array (M, 3) of whole numbers, optional
///     With corners: each triangle by three rows of them.
/// overshoot : float
///     Largest distance by which the shapes stick out, meters.
/// shapes : int
///     Most shapes, 1 to 64.
///
/// Attributes
/// ----------
/// overshoot : float
///     Distance by which they stick out, meters.
#[pyclass(name = "Mesh", module = "mobee", frozen, extends = PyShape, get_all)]
pub(crate) struct PyMesh {
    overshoot: f64,
}

#[pymethods]
impl PyMesh {
    #[new]
    #[pyo3(signature = (source, triangles=None, *, overshoot=0.01, shapes=12))]
    fn new(
        py: Python<'_>,
        source: &Bound<'_, PyAny>,
        triangles: Option<&Bound<'_, PyAny>>,
        overshoot: f64,
        shapes: usize,
    ) -> PyResult<PyClassInitializer<Self>> {
        let given = match triangles {
            None => {
                let path: PathBuf = source.extract()?;
                Ok(path)
            }
            Some(triangles) => {
                let corners = points("source", source, MAX_MESH)?;
                let given = points("triangles", triangles, MAX_MESH)?;
                let row = |i: f64| (i >= 0.0 && i < corners.len() as f64 && i.fract() == 0.0).then_some(i as u32);
                let rows = |[a, b, c]: [f64; 3]| Some([row(a)?, row(b)?, row(c)?]);
                let triangles: Option<Vec<[u32; 3]>> = given.into_iter().map(rows).collect();
                let triangles = triangles.ok_or_else(|| {
                    let remedy = format!("give three whole numbers below {} for each", corners.len());
                    Failure::new("mesh", "triangles names a corner that is not there", remedy).at("triangles")
                })?;
                Err(Mesh { vertices: corners.into_iter().map(Into::into).collect(), triangles })
            }
        };
        let (primitives, overshoot) = fitted(py, overshoot, shapes, move || match given {
            Ok(path) => Ok(load_mesh(path)?),
            Err(mesh) => Ok(mesh),
        })?;
        let text = format!("Mesh({} shapes, overshoot={overshoot:.4})", primitives.len());
        let shape = PyShape { primitives, text };
        Ok(PyClassInitializer::from(shape).add_subclass(PyMesh { overshoot }))
    }
}

/// Primitives around a mesh, and how far they stick out.
fn fitted(
    py: Python<'_>,
    overshoot: f64,
    shapes: usize,
    mesh: impl FnOnce() -> Result<Mesh, Failure> + Send + 'static,
) -> PyResult<(Vec<Primitive>, f64)> {
    if !(1e-4..=1.0).contains(&overshoot) || !(1..=64).contains(&shapes) {
        let remedy = "give overshoot from 0.0001 to 1 m, and shapes from 1 to 64";
        return Err(Failure::new("bounds", "overshoot or shapes is out of bounds", remedy).into());
    }
    let options = FitOptions { overshoot, primitives: shapes };
    let fitted = background(py, None, move |_, _| {
        let fitted = fit_link(&[mesh()?], &options);
        fitted.map_err(|why| Failure::new("mesh", format!("the mesh: {why}"), "give a mesh with a surface, in meters"))
    })?;
    Ok((fitted.primitives, fitted.overshoot))
}

/// An obstacle of this shape.
pub(crate) fn object(name: &str, shape: &PyShape, pose: Isometry3<f64>) -> Object {
    let shapes = shape.primitives.clone();
    Object { name: name.to_owned(), class: ObjectClass::Obstacle, persistent: false, pose, shapes, color: None }
}

/// An object that a scene accepts.
pub(crate) fn checked(object: &Object) -> Result<(), Failure> {
    Scene::new(Vec::new(), vec![object.clone()])?;
    Ok(())
}
