//! `mobee.Scene`: robots and obstacles, and their contacts.

use crate::arrays::{Rows, array, reserved};
use crate::failure::Failure;
use crate::joints::{Beyond, JointTable};
use crate::place::bases_of;
use crate::plan::{FoundPath, PathSearch, PyPlan, pair_rules, seconds};
use crate::results::{PyBlocked, PyContact, PyFree, PyUnproved};
use crate::robot::PyRobot;
use crate::wait::{background, chunks};
use crate::world::{PyWorld, WorldItem};
use mobee_fast::{EdgeVerdict, FastScene};
use mobee_model::{Contact, Object, Robot, Scene};
use pyo3::prelude::*;
use pyo3::types::PyList;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Robots of a scene at most.
const MAX_ROBOTS: usize = 64;
/// Rows of the first chunk of a batch: of a fast query, of one that measures distances, and of edges.
const FIRST_FREE: usize = 1024;
const FIRST_SCALAR: usize = 16;
const FIRST_EDGES: usize = 32;
/// Goals of a plan at most.
const MAX_GOALS: usize = 1000;
/// Contacts that a call returns at most.
const MAX_CONTACTS: usize = 1_000_000;

/// Robots and obstacles in one world, as they were when it was made; it never changes.
///
/// Parameters
/// ----------
/// robots : Robot or sequence of Robot
///     A configuration of the scene has the joints of all of them, in this order.
/// world : World, optional
///     Obstacles, as they are now.
/// bases : array (4, 4) or sequence of them, optional
///     Base of each robot, ``world_from_base``; default: at the origin.
/// clearance : float
///     Pairs of shapes must be farther apart than this to be free, meters.
///
/// Raises
/// ------
/// MobeeError
///     code ``duplicate`` (two robots of one name), ``clearance``, ``pose``, ``shape``, ``joints``, ``too_many``.
#[pyclass(name = "Scene", module = "mobee", frozen)]
pub(crate) struct PyScene {
    pub scene: Arc<Scene>,
    pub joints: JointTable,
    pub clearance: f64,
    robots: Vec<Py<PyRobot>>,
    /// Compiled: one for each call that is under way, the rest to be used again. The lock is held with the interpreter's.
    fast: Mutex<Vec<FastScene>>,
}

/// One robot of a scene, with all others at home.
pub(crate) struct SceneRobot {
    scene: Arc<Scene>,
    robot: usize,
    clearance: f64,
}

impl SceneRobot {
    /// Tests that the robot is free at a pose, rad of encoder.
    pub fn is_free(&self, pose: &[f64]) -> bool {
        let mut poses = self.scene.home();
        if let Some(own) = poses.get_mut(self.robot) {
            *own = Arc::from(pose);
        }
        self.scene.robot_free(self.robot, &poses, self.clearance)
    }
}

impl PyScene {
    /// The scene of a run.
    pub fn in_run(scene: Arc<Scene>, clearance: f64, robots: Vec<Py<PyRobot>>) -> Result<Self, Failure> {
        let joints = JointTable::new(scene.robots().iter().map(Arc::as_ref));
        let fast = FastScene::new(&scene, clearance)?;
        Ok(Self { scene, joints, clearance, robots, fast: Mutex::new(vec![fast]) })
    }

    /// The index of a robot, which must be the very one that the scene was made with.
    pub fn index_of(&self, robot: &Arc<Robot>) -> Result<usize, Failure> {
        // the scene's own models have the attached objects
        self.robots.iter().position(|r| Arc::ptr_eq(&r.get().model, robot)).ok_or_else(|| {
            let remedy = "give a scene that was made with this robot";
            Failure::new("unknown", format!("the scene has no robot {}", robot.name), remedy).at("scene")
        })
    }

    /// For queries about one robot.
    pub fn of_robot(&self, robot: &Arc<Robot>) -> Result<SceneRobot, Failure> {
        let robot = self.index_of(robot)?;
        Ok(SceneRobot { scene: Arc::clone(&self.scene), robot, clearance: self.clearance })
    }

    /// Runs a query with a compiled scene of its own.
    fn with_fast<T>(&self, query: impl FnOnce(&mut FastScene) -> PyResult<T>) -> PyResult<T> {
        let lock = || self.fast.lock().unwrap_or_else(PoisonError::into_inner);
        let spare = {
            let mut all = lock();
            // the last one stays, to be copied
            if all.len() > 1 { all.pop() } else { all.first().cloned() }
        };
        let mut fast = match spare {
            Some(fast) => fast,
            None => FastScene::new(&self.scene, self.clearance).map_err(Failure::from)?,
        };
        let answer = query(&mut fast);
        lock().push(fast);
        answer
    }

    /// A row as poses of each robot.
    fn split<'a>(&self, row: &'a [f64]) -> Vec<&'a [f64]> {
        let mut rest = row;
        let own = |robot: &Arc<Robot>| {
            let (own, others) = rest.split_at_checked(robot.motors.len()).unwrap_or((rest, &[]));
            rest = others;
            own
        };
        self.scene.robots().iter().map(own).collect()
    }

    /// Answers each row of a batch by the scalar engine.
    pub fn each_row<T: Send>(
        &self,
        py: Python<'_>,
        rows: &Rows<'_>,
        out: &mut Vec<T>,
        answer: impl Fn(&[&[f64]]) -> Result<T, Failure> + Send,
    ) -> PyResult<()> {
        let (width, single) = (self.joints.len(), rows.single);
        let load = |from, count, buffer: &mut Vec<f64>| rows.load(from, count, buffer);
        chunks(py, rows.rows, FIRST_SCALAR, load, move |poses, from| {
            self.joints.convert("q", poses, (!single).then_some(from), Beyond::Refused)?;
            poses.chunks_exact(width).try_for_each(|row| {
                out.push(answer(&self.split(row))?);
                Ok(())
            })
        })
    }

    fn contact(&self, contact: &Contact) -> PyContact {
        contact_of(&self.scene, contact)
    }

    fn verdict<'py>(&self, py: Python<'py>, verdict: &EdgeVerdict) -> PyResult<Bound<'py, PyAny>> {
        Ok(match verdict {
            EdgeVerdict::Free => Bound::new(py, PyFree)?.into_any(),
            EdgeVerdict::Blocked(obstruction) => {
                let name = |id| self.scene.shape_name(id);
                let by = obstruction.pair.map(|(a, b)| (name(a), name(b)));
                Bound::new(py, PyBlocked { at: obstruction.at, by })?.into_any()
            }
            EdgeVerdict::Uncertified { at } => Bound::new(py, PyUnproved { at: *at })?.into_any(),
        })
    }
}

/// A contact with the names of its shapes.
pub(crate) fn contact_of(scene: &Scene, contact: &Contact) -> PyContact {
    let [a, b] = contact.points;
    PyContact {
        a: scene.shape_name(contact.pair.0),
        b: scene.shape_name(contact.pair.1),
        distance: contact.distance,
        points: [a.x, a.y, a.z, b.x, b.y, b.z],
    }
}

/// The robots of an argument.
fn robots_of(robots: &Bound<'_, PyAny>) -> PyResult<Vec<Py<PyRobot>>> {
    if let Ok(robot) = robots.cast::<PyRobot>() {
        return Ok(vec![robot.clone().unbind()]);
    }
    let mut all = Vec::new();
    for robot in robots.try_iter()? {
        all.push(robot?.cast::<PyRobot>().map_err(PyErr::from)?.clone().unbind());
        if all.len() > MAX_ROBOTS {
            let message = format!("more than {MAX_ROBOTS} robots");
            return Err(Failure::new("too_many", message, "give fewer").at("robots").into());
        }
    }
    Ok(all)
}

/// Models of robots with the objects attached to them, and the other objects.
fn carried(
    robots: &[Py<PyRobot>],
    mut models: Vec<Arc<Robot>>,
    items: Vec<WorldItem>,
) -> Result<(Vec<Arc<Robot>>, Vec<Object>), Failure> {
    let mut objects = Vec::new();
    for WorldItem { object, carrier } in items {
        let Some(carrier) = carrier else {
            objects.push(Object::clone(&object));
            continue;
        };
        let is_named = |robot: &PyRobot| carrier.robot.as_ref().is_none_or(|name| *name == robot.model.name);
        let carries = |robot: &PyRobot| is_named(robot) && robot.has_frame(&carrier.link);
        let mut carriers = robots.iter().zip(&mut models).filter(|(robot, _)| carries(robot.get()));
        match (carriers.next(), carriers.next()) {
            (Some((robot, model)), None) => *model = Arc::new(robot.get().carrying(model, &object, &carrier)?),
            (None, _) => {
                let message = format!("{} is attached to {}, and no robot has such a link", object.name, carrier.link);
                return Err(Failure::new("unknown", message, "give this robot, or attach it elsewhere").at("world"));
            }
            (Some(_), Some(_)) => {
                let message = format!("{} is attached to {}, which several robots have", object.name, carrier.link);
                return Err(Failure::new("unknown", message, "name the robot: attach(..., robot=...)").at("world"));
            }
        }
    }
    Ok((models, objects))
}

#[pymethods]
impl PyScene {
    #[new]
    #[pyo3(signature = (robots, world=None, *, bases=None, clearance=0.0))]
    fn new(
        py: Python<'_>,
        robots: &Bound<'_, PyAny>,
        world: Option<&PyWorld>,
        bases: Option<&Bound<'_, PyAny>>,
        clearance: f64,
    ) -> PyResult<Self> {
        let robots = robots_of(robots)?;
        let bases = bases_of(bases, robots.len())?;
        let models: Vec<Arc<Robot>> = robots.iter().map(|r| Arc::clone(&r.get().model)).collect();
        let joints = JointTable::new(models.iter().map(Arc::as_ref));
        if joints.len() == 0 {
            let message = "the scene has no joint that moves";
            return Err(Failure::new("joints", message, "give a robot with a joint").at("robots").into());
        }
        let (models, objects) = carried(&robots, models, world.map(PyWorld::snapshot).unwrap_or_default())?;
        let (scene, fast) = background(py, None, move |_, _| {
            let scene = Scene::new(models.into_iter().zip(bases).collect(), objects)?;
            let fast = FastScene::new(&scene, clearance).map_err(|e| Failure::from(e).at("clearance"))?;
            Ok((scene, fast))
        })?;
        Ok(Self { scene: Arc::new(scene), joints, clearance, robots, fast: Mutex::new(vec![fast]) })
    }

    /// The robots, in the order of configurations.
    #[getter]
    fn robots(&self, py: Python<'_>) -> Vec<Py<PyRobot>> {
        self.robots.iter().map(|r| r.clone_ref(py)).collect()
    }

    /// Number of joints of all robots.
    #[getter]
    fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Names of the joints of a configuration: ``robot:joint`` where there are several robots.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.joints.names.clone()
    }

    /// Pairs must be farther apart than this to be free, meters.
    #[getter]
    fn clearance(&self) -> f64 {
        self.clearance
    }

    /// Tests which configurations are free: within the limits, all pairs of shapes farther apart than the clearance, and all constraints of
    /// the robots' files satisfied. The verdicts are those of the exact engine, whatever the size of the batch.
    ///
    /// Parameters
    /// ----------
    /// q : array (dof,) or (N, dof)
    ///     Configurations, rad or m.
    ///
    /// Returns
    /// -------
    /// bool or ndarray (N,) of bool
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``shape``, ``dtype``, ``not_finite``, ``too_many``.
    fn free<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let rows = Rows::configurations("q", q, &self.joints)?;
        if rows.single {
            let mut row = Vec::with_capacity(self.joints.len());
            rows.load(0, 1, &mut row)?;
            let within = self.joints.within(&row).iter().all(|within| *within);
            self.joints.convert("q", &mut row, None, Beyond::Passed)?;
            // microseconds: to get the interpreter's lock back may take longer
            let mut free = Vec::with_capacity(1);
            self.with_fast(|fast| Ok(fast.free(&row, &mut free).map_err(Failure::from)?))?;
            let free = within && free.first().copied().unwrap_or(false);
            return Ok(free.into_pyobject(py)?.to_owned().into_any());
        }
        let mut all: Vec<bool> = reserved(rows.rows, 1)?;
        let out = &mut all;
        self.with_fast(|fast| {
            let mut verdicts = Vec::new();
            let load = |from, count, buffer: &mut Vec<f64>| rows.load(from, count, buffer);
            chunks(py, rows.rows, FIRST_FREE, load, move |poses, from| {
                let within = self.joints.within(poses);
                self.joints.convert("q", poses, Some(from), Beyond::Passed)?;
                fast.free(poses, &mut verdicts).map_err(Failure::from)?;
                out.extend(verdicts.iter().zip(within).map(|(free, within)| *free && within));
                Ok(())
            })
        })?;
        let shape = [all.len()];
        Ok(array(py, all, &shape)?.into_any())
    }

    /// Signed distance of the nearest pair of shapes that can move against each other.
    ///
    /// Parameters
    /// ----------
    /// q : array (dof,) or (N, dof)
    ///     Configurations, rad or m, within the limits.
    ///
    /// Returns
    /// -------
    /// float or ndarray (N,)
    ///     Meters; negative is penetration depth, ``inf`` where there is no such pair.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``limits``, and as `free`.
    fn distance<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let rows = Rows::configurations("q", q, &self.joints)?;
        let mut all: Vec<f64> = reserved(rows.rows, 1)?;
        self.each_row(py, &rows, &mut all, |poses| {
            Ok(self.scene.clearance(poses, f64::INFINITY).map_or(f64::INFINITY, |c| c.distance))
        })?;
        if rows.single {
            return Ok(all.first().copied().unwrap_or(f64::INFINITY).into_pyobject(py)?.into_any());
        }
        let shape = [all.len()];
        Ok(array(py, all, &shape)?.into_any())
    }

    /// Pairs of shapes that touch, or are nearer than a distance. Pairs that no joint moves against each other are left out.
    ///
    /// Parameters
    /// ----------
    /// q : array (dof,) or (N, dof)
    ///     Configurations, rad or m, within the limits.
    /// within : float, optional
    ///     Meters; default: the scene's clearance.
    ///
    /// Returns
    /// -------
    /// list[Contact] or list[list[Contact]]
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``limits``, ``bounds``, and as `free`.
    #[pyo3(signature = (q, within=None))]
    fn contacts<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        within: Option<f64>,
    ) -> PyResult<Bound<'py, PyList>> {
        let within = within.unwrap_or(self.clearance);
        if within.is_nan() {
            return Err(Failure::new("bounds", "within is not a number", "give meters").at("within").into());
        }
        let rows = Rows::configurations("q", q, &self.joints)?;
        let mut all: Vec<Vec<Contact>> = reserved(rows.rows, 1)?;
        let total = std::sync::atomic::AtomicUsize::new(0);
        self.each_row(py, &rows, &mut all, |poses| {
            let found = self.scene.contacts(poses, within);
            if total.fetch_add(found.len(), std::sync::atomic::Ordering::Relaxed) + found.len() > MAX_CONTACTS {
                let message = format!("more than {MAX_CONTACTS} contacts");
                return Err(Failure::new("too_many", message, "split the batch, or ask for nearer ones"));
            }
            Ok(found)
        })?;
        let list = |found: &Vec<Contact>| PyList::new(py, found.iter().map(|c| self.contact(c)).collect::<Vec<_>>());
        match all.first() {
            Some(found) if rows.single => list(found),
            _ => PyList::new(py, all.iter().map(list).collect::<PyResult<Vec<_>>>()?),
        }
    }

    /// Tests whether straight lines in joint space are free: proved for every configuration on them, not sampled.
    ///
    /// Joints go straight from `q0` to `q1`, continuous ones too.
    ///
    /// Parameters
    /// ----------
    /// q0, q1 : array (dof,) or (N, dof)
    ///     Beginnings and ends of the edges, rad or m. One of the two may be a single configuration for all edges of a batch.
    ///
    /// Returns
    /// -------
    /// Free, Blocked or Unproved, or a list of them
    ///     An end beyond a joint limit is Blocked with ``by=None``.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     As `free`; code ``shape`` if the batches differ in length.
    fn edge<'py>(
        &self,
        py: Python<'py>,
        q0: &Bound<'py, PyAny>,
        q1: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let from = Rows::configurations("q0", q0, &self.joints)?;
        let to = Rows::configurations("q1", q1, &self.joints)?;
        let count = match (from.single, to.single) {
            (true, _) => to.rows,
            (_, true) => from.rows,
            _ if from.rows == to.rows => from.rows,
            _ => {
                let message = format!("q0 has {} rows, q1 {}", from.rows, to.rows);
                return Err(Failure::new("shape", message, "give both the same number of rows").at("q1").into());
            }
        };
        let width = self.joints.len();
        let mut all: Vec<EdgeVerdict> = reserved(count, 1)?;
        let out = &mut all;
        let (mut starts, mut ends) = (Vec::new(), Vec::new());
        let load = |first, count, edges: &mut Vec<f64>| {
            starts.clear();
            ends.clear();
            let which = |rows: &Rows<'_>| if rows.single { (0, 1) } else { (first, count) };
            from.load(which(&from).0, which(&from).1, &mut starts)?;
            to.load(which(&to).0, which(&to).1, &mut ends)?;
            for (name, rows, numbers) in [("q0", &from, &mut starts), ("q1", &to, &mut ends)] {
                self.joints.convert(name, numbers, (!rows.single).then_some(first), Beyond::Straight)?;
            }
            let row = |all: &[f64], single: bool, i: usize| {
                let i = if single { 0 } else { i };
                all.get(i * width..(i + 1) * width).unwrap_or_default().to_vec()
            };
            for i in 0..count {
                edges.extend(row(&starts, from.single, i));
                edges.extend(row(&ends, to.single, i));
            }
            Ok(())
        };
        self.with_fast(|fast| {
            let mut verdicts = Vec::new();
            chunks(py, count, FIRST_EDGES, load, move |edges, _| {
                fast.certify(edges, &mut verdicts).map_err(Failure::from)?;
                out.extend_from_slice(&verdicts);
                Ok(())
            })
        })?;
        match all.first() {
            Some(verdict) if from.single && to.single => self.verdict(py, verdict),
            _ => {
                let all = all.iter().map(|v| self.verdict(py, v)).collect::<PyResult<Vec<_>>>()?;
                Ok(PyList::new(py, all)?.into_any())
            }
        }
    }

    /// A path from one configuration to another on edges that are proved free (RRT-Connect, then shortcuts).
    ///
    /// Parameters
    /// ----------
    /// start : array (dof,)
    ///     The configuration of all robots, rad or m.
    /// goal : array (dof,) or (K, dof)
    ///     One goal, or several, any of which will do: the search grows from all of them, and leaves out those that
    ///     can't be stood at if another one can; `Ik.q` of `Robot.ik`, for a pose of a frame. One
    ///     robot moves: the others stand at `start`.
    /// seed : int
    ///     Seed of everything random: equal seeds, equal paths.
    /// budget : int
    ///     Straight lines that may be judged, for all goals together, at most.
    /// time_limit : float or None
    ///     Seconds after which the search ends without a plan, at most. A plan that is found does not depend on it.
    /// shorten : bool
    ///     Make the path shorter by shortcuts.
    /// may_touch : sequence of str
    ///     Pairs ``A:B`` that may touch, such as the gripper and the object to be picked: names of links, parts and
    ///     markers of the robot that moves, of objects, and of other robots.
    /// pair_clearances : dict of str to float
    ///     Clearances of pairs ``A:B`` where they are lower than the scene's, meters.
    ///
    /// Returns
    /// -------
    /// Plan or NoPlan
    ///     `NoPlan` is false in a condition, and has the reason.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``robots`` (more than one would move), ``pair`` (an unknown name), ``limits``, ``bounds``, and as `free`.
    #[pyo3(signature = (start, goal, *, seed=0, budget=20_000, time_limit=None, shorten=true, may_touch=Vec::new(), pair_clearances=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python method")]
    fn plan<'py>(
        &self,
        py: Python<'py>,
        start: &Bound<'py, PyAny>,
        goal: &Bound<'py, PyAny>,
        seed: u64,
        budget: u64,
        time_limit: Option<f64>,
        shorten: bool,
        may_touch: Vec<String>,
        pair_clearances: Option<BTreeMap<String, f64>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rules = pair_rules(&may_touch, &pair_clearances.unwrap_or_default())?;
        let time_limit = time_limit.map(seconds).transpose()?;
        let mut ends: Vec<Vec<f64>> = Vec::new();
        for (what, given, most) in [("start", start, 1), ("goal", goal, MAX_GOALS)] {
            let rows = Rows::configurations(what, given, &self.joints)?;
            if rows.rows == 0 || rows.rows > most || (most == 1 && !rows.single) {
                let remedy = format!("give one start, and 1 to {MAX_GOALS} goals");
                return Err(Failure::new("shape", format!("{what} has {} rows", rows.rows), remedy).at(what).into());
            }
            let mut numbers = Vec::new();
            rows.load(0, rows.rows, &mut numbers)?;
            self.joints.convert(what, &mut numbers, (!rows.single).then_some(0), Beyond::Refused)?;
            ends.extend(numbers.chunks_exact(self.joints.len()).map(<[f64]>::to_vec));
        }
        let start = ends.remove(0);
        let search = PathSearch {
            scene: Arc::clone(&self.scene),
            clearance: self.clearance,
            start,
            goals: ends,
            seed,
            budget,
            time_limit,
            shorten,
            rules,
        };
        let found = background(py, None, move |cancelled, _| search.run(cancelled))?;
        match found {
            Err(reason) => Ok(Bound::new(py, reason)?.into_any()),
            Ok(found) => {
                let rows = found.poses.len();
                let path = found.poses.iter().flat_map(|pose| self.joints.configuration(pose)).collect();
                let FoundPath { goal, length, evaluations, .. } = found;
                Ok(Bound::new(py, PyPlan { path, rows, goal, length, evaluations })?.into_any())
            }
        }
    }

    /// Draws configurations, or a path as an animation, in the Rerun viewer, a notebook or a file. Shapes that are nearer than the
    /// clearance are red. Needs the viewer's package: ``pip install 'mobee[show]'``.
    ///
    /// Parameters
    /// ----------
    /// q : array (dof,) or (N, dof), optional
    ///     Configurations, rad or m, within the limits, one after the other on the timeline ``row``; default: all robots at home.
    /// path : array (N, dof) or Plan, optional
    ///     A path in place of them: its straight edges are animated on the timeline ``time``, the fastest joint at 1 rad or m per
    ///     second, and the shape that moves farthest leaves a trace.
    /// to : "viewer", "notebook", path or rerun.RecordingStream, optional
    ///     The viewer, which is started; the notebook's output; a file ``.rrd``; or a recording of your own. Default: the
    ///     notebook in a notebook, else the viewer.
    /// name : str
    ///     Name of the recording.
    ///
    /// Returns
    /// -------
    /// rerun.RecordingStream
    ///     To add what you like: the scene is below ``/world``, in meters.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``import`` (rerun-sdk is not installed), ``twice`` (q and path), ``file``, ``too_many``, ``limits``, and as `free`.
    #[pyo3(signature = (q=None, path=None, *, to=None, name="mobee"))]
    fn show<'py>(
        slf: &Bound<'py, Self>,
        q: Option<&Bound<'py, PyAny>>,
        path: Option<&Bound<'py, PyAny>>,
        to: Option<&Bound<'py, PyAny>>,
        name: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("mobee._show")?.getattr("show")?.call1((slf, q, path, to, name))
    }

    fn __repr__(&self) -> String {
        let names: Vec<&str> = self.scene.robots().iter().map(|r| r.name.as_str()).collect();
        format!(
            "Scene({}, {} objects, dof={}, clearance={})",
            names.join(", "),
            self.scene.objects().count(),
            self.joints.len(),
            self.clearance
        )
    }
}
