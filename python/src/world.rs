//! `mobee.World` and its shapes.

use crate::arrays::{fixed, points};
use crate::failure::Failure;
use crate::place::{PoseArguments, PoseParts};
use crate::wait::background;
use mobee_import::{FitOptions, fit_link, load_mesh};
use mobee_model::{Hull, Mesh, Object, ObjectClass, Primitive, Scene, SceneError, Shape, load_world};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most corners and triangles of a mesh, and points of a hull.
const MAX_MESH: usize = 1_000_000;
const MAX_HULL: usize = 112;

/// A solid for `World.add`: one of Box, Sphere, Cylinder, Capsule, Hull, Mesh.
#[pyclass(name = "Shape", module = "mobee", frozen, subclass)]
pub(crate) struct PyShape {
    primitives: Vec<Primitive>,
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

/// Obstacles by name. Changes after a `Scene` was made of it don't change that scene.
///
/// Poses are ``world_from_object``: a 4x4 array, or `position` with `quat_xyzw` or `quat_wxyz`; without any, the origin.
#[pyclass(name = "World", module = "mobee", frozen)]
#[derive(Default)]
pub(crate) struct PyWorld {
    objects: Mutex<Vec<WorldItem>>,
    warnings: Vec<String>,
}

/// An object, and the link that carries it.
#[derive(Clone)]
pub(crate) struct WorldItem {
    pub object: Arc<Object>,
    pub carrier: Option<Arc<Carrier>>,
}

/// The link that carries an object.
pub(crate) struct Carrier {
    pub link: String,
    /// The robot; none: the only one that has such a link.
    pub robot: Option<String>,
    /// `link_from_object`.
    pub pose: Isometry3<f64>,
    /// Links and parts that the object may touch.
    pub touch: Vec<String>,
}

impl PyWorld {
    /// The objects as they are now.
    pub fn snapshot(&self) -> Vec<WorldItem> {
        self.objects().clone()
    }

    /// The lock is held for lookups alone, with the interpreter's, so that no thread waits for it.
    fn objects(&self) -> MutexGuard<'_, Vec<WorldItem>> {
        self.objects.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn object(name: &str, shape: &PyShape, pose: Isometry3<f64>) -> Object {
    let shapes = shape.primitives.clone();
    Object { name: name.to_owned(), class: ObjectClass::Obstacle, persistent: false, pose, shapes, color: None }
}

/// An object that a scene accepts.
fn checked(object: &Object) -> Result<(), Failure> {
    Scene::new(Vec::new(), vec![object.clone()])?;
    Ok(())
}

fn find(objects: &[WorldItem], name: &str) -> Result<usize, Failure> {
    objects.iter().position(|o| o.object.name == name).ok_or_else(|| {
        let names: Vec<String> = objects.iter().take(20).map(|o| format!("`{}`", o.object.name)).collect();
        let known = if names.is_empty() { "no objects".to_owned() } else { names.join(", ") };
        Failure::from(SceneError::Unknown { name: name.to_owned(), known }).at("name")
    })
}

#[pymethods]
impl PyWorld {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Reads a world file (XML). Its targets and ghosts never collide.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``file``.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let loaded = background(py, None, move |_, _| Ok(load_world(path)?))?;
        let item = |object| WorldItem { object: Arc::new(object), carrier: None };
        let objects = Mutex::new(loaded.value.into_iter().map(item).collect());
        Ok(Self { objects, warnings: loaded.warnings.iter().map(ToString::to_string).collect() })
    }

    /// Adds an obstacle.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     A name that no other object has.
    /// shape : Box, Sphere, Cylinder, Capsule, Hull or Mesh
    /// pose : array (4, 4), optional
    ///     ``world_from_object``, meters.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``duplicate``, ``pose``, ``not_finite``, ``shape``, ``twice``.
    #[pyo3(signature = (name, shape, pose=None, *, position=None, quat_xyzw=None, quat_wxyz=None))]
    fn add(
        &self,
        name: &str,
        shape: &PyShape,
        pose: Option<&Bound<'_, PyAny>>,
        position: Option<&Bound<'_, PyAny>>,
        quat_xyzw: Option<&Bound<'_, PyAny>>,
        quat_wxyz: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let pose = place(pose, position, quat_xyzw, quat_wxyz)?;
        let object = object(name, shape, pose);
        checked(&object)?;
        let mut objects = self.objects();
        if objects.iter().any(|o| o.object.name == name) {
            return Err(Failure::from(SceneError::Duplicate { kind: "object", name: object.name }).at("name").into());
        }
        objects.push(WorldItem { object: Arc::new(object), carrier: None });
        Ok(())
    }

    /// Puts an object elsewhere.
    ///
    /// Parameters
    /// ----------
    /// name : str
    /// pose : array (4, 4), optional
    ///     ``world_from_object``, meters.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``unknown``, ``attached`` (a robot carries it), and as `add`.
    #[pyo3(signature = (name, pose=None, *, position=None, quat_xyzw=None, quat_wxyz=None))]
    fn r#move(
        &self,
        name: &str,
        pose: Option<&Bound<'_, PyAny>>,
        position: Option<&Bound<'_, PyAny>>,
        quat_xyzw: Option<&Bound<'_, PyAny>>,
        quat_wxyz: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let pose = place(pose, position, quat_xyzw, quat_wxyz)?;
        let mut objects = self.objects();
        let at = find(&objects, name)?;
        if let Some(slot) = objects.get_mut(at) {
            if let Some(carrier) = &slot.carrier {
                let message = format!("{name} is attached to {}", carrier.link);
                return Err(Failure::new("attached", message, "detach it at its new pose").at("name").into());
            }
            slot.object = Arc::new(Object { pose, ..Object::clone(&slot.object) });
        }
        Ok(())
    }

    /// Attaches an object to a link of a robot, such as a cup to a gripper.
    ///
    /// In scenes that are made afterward it moves with the link. It is tested against the world, other robots, and all links of its robot
    /// that can move relative to it, whatever its class. An attached object can be attached again, elsewhere.
    ///
    /// Parameters
    /// ----------
    /// name : str
    /// link : str
    ///     One of `Robot.frames`.
    /// pose : array (4, 4), optional
    ///     ``link_from_object``, meters: ``inv(base_from_link) @ base_from_object``, where ``robot.fk(q, link)`` is ``base_from_link``.
    ///     Without any, the object's origin is that of the link.
    /// touch : sequence of str
    ///     Links and parts of the robot that may touch it, such as fingers. For objects of the world, such as the table from which it is
    ///     lifted, see ``may_touch`` of `Scene.plan`.
    /// robot : str, optional
    ///     Name of the robot; default: the only one of the scene that has such a link.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``unknown``, and as `add`. Links are looked up when a `Scene` is made.
    #[pyo3(signature = (name, link, pose=None, *, position=None, quat_xyzw=None, quat_wxyz=None, touch=Vec::new(), robot=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn attach(
        &self,
        name: &str,
        link: &str,
        pose: Option<&Bound<'_, PyAny>>,
        position: Option<&Bound<'_, PyAny>>,
        quat_xyzw: Option<&Bound<'_, PyAny>>,
        quat_wxyz: Option<&Bound<'_, PyAny>>,
        touch: Vec<String>,
        robot: Option<String>,
    ) -> PyResult<()> {
        let pose = place(pose, position, quat_xyzw, quat_wxyz)?;
        let mut objects = self.objects();
        let at = find(&objects, name)?;
        if let Some(slot) = objects.get_mut(at) {
            slot.carrier = Some(Arc::new(Carrier { link: link.to_owned(), robot, pose, touch }));
        }
        Ok(())
    }

    /// Puts an attached object down.
    ///
    /// Parameters
    /// ----------
    /// name : str
    /// pose : array (4, 4), optional
    ///     ``world_from_object``, meters.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``unknown``, ``attached`` (it is not), and as `add`.
    #[pyo3(signature = (name, pose=None, *, position=None, quat_xyzw=None, quat_wxyz=None))]
    fn detach(
        &self,
        name: &str,
        pose: Option<&Bound<'_, PyAny>>,
        position: Option<&Bound<'_, PyAny>>,
        quat_xyzw: Option<&Bound<'_, PyAny>>,
        quat_wxyz: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let pose = place(pose, position, quat_xyzw, quat_wxyz)?;
        let mut objects = self.objects();
        let at = find(&objects, name)?;
        if let Some(slot) = objects.get_mut(at) {
            if slot.carrier.is_none() {
                let message = format!("{name} is not attached to any link");
                return Err(Failure::new("attached", message, "use move").at("name").into());
            }
            *slot = WorldItem { object: Arc::new(Object { pose, ..Object::clone(&slot.object) }), carrier: None };
        }
        Ok(())
    }

    /// The link of each attached object, by the object's name.
    #[getter]
    fn attached(&self) -> BTreeMap<String, String> {
        let item = |o: &WorldItem| Some((o.object.name.clone(), o.carrier.as_ref()?.link.clone()));
        self.objects().iter().filter_map(item).collect()
    }

    /// Takes an object away.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``unknown``.
    fn remove(&self, name: &str) -> PyResult<()> {
        let mut objects = self.objects();
        let at = find(&objects, name)?;
        objects.remove(at);
        Ok(())
    }

    /// Names of the objects, in the order in which they were added.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.objects().iter().map(|o| o.object.name.clone()).collect()
    }

    /// Warnings about the world's file, a line each with its place.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    fn __len__(&self) -> usize {
        self.objects().len()
    }

    fn __contains__(&self, name: &str) -> bool {
        self.objects().iter().any(|o| o.object.name == name)
    }

    fn __repr__(&self) -> String {
        format!("World({} objects)", self.objects().len())
    }
}

fn place(
    pose: Option<&Bound<'_, PyAny>>,
    position: Option<&Bound<'_, PyAny>>,
    quat_xyzw: Option<&Bound<'_, PyAny>>,
    quat_wxyz: Option<&Bound<'_, PyAny>>,
) -> PyResult<Isometry3<f64>> {
    let PoseParts { pose, turn } = PoseArguments { what: "pose", pose, position, quat_xyzw, quat_wxyz }.parts()?;
    Ok(pose.unwrap_or_else(|| Isometry3::from_parts(Vector3::zeros().into(), turn.unwrap_or_default())))
}
