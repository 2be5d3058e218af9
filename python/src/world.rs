//! `mobee.World`: obstacles by name, and the links that carry them.

use crate::failure::Failure;
use crate::place::{PoseArguments, PoseParts};
use crate::shapes::{PyShape, checked, object};
use crate::wait::background;
use mobee_model::{Object, SceneError, load_world};
use nalgebra::{Isometry3, Vector3};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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
