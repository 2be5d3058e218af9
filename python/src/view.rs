//! `mobee.View`: snapshot of a run for an agent in Python.

use crate::arrays::array;
use crate::joints::JointTable;
use crate::pose::matrix;
use crate::results::PyContact;
use crate::robot::PyRobot;
use crate::scene::{PyScene, contact_of};
use mobee_contract::View;
use mobee_model::{ObjectClass, Scene};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, PoisonError};

/// The robots of a run, as all views of it have them.
pub(crate) struct RunRobots {
    /// Robots and objects at the start.
    pub start: Arc<Scene>,
    pub names: Vec<String>,
    pub joints: Vec<Arc<JointTable>>,
    pub seeds: Vec<u64>,
    models: Mutex<Vec<Option<Py<PyRobot>>>>,
    /// The newest compiled scene.
    newest: Mutex<Option<(Arc<Scene>, Py<PyScene>)>>,
}

impl RunRobots {
    pub fn new(scene: &Arc<Scene>, seeds: Vec<u64>) -> Self {
        let robots = scene.robots();
        Self {
            start: Arc::clone(scene),
            names: robots.iter().map(|robot| robot.name.clone()).collect(),
            joints: robots.iter().map(|robot| Arc::new(JointTable::new([robot.as_ref()]))).collect(),
            seeds,
            models: Mutex::new(robots.iter().map(|_| None).collect()),
            newest: Mutex::default(),
        }
    }

    /// The model of a robot.
    pub fn model(&self, py: Python<'_>, scene: &Scene, robot: usize) -> PyResult<Py<PyRobot>> {
        let made = self
            .models
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get(robot)
            .and_then(|m| m.as_ref().map(|model| model.clone_ref(py)));
        if let Some(made) = made {
            return Ok(made);
        }
        let model = scene.robots().get(robot).ok_or_else(crate::wait::internal)?;
        let made = Py::new(py, PyRobot::in_run(Arc::clone(model)))?;
        if let Some(slot) = self.models.lock().unwrap_or_else(PoisonError::into_inner).get_mut(robot) {
            *slot = Some(made.clone_ref(py));
        }
        Ok(made)
    }
}

/// Snapshot of robot, objects and contacts for an agent; it never changes.
#[pyclass(name = "View", module = "mobee", frozen)]
pub(crate) struct PyView {
    pub view: View,
    pub robots: Arc<RunRobots>,
}

impl PyView {
    fn joints(&self) -> PyResult<&Arc<JointTable>> {
        Ok(self.robots.joints.get(self.view.robot).ok_or_else(crate::wait::internal)?)
    }
}

#[pymethods]
impl PyView {
    /// Time of the run at which it was taken, s.
    #[getter]
    fn at(&self) -> f64 {
        self.view.at.secs()
    }

    /// Name of the agent's robot.
    #[getter]
    fn robot(&self) -> &str {
        self.robots.names.get(self.view.robot).map_or("", String::as_str)
    }

    /// Seed for the agent's random numbers, from the run's seed and the robot's name.
    #[getter]
    fn seed(&self) -> u64 {
        self.robots.seeds.get(self.view.robot).copied().unwrap_or_default()
    }

    /// Configuration of the agent's robot as measured, ndarray (dof,), rad or m.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let q = self.joints()?.configuration(self.view.pose());
        let shape = [q.len()];
        array(py, q, &shape)
    }

    /// Configurations of all robots by their names, each ndarray (dof,), rad or m.
    #[getter]
    fn configurations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for ((name, joints), pose) in self.robots.names.iter().zip(&self.robots.joints).zip(&self.view.poses) {
            let q = joints.configuration(pose);
            let shape = [q.len()];
            all.set_item(name, array(py, q, &shape)?)?;
        }
        Ok(all)
    }

    /// Names of the robot's joints, in the order of `q`.
    #[getter]
    fn joint_names(&self) -> PyResult<Vec<String>> {
        Ok(self.joints()?.names.clone())
    }

    /// The model of the agent's robot: limits, frames, kinematics.
    #[getter]
    fn model(&self, py: Python<'_>) -> PyResult<Py<PyRobot>> {
        self.robots.model(py, &self.view.scene, self.view.robot)
    }

    /// The robot's contacts: its present ones or, while it rests after a failed motion, those that failed it.
    #[getter]
    fn contacts(&self) -> Vec<PyContact> {
        self.view.contacts.iter().map(|contact| contact_of(&self.view.scene, contact)).collect()
    }

    /// Distance that a plan should leave to everything, m.
    #[getter]
    fn clearance(&self) -> f64 {
        self.view.clearance
    }

    /// The objects of the world, by their names.
    #[getter]
    fn objects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (_, object) in self.view.scene.objects() {
            let class = match object.class {
                ObjectClass::Obstacle => "obstacle",
                ObjectClass::Target => "target",
                ObjectClass::Ghost => "ghost",
            };
            let seen = self.view.seen(&object.name);
            let item = PyWorldObject {
                name: object.name.clone(),
                kind: class,
                pose: matrix(&object.pose),
                seen_at: seen.and_then(|seen| seen.at).map(mobee_contract::Time::secs),
                is_stale: seen.is_some_and(|seen| seen.is_stale),
            };
            all.set_item(&object.name, Bound::new(py, item)?)?;
        }
        Ok(all)
    }

    /// Robots and objects for collision queries, with `clearance`. Its configurations have the joints of all robots, in the order of
    /// `configurations`. Compiled at its first use, and again after the world changed: some milliseconds.
    #[getter]
    fn scene(&self, py: Python<'_>) -> PyResult<Py<PyScene>> {
        let clearance = self.view.clearance;
        let newest =
            self.robots.newest.lock().unwrap_or_else(PoisonError::into_inner).as_ref().and_then(|(of, made)| {
                let same = Arc::ptr_eq(of, &self.view.scene) && made.get().clearance == clearance;
                same.then(|| made.clone_ref(py))
            });
        if let Some(made) = newest {
            return Ok(made);
        }
        let count = self.robots.names.len();
        let models = (0..count).map(|r| self.robots.model(py, &self.view.scene, r)).collect::<PyResult<Vec<_>>>()?;
        let made = Py::new(py, PyScene::in_run(Arc::clone(&self.view.scene), clearance, models)?)?;
        let before = self
            .robots
            .newest
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .replace((Arc::clone(&self.view.scene), made.clone_ref(py)));
        drop(before);
        Ok(made)
    }

    fn __repr__(&self) -> String {
        format!("View({:?}, at={:.3})", self.robot(), self.at())
    }
}

/// An object of a run's world.
///
/// Attributes
/// ----------
/// name : str
/// kind : str
///     ``obstacle``, ``target`` (to reach for) or ``ghost`` (shown only); robots collide with obstacles alone.
/// seen_at : float or None
///     When a sensor of the run last saw it, s; None if no sensor tracks it, or none has seen it yet.
/// is_stale : bool
///     A sensor tracks it, and has not seen it for too long.
#[pyclass(name = "WorldObject", module = "mobee", frozen)]
pub(crate) struct PyWorldObject {
    #[pyo3(get)]
    name: String,
    #[pyo3(get)]
    kind: &'static str,
    pose: [f64; 16],
    #[pyo3(get)]
    seen_at: Option<f64>,
    #[pyo3(get)]
    is_stale: bool,
}

#[pymethods]
impl PyWorldObject {
    /// Pose, ``world_from_object``, ndarray (4, 4), m.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, self.pose.to_vec(), &[4, 4])
    }

    fn __repr__(&self) -> String {
        let [_, _, _, x, _, _, _, y, _, _, _, z, ..] = self.pose;
        format!("WorldObject({:?}, {}, at ({x:.3}, {y:.3}, {z:.3}))", self.name, self.kind)
    }
}
