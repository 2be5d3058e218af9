//! `mobee.Roadmap`: configurations and edges of one robot, in files.

use crate::arrays::{Rows, array};
use crate::failure::Failure;
use crate::intent::indices;
use crate::joints::{Beyond, JointTable};
use crate::plan::{PyNoPlan, PyPlan};
use crate::robot::PyRobot;
use crate::scene::PyScene;
use crate::session::of_report;
use crate::wait::background;
use mobee::compose::maps::{built, read_settings};
use mobee::config::Complaints;
use mobee::roadmap::{ImproveSettings, improve};
use mobee_contract::KindError;
use mobee_model::file::{MIB, read_text};
use mobee_model::{Robot, Scene, load_robot, load_world};
use mobee_planning::map_file::{MapFile, StoredVerdict, certify};
use mobee_planning::roadmap::join::JoinSettings;
use mobee_planning::roadmap::{Roadmap, Vertex};
use nalgebra::Isometry3;
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

/// Maximum size of a map file, bytes.
const MAX_MAP_BYTES: u64 = 64 * MIB;
/// Vertices at most that are given at once, or added by `improve`.
const MAX_VERTICES: usize = 100_000;
/// Nearest vertices that one is joined to, at most.
const MAX_NEIGHBORS: usize = 64;
/// Straight lines that one plan of `improve` may judge, at most.
const MAX_BUDGET: u64 = 10_000_000;

/// Configurations of one robot, and straight edges between them, whose verdicts are stored with them. It never changes.
///
/// Parameters
/// ----------
/// robot : Robot
/// q : array (N, dof)
///     Vertices, rad or m, such as free configurations at random.
/// joints : sequence of str, optional
///     The joints in which the vertices differ; default: all.
/// neighbors : int
///     Nearest vertices in joint space that each is joined to, in both directions, 1 to 64.
///
/// Raises
/// ------
/// MobeeError
///     code ``shape``, ``dtype``, ``not_finite``, ``limits``, ``joints``, ``bounds``, ``too_many``.
#[pyclass(name = "Roadmap", module = "mobee", frozen)]
pub(crate) struct PyRoadmap {
    file: Arc<MapFile>,
    robot: Arc<Robot>,
    joints: Arc<JointTable>,
}

impl PyRoadmap {
    fn of(file: MapFile, robot: Arc<Robot>) -> Self {
        let joints = Arc::new(JointTable::new([robot.as_ref()]));
        Self { file: Arc::new(file), robot, joints }
    }

    /// The scene of a query, which must have the map's robot and no other.
    fn scene<'a>(&self, scene: &'a PyScene) -> Result<&'a Arc<Scene>, Failure> {
        let wrong = |message: String, remedy: String| Failure::new("robots", message, remedy).at("scene");
        let [robot] = scene.scene.robots() else {
            let message = format!("the scene has {} robots", scene.scene.robots().len());
            return Err(wrong(message, "a roadmap needs a scene of its robot alone".into()));
        };
        self.file.check(robot).map_err(|e| wrong(e.what, e.help))?;
        Ok(&scene.scene)
    }

    /// The number of a vertex from its name or number.
    fn vertex(&self, map: &Roadmap, what: &'static str, given: &Bound<'_, PyAny>) -> PyResult<u32> {
        let name: String = match given.extract::<String>() {
            Ok(name) => name,
            Err(_) => given.extract::<u32>()?.to_string(),
        };
        let unknown = || {
            let remedy = format!("give a name, or a number below {}", map.len());
            Failure::new("unknown", format!("there is no vertex {name:?}"), remedy).at(what)
        };
        Ok(map.find(&name).ok_or_else(unknown)?)
    }
}

impl From<KindError> for Failure {
    /// The first error, with its place.
    fn from(e: KindError) -> Self {
        let first = e.all().into_iter().next();
        let Some(KindError { path, what, help, .. }) = first else {
            return crate::wait::internal();
        };
        let failure = Self::new("config", what, help);
        if path.is_empty() { failure } else { failure.at(path) }
    }
}

#[pymethods]
impl PyRoadmap {
    #[new]
    #[pyo3(signature = (robot, q, *, joints=None, neighbors=8))]
    fn new(
        py: Python<'_>,
        robot: &PyRobot,
        q: &Bound<'_, PyAny>,
        joints: Option<&Bound<'_, PyAny>>,
        neighbors: usize,
    ) -> PyResult<Self> {
        let rows = Rows::configurations("q", q, &robot.joints)?;
        bounds("neighbors", neighbors, 1, MAX_NEIGHBORS)?;
        bounds("q", rows.rows, 1, MAX_VERTICES)?;
        let motors = match joints {
            None => (0..robot.joints.len()).collect(),
            Some(names) => indices(&robot.joints, names, "Roadmap")?,
        };
        let (mut poses, width) = (Vec::new(), robot.joints.len());
        rows.load(0, rows.rows, &mut poses)?;
        robot.joints.convert("q", &mut poses, (!rows.single).then_some(0), Beyond::Refused)?;
        let model = Arc::clone(&robot.model);
        let file = background(py, None, move |_, _| {
            let mut map = Roadmap::new(motors, &model);
            for pose in poses.chunks_exact(width) {
                map.add(Vertex { name: None, q: pose.to_vec(), at: [0.0; 3] });
            }
            map.join_nearest(neighbors);
            Ok(map.file(&model))
        })?;
        Ok(Self::of(file, Arc::clone(&robot.model)))
    }

    /// Reads a map file, such as ``mobee roadmap build`` and runs write.
    ///
    /// Parameters
    /// ----------
    /// path : path
    /// robot : Robot
    ///     The robot that the map was made for: its digest is compared.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``file``: not a map, or of another robot.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, robot: &PyRobot) -> PyResult<Self> {
        let model = Arc::clone(&robot.model);
        let file = background(py, None, move |_, _| {
            let place = path.display().to_string();
            let wrong = |what: String, help: String| Failure::new("file", what, help);
            let text = read_text(&path, MAX_MAP_BYTES)
                .map_err(|e| wrong(format!("cannot read the file: {e}"), "give a map".into()).at(&place))?;
            let file = MapFile::parse(&text).map_err(|e| {
                let line = text.get(..e.span.start).map_or(1, |before| before.lines().count().max(1));
                wrong(e.what, e.help).at(format!("{place}:{line}"))
            })?;
            file.check(&model).map_err(|e| wrong(e.what, e.help).at(&place))?;
            Ok(file)
        })?;
        Ok(Self::of(file, Arc::clone(&robot.model)))
    }

    /// Builds the map of a table, as ``mobee roadmap build``: configurations with the hand over it, wherever it can reach.
    ///
    /// Parameters
    /// ----------
    /// settings : path
    ///     Such as ``configs/roadmaps/table.toml`` of the repository; docs/roadmaps.md.
    /// set : sequence of str
    ///     Assignments: ``["vertices=500"]``.
    /// progress : callable, optional
    ///     Called with the step and the share of it that is done.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``config``, ``file``, ``run`` (no such configuration was found).
    #[staticmethod]
    #[pyo3(signature = (settings, *, set=Vec::new(), progress=None))]
    fn build(
        py: Python<'_>,
        settings: PathBuf,
        set: Vec<String>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (file, robot) = background(py, progress, move |cancelled, reports| {
            let (settings, source) = read_settings(&settings, &set)?;
            let robot = Arc::new(load_robot(&settings.robot)?.value);
            let objects = settings.world.as_ref().map(load_world).transpose()?.map(|w| w.value).unwrap_or_default();
            let scene = Scene::new(vec![(Arc::clone(&robot), Isometry3::identity())], objects)?;
            let plan = settings.plan(&robot).map_err(|e| {
                let mut wrong = Complaints::default();
                e.all().into_iter().for_each(|e| wrong.push(source.error(&e.path, e.what, e.help)));
                Failure::from(wrong)
            })?;
            let mut watch = |share| {
                // dropped if the caller has gone or is slower
                let _ = reports.try_send(("finds configurations", share));
                if cancelled.is_set() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let file = built(&scene, &robot, &Arc::new(plan), &mut watch).map_err(Failure::from)?;
            Ok((file, robot))
        })?;
        Ok(Self::of(file, robot))
    }

    /// Writes the map file: for `Roadmap.load`, ``mobee roadmap`` and agents of the kind ``roadmap``.
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
        Ok(crate::load::write(&path, &self.file.text())?)
    }

    /// The map with a verdict for each edge in this scene, with its clearance: proved free, blocked, or unproved.
    ///
    /// Parameters
    /// ----------
    /// scene : Scene
    ///     Of the map's robot alone.
    /// progress : callable, optional
    ///     Called with the step and the share of it that is done.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``robots``: other robots.
    #[pyo3(signature = (scene, *, progress=None))]
    fn validate(&self, py: Python<'_>, scene: &PyScene, progress: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let (world, clearance, mut file) = (Arc::clone(self.scene(scene)?), scene.clearance, (*self.file).clone());
        let file = background(py, progress, move |_, reports| {
            let mut show = |share| {
                // dropped if the caller has gone or is slower
                let _ = reports.try_send(("certifies edges", share));
            };
            certify(&mut file, &world, clearance, &mut show)?;
            Ok(file)
        })?;
        Ok(Self::of(file, Arc::clone(&self.robot)))
    }

    /// The map with its parts joined by a planner, more vertices where it is thin, and, if desired, without what can't be reached; validated.
    ///
    /// Parameters
    /// ----------
    /// scene : Scene
    ///     Of the map's robot alone. New edges are proved free in it.
    /// pairs : int
    ///     Pairs of vertices between which a path to each part is planned.
    /// budget : int
    ///     Straight lines that one plan may judge.
    /// grow : int
    ///     Vertices to add where the map is thin, at most.
    /// neighbors : int
    ///     Nearest vertices that an added one is joined to.
    /// prune : bool
    ///     Leave out vertices that can't be reached or left, and renumber the others.
    /// seed : int
    ///     Equal seeds, equal maps.
    /// progress : callable, optional
    ///     Called with the step and the share of it that is done.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``robots``, ``bounds``.
    #[pyo3(signature = (scene, *, pairs=3, budget=5000, grow=0, neighbors=8, prune=false, seed=1, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn improve(
        &self,
        py: Python<'_>,
        scene: &PyScene,
        pairs: usize,
        budget: u64,
        grow: usize,
        neighbors: usize,
        prune: bool,
        seed: u64,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        bounds("pairs", pairs, 1, 1000)?;
        bounds("budget", usize::try_from(budget).unwrap_or(usize::MAX), 1, MAX_BUDGET as usize)?;
        bounds("grow", grow, 0, MAX_VERTICES)?;
        bounds("neighbors", neighbors, 1, MAX_NEIGHBORS)?;
        let settings = ImproveSettings { join: JoinSettings { pairs, budget, seed }, grow, neighbors, prune };
        let (world, clearance, mut file) = (Arc::clone(self.scene(scene)?), scene.clearance, (*self.file).clone());
        let file = background(py, progress, move |_, reports| {
            let mut show = |step: &'static str, share: f64| {
                // dropped if the caller has gone or is slower
                let _ = reports.try_send((step, share));
            };
            certify(&mut file, &world, clearance, &mut |share| show("certifies edges", share))?;
            let (mut better, _) = improve(&file, &world, clearance, settings, &mut show).map_err(of_report)?;
            certify(&mut better, &world, clearance, &mut |share| show("certifies edges", share))?;
            Ok(better)
        })?;
        Ok(Self::of(file, Arc::clone(&self.robot)))
    }

    /// The shortest path over edges that are proved free.
    ///
    /// Parameters
    /// ----------
    /// start, goal : int or str
    ///     Numbers or names of vertices.
    ///
    /// Returns
    /// -------
    /// Plan or NoPlan
    ///     The proofs hold for the scene of `validate`. A joint without end takes the short way round.
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``unknown`` (a vertex), ``unvalidated``.
    fn path<'py>(
        &self,
        py: Python<'py>,
        start: &Bound<'py, PyAny>,
        goal: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        if self.file.certified.is_none() {
            let message = "the edges of this map have no verdicts";
            return Err(Failure::new("unvalidated", message, "call validate with a scene").into());
        }
        let mut file = (*self.file).clone();
        file.edges.retain(|edge| edge.verdict == Some(StoredVerdict::Free));
        let map = Roadmap::of_file(&file, &self.robot).map_err(Failure::from)?;
        let (from, to) = (self.vertex(&map, "start", start)?, self.vertex(&map, "goal", goal)?);
        let Some(path) = map.plan(from, to) else {
            let reason = format!("no path leads from {from} to {to} over edges that are proved free");
            return Ok(Bound::new(py, PyNoPlan { code: "exhausted", reason })?.into_any());
        };
        let mut poses: Vec<Vec<f64>> = Vec::new();
        for vertex in path.iter().filter_map(|id| map.vertex(*id)) {
            let pose = poses.last().map(|last| self.robot.nearest_equivalent(last, &vertex.q));
            poses.push(pose.unwrap_or_else(|| vertex.q.clone()));
        }
        let way = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        let length = poses.iter().zip(poses.iter().skip(1)).map(way).sum();
        let rows = poses.len();
        let path = poses.iter().flat_map(|pose| self.joints.configuration(pose)).collect();
        Ok(Bound::new(py, PyPlan { path, rows, goal: 0, length, evaluations: 0 })?.into_any())
    }

    /// The vertices, nearest first, by their distance in joint space from a configuration.
    ///
    /// Parameters
    /// ----------
    /// q : array (dof,)
    ///     rad or m.
    ///
    /// Returns
    /// -------
    /// ndarray (N,) of int
    fn nearest<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<i64>>> {
        let rows = Rows::configurations("q", q, &self.joints)?;
        if !rows.single {
            return Err(Failure::new("shape", "q is a batch", "give one configuration, (dof,)").at("q").into());
        }
        let mut pose = Vec::new();
        rows.load(0, 1, &mut pose)?;
        self.joints.convert("q", &mut pose, None, Beyond::Refused)?;
        let map = Roadmap::of_file(&self.file, &self.robot).map_err(Failure::from)?;
        let all: Vec<i64> = map.by_distance(&pose).into_iter().map(i64::from).collect();
        let shape = [all.len()];
        array(py, all, &shape)
    }

    /// Configurations of the vertices, ndarray (N, dof), rad or m.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let all = self.file.vertices.iter().flat_map(|v| self.joints.configuration(&v.q_rad)).collect();
        array(py, all, &[self.file.vertices.len(), self.joints.len()])
    }

    /// Directed edges, ndarray (E, 2) of int: numbers of vertices.
    #[getter]
    fn edges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<i64>>> {
        let all = self.file.edges.iter().flat_map(|e| [i64::from(e.from), i64::from(e.to)]).collect();
        array(py, all, &[self.file.edges.len(), 2])
    }

    /// Which edges are proved free, ndarray (E,) of bool; None before `validate`.
    #[getter]
    fn free<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArrayDyn<bool>>>> {
        if self.file.certified.is_none() {
            return Ok(None);
        }
        let all: Vec<bool> = self.file.edges.iter().map(|e| e.verdict == Some(StoredVerdict::Free)).collect();
        let shape = [all.len()];
        Ok(Some(array(py, all, &shape)?))
    }

    /// Clearance of the verdicts, m; None before `validate`.
    #[getter]
    fn clearance(&self) -> Option<f64> {
        self.file.certified.as_ref().map(|certified| certified.clearance_m)
    }

    fn __len__(&self) -> usize {
        self.file.vertices.len()
    }

    fn __repr__(&self) -> String {
        let MapFile { robot, vertices, edges, .. } = &*self.file;
        format!("Roadmap({robot:?}, {} vertices, {} edges)", vertices.len(), edges.len())
    }
}

fn bounds(what: &'static str, number: usize, least: usize, most: usize) -> Result<(), Failure> {
    if (least..=most).contains(&number) {
        return Ok(());
    }
    let message = format!("{what} is {number}");
    Err(Failure::new("bounds", message, format!("give {least} to {most}")).at(what))
}
