//! The run behind `mobee.Follow`: set-points of a program, and what was sent of them.

use crate::arrays::{Rows, array};
use crate::driver_line::drivers_of;
use crate::failure::Failure;
use crate::follow::{FollowCommand, FollowLine, FollowReply, FollowSettings, FollowStatus, FollowTicket};
use crate::joints::JointTable;
use crate::motion_book::{MotionAccount, MotionBook};
use crate::relay::RunMessage;
use crate::sense_slots::SenseClasses;
use crate::session::{Finished, RunOrigin, RunRequest, Session, SessionWait, scene_of};
use crate::view::{PyView, RunRobots};
use crate::wait::{SIGNAL_PERIOD, background, internal};
use mobee_contract::{CommitId, Hold, Status};
use mobee_model::Motor;
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};
use std::time::Duration;

/// Time for which a program waits for the reply by a real clock: then the command is withdrawn.
const SEND_PATIENCE: Duration = Duration::from_millis(4);
/// The same for a chunk.
const CHUNK_PATIENCE: Duration = Duration::from_secs(2);
/// Time in which a robot comes to rest before its run is ended.
const REST_PATIENCE: Duration = Duration::from_secs(3);
/// Time for the verdict on a command that can't be withdrawn any more.
const VERDICT_PATIENCE: Duration = Duration::from_millis(100);
/// Time in which a run that no longer replies ends.
const END_PATIENCE: Duration = Duration::from_secs(5);
/// Time in which the robot must become ready.
const READY_PATIENCE: Duration = Duration::from_secs(30);
/// Distance of plans beyond the margin, m.
const ALLOWANCE_M: f64 = 0.002;
/// Set-points of a chunk at most.
const MAX_CHUNK: usize = 10_000;

struct FollowingState {
    session: Option<Session>,
    /// Reason for the end of the run.
    over: Option<String>,
    folder: Option<PathBuf>,
    summary: Option<String>,
}

/// A run whose robot follows the set-points of a program.
#[pyclass(name = "Following", module = "mobee._native", frozen)]
pub(crate) struct PyFollowing {
    state: Mutex<FollowingState>,
    line: FollowLine,
    book: MotionBook,
    robots: Arc<RunRobots>,
    joints: Arc<JointTable>,
    period: Duration,
    clearance: f64,
    real: bool,
}

/// Names, lower and upper limits, and units of joints.
type JointParts<'py> = (Vec<String>, Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>, Vec<String>);
/// What was sent, how much of it ("sent", "limited", "held"), the reason as a code and a sentence, and the transaction.
type SentParts<'py> = (Bound<'py, PyArrayDyn<f64>>, &'static str, &'static str, String, Option<u64>);

impl PyFollowing {
    fn lock(&self) -> Result<MutexGuard<'_, FollowingState>, Failure> {
        match self.state.try_lock() {
            Ok(state) => Ok(state),
            Err(TryLockError::Poisoned(state)) => Ok(state.into_inner()),
            Err(TryLockError::WouldBlock) => {
                let what = "another thread is sending to this robot";
                Err(Failure::new("busy", what, "send from one thread at a time"))
            }
        }
    }

    /// Sends a command and waits for its reply.
    fn command(&self, py: Python<'_>, command: FollowCommand, span: Duration) -> PyResult<FollowReply> {
        let mut state = self.lock()?;
        state.check(py)?;
        let is_step = matches!(command, FollowCommand::Target(_));
        let ticket = self.line.send(command, span);
        let patience = if is_step { SEND_PATIENCE } else { CHUNK_PATIENCE };
        let reply =
            if self.real { py.detach(|| self.reply(&ticket, patience)) } else { state.virtual_reply(py, &ticket)? };
        match reply {
            Some(reply) => Ok(reply),
            None => {
                state.check(py)?;
                let q = self.line.latest().map(|latest| latest.q.to_vec()).unwrap_or_default();
                if q.is_empty() {
                    state.note(py, END_PATIENCE)?;
                    state.check(py)?;
                    let what = "the connection to the robot is being restarted";
                    return Err(Failure::new("not_ready", what, "try again").into());
                }
                let reason = format!("no reply within {} ms; what was sent is withdrawn", patience.as_millis());
                Ok(FollowReply { q, status: FollowStatus::Held, code: "late", reason, id: None })
            }
        }
    }

    /// The reply by a real clock; `None` if the command was withdrawn.
    fn reply(&self, ticket: &FollowTicket, patience: Duration) -> Option<FollowReply> {
        match ticket.wait(patience) {
            Ok(reply) => Some(reply),
            Err(_) if ticket.withdraw() => None,
            Err(_) => ticket.wait(VERDICT_PATIENCE).ok(),
        }
    }

    fn parts<'py>(&self, py: Python<'py>, reply: FollowReply, chunk: bool) -> PyResult<SentParts<'py>> {
        let FollowReply { q, status, code, reason, id } = reply;
        let width = self.joints.len().max(1);
        let (rows, q) = match (chunk, status) {
            (true, FollowStatus::Held) => (0, Vec::new()),
            _ => (q.len() / width, q.chunks(width).flat_map(|row| self.joints.configuration(row)).collect()),
        };
        let shape: &[usize] = if chunk { &[rows, width] } else { &[width] };
        Ok((array(py, q, shape)?, status.word(), code, reason, id.map(|id| id.0)))
    }

    /// Rows of numbers in rad of encoder, whatever they are.
    fn rows(&self, q: &Bound<'_, PyAny>, single: bool) -> PyResult<Vec<Vec<f64>>> {
        let rows = Rows::configurations("q", q, &self.joints)?;
        let width = self.joints.len();
        if rows.single != single || rows.rows == 0 || rows.rows > MAX_CHUNK {
            let wanted = if single { format!("({width},)") } else { format!("(N, {width}), N up to {MAX_CHUNK}") };
            let what =
                if rows.single { "q is a single configuration".into() } else { format!("q has {} rows", rows.rows) };
            return Err(Failure::new("shape", what, format!("give {wanted}")).at("q").into());
        }
        let mut all = Vec::new();
        rows.load(0, rows.rows, &mut all)?;
        let row = |row: &[f64]| row.iter().enumerate().map(|(j, q)| q * self.joints.scale(j)).collect();
        Ok(all.chunks(width.max(1)).map(row).collect())
    }

    fn account<'py>(&self, py: Python<'py>, account: MotionAccount) -> PyResult<Bound<'py, PyDict>> {
        let entry = PyDict::new(py);
        entry.set_item("id", account.id.map(|id| id.0))?;
        entry.set_item("outcome", account.outcome)?;
        entry.set_item("cause", account.cause)?;
        entry.set_item("contacts", account.contacts)?;
        entry.set_item("depth", account.depth)?;
        entry.set_item("retreat_s", account.retreat_s)?;
        Ok(entry)
    }

    /// Waits until the robot is ready.
    fn begin(&self, py: Python<'_>) -> PyResult<()> {
        if !self.real {
            self.command(py, FollowCommand::Pause, Duration::ZERO)?;
        }
        let mut waited = Duration::ZERO;
        loop {
            let latest = self.line.latest();
            if latest.as_ref().is_some_and(|latest| latest.ready && latest.status == Status::Rest) {
                return Ok(());
            }
            self.lock()?.check(py)?;
            if waited >= READY_PATIENCE || !self.real {
                let state = latest.map_or("the controller does not start".to_owned(), |latest| match latest.status {
                    Status::Holding(hold) => format!("the robot holds: {hold}"),
                    status => format!("the robot is not ready: {}", status.word()),
                });
                return Err(Failure::new("not_ready", state, "see `mobee doctor` and the run's journal").into());
            }
            self.lock()?.note(py, SIGNAL_PERIOD)?;
            py.check_signals()?;
            waited += SIGNAL_PERIOD;
        }
    }
}

impl FollowingState {
    /// Notes the end of the run.
    fn note(&mut self, py: Python<'_>, patience: Duration) -> PyResult<()> {
        let Some(session) = &self.session else { return Ok(()) };
        match py.detach(|| session.wait(patience)) {
            SessionWait::NotYet => {}
            SessionWait::Gone if self.over.is_some() => {}
            SessionWait::Gone => return Err(internal().into()),
            SessionWait::Message(RunMessage::Question(pending)) => drop(pending),
            SessionWait::Message(RunMessage::Sense(pending)) => drop(pending),
            SessionWait::Message(RunMessage::Ended(ended)) => {
                let Finished { folder, summary, .. } = ended.inspect_err(|failure| {
                    self.over = Some(failure.message.clone());
                })?;
                let value: serde_json::Value = serde_json::from_str(&summary).unwrap_or_default();
                let reason = value.get("reason").and_then(serde_json::Value::as_str).unwrap_or("ended");
                self.over = Some(reason.to_owned());
                (self.folder, self.summary) = (Some(folder), Some(summary));
            }
        }
        Ok(())
    }

    /// Tests that the run is under way, in this process.
    fn check(&mut self, py: Python<'_>) -> PyResult<()> {
        if self.session.as_ref().is_some_and(|session| !session.is_own()) {
            let what = "this run was started in another process";
            return Err(Failure::new("fork", what, "start it after the fork, or start processes by spawn").into());
        }
        self.note(py, Duration::ZERO)?;
        match (&self.session, &self.over) {
            (None, _) => Err(Failure::new("closed", "the run is closed", "start another one").into()),
            (_, Some(why)) => {
                Err(Failure::new("over", format!("the run is over: {why}"), "see its journal, and start another one")
                    .into())
            }
            _ => Ok(()),
        }
    }

    /// The reply in virtual time, which comes when the clock has gone on; `None` if the run has ended.
    fn virtual_reply(&mut self, py: Python<'_>, ticket: &FollowTicket) -> PyResult<Option<FollowReply>> {
        loop {
            match py.detach(|| ticket.wait(SIGNAL_PERIOD)) {
                Ok(reply) => return Ok(Some(reply)),
                Err(RecvTimeoutError::Disconnected) => {
                    self.note(py, END_PATIENCE)?;
                    return Ok(None);
                }
                Err(RecvTimeoutError::Timeout) => {
                    py.check_signals()?;
                    self.note(py, Duration::ZERO)?;
                    if self.over.is_some() {
                        return Ok(None);
                    }
                }
            }
        }
    }
}

#[pymethods]
impl PyFollowing {
    /// Starts a run and waits until its robot is ready. `drivers`: lines of drivers in Python, by their robots.
    #[new]
    #[pyo3(signature = (path, drivers, *, set, out, robot, class_, period, speed, hold_after, clearance, recover))]
    #[expect(clippy::too_many_arguments, reason = "named arguments of one call in the package")]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        drivers: &Bound<'_, PyDict>,
        set: Vec<String>,
        out: Option<PathBuf>,
        robot: String,
        class_: String,
        period: f64,
        speed: f64,
        hold_after: f64,
        clearance: f64,
        recover: bool,
    ) -> PyResult<Self> {
        let agents = BTreeMap::from([(robot.clone(), class_)]);
        let origin = RunOrigin::File { file: path, set };
        let period = Duration::from_secs_f64(period);
        let settings = FollowSettings {
            robot: robot.clone(),
            period,
            speed,
            hold_after: Duration::from_secs_f64(hold_after),
            extra: clearance,
            recover,
            tick: period,
            margin: 0.0,
        };
        let account = Some(robot.clone());
        let drivers = drivers_of(drivers)?;
        let request = RunRequest {
            origin,
            out,
            agents,
            senses: SenseClasses::default(),
            drivers,
            account,
            only_virtual: false,
            follow: Some(settings),
        };
        let session = background(py, None, move |_, _| Session::start(request))?;
        let robots = Arc::new(RunRobots::new(&session.scene, session.seeds.clone()));
        let (line, book) = session.line.clone().zip(session.book.clone()).ok_or_else(internal)?;
        let index = robots.names.iter().position(|name| *name == robot).ok_or_else(internal)?;
        let joints = robots.joints.get(index).cloned().ok_or_else(internal)?;
        let real = session.real;
        let state = FollowingState { session: Some(session), over: None, folder: None, summary: None };
        let clearance = ALLOWANCE_M;
        let following = Self { state: Mutex::new(state), line, book, robots, joints, period, clearance, real };
        following.begin(py)?;
        Ok(following)
    }

    /// Names, limits (rad or m) and units of a robot's joints, without a run.
    #[staticmethod]
    #[pyo3(signature = (path, *, set, robot, class_))]
    fn joints<'py>(
        py: Python<'py>,
        path: PathBuf,
        set: Vec<String>,
        robot: String,
        class_: String,
    ) -> PyResult<JointParts<'py>> {
        let agents = BTreeMap::from([(robot.clone(), class_)]);
        let origin = RunOrigin::File { file: path, set };
        let scene = background(py, None, move |_, _| scene_of(&origin, &agents))?;
        let model = scene.robots().iter().find(|model| model.name == robot).ok_or_else(internal)?;
        let joints = JointTable::new([model.as_ref()]);
        let shape = [joints.len()];
        let limits = |of: fn(&Motor) -> f64| array(py, joints.si(of), &shape);
        let units = joints.units().map(str::to_owned).collect();
        Ok((joints.names.clone(), limits(|m| m.min)?, limits(|m| m.max)?, units))
    }

    /// Sends a set-point to be reached within a period.
    fn send<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<SentParts<'py>> {
        let goal = self.rows(q, true)?.into_iter().next().unwrap_or_default();
        let reply = self.command(py, FollowCommand::Target(goal), self.period)?;
        self.parts(py, reply, false)
    }

    /// Sends set-points, each a period after the one before.
    fn chunk<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>, period: f64) -> PyResult<SentParts<'py>> {
        let goals = self.rows(q, false)?;
        let reply = self.command(py, FollowCommand::Chunk(goals, Duration::from_secs_f64(period)), Duration::ZERO)?;
        self.parts(py, reply, true)
    }

    /// Lets a run in virtual time go on.
    fn pause(&self, py: Python<'_>, seconds: f64) -> PyResult<()> {
        self.command(py, FollowCommand::Pause, Duration::from_secs_f64(seconds)).map(drop)
    }

    /// The newest reading, contacts and objects; None while the service is being restarted.
    fn view(&self, py: Python<'_>) -> PyResult<Option<Py<PyView>>> {
        let Some(view) = self.line.view(self.clearance) else { return Ok(None) };
        Ok(Some(Py::new(py, PyView { view, robots: Arc::clone(&self.robots) })?))
    }

    /// State of the filter in a word, and the reason of a hold.
    fn status(&self) -> (&'static str, Option<String>) {
        match self.line.latest().map(|latest| latest.status) {
            None => ("over", None),
            Some(Status::Holding(hold)) => (Status::Holding(Hold::InContact).word(), Some(hold.to_string())),
            Some(status) => (status.word(), None),
        }
    }

    /// Account of a transaction; None while it is under way.
    fn account_of<'py>(&self, py: Python<'py>, id: u64) -> PyResult<Option<Bound<'py, PyDict>>> {
        if !self.line.has_ended(CommitId(id)) {
            return Ok(None);
        }
        let account = py.detach(|| self.book.account_of(CommitId(id)));
        account.map(|account| self.account(py, account)).transpose()
    }

    /// Account of the last transaction that has ended.
    fn last<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.book.last().map(|account| self.account(py, account)).transpose()
    }

    /// Numbers of transactions that were committed, rolled back and faulted.
    fn outcomes(&self) -> [u64; 3] {
        self.book.outcomes()
    }

    /// Why the last chunk was ended early, if it was.
    fn cut(&self) -> Option<String> {
        self.line.cut()
    }

    /// Names of the joints.
    fn joint_names(&self) -> Vec<String> {
        self.joints.names.clone()
    }

    /// True if the run has a real clock.
    fn is_real(&self) -> bool {
        self.real
    }

    /// Warnings about the configuration.
    fn warnings(&self) -> PyResult<Vec<String>> {
        Ok(self.lock()?.session.as_ref().map(|session| session.warnings.clone()).unwrap_or_default())
    }

    /// Lets the robot come to rest, so that its transaction ends by itself.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        self.command(py, FollowCommand::Finish, Duration::ZERO)?;
        let mut waited = Duration::ZERO;
        while waited < REST_PATIENCE && self.line.latest().is_some_and(|latest| latest.status == Status::Moving) {
            if self.real {
                self.lock()?.note(py, SIGNAL_PERIOD)?;
                py.check_signals()?;
            } else {
                self.command(py, FollowCommand::Pause, SIGNAL_PERIOD)?;
            }
            waited += SIGNAL_PERIOD;
        }
        Ok(())
    }

    /// Ends the run in order, and waits for its end: the folder and the summary. Once more is no error.
    fn close(&self, py: Python<'_>, patience: f64) -> PyResult<(Option<PathBuf>, Option<String>)> {
        let mut state = self.lock()?;
        if state.session.as_ref().is_some_and(|session| !session.is_own()) {
            // in a forked child: locks of these may be held by threads that did not come along
            std::mem::forget(state.session.take());
            return Ok((None, None));
        }
        if let Some(session) = &state.session {
            session.end(false);
            let mut left = Duration::from_secs_f64(patience);
            while state.over.is_none() && !left.is_zero() {
                state.note(py, SIGNAL_PERIOD)?;
                py.check_signals()?;
                left = left.saturating_sub(SIGNAL_PERIOD);
            }
        }
        state.session = None;
        Ok((state.folder.clone(), state.summary.clone()))
    }

    fn __repr__(&self) -> String {
        format!("Following({} joints)", self.joints.len())
    }
}
