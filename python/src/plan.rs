//! Plans: certified paths of one robot of a scene.

use crate::arrays::{array, vector};
use crate::failure::Failure;
use crate::timing::{TimedPath, TimingLimits, timed};
use crate::wait::{Cancelled, background};
use mobee_model::{PairRule, Robot, Scene};
use mobee_planning::planners::{JointSpace, NoPath, Planner, PlanningProblem, RrtConnect, shorten};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::ops::{ControlFlow, Range};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Straight lines that shortcuts may have judged, at most.
const SHORTCUTS: u64 = 10_000;

/// A path on edges that are proved free: at every configuration on it all pairs are farther apart than the scene's clearance. True in a
/// condition.
///
/// Attributes
/// ----------
/// path : ndarray (M, dof)
///     Configurations from start to goal, rad or m; joints go straight from one to the next. A joint without end ends in the turn that
///     is nearest.
/// goal : int
///     Which of the goals it leads to.
/// length : float
///     In joint space: the sum of the edges' Euclidean lengths, where a meter counts as 1000 degrees, rad.
/// evaluations : int
///     Straight lines that were judged to find it.
#[pyclass(name = "Plan", module = "mobee", frozen)]
pub(crate) struct PyPlan {
    pub path: Vec<f64>,
    pub rows: usize,
    #[pyo3(get)]
    pub goal: usize,
    #[pyo3(get)]
    pub length: f64,
    #[pyo3(get)]
    pub evaluations: u64,
}

#[pymethods]
impl PyPlan {
    #[getter]
    fn path<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, self.path.clone(), &[self.rows, self.path.len() / self.rows.max(1)])
    }

    /// A trajectory along the path, as fast as limits of velocity, acceleration and jerk permit (Ruckig).
    ///
    /// It stays on the proved edges, so it comes to rest at each corner, and joints move in proportion between two corners.
    ///
    /// Parameters
    /// ----------
    /// velocity, acceleration, jerk : float or array (dof,)
    ///     Greatest ones of each joint, above zero, rad or m, per s, s^2 and s^3.
    /// every : float
    ///     Period of the samples, s. Corners are samples, too.
    ///
    /// Returns
    /// -------
    /// Trajectory
    ///
    /// Raises
    /// ------
    /// MobeeError
    ///     code ``bounds`` or ``limits`` (limits that are not above zero, or too different in magnitude), ``shape``, ``dtype``, ``too_many``.
    #[pyo3(signature = (*, velocity, acceleration, jerk, every=0.01))]
    fn time_parameterize(
        &self,
        py: Python<'_>,
        velocity: &Bound<'_, PyAny>,
        acceleration: &Bound<'_, PyAny>,
        jerk: &Bound<'_, PyAny>,
        every: f64,
    ) -> PyResult<PyTrajectory> {
        let width = self.path.len() / self.rows.max(1);
        let limits = TimingLimits {
            velocity: limits_of("velocity", velocity, width)?,
            acceleration: limits_of("acceleration", acceleration, width)?,
            jerk: limits_of("jerk", jerk, width)?,
        };
        if !(1e-6..=1e6).contains(&every) {
            let message = format!("every is {every} s");
            return Err(Failure::new("bounds", message, "give seconds, such as 0.01").at("every").into());
        }
        let path = self.path.clone();
        let timed = background(py, None, move |_, _| timed(&path, width, &limits, every))?;
        Ok(PyTrajectory { timed, width })
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __repr__(&self) -> String {
        format!("Plan({} configurations, length={:.3}, evaluations={})", self.rows, self.length, self.evaluations)
    }
}

/// A path with times, from rest to rest; at each corner it rests.
///
/// Attributes
/// ----------
/// times : ndarray (T,)
///     From 0, s; increasing.
/// q, velocity, acceleration : ndarray (T, dof)
///     rad or m, per s and s^2.
/// duration : float
///     s.
#[pyclass(name = "Trajectory", module = "mobee", frozen)]
pub(crate) struct PyTrajectory {
    timed: TimedPath,
    width: usize,
}

impl PyTrajectory {
    fn table<'py>(&self, py: Python<'py>, all: &[f64]) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, all.to_vec(), &[self.timed.times.len(), self.width])
    }
}

#[pymethods]
impl PyTrajectory {
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, self.timed.times.clone(), &[self.timed.times.len()])
    }

    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.table(py, &self.timed.q)
    }

    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.table(py, &self.timed.velocity)
    }

    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.table(py, &self.timed.acceleration)
    }

    #[getter]
    fn duration(&self) -> f64 {
        self.timed.times.last().copied().unwrap_or_default()
    }

    fn __len__(&self) -> usize {
        self.timed.times.len()
    }

    fn __repr__(&self) -> String {
        format!("Trajectory({} samples, duration={:.3})", self.timed.times.len(), self.duration())
    }
}

/// Limits of all joints, or one for each.
fn limits_of(what: &'static str, given: &Bound<'_, PyAny>, width: usize) -> PyResult<Vec<f64>> {
    let all = match given.extract::<f64>() {
        Ok(one) => vec![one; width],
        Err(_) => vector(what, given, width, &format!("give a number, or ({width},) of them"))?,
    };
    if let Some(limit) = all.iter().find(|limit| !(1e-9..=1e9).contains(*limit)) {
        let message = format!("a limit is {limit}");
        return Err(Failure::new("bounds", message, "give limits above zero").at(what).into());
    }
    Ok(all)
}

/// Why there is no plan. False in a condition.
///
/// Attributes
/// ----------
/// code : str
///     ``blocked`` or ``limits`` (an end can't be stood at), or ``exhausted`` (the budget or the time is spent; there may be a path all the same).
/// reason : str
///     In words; if none of several goals can be stood at, of the first one.
#[pyclass(name = "NoPlan", module = "mobee", frozen, get_all)]
pub(crate) struct PyNoPlan {
    pub code: &'static str,
    pub reason: String,
}

#[pymethods]
impl PyNoPlan {
    fn __bool__(&self) -> bool {
        false
    }

    fn __repr__(&self) -> String {
        format!("NoPlan({}: {})", self.code, self.reason)
    }
}

/// A search for a path; poses are of all robots, one after the other, rad of encoder.
pub(crate) struct PathSearch {
    pub scene: Arc<Scene>,
    pub clearance: f64,
    pub start: Vec<f64>,
    /// One at least.
    pub goals: Vec<Vec<f64>>,
    pub seed: u64,
    pub budget: u64,
    pub time_limit: Option<Duration>,
    pub shorten: bool,
    /// Rules for pairs; their names are those of the robot that moves.
    pub rules: Vec<PairRule>,
}

/// A path of all robots.
pub(crate) struct FoundPath {
    pub poses: Vec<Vec<f64>>,
    pub goal: usize,
    pub length: f64,
    pub evaluations: u64,
}

impl PathSearch {
    /// Searches from the start and all goals at once, until one is reached, or the budget or the time is spent.
    ///
    /// # Errors
    /// If more than one robot would move, or a rule has an unknown name.
    #[expect(clippy::disallowed_methods, reason = "how long Python waits; a plan that is found does not depend on it")]
    pub fn run(&self, cancelled: &Cancelled) -> Result<Result<FoundPath, PyNoPlan>, Failure> {
        let (robot, columns) = self.mover()?;
        let motors: Vec<usize> = (0..columns.len()).collect();
        let poses: Vec<&[f64]> = self.columns().into_iter().map(|own| slice(&self.start, &own)).collect();
        let scene = self.scene.with_pair_rules(robot, &self.rules)?;
        let mut space = JointSpace::new(&scene, robot, &poses, &motors, &[], self.clearance)?;
        let problem = PlanningProblem {
            start: slice(&self.start, &columns).to_vec(),
            goals: self.goals.iter().map(|goal| slice(goal, &columns).to_vec()).collect(),
            seed: self.seed,
            budget: self.budget,
        };
        let begun = Instant::now();
        let is_late = || self.time_limit.is_some_and(|limit| begun.elapsed() > limit);
        let mut watch =
            |_| if cancelled.is_set() || is_late() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
        let path = match RrtConnect::default().plan(&mut space, &problem, &mut watch) {
            Ok(path) if self.shorten => shorten(&mut space, path, self.seed, SHORTCUTS.min(self.budget)),
            Ok(path) => path,
            Err(NoPath::Cancelled) => {
                let reason =
                    "the time limit is reached; there may be a path: give more time, or another seed".to_owned();
                return Ok(Err(PyNoPlan { code: code(&NoPath::Cancelled), reason }));
            }
            Err(why) => return Ok(Err(PyNoPlan { code: code(&why), reason: why.text(&scene, robot) })),
        };
        let whole = |own: &Vec<f64>| {
            let mut pose = self.start.clone();
            if let Some(place) = pose.get_mut(columns.clone()) {
                place.copy_from_slice(own);
            }
            pose
        };
        let poses = path.poses.iter().map(whole).collect();
        let (goal, length) = (path.goal, path.length());
        Ok(Ok(FoundPath { poses, goal, length, evaluations: space.evaluations() }))
    }

    /// The robot that moves, and its columns; the first if none does.
    fn mover(&self) -> Result<(usize, Range<usize>), Failure> {
        let all = self.columns();
        let moves = |own: &Range<usize>| self.goals.iter().any(|goal| slice(goal, own) != slice(&self.start, own));
        let mut movers = all.iter().cloned().enumerate().filter(|(_, own)| moves(own));
        let first = movers.next().or_else(|| all.iter().cloned().enumerate().next());
        if let (Some((a, _)), Some((b, _))) = (&first, movers.next()) {
            let name = |r: usize| self.scene.robots().get(r).map_or("?", |robot| robot.name.as_str());
            let message = format!("start and goal differ for {} and for {}", name(*a), name(b));
            return Err(Failure::new("robots", message, "plan for one robot after the other").at("goal"));
        }
        first.ok_or_else(|| Failure::new("robots", "the scene has no robot", "give one"))
    }

    /// Each robot's share of a pose.
    fn columns(&self) -> Vec<Range<usize>> {
        let mut first = 0;
        let own = |robot: &Arc<Robot>| {
            let own = first..first + robot.motors.len();
            first = own.end;
            own
        };
        self.scene.robots().iter().map(own).collect()
    }
}

/// The rules for pairs of arguments.
///
/// # Errors
/// A pair that is not two names.
pub(crate) fn pair_rules(may_touch: &[String], clearances: &BTreeMap<String, f64>) -> Result<Vec<PairRule>, Failure> {
    let pair = |argument: &'static str, names: &str, rule: Option<PairRule>| {
        let remedy = "give two names, such as \"gripper:cup\"";
        rule.ok_or_else(|| Failure::new("pair", format!("{names:?} is not a pair"), remedy).at(argument))
    };
    let touching = may_touch.iter().map(|names| pair("may_touch", names, PairRule::may_touch(names)));
    let near = clearances.iter().map(|(names, m)| pair("pair_clearances", names, PairRule::near(names, *m)));
    touching.chain(near).collect()
}

/// A time limit.
///
/// # Errors
/// Not a positive number of seconds.
pub(crate) fn seconds(seconds: f64) -> Result<Duration, Failure> {
    let limit = Duration::try_from_secs_f64(seconds).ok().filter(|limit| !limit.is_zero());
    let wrong = || Failure::new("bounds", format!("{seconds} s is not above zero"), "give seconds, such as 1.5");
    limit.ok_or_else(|| wrong().at("time_limit"))
}

fn slice<'a>(pose: &'a [f64], own: &Range<usize>) -> &'a [f64] {
    pose.get(own.clone()).unwrap_or_default()
}

fn code(why: &NoPath) -> &'static str {
    match why {
        NoPath::Blocked { .. } => "blocked",
        NoPath::Limits { .. } => "limits",
        NoPath::Malformed(_) => "malformed",
        NoPath::Exhausted { .. } | NoPath::Cancelled => "exhausted",
    }
}
