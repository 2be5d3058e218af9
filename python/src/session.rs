//! A run on a thread of its own, and the messages between it and Python. No Python here.

use crate::callback_line::CallbackLine;
use crate::failure::Failure;
use crate::follow::{FollowLine, FollowService, FollowSettings};
use crate::motion_book::MotionBook;
use crate::relay::{RelayAgent, RelayLine, RunMessage};
use crate::sense_slots::SenseClasses;
use crate::slots::{PassedParts, with_passed};
use crate::wait::Cancelled;
use mobee::compose::{Composition, from_source};
use mobee::config::{ClockMode, Complaints, ConfigError, Source};
use mobee::kinds::PYTHON;
use mobee::replay::RecordedRun;
use mobee::run::{embedded, event_sink, in_order, summary};
use mobee_contract::Agent;
use mobee_model::Scene;
use mobee_runtime::system::Control;
use mobee_runtime::tap::SinkSpec;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;
use tokio::sync::mpsc;

/// Messages of the run that may wait for Python: one of each agent, detector and locator.
const MAX_MESSAGES: usize = 64;
/// Controls that may wait for the run.
const MAX_CONTROLS: usize = 16;
/// Least time between two set-points: supervise accepts 250 commands a second.
const MIN_TICK: Duration = Duration::from_millis(5);
/// Events that may wait for the account of motions by a real clock: no part of the run waits for it.
const REAL_CAPACITY: usize = 4096;

/// Source of a run.
pub(crate) enum RunOrigin {
    /// A configuration file with assignments as of `--set`.
    File { file: PathBuf, set: Vec<String> },
    /// The folder of a run, which is replayed.
    Replay(PathBuf),
}

/// A run to be started.
pub(crate) struct RunRequest {
    pub origin: RunOrigin,
    pub out: Option<PathBuf>,
    /// Robots with an agent in Python, each with the name of its class.
    pub agents: BTreeMap<String, String>,
    /// Detectors and locators in Python.
    pub senses: SenseClasses,
    /// Drivers in Python, by robot.
    pub drivers: BTreeMap<String, Arc<CallbackLine>>,
    /// Robot for which a [`MotionBook`] is written.
    pub account: Option<String>,
    /// Refuses real clocks.
    pub only_virtual: bool,
    /// The robot that follows set-points from outside; an account of its motions is written.
    pub follow: Option<FollowSettings>,
}

/// A run that has ended.
pub(crate) struct Finished {
    pub folder: PathBuf,
    /// As JSON.
    pub summary: String,
    pub in_order: bool,
    /// Of a replay: the number of events that are equal, or the first difference.
    pub equal: Option<Result<u64, String>>,
}

type Ended = Result<Finished, Failure>;

/// A run that has been started.
pub(crate) struct Session {
    messages: Mutex<Receiver<RunMessage<Ended>>>,
    controls: mpsc::Sender<Control>,
    cancelled: Cancelled,
    pid: u32,
    /// Robots and objects at the start.
    pub scene: Arc<Scene>,
    /// Seed of each robot's agent.
    pub seeds: Vec<u64>,
    pub warnings: Vec<String>,
    pub book: Option<MotionBook>,
    /// The connection to the robot that follows.
    pub line: Option<FollowLine>,
    /// True if the run has a real clock.
    pub real: bool,
}

/// Result of waiting for a message.
pub(crate) enum SessionWait {
    Message(RunMessage<Ended>),
    NotYet,
    /// The thread is gone: it panicked.
    Gone,
}

impl Session {
    /// Builds what is to be run and starts it.
    ///
    /// # Errors
    /// All that is wrong with the configuration; nothing runs then.
    pub fn start(request: RunRequest) -> Result<Self, Failure> {
        let RunRequest { origin, out, agents, senses, drivers, account, only_virtual, follow } = request;
        let passed = PassedParts { agents: agents.keys().cloned().collect(), drivers, senses: true };
        let (mut composition, recorded) = match origin {
            RunOrigin::File { file, set } => {
                let mut source = source(&file, &set, &agents, &passed)?;
                senses.assign(&mut source)?;
                (with_passed(&passed, || from_source(&source))?, None)
            }
            RunOrigin::Replay(folder) => {
                let recorded = RecordedRun::open(&folder).map_err(of_report)?;
                let composition = with_passed(&passed, || recorded.compose()).map_err(of_report)?;
                (composition, Some(recorded))
            }
        };
        let real = composition.config.clock == ClockMode::Real;
        if real && only_virtual {
            let remedy = "set clock = \"virtual\" with a simulated robot";
            return Err(Failure::new("clock", "an environment runs in virtual time only", remedy).at("clock"));
        }
        let (questions, messages) = sync_channel(MAX_MESSAGES);
        let cancelled = Cancelled::default();
        for robot in composition.robots.iter_mut().filter(|robot| passed.agents.contains(&robot.name)) {
            let line = RelayLine::new(questions.clone(), cancelled.clone(), real);
            robot.agent = Some(Arc::new(move || Ok(Box::new(RelayAgent::new(&line)) as Box<dyn Agent>)));
        }
        senses.install(&mut composition, || RelayLine::new(questions.clone(), cancelled.clone(), real))?;
        let scene = Arc::new(composition.scene.clone());
        let warnings = composition.warnings.clone();
        let seed = composition.config.seed;
        let names = composition.robots.iter().map(|robot| robot.name.as_str());
        let seeds = names.map(|name| mobee::compose::derive_seed(seed, &format!("{name}/agent"))).collect();
        let book = account.map(|robot| MotionBook::new(&robot, scene.clone()));
        let mut sinks: Vec<SinkSpec> = book.iter().map(sink).collect();
        if real {
            sinks.iter_mut().for_each(|sink| sink.capacity = REAL_CAPACITY);
        }
        let line = match (follow, &book) {
            (Some(settings), Some(book)) => Some(serve(&mut composition, settings, book, &cancelled)?),
            _ => None,
        };
        let (controls, receiver) = mpsc::channel(MAX_CONTROLS);
        let to_run = controls.clone();
        let work = move || {
            let ended = run(composition, recorded.as_ref(), out.as_deref(), sinks, (to_run, receiver));
            // fails if the session was dropped
            let _ = questions.send(RunMessage::Ended(ended));
        };
        thread::Builder::new().name("mobee-run".to_owned()).spawn(work).map_err(|e| {
            Failure::new("threads", format!("no thread could be started: {e}"), "end other threads, or raise the limit")
        })?;
        let pid = std::process::id();
        Ok(Self { messages: Mutex::new(messages), controls, cancelled, pid, scene, seeds, warnings, book, line, real })
    }

    /// Tests that this process started the run: the threads of a run do not exist in a child that was forked from it.
    pub fn is_own(&self) -> bool {
        self.pid == std::process::id()
    }

    /// Waits for a message, for so long.
    pub fn wait(&self, patience: Duration) -> SessionWait {
        match self.messages.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(patience) {
            Ok(message) => SessionWait::Message(message),
            Err(RecvTimeoutError::Timeout) => SessionWait::NotYet,
            Err(RecvTimeoutError::Disconnected) => SessionWait::Gone,
        }
    }

    /// Ends the run: in order, or at once. Agents in Python are called no more.
    ///
    /// In virtual time, while a question has no reply, the control arrives before the clock goes on, so that equal runs end equally.
    pub fn end(&self, at_once: bool) {
        // full: it is being ended already
        let _ = self.controls.try_send(if at_once { Control::Abort } else { Control::Stop });
        self.cancelled.set();
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.end(false);
    }
}

/// Adds the service through which a program moves a robot, in place of the robot's agent.
fn serve(
    composition: &mut Composition,
    settings: FollowSettings,
    book: &MotionBook,
    cancelled: &Cancelled,
) -> Result<FollowLine, Failure> {
    let real = composition.config.clock == ClockMode::Real;
    let robot = composition.robots.iter_mut().find(|robot| robot.name == settings.robot);
    let robot = robot.ok_or_else(|| {
        Failure::new("robots", format!("there is no robot {}", settings.robot), "name one of the file").at("robot")
    })?;
    robot.agent = None;
    let period = Duration::from_secs_f64(robot.controller.period_s.clamp(1e-3, 1.0));
    let settings = FollowSettings { tick: period.max(MIN_TICK), margin: robot.controller.margin_m, ..settings };
    let line = FollowLine::default();
    let (book, cancelled) = (book.clone(), cancelled.clone());
    composition.services.push(Arc::new(FollowService { line: line.clone(), settings, book, cancelled, real }));
    Ok(line)
}

fn sink(book: &MotionBook) -> SinkSpec {
    let book = book.clone();
    event_sink("motions", Arc::new(move || Ok(Box::new(book.clone()))))
}

fn run(
    composition: Composition,
    recorded: Option<&RecordedRun>,
    out: Option<&Path>,
    sinks: Vec<SinkSpec>,
    controls: (mpsc::Sender<Control>, mpsc::Receiver<Control>),
) -> Ended {
    let (folder, done, equal) = match recorded {
        Some(recorded) => {
            let (folder, done, equal) = recorded.embedded(composition, out, controls).map_err(of_report)?;
            (folder, done, Some(equal))
        }
        None => {
            let (folder, done) = embedded(composition, out, sinks, controls).map_err(of_report)?;
            (folder, done, None)
        }
    };
    let path = folder.path().canonicalize().unwrap_or_else(|_| folder.path().to_owned());
    Ok(Finished { folder: path, summary: summary(&done).to_string(), in_order: in_order(&done.end), equal })
}

/// The robots' names of a configuration, as far as it has any.
pub(crate) fn robot_names(origin: &RunOrigin) -> Result<Vec<String>, Failure> {
    let name = |robot: &serde_json::Value| robot.get("name")?.as_str().map(str::to_owned);
    let names = |source: &Source| {
        let robots = source.value.get("robot").and_then(serde_json::Value::as_array);
        robots.into_iter().flatten().filter_map(name).collect()
    };
    match origin {
        RunOrigin::File { file, set } => Ok(names(&Source::load(file, set)?)),
        RunOrigin::Replay(folder) => Ok(names(RecordedRun::open(folder).map_err(of_report)?.source())),
    }
}

/// The scene of a configuration with an agent from outside.
pub(crate) fn scene_of(origin: &RunOrigin, agents: &BTreeMap<String, String>) -> Result<Scene, Failure> {
    let RunOrigin::File { file, set } = origin else {
        return Err(Failure::new("file", "this is the folder of a run", "give a configuration file"));
    };
    let passed = PassedParts { agents: agents.keys().cloned().collect(), ..PassedParts::default() };
    let source = source(file, set, agents, &passed)?;
    Ok(with_passed(&passed, || from_source(&source))?.scene)
}

/// A configuration file with the parts in Python in place of its own.
fn source(
    file: &Path,
    set: &[String],
    agents: &BTreeMap<String, String>,
    passed: &PassedParts,
) -> Result<Source, Failure> {
    let mut source = Source::load(file, set)?;
    let drivers = passed.drivers.iter().map(|(robot, line)| (robot, "driver", &line.spec.class));
    for (robot, role, class) in agents.iter().map(|(robot, class)| (robot, "agent", class)).chain(drivers) {
        let class = serde_json::Value::String(class.clone());
        source.set(&format!("robot.{robot}.{role}={{ kind = \"{PYTHON}\", class = {class} }}"))?;
    }
    if !passed.drivers.is_empty() && source.value.get("clock").and_then(serde_json::Value::as_str) != Some("real") {
        let what = "a driver in Python runs by the wall clock, and this file's clock is virtual";
        return Err(Failure::new("clock", what, "pass clock=\"real\"").at("clock"));
    }
    Ok(source)
}

impl From<ConfigError> for Failure {
    fn from(e: ConfigError) -> Self {
        Complaints::from(e).into()
    }
}

impl From<Complaints> for Failure {
    /// The first complaint with its place and remedy, and the others in its words.
    fn from(all: Complaints) -> Self {
        let mut complaints = all.iter();
        let Some(first) = complaints.next() else {
            return Self::new("config", "the configuration is refused", "run `mobee check` on it");
        };
        let text = |complaint: &mobee::config::Complaint| match complaint {
            mobee::config::Complaint::Config(e) => e.message().to_owned(),
            mobee::config::Complaint::Model(e) => e.message().to_owned(),
        };
        let place = |complaint: &mobee::config::Complaint| {
            complaint.place().map(|(file, line, column)| format!("{file}:{line}:{column}"))
        };
        let mut message = text(first);
        for other in complaints {
            let at = place(other).map_or(String::new(), |place| format!("{place}: "));
            message.push_str(&format!("\nand: {at}{}\n  help: {}", text(other), other.remedy()));
        }
        Self { place: place(first), ..Self::new("config", message, first.remedy()) }
    }
}

/// From the error of a run.
pub(crate) fn of_report(report: miette::Report) -> Failure {
    match report.downcast::<Complaints>() {
        Ok(complaints) => complaints.into(),
        Err(report) => match report.downcast::<ConfigError>() {
            Ok(e) => e.into(),
            Err(report) => {
                let mut message = report.to_string();
                for cause in report.chain().skip(1) {
                    message.push_str(&format!(": {cause}"));
                }
                let remedy = report.help().map(|help| help.to_string());
                let (message, remedy) = match (remedy, message.rsplit_once("; ")) {
                    (Some(remedy), _) => (message, remedy),
                    (None, Some((message, remedy))) => (message.to_owned(), remedy.to_owned()),
                    (None, None) => (message, String::new()),
                };
                Failure::new("run", message, remedy)
            }
        },
    }
}
