//! `mobee.run`, `mobee.replay` and the journal of a run.

use crate::driver_line::drivers_of;
use crate::failure::Failure;
use crate::relay::RunMessage;
use crate::sense_serve::PySenses;
use crate::serve::PyAgents;
use crate::session::{Finished, RunOrigin, RunRequest, Session, SessionWait, robot_names};
use crate::view::RunRobots;
use crate::wait::{SIGNAL_PERIOD, background};
use mobee_journal::check::{check, judged};
use mobee_journal::journal::{self, JournalError, JournalLines};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::cell::Cell;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Runs within agents of runs at most.
const MAX_NESTED: u32 = 3;
/// Longest time that a message is waited for without looking at signals.
const WAIT: Duration = SIGNAL_PERIOD;

thread_local! {
    static NESTED: Cell<u32> = const { Cell::new(0) };
}

/// Counts the runs that this thread conducts.
struct Nested;

impl Nested {
    fn enter() -> Result<Self, Failure> {
        let depth = NESTED.get();
        if depth >= MAX_NESTED {
            let what = format!("{MAX_NESTED} runs are under way within each other");
            return Err(Failure::new("nested", what, "start no run within an agent's own call"));
        }
        NESTED.set(depth + 1);
        Ok(Self)
    }
}

impl Drop for Nested {
    fn drop(&mut self) {
        NESTED.set(NESTED.get().saturating_sub(1));
    }
}

/// The parts of `mobee.Run`: folder, summary as JSON, whether it ended in order, warnings, and of a replay the equal events and the first
/// difference.
type RunParts = (PathBuf, String, bool, Vec<String>, Option<u64>, Option<String>);

/// Runs a file, or replays a folder; calls agents, detectors and locators in this thread.
#[pyfunction]
#[pyo3(signature = (path, agents, drivers, detectors, locators, *, set, out, replay))]
#[expect(clippy::too_many_arguments, reason = "arguments of Python, from `mobee.run` alone")]
pub(crate) fn conduct(
    py: Python<'_>,
    path: PathBuf,
    agents: &Bound<'_, PyDict>,
    drivers: &Bound<'_, PyDict>,
    detectors: &Bound<'_, PyDict>,
    locators: &Bound<'_, PyDict>,
    set: Vec<String>,
    out: Option<PathBuf>,
    replay: bool,
) -> PyResult<RunParts> {
    let _nested = Nested::enter()?;
    let mut agents = PyAgents::read(agents)?;
    let origin = if replay { RunOrigin::Replay(path) } else { RunOrigin::File { file: path, set } };
    let drivers = drivers_of(drivers)?;
    let mut senses = PySenses::read(detectors, locators)?;
    let request = RunRequest {
        origin,
        out,
        agents: agents.classes(),
        senses: senses.classes(),
        drivers,
        account: None,
        only_virtual: false,
        follow: None,
    };
    let session = background(py, None, move |_, _| Session::start(request))?;
    let robots = Arc::new(RunRobots::new(&session.scene, session.seeds.clone()));
    let mut interrupted: Option<PyErr> = None;
    let mut signals = 0;
    let finished = loop {
        let waited = py.detach(|| session.wait(WAIT));
        let outcome = match waited {
            SessionWait::Message(RunMessage::Ended(ended)) => break ended?,
            SessionWait::Message(RunMessage::Question(pending)) if interrupted.is_none() => {
                agents.serve(py, &robots, *pending).and_then(|()| py.check_signals())
            }
            SessionWait::Message(RunMessage::Sense(pending)) if interrupted.is_none() => {
                senses.serve(py, &robots, *pending).and_then(|()| py.check_signals())
            }
            SessionWait::Message(RunMessage::Question(_) | RunMessage::Sense(_)) | SessionWait::NotYet => {
                py.check_signals()
            }
            SessionWait::Gone => return Err(crate::wait::internal().into()),
        };
        if let Err(e) = outcome {
            // once: the run ends in order; twice: at once; three times: it is left to its thread
            signals += 1;
            session.end(signals > 1);
            if signals > 2 {
                return Err(e);
            }
            interrupted.get_or_insert(e);
        }
    };
    if let Some(e) = interrupted {
        let folder = finished.folder.as_os_str().to_owned();
        // an exception that takes no attributes goes without
        let _ = e.value(py).setattr("run_folder", folder);
        return Err(e);
    }
    let Finished { folder, summary, in_order, equal } = finished;
    let (equal, difference) = match equal {
        Some(Ok(equal)) => (Some(equal), None),
        Some(Err(difference)) => (None, Some(difference)),
        None => (None, None),
    };
    Ok((folder, summary, in_order, session.warnings.clone(), equal, difference))
}

/// Names of the robots of a configuration file, or of a run's folder.
#[pyfunction]
#[pyo3(signature = (path, *, set, replay))]
pub(crate) fn robots_of(py: Python<'_>, path: PathBuf, set: Vec<String>, replay: bool) -> PyResult<Vec<String>> {
    let origin = if replay { RunOrigin::Replay(path) } else { RunOrigin::File { file: path, set } };
    background(py, None, move |_, _| robot_names(&origin))
}

impl From<JournalError> for Failure {
    fn from(e: JournalError) -> Self {
        let place = match (e.line, e.column) {
            (0, _) => e.file.display().to_string(),
            (line, column) => format!("{}:{line}:{column}", e.file.display()),
        };
        Self::new("journal", e.what, e.help).at(place)
    }
}

/// Lines of a journal: number, time, event as JSON. Their hashes are checked as they are read.
#[pyclass(name = "JournalLines", module = "mobee._native", frozen)]
pub(crate) struct PyJournalLines(Mutex<JournalLines>);

#[pymethods]
impl PyJournalLines {
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        Ok(Self(Mutex::new(journal::read(&path).map_err(Failure::from)?)))
    }

    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__(&self) -> PyResult<Option<(u64, f64, String)>> {
        let line = self.0.lock().unwrap_or_else(PoisonError::into_inner).next();
        match line {
            None => Ok(None),
            // the journal of a process that was killed ends in mid-line
            Some(Err(e)) if e.truncated => Ok(None),
            Some(Err(e)) => Err(Failure::from(e).into()),
            Some(Ok(line)) => {
                let text = serde_json::to_string(&line.event).map_err(|_| crate::wait::internal())?;
                Ok(Some((line.n, line.at.secs(), text)))
            }
        }
    }
}

/// The parts of `mobee.Verdict`: events, hash, why it ended, violations as invariant, line, time and words, damage, and what was judged.
type CheckParts = (u64, String, Option<String>, Vec<(String, u64, f64, String)>, Vec<String>, String);

/// Checks a run's journal and invariants.
#[pyfunction]
pub(crate) fn check_run(py: Python<'_>, path: PathBuf) -> PyResult<CheckParts> {
    let report = background(py, None, move |_, _| check(&path).map_err(Failure::from))?;
    let violation = |v: &mobee_journal::check::Violation| (v.invariant.to_owned(), v.line, v.at.secs(), v.what.clone());
    let violations = report.violations.iter().map(violation).collect();
    let mut damage = report.files.damage.clone();
    damage.extend(report.truncated.as_ref().map(ToString::to_string));
    Ok((report.events, report.hash, report.ended, violations, damage, judged(report.poses.readings > 0).to_string()))
}
