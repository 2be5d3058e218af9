//! The run behind an environment of gymnasium: one step is one motion and its outcome.

use crate::failure::Failure;
use crate::intent::{AnsweringRobot, intent};
use crate::motion_book::MotionAccount;
use crate::relay::{AgentQuestion, AgentReply, PendingQuestion, RunMessage};
use crate::sense_slots::SenseClasses;
use crate::session::{RunOrigin, RunRequest, Session, SessionWait};
use crate::view::{PyView, RunRobots};
use crate::wait::{SIGNAL_PERIOD, background, internal};
use mobee_contract::Intent;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};
use std::time::{Duration, Instant};

/// Time in which an outcome must reach the account of motions.
const ACCOUNT_PATIENCE: Duration = Duration::from_secs(5);
/// Time that a run that is closed has for its orderly end.
const CLOSE_PATIENCE: Duration = Duration::from_secs(5);
/// Attempts at a motion while the filter does not accept any: each waits for 0.1 s of the run.
const MAX_ATTEMPTS: u32 = 600;
/// Refusals that do not concern the motion: it is tried again.
const PASSING: [&str; 4] = ["closed", "busy", "not_ready", "pushing"];

enum StepPhase {
    /// The robot rests, and a question waits for the next step.
    Resting(Box<PendingQuestion>),
    /// A step was interrupted, and its outcome is still to come.
    Moving,
    /// The run is over: why.
    Over(String),
    Closed,
}

struct StepsState {
    state: StepPhase,
    session: Option<Session>,
    robots: Arc<RunRobots>,
    robot: String,
    folder: Option<PathBuf>,
}

/// A run in virtual time; its clock stands between two steps.
#[pyclass(name = "Steps", module = "mobee._native", frozen)]
pub(crate) struct PySteps(Mutex<StepsState>);

impl PySteps {
    fn lock(&self) -> Result<MutexGuard<'_, StepsState>, Failure> {
        match self.0.try_lock() {
            Ok(inner) => Ok(inner),
            Err(TryLockError::Poisoned(inner)) => Ok(inner.into_inner()),
            Err(TryLockError::WouldBlock) => {
                let what = "another thread is using this environment";
                Err(Failure::new("busy", what, "give each thread an environment of its own"))
            }
        }
    }
}

fn closed() -> Failure {
    Failure::new("closed", "the environment is closed", "make another one")
}

impl StepsState {
    /// Waits until the robot rests again, or the run is over. Ctrl-C ends the wait, and not the run.
    fn settle(&mut self, py: Python<'_>) -> PyResult<()> {
        loop {
            let session = self.session.as_ref().ok_or_else(closed)?;
            match py.detach(|| session.wait(SIGNAL_PERIOD)) {
                SessionWait::NotYet => py.check_signals()?,
                SessionWait::Gone => return Err(internal().into()),
                SessionWait::Message(RunMessage::Question(pending)) => match pending.question {
                    AgentQuestion::Next { .. } => {
                        self.state = StepPhase::Resting(pending);
                        return Ok(());
                    }
                    // the motion goes on as it was
                    AgentQuestion::Revise => {
                        let _ = pending.reply.try_send(Ok(AgentReply { intent: None, state: None }));
                    }
                },
                // no detector of an environment is in Python
                SessionWait::Message(RunMessage::Sense(pending)) => drop(pending),
                SessionWait::Message(RunMessage::Ended(ended)) => {
                    let finished = match ended {
                        Ok(finished) => finished,
                        Err(failure) => {
                            self.state = StepPhase::Over(failure.message.clone());
                            return Err(failure.into());
                        }
                    };
                    let reason = reason_of(&finished.summary);
                    self.folder = Some(finished.folder);
                    self.state = StepPhase::Over(reason);
                    return Ok(());
                }
            }
        }
    }

    fn view(&self, py: Python<'_>) -> PyResult<Option<Py<PyView>>> {
        let StepPhase::Resting(pending) = &self.state else { return Ok(None) };
        Ok(Some(Py::new(py, PyView { view: pending.view.clone(), robots: Arc::clone(&self.robots) })?))
    }

    /// Replies to the question that is open.
    fn reply(&mut self, intent: Intent) {
        if let StepPhase::Resting(pending) = std::mem::replace(&mut self.state, StepPhase::Moving) {
            let _ = pending.reply.try_send(Ok(AgentReply { intent: Some(intent), state: None }));
        }
    }

    /// One motion to its outcome.
    fn motion(&mut self, py: Python<'_>, wanted: &Intent) -> PyResult<MotionAccount> {
        let pauses = matches!(wanted, Intent::Wait(_) | Intent::Stop | Intent::Done(_));
        for _ in 0..MAX_ATTEMPTS {
            let before = self.book()?.settled();
            self.reply(wanted.clone());
            self.settle(py)?;
            if pauses || !matches!(self.state, StepPhase::Resting(_)) {
                break;
            }
            let book = self.book()?.clone();
            let Some(account) = py.detach(|| book.after(before, ACCOUNT_PATIENCE)) else { break };
            let passes = account.refusal.as_ref().is_some_and(|(code, _)| PASSING.contains(code));
            if !passes {
                return Ok(account);
            }
            py.check_signals()?;
        }
        Ok(MotionAccount::default())
    }

    fn book(&self) -> PyResult<&crate::motion_book::MotionBook> {
        let session = self.session.as_ref().ok_or_else(closed)?;
        Ok(session.book.as_ref().ok_or_else(internal)?)
    }
}

fn reason_of(summary: &str) -> String {
    let value: serde_json::Value = serde_json::from_str(summary).unwrap_or_default();
    value.get("reason").and_then(serde_json::Value::as_str).unwrap_or("ended").to_owned()
}

#[pymethods]
impl PySteps {
    /// Starts a run and waits until its robot is ready.
    #[new]
    #[pyo3(signature = (path, *, set, out, robot, class_))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        set: Vec<String>,
        out: PathBuf,
        robot: String,
        class_: String,
    ) -> PyResult<Self> {
        let agents = BTreeMap::from([(robot.clone(), class_)]);
        let origin = RunOrigin::File { file: path, set };
        let account = Some(robot.clone());
        let drivers = BTreeMap::new();
        let request = RunRequest {
            origin,
            out: Some(out),
            agents,
            senses: SenseClasses::default(),
            drivers,
            account,
            only_virtual: true,
            follow: None,
        };
        let session = background(py, None, move |_, _| Session::start(request))?;
        let robots = Arc::new(RunRobots::new(&session.scene, session.seeds.clone()));
        let mut inner = StepsState { state: StepPhase::Moving, session: Some(session), robots, robot, folder: None };
        inner.settle(py)?;
        Ok(Self(Mutex::new(inner)))
    }

    /// The view of the robot at rest; None once the run is over.
    fn view(&self, py: Python<'_>) -> PyResult<Option<Py<PyView>>> {
        self.lock()?.view(py)
    }

    /// Warnings about the configuration.
    fn warnings(&self) -> PyResult<Vec<String>> {
        Ok(self.lock()?.session.as_ref().map(|session| session.warnings.clone()).unwrap_or_default())
    }

    /// Folder of the run, once it is over.
    fn folder(&self) -> PyResult<Option<PathBuf>> {
        Ok(self.lock()?.folder.clone())
    }

    /// Carries out one motion: the view after its outcome, None once the run is over, and its account.
    fn step<'py>(
        &self,
        py: Python<'py>,
        answer: &Bound<'py, PyAny>,
    ) -> PyResult<(Option<Py<PyView>>, Bound<'py, PyDict>)> {
        let mut inner = self.lock()?;
        let session = inner.session.as_ref().ok_or_else(closed)?;
        if !session.is_own() {
            let what = "this environment was made in another process: its run did not come along";
            return Err(
                Failure::new("fork", what, "make environments after the fork, or start processes by spawn").into()
            );
        }
        if matches!(inner.state, StepPhase::Moving) {
            // an earlier step was interrupted by Ctrl-C
            inner.settle(py)?;
        }
        let wanted = match &inner.state {
            StepPhase::Resting(pending) => {
                let joints = inner.robots.joints.get(pending.view.robot).cloned().ok_or_else(internal)?;
                let standing = AnsweringRobot { joints: &joints, pose: pending.view.pose(), place: "step".to_owned() };
                intent(answer, &standing)?
            }
            StepPhase::Over(why) => {
                return Err(Failure::new("over", format!("the run is over: {why}"), "call reset").into());
            }
            StepPhase::Moving | StepPhase::Closed => return Err(closed().into()),
        };
        let account = inner.motion(py, &wanted)?;
        let info = PyDict::new(py);
        let over = if let StepPhase::Over(why) = &inner.state { Some(why.clone()) } else { None };
        let outcome = match (&account, &over) {
            (MotionAccount { outcome: Some(outcome), .. }, _) => outcome,
            (_, Some(_)) => "over",
            (MotionAccount { refusal: Some(_), .. }, _) => "refused",
            _ => "waited",
        };
        info.set_item("outcome", outcome)?;
        info.set_item("cause", account.cause)?;
        info.set_item("contacts", account.contacts)?;
        info.set_item("depth", account.depth)?;
        info.set_item("retreat_s", account.retreat_s)?;
        let (code, words) = account.refusal.map_or((None, over), |(code, words)| (Some(code), Some(words)));
        info.set_item("refusal", code)?;
        info.set_item("reason", words)?;
        Ok((inner.view(py)?, info))
    }

    /// Ends the run in order and waits for its end, some seconds at most. Once more is no error.
    fn close(&self, py: Python<'_>) -> PyResult<Option<PathBuf>> {
        let mut inner = self.lock()?;
        let own = inner.session.as_ref().is_some_and(Session::is_own);
        let Some(session) = inner.session.take() else { return Ok(inner.folder.clone()) };
        let was_over = matches!(inner.state, StepPhase::Over(_));
        let open = std::mem::replace(&mut inner.state, StepPhase::Closed);
        if !own {
            // in a forked child: locks of these may be held by threads that did not come along
            std::mem::forget((session, open));
            return Ok(None);
        }
        if was_over {
            return Ok(inner.folder.clone());
        }
        session.end(false);
        // the question has no reply: the clock goes on
        drop(open);
        let folder = py.detach(move || ended_within(&session, CLOSE_PATIENCE));
        inner.folder = folder;
        Ok(inner.folder.clone())
    }

    fn __repr__(&self) -> String {
        self.lock().map_or_else(|_| "Steps".to_owned(), |inner| format!("Steps({:?})", inner.robot))
    }
}

/// The folder of a run that is being ended.
#[expect(clippy::disallowed_methods, reason = "how long Python waits, which no run depends on")]
fn ended_within(session: &Session, patience: Duration) -> Option<PathBuf> {
    let until = Instant::now() + patience;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        match session.wait(left) {
            SessionWait::Message(RunMessage::Question(pending)) => drop(pending),
            SessionWait::Message(RunMessage::Sense(pending)) => drop(pending),
            SessionWait::Message(RunMessage::Ended(ended)) => return ended.ok().map(|finished| finished.folder),
            SessionWait::NotYet | SessionWait::Gone => return None,
        }
    }
}
