//! `mobee.Robot`: a model and its kinematics.

use crate::arrays::{Rows, array, reserved};
use crate::attach::attach;
use crate::chain::Chain;
use crate::failure::Failure;
use crate::inverse::{FrameGoal, solve};
use crate::joints::{Beyond, JointTable};
use crate::place::{PoseArguments, PoseParts};
use crate::pose::matrix;
use crate::results::PyIk;
use crate::scene::PyScene;
use crate::wait::{background, chunks};
use crate::world::Carrier;
use mobee_model::{Object, Primitive, Robot, Skeleton, suggestion};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Rows of the first chunk of a batch.
const FIRST_CHUNK: usize = 512;
/// Bounds on how hard inverse kinematics may try.
const MAX_ATTEMPTS: usize = 1_000_000;

/// A robot model: joints, frames, collision shapes. Made by `mobee.load`; never changes.
///
/// Positions of joints are radians, or meters for prismatic joints (`units`). A configuration is an array ``(dof,)`` in the order of
/// `joint_names`, a batch is ``(N, dof)``; `float64` is taken as it is, and other real numbers are converted.
#[pyclass(name = "Robot", module = "mobee", frozen)]
pub(crate) struct PyRobot {
    pub model: Arc<Robot>,
    pub joints: Arc<JointTable>,
    frames: BTreeMap<String, RobotFrame>,
    /// The robot file.
    text: String,
    notes: Vec<String>,
    warnings: Vec<String>,
}

/// A frame of a robot: that of a node, turned.
struct RobotFrame {
    chain: Arc<Chain>,
    node: usize,
    /// `node_from_frame`.
    turn: UnitQuaternion<f64>,
}

impl PyRobot {
    /// # Arguments
    /// * `rotations`: of each link, `root_from_link` with all joints at zero, where they are known.
    /// * `text`: the robot file.
    /// * `comments`: notes and warnings.
    pub fn new(
        model: Robot,
        rotations: &BTreeMap<String, UnitQuaternion<f64>>,
        text: String,
        comments: (Vec<String>, Vec<String>),
    ) -> Self {
        let skeleton = Skeleton::new(&model, Isometry3::identity());
        let nodes = model.nodes.iter().enumerate().filter_map(|(i, node)| Some((node.name.as_deref()?, i)));
        let markers = model.markers.iter().map(|marker| (marker.name.as_str(), marker.node));
        let mut frames = BTreeMap::new();
        for (name, node) in nodes.chain(markers) {
            let turn = rotations.get(name).copied().unwrap_or_default();
            if let Some(chain) = Chain::new(&skeleton, node, &turn) {
                frames.insert(name.to_owned(), RobotFrame { chain: Arc::new(chain), node, turn });
            }
        }
        let joints = Arc::new(JointTable::new([&model]));
        let (notes, warnings) = comments;
        Self { model: Arc::new(model), joints, frames, text, notes, warnings }
    }

    /// The robot of a run.
    pub fn in_run(model: Arc<Robot>) -> Self {
        let none = (Vec::new(), Vec::new());
        Self { model: Arc::clone(&model), ..Self::new((*model).clone(), &BTreeMap::new(), String::new(), none) }
    }

    /// The chain to a frame.
    pub fn chain(&self, frame: &str) -> Result<&Arc<Chain>, Failure> {
        Ok(&self.frame(frame)?.chain)
    }

    /// Tests for a frame.
    pub fn has_frame(&self, frame: &str) -> bool {
        self.frames.contains_key(frame)
    }

    /// The robot with an object attached.
    ///
    /// # Errors
    /// A link or part that the robot does not have; an object with the name of a link.
    pub fn carrying(&self, model: &Robot, object: &Object, carrier: &Carrier) -> Result<Robot, Failure> {
        let RobotFrame { node, turn, .. } = self.frame(&carrier.link)?;
        if model.node_named(&object.name).is_some() {
            let message = format!("{} is also a link of the robot {}", object.name, model.name);
            return Err(Failure::new("duplicate", message, "give the object another name").at("world"));
        }
        let mut touch = Vec::new();
        for name in &carrier.touch {
            match model.parts.iter().position(|part| part.name == *name) {
                Some(part) => {
                    touch.extend(model.nodes.iter().enumerate().filter(|(_, n)| n.part == part).map(|(i, _)| i))
                }
                None => touch.push(self.frame(name).map_err(|failure| failure.at("touch"))?.node),
            }
        }
        let node_from_object = Isometry3::from_parts(Translation3::identity(), *turn) * carrier.pose;
        let solids = object.shapes.iter().map(|s| Primitive { pose: node_from_object * s.pose, ..s.clone() }).collect();
        let mut carrying = model.clone();
        attach(&mut carrying, &object.name, *node, solids, &touch);
        Ok(carrying)
    }

    fn frame(&self, frame: &str) -> Result<&RobotFrame, Failure> {
        self.frames.get(frame).ok_or_else(|| {
            let known: Vec<&str> = self.frames.keys().map(String::as_str).collect();
            let message = format!("the robot {} has no frame {frame:?}", self.model.name);
            Failure::new("unknown", message, suggestion(frame, "frame", &known)).at("frame")
        })
    }

    fn vector<'py>(&self, py: Python<'py>, all: Vec<f64>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, all, &[self.joints.len()])
    }

    /// Answers each row of a batch with as many numbers as `shape` has.
    fn each_row<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        shape: [usize; 2],
        answer: impl Fn(&[f64], &mut [f64]) + Send,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let rows = Rows::configurations("q", q, &self.joints)?;
        let (width, size) = (self.joints.len(), shape[0] * shape[1]);
        let mut all: Vec<f64> = reserved(rows.rows, size)?;
        let single = rows.single;
        let load = |from, count, buffer: &mut Vec<f64>| rows.load(from, count, buffer);
        let out = &mut all;
        let count = rows.rows;
        chunks(py, count, FIRST_CHUNK, load, move |poses, from| {
            self.joints.convert("q", poses, (!single).then_some(from), Beyond::Refused)?;
            // a robot without joints has rows without numbers
            let rows = poses.len().checked_div(width).unwrap_or(count - from);
            for row in 0..rows {
                let first = out.len();
                out.resize(first + size, 0.0);
                if let (Some(pose), Some(out)) = (poses.get(row * width..(row + 1) * width), out.get_mut(first..)) {
                    answer(pose, out);
                }
            }
            Ok(())
        })?;
        let whole = [rows.rows, shape[0], shape[1]];
        array(py, all, if rows.single { &whole[1..] } else { &whole })
    }
}

#[pymethods]
impl PyRobot {
    /// Name of the robot.
    #[getter]
    fn name(&self) -> &str {
        &self.model.name
    }

    /// Number of joints that move.
    #[getter]
    fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Names of the joints, in the order of every configuration.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.joints.names.clone()
    }

    /// Unit of each joint: ``"rad"``, or ``"m"`` for prismatic joints.
    #[getter]
    fn units(&self) -> Vec<&'static str> {
        self.joints.units().collect()
    }

    /// Lower limits, ndarray (dof,), rad or m.
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.vector(py, self.joints.si(|m| m.min))
    }

    /// Upper limits, ndarray (dof,), rad or m.
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.vector(py, self.joints.si(|m| m.max))
    }

    /// Home configuration, ndarray (dof,), rad or m: free of collisions if the import found such a one (see `notes`).
    #[getter]
    fn home<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.vector(py, self.joints.si(|m| m.home))
    }

    /// Body parts and the joints of each: the groups of an SRDF, or one part with all joints.
    #[getter]
    fn parts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let parts = PyDict::new(py);
        for part in &self.model.parts {
            let motors = self.model.motors.get(part.motors.clone()).unwrap_or_default();
            parts.set_item(&part.name, motors.iter().map(|m| m.name.as_str()).collect::<Vec<_>>())?;
        }
        Ok(parts)
    }

    /// Names of the frames: all links of a URDF; named nodes and markers of a robot file.
    #[getter]
    fn frames(&self) -> Vec<String> {
        self.frames.keys().cloned().collect()
    }

    /// Decisions of the import, a line each: shapes, home, pairs.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// Warnings about the robot's files, a line each with its place.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// Forward kinematics: the pose of a frame in the robot's base frame.
    ///
    /// Parameters
    /// ----------
    /// q : array (dof,) or (N, dof)
    ///     Configurations, rad or m, within the limits.
    /// frame : str
    ///     One of `frames`. Of a robot from a URDF it is the link's frame. A robot file (ZRP XML) has no link orientations: its frames
    ///     are parallel to the base frame with all joints at zero.
    ///
    /// Returns
    /// -------
    /// ndarray (4, 4) or (N, 4, 4)
    ///     ``base_from_frame``, meters.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``shape``, ``dtype``, ``not_finite``, ``limits``, ``unknown`` (frame).
    fn fk<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>, frame: &str) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let chain = Arc::clone(self.chain(frame)?);
        self.each_row(py, q, [4, 4], move |q, out| out.copy_from_slice(&matrix(&chain.forward(q))))
    }

    /// Geometric Jacobian of a frame.
    ///
    /// Parameters
    /// ----------
    /// q : array (dof,) or (N, dof)
    ///     Configurations, rad or m, within the limits.
    /// frame : str
    ///     One of `frames`.
    ///
    /// Returns
    /// -------
    /// ndarray (6, dof) or (N, 6, dof)
    ///     Velocity of the frame's origin (rows 0 to 2, m/s) and its angular velocity (rows 3 to 5, rad/s), both along the axes of the
    ///     base frame, per velocity of each joint (rad/s or m/s).
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     As `fk`.
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        frame: &str,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let chain = Arc::clone(self.chain(frame)?);
        let (joints, width) = (Arc::clone(&self.joints), self.joints.len());
        self.each_row(py, q, [6, width], move |q, out| {
            chain.jacobian(q, width, out);
            // per rad or meter, not per rad of encoder
            out.iter_mut().enumerate().for_each(|(i, entry)| *entry *= joints.scale(i % width.max(1)));
        })
    }

    /// Inverse kinematics: configurations with a frame at a pose, by damped least squares from the seed and from random starts.
    ///
    /// Parameters
    /// ----------
    /// pose : array (4, 4), optional
    ///     ``base_from_frame``, meters. Or give `position` (3,) alone for any orientation, or with `quat_xyzw` or `quat_wxyz`.
    /// frame : str
    ///     One of `frames`.
    /// seed : array (dof,), optional
    ///     The first start; solutions are sorted by their distance from it. Default: home. Joints that don't move the frame stay there.
    /// scene : Scene, optional
    ///     Only solutions that are free in this scene, with other robots at home.
    /// attempts, solutions : int
    ///     Starts at most, and solutions at most.
    /// position_tolerance, angle_tolerance : float
    ///     Largest residuals of a solution, meters and rad.
    /// random_seed : int
    ///     Seed of the random starts: equal seeds, equal answers.
    ///
    /// Returns
    /// -------
    /// list[Ik]
    ///     Distinct solutions with their residuals, the nearest to the seed first; empty if none was found.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``pose``, ``twice``, ``missing``, ``bounds``, ``unknown`` (frame, or a scene without this robot), and as `fk`.
    #[pyo3(signature = (pose=None, frame=None, seed=None, scene=None, *, position=None, quat_xyzw=None, quat_wxyz=None, attempts=50,
                        solutions=8, position_tolerance=1e-4, angle_tolerance=1e-3, random_seed=0))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn ik<'py>(
        &self,
        py: Python<'py>,
        pose: Option<&Bound<'py, PyAny>>,
        frame: Option<&str>,
        seed: Option<&Bound<'py, PyAny>>,
        scene: Option<&PyScene>,
        position: Option<&Bound<'py, PyAny>>,
        quat_xyzw: Option<&Bound<'py, PyAny>>,
        quat_wxyz: Option<&Bound<'py, PyAny>>,
        attempts: usize,
        solutions: usize,
        position_tolerance: f64,
        angle_tolerance: f64,
        random_seed: u64,
    ) -> PyResult<Vec<PyIk>> {
        let PoseParts { pose, turn } = PoseArguments { what: "pose", pose, position, quat_xyzw, quat_wxyz }.parts()?;
        let missing = |what: &str, remedy: &str| Failure::new("missing", format!("{what} is missing"), remedy).at(what);
        let pose = pose.ok_or_else(|| missing("pose", "give a 4x4 array, or position=(x, y, z)"))?;
        let frame = frame.ok_or_else(|| missing("frame", "name one of robot.frames"))?;
        let tolerance = (position_tolerance, angle_tolerance);
        if !(tolerance.0 > 0.0 && tolerance.1 > 0.0 && attempts <= MAX_ATTEMPTS) {
            let remedy = format!("give tolerances above zero, and {MAX_ATTEMPTS} attempts at most");
            return Err(Failure::new("bounds", "a tolerance or the number of attempts is out of bounds", remedy).into());
        }
        let at = pose.translation.vector;
        let goal = FrameGoal { at, turn, tolerance, attempts, solutions, random_seed };
        let seed = match seed {
            Some(seed) => self.one(seed, "seed")?,
            None => self.model.home(),
        };
        let chain = Arc::clone(self.chain(frame)?);
        let world = scene.map(|scene| scene.of_robot(&self.model)).transpose()?;
        let robot = Arc::clone(&self.model);
        let found = background(py, None, move |cancelled, _| {
            let free = |pose: &[f64]| world.as_ref().is_none_or(|world| world.is_free(pose));
            Ok(solve(&robot, &chain, &seed, &goal, free, || cancelled.is_set()))
        })?;
        let answer = |s: crate::inverse::Solution| PyIk {
            q: self.joints.configuration(&s.pose),
            position_error: s.off.0,
            angle_error: s.off.1,
        };
        Ok(found.into_iter().map(answer).collect())
    }

    /// Writes the robot file (ZRP XML): `mobee.load` reads it without a fit, and `mobee run` can use it.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     A file that does not exist yet.
    /// overwrite : bool
    ///     Replace the file if it exists.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``file``.
    #[pyo3(signature = (path, *, overwrite=false))]
    fn save(&self, path: PathBuf, overwrite: bool) -> PyResult<()> {
        if path.exists() && !overwrite {
            let message = format!("{} exists already", path.display());
            return Err(Failure::new("file", message, "name another file, or give overwrite=True").at("path").into());
        }
        if self.text.is_empty() {
            let message = "this is the robot of a run, whose file exists already";
            return Err(Failure::new("file", message, "copy the file that the run's configuration names").into());
        }
        Ok(crate::load::write(&path, &self.text)?)
    }

    fn __repr__(&self) -> String {
        format!("Robot({:?}, dof={})", self.model.name, self.joints.len())
    }
}

impl PyRobot {
    /// One configuration, as rad of encoder.
    pub fn one(&self, q: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<f64>> {
        let rows = Rows::configurations(what, q, &self.joints)?;
        if !rows.single {
            let message = format!("{what} is a batch");
            return Err(Failure::new("shape", message, "give one configuration, (dof,)").at(what).into());
        }
        let mut pose = Vec::new();
        rows.load(0, 1, &mut pose)?;
        self.joints.convert(what, &mut pose, None, Beyond::Refused)?;
        Ok(pose)
    }
}
