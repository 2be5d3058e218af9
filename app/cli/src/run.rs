//! `mobee run`: a run from its configuration file to its folder.

mod disk_space;
mod embedded;
mod event_printer;
mod folder;
mod interrupt;
mod log;
mod progress;
mod ready;
mod record;
mod record_switch;
mod report;
mod resource_limits;
mod resume;
mod sinks;
mod space_guard;
mod watch;

pub use embedded::{embedded, event_sink};
pub use folder::Folder;
pub(crate) use log::LogBook;
pub(crate) use record::Recording;
pub use report::Output;
pub use report::summary;
pub(crate) use resource_limits::check_network_access;
pub use resume::command as resume;
pub(crate) use sinks::{QUEUE_ENTRIES, WRITE_TIMEOUT, recorder_settings};

use crate::ctl::{BesideNames, CtlPort, CtlService, StopConnections};
use event_printer::RecentFailures;
use miette::{IntoDiagnostic, Report, WrapErr};
use mobee_compose::config::{ClockMode, Config, ConfigError, Resolved, Source};
use mobee_compose::{Composition, compose};
use mobee_contract::{Event, Service, Time};
use mobee_journal::journal::Journal;
use mobee_model::Labels;
use mobee_runtime::clock::ClockKind;
use mobee_runtime::system::{Control, Past, Reason, RunCounts, RunEnd, RunProgress, Setup};
use mobee_runtime::tap::{OpenSink, SinkSpec, Taps};
use serde_json::json;
use std::net::SocketAddr;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use tokio::sync::mpsc;
use watch::WatchService;

/// Exit code of a run that ended in order but whose machine was too slow for it.
const EXIT_OVERLOADED: u8 = 3;

/// Exit code of a run that ended in order, but with a sensor or service down after using up its restarts.
const EXIT_GAVE_UP: u8 = 4;

/// The program's name and version.
const BUILD: &str = concat!("mobee ", env!("CARGO_PKG_VERSION"));

/// Runs a file and prints a summary.
///
/// # Errors
/// Complaints about the configuration, before anything is written or moved.
pub fn command(
    file: &Path,
    set: &[String],
    out: Option<&Path>,
    output: Output,
    ctl: CtlAt,
    watch: bool,
) -> Result<ExitCode, Report> {
    let source = Source::load(file, set)?;
    let mut composition = mobee_compose::from_source(&source)?;
    if watch && composition.config.clock == ClockMode::Virtual {
        let what = "--watch waits for edits, but with this file's virtual clock the run ends almost at once";
        return Err(ConfigError::plain(what, "add --clock real").into());
    }
    for w in &composition.warnings {
        eprintln!("warning: {w}");
    }
    disk_space::check(out)?;
    resource_limits::check(&composition.config, ctl)?;
    let folder = Folder::create(&composition.config.name, out)?;
    let (controls, receiver) = mpsc::channel(16);
    if watch {
        let service = WatchService::new(source, &composition, set, controls.clone());
        composition.services.push(Arc::new(service));
    }
    conduct(composition, &folder, Extras::default(), output, ctl, (controls, receiver))
}

/// Optional parts of a run beside its composition.
#[derive(Default)]
pub(crate) struct Extras {
    /// The journal and the state that an earlier process left of the run.
    pub(crate) past: Option<(Journal, Past)>,
    /// Damage found in the run's files, one sentence each.
    pub(crate) damage: Vec<String>,
    /// Controls that are applied at given times.
    pub(crate) planned: Vec<(Time, Control)>,
    /// Further sinks for the run's entries.
    pub(crate) sinks: Vec<SinkSpec>,
    /// A recorder in place of the run's own.
    pub(crate) recorder: Option<OpenSink>,
    /// The configuration that the journal records, if it is not the composition's.
    pub(crate) journaled_config: Option<serde_json::Value>,
    /// The switch of the recording, for `mobee ctl record`.
    pub(crate) recording: Option<Arc<Recording>>,
    /// The progress bar and the settings of the terminal's output.
    pub(crate) terminal: Option<(progress::Bar, event_printer::TerminalSettings)>,
    /// The log that holds the newest events as sentences.
    pub(crate) log: Option<LogBook>,
}

/// Runs with a progress bar and signals, and prints the summary.
fn conduct(
    composition: Composition,
    folder: &Folder,
    extras: Extras,
    output: Output,
    ctl: CtlAt,
    controls: (mpsc::Sender<Control>, mpsc::Receiver<Control>),
) -> Result<ExitCode, Report> {
    let done = run_in_terminal(composition, folder, extras, output, ctl, controls)?;
    Ok(match &done.overload {
        _ if !in_order(&done.end) => ExitCode::FAILURE,
        _ if !done.end.counts.down.is_empty() => ExitCode::from(EXIT_GAVE_UP),
        Some((_, true)) => ExitCode::from(EXIT_OVERLOADED),
        _ => ExitCode::SUCCESS,
    })
}

/// Like [`conduct`], but returns the end of the run.
pub(crate) fn run_in_terminal(
    mut composition: Composition,
    folder: &Folder,
    mut extras: Extras,
    output: Output,
    ctl: CtlAt,
    (controls, receiver): (mpsc::Sender<Control>, mpsc::Receiver<Control>),
) -> Result<Done, Report> {
    let bar = progress::Bar::new(&composition.config, output);
    interrupt::listen(controls.clone())?;
    let recording = Arc::new(Recording::new(composition.config.record.enabled));
    let address = match ctl {
        CtlAt::Off => None,
        CtlAt::Folder => Some(None),
        CtlAt::Address(address) => Some(Some(address)),
    };
    let live = composition.config.clock_kind() == ClockKind::Real;
    let ready = ready::lines(&composition, folder, ctl);
    let stop_connections = StopConnections::default();
    if let Some(address) = address.filter(|_| live) {
        attach_ctl(&mut composition, &mut extras, folder, address, (controls, &recording, &stop_connections));
    }
    extras.recording = Some(recording);
    let recent = RecentFailures::default();
    let settings = event_printer::TerminalSettings { live, quiet: output.quiet, ready, recent: recent.clone() };
    extras.terminal = Some((bar.clone(), settings));
    let labels = Labels::new(composition.scene.robots());
    let done = run_with(composition, folder, extras, receiver, |p| bar.show(p))?;
    bar.finish();
    report::print(&done, folder, output, &labels, &recent.lines())?;
    // the client that requested the end waits until its connection is closed
    stop_connections.close();
    Ok(done)
}

/// Adds the service that `mobee ctl` reaches, at an address or in the run's folder, and the log that it shows.
fn attach_ctl(
    composition: &mut Composition,
    extras: &mut Extras,
    folder: &Folder,
    address: Option<SocketAddr>,
    (controls, recording, stop_connections): (mpsc::Sender<Control>, &Arc<Recording>, &StopConnections),
) {
    let beside = BesideNames { bridges: composition.bridge_names(), cameras: composition.camera_names() };
    let log = extras.log.insert(LogBook::default()).clone();
    let port = CtlPort { address, log, stop_connections: stop_connections.clone() };
    composition.services.push(Arc::new(CtlService::new(folder, port, controls, recording.clone(), beside)));
}

/// Address at which `mobee ctl` controls a run with a real clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CtlAt {
    /// At a socket in its folder, which only its user can reach.
    #[default]
    Folder,
    /// At this address, with the key in its folder.
    Address(SocketAddr),
    /// No control port.
    Off,
}

/// A run that has ended.
pub struct Done {
    /// The end as the system reports it.
    pub end: RunEnd,
    /// The last hash of the journal.
    pub hash: String,
    /// True if the whole journal is on disk.
    pub whole: bool,
    /// Elapsed wall-clock time.
    pub wall: Duration,
    /// Start of this process on the run's clock.
    pub began: Time,
    /// True if the run used the wall clock.
    pub real: bool,
    /// Errors of the journal, the recording or other files.
    pub complaints: Vec<String>,
    /// The overload of the machine as a sentence; true if it lasted, or data was lost by it.
    pub overload: Option<(String, bool)>,
}

/// True if a run ended as intended.
pub fn in_order(end: &RunEnd) -> bool {
    matches!(end.reason, Reason::Done | Reason::Time | Reason::Interrupted)
}

/// Like [`mobee_runtime::system::overload`], but counts only losses of the run's own files: a viewer or terminal that
/// lags behind does not harm the run.
pub(crate) fn overload(counts: &RunCounts, dropped: impl IntoIterator<Item = (String, u64)>) -> Option<(String, bool)> {
    let own = |name: &str| ![sinks::VIEWER, sinks::TERMINAL].contains(&name);
    let dropped: Vec<_> = dropped.into_iter().filter(|(name, _)| own(name)).collect();
    mobee_runtime::system::overload(counts, &dropped)
}

/// Runs a composition into a folder.
///
/// # Errors
/// If the journal or the recording can't be opened, or the system can't be started.
pub fn run(
    composition: Composition,
    folder: &Folder,
    controls: mpsc::Receiver<Control>,
    progress: impl FnMut(&RunProgress),
) -> Result<Done, Report> {
    run_with(composition, folder, Extras::default(), controls, progress)
}

/// [`run`] with extras.
///
/// # Errors
/// As for [`run`].
pub(crate) fn run_with(
    composition: Composition,
    folder: &Folder,
    extras: Extras,
    controls: mpsc::Receiver<Control>,
    progress: impl FnMut(&RunProgress),
) -> Result<Done, Report> {
    let Extras { past, mut damage, planned, sinks, recorder, journaled_config, recording, terminal, log } = extras;
    let Composition { config, file, scene, robots, sensors, truth, script, bridges, services, .. } = composition;
    let values = serde_json::to_value(&config).into_diagnostic()?;
    let file = file.canonicalize().unwrap_or(file);
    let resolved = Resolved { file, config: values.clone() };
    let (journal, past) = match past {
        // config.json keeps the initial configuration; that of the resumed run is in the journal's `resumed` event
        Some((journal, past)) => (journal, Some(past)),
        None => {
            folder.write("config.json", &serde_json::to_string_pretty(&resolved).into_diagnostic()?)?;
            (Journal::create(folder.path(), &json!({ "build": BUILD })).map_err(Report::msg)?, None)
        }
    };
    let motors: Vec<usize> = scene.robots().iter().map(|r| r.motors.len()).collect();
    let mut specs = vec![sinks::journal(&journal)];
    specs.extend(sinks::rings(&config, folder, motors.clone()));
    specs.extend(sinks::tracks(&config, folder, motors).map_err(Report::msg)?);
    specs.extend(sinks::frames(&config, folder, &mut damage).map_err(Report::msg)?);
    let began = past.as_ref().map_or(Time::ZERO, |past| past.at);
    let in_words = Arc::new(scene.clone());
    specs.extend(terminal.map(|(bar, settings)| sinks::terminal(bar, settings, &in_words)));
    specs.extend(log.map(|log| log.sink(&in_words)));
    let on = recording.as_ref().map_or_else(|| Arc::new(AtomicBool::new(true)), |r| r.on.clone());
    specs.extend(sinks::recorder(&config, folder, recorder, on));
    specs.extend(sinks::viewer(&config, folder));
    specs.extend(sinks);
    let taps =
        Taps::spawn(config.clock_kind(), specs).map_err(Report::msg).wrap_err("the run's folder can't be written")?;
    // also in the journal: once the files are continued, the next process to resume finds no trace of the damage
    let begins = past.as_ref().map_or(Time::ZERO, |past| past.at);
    damage.into_iter().for_each(|text| taps.event(begins, Event::Warning { text }));
    if let Some(recording) = recording {
        recording.open(taps.clone(), recorder_settings(&config, folder));
    }
    let kind = config.clock_kind();
    let setup = Setup {
        scene,
        robots,
        seed: config.seed,
        clock: kind,
        taps: taps.clone(),
        config: journaled_config.unwrap_or(values),
        script,
        // bridges first: the names of the bridges in the run must be those of the composition
        services: bridges.into_iter().map(|bridge| bridge as Arc<dyn Service>).chain(services).collect(),
        sensors,
        truth: Some(truth),
        past,
    };
    #[expect(clippy::disallowed_methods, reason = "the real-time factor compares the run's clock with the wall's")]
    let started = std::time::Instant::now();
    let limit = config.for_s.map(Duration::from_secs_f64);
    let end = mobee_runtime::system::run_under(setup, planned, controls, limit, progress);
    let (at, reason) =
        end.as_ref().map_or((Time::ZERO, "failed to start".to_owned()), |e| (e.ended_at, e.reason.to_string()));
    let reports = taps.finish(at, Event::Ended { reason });
    // the recorders close their files
    drop(taps);
    let end = end.map_err(|e| Report::msg(e.to_string()))?;
    // a sink that failed has reported an error already
    let dropped: Vec<_> = reports.iter().filter(|r| r.error.is_none()).map(|r| (r.name.clone(), r.dropped)).collect();
    let overload = Some(()).filter(|()| kind == ClockKind::Real).and_then(|()| overload(&end.counts, dropped));
    let complaints = reports.into_iter().filter_map(|r| r.error.map(|e| format!("{}: {e}", r.name))).collect();
    let wall = started.elapsed();
    let real = kind == ClockKind::Real;
    let hash = journal.hash();
    let whole = journal.is_whole();
    let mut done = Done { hash, whole, wall, began, real, complaints, overload, end };
    for (robot, snapshot) in &done.end.snapshots {
        // a map that an agent leaves is written into the run's folder
        if let Some(map) = snapshot.state.get("map") {
            let run = folder.path().file_name().unwrap_or_default().to_string_lossy();
            let ours = crate::roadmap::left_behind(map, &run);
            let map = ours.map_or_else(|| serde_json::to_string_pretty(map).into_diagnostic(), Ok)?;
            let written = folder.write(&format!("roadmap-{robot}.json"), &map);
            done.complaints.extend(written.err().map(|e| e.message().to_owned()));
        }
    }
    let text = serde_json::to_string_pretty(&summary(&done)).into_diagnostic()?;
    // an error is printed, too
    done.complaints.extend(folder.write("summary.json", &text).err().map(|e| e.message().to_owned()));
    if done.whole {
        done.complaints.extend(journal.seal_files(&folder.now()).err());
    }
    done.complaints.extend(folder.renamed());
    Ok(done)
}

/// Runs a shipped behavior in a folder that is thrown away: for examples and tests.
///
/// # Errors
/// As for [`command`].
pub fn example(file: &str, set: &[&str]) -> Result<Done, Box<dyn std::error::Error>> {
    let scratch = tempfile::tempdir()?;
    example_in(scratch.path(), file, set)
}

/// Like [`example`], but in this folder, which must be empty and remains.
///
/// # Errors
/// As for [`command`].
pub fn example_in(folder: &Path, file: &str, set: &[&str]) -> Result<Done, Box<dyn std::error::Error>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(file);
    let set: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
    let (config, source) = Config::load(&path, &set)?;
    let composition = compose(config, &source)?;
    let folder = Folder::create("example", Some(folder))?;
    let (_controls, receiver) = mpsc::channel(1);
    Ok(run(composition, &folder, receiver, |_| ())?)
}
