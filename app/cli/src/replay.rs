//! `mobee replay`: repeats a run in virtual time, from its folder.
//!
//! ```text
//! unchanged        run again ──every event──> compare with the journal: equal, or the first difference
//! --at T --set ..  equal up to T, then another agent, controller, world or script: both futures in one recording
//! ```

mod changes;
mod compare;

use crate::inspect::journal_error;
use crate::run::{
    CtlAt, Done, Extras, Folder, Output, QUEUE_ENTRIES, WRITE_TIMEOUT, recorder_settings, run_in_terminal, run_with,
};
use changes::changes;
use compare::{Compare, Verdict};
use miette::{IntoDiagnostic, Report};
use mobee_compose::config::{ClockMode, Config, ConfigError, Source};
use mobee_compose::{Composition, compose};
use mobee_contract::{Event, Time};
use mobee_journal::journal;
use mobee_recorder::Recording;
use mobee_runtime::system::Control;
use mobee_runtime::tap::{OpenSink, Pictures, SinkSpec};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use tokio::sync::mpsc;

/// Arguments of `mobee replay`.
#[derive(clap::Args)]
pub struct ReplayArgs {
    /// The folder of a run in virtual time.
    run: PathBuf,
    /// Apply `--set` from this second of the run on; up to it everything must be as recorded.
    #[arg(long, value_name = "SECONDS", requires = "set")]
    at: Option<f64>,
    /// Change the agent, controller, world or script: --set robot.icub.agent.speed=0.2
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Write into this new folder instead of runs/NAME-replay-TIME.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print only the summary, as JSON, on standard output.
    #[arg(long)]
    json: bool,
}

/// A recorded run in virtual time, to be run again.
pub struct RecordedRun {
    dir: PathBuf,
    source: Source,
    /// Time of its last event.
    until: Time,
}

impl RecordedRun {
    /// Reads a run's folder, and its journal from end to end.
    ///
    /// # Errors
    /// If it is not a run's folder, or its run can't be replayed.
    pub fn open(dir: &Path) -> Result<RecordedRun, Report> {
        Folder::must_be_run(dir)?;
        let (config, source) = Config::load_resolved(&dir.join("config.json"))?;
        let refuse =
            |what: &str, help: &str| Report::from(ConfigError::plain(format!("{}: {what}", dir.display()), help));
        if config.clock == ClockMode::Real {
            return Err(refuse(
                "a run by the wall clock can't be replayed",
                "play what it recorded as a robot: `mobee inspect RUN --poses FILE`, and a driver of kind `replay`",
            ));
        }
        let mut until = Time::ZERO;
        let mut ended = None;
        for line in journal::read(dir).map_err(journal_error)? {
            let line = match line {
                Err(e) if e.truncated => break,
                line => line.map_err(journal_error)?,
            };
            until = line.at;
            match line.event {
                Event::Injected { .. } => {
                    return Err(refuse(
                        "faults were injected into this run, and its folder does not record which",
                        "repeat it with the command that `mobee torture` printed",
                    ));
                }
                Event::Resumed { .. } => {
                    return Err(refuse(
                        "this run was resumed, and the time at which its process had ended is not recorded",
                        "replay an uninterrupted run",
                    ));
                }
                Event::Ended { reason } => ended = Some(reason),
                _ => {}
            }
        }
        if ended.as_deref() == Some("interrupted") {
            eprintln!("warning: this run was interrupted by hand; it can only be equal up to there");
        }
        Ok(RecordedRun { dir: dir.to_owned(), source, until })
    }

    /// Its resolved configuration.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// Builds what its configuration names.
    ///
    /// # Errors
    /// Every complaint, with its place and remedy.
    pub fn compose(&self) -> Result<Composition, Report> {
        Ok(compose(Config::from_source(&self.source)?, &self.source)?)
    }

    /// Runs its composition again, into `out` or a new folder below `runs/`, without terminal and signals; and the number of events that are
    /// equal to those of the journal, or the first difference.
    ///
    /// # Errors
    /// If the journal can't be read, a folder can't be made, or the system can't be started.
    pub fn embedded(
        &self,
        mut composition: Composition,
        out: Option<&Path>,
        controls: (mpsc::Sender<Control>, mpsc::Receiver<Control>),
    ) -> Result<(Folder, Done, Result<u64, String>), Report> {
        let (sink, verdict) = self.watch(None, controls.0.clone())?;
        // the journal has the configuration as it was, with its recording
        let journaled_config = Some(serde_json::to_value(&composition.config).into_diagnostic()?);
        let folder = Folder::create(&format!("{}-replay", composition.config.name), out)?;
        composition.config.record.enabled = false;
        let extras = Extras { sinks: vec![sink], journaled_config, ..Extras::default() };
        let done = run_with(composition, &folder, extras, controls.1, |_| ())?;
        let equal = verdict.after(&done);
        Ok((folder, done, equal))
    }

    /// A sink that compares a run with the journal up to `until`, and stops the run at the first difference.
    fn watch(&self, until: Option<Time>, stop: mpsc::Sender<Control>) -> Result<(SinkSpec, Verdict), Report> {
        let verdict = Verdict::default();
        let compare = Compare::new(&self.dir, until, verdict.clone(), stop).map_err(journal_error)?;
        let spec = SinkSpec {
            pictures: Pictures::None,
            name: "compare".into(),
            essential: false,
            poses: None,
            capacity: QUEUE_ENTRIES,
            patience: WRITE_TIMEOUT,
            open: Some(Arc::new(move || Ok(Box::new(compare.clone())))),
        };
        Ok((spec, verdict))
    }
}

/// Runs `mobee replay`.
///
/// # Errors
/// Complaints about the folder, its journal, or the changes, before anything runs.
pub fn command(args: &ReplayArgs) -> Result<ExitCode, Report> {
    let output = Output { json: args.json, ..Output::default() };
    let recorded = RecordedRun::open(&args.run)?;
    let name = |c: &Composition| format!("{}-replay", c.config.name);
    if args.set.is_empty() {
        let composition = recorded.compose()?;
        let folder = Folder::create(&name(&composition), args.out.as_deref())?;
        let (controls, receiver) = mpsc::channel(16);
        let (sink, verdict) = recorded.watch(None, controls.clone())?;
        let extras = Extras { sinks: vec![sink], ..Extras::default() };
        let done = run_in_terminal(composition, &folder, extras, output, CtlAt::Off, (controls, receiver))?;
        return Ok(judged(&verdict.after(&done), "the run matched the journal", &done));
    }
    let at = moment(args.at, &recorded)?;
    let mut source = recorded.source.clone();
    for assignment in &args.set {
        source.set(assignment)?;
    }
    let other = compose(Config::from_source(&source)?, &source)?;
    let mut composition = recorded.compose()?;
    let planned = changes(&composition, &other, at)?;
    for warning in other.warnings.iter().filter(|w| !composition.warnings.contains(w)) {
        eprintln!("warning: {warning}");
    }
    let folder = Folder::create(&name(&composition), args.out.as_deref())?;
    let recording = match composition.config.record.enabled {
        true => Some(
            Recording::begin(&recorder_settings(&composition.config, &folder))
                .map_err(|e| Report::msg(e.to_string()))?,
        ),
        false => None,
    };
    if let Some(recording) = &recording {
        // the recorded course, beside the changed one
        eprintln!("first unchanged, for the recording");
        again(&recorded, recording)?;
    }
    let journaled_config = serde_json::to_value(&composition.config).into_diagnostic()?;
    composition.script = other.script;
    composition.config.for_s = other.config.for_s;
    let (controls, receiver) = mpsc::channel(16);
    let (sink, verdict) = recorded.watch(Some(at), controls.clone())?;
    let recorder = recording.map(|r| opener(r, "changed"));
    let extras =
        Extras { sinks: vec![sink], planned, recorder, journaled_config: Some(journaled_config), ..Extras::default() };
    let done = run_in_terminal(composition, &folder, extras, output, CtlAt::Off, (controls, receiver))?;
    Ok(judged(&verdict.after(&done), &format!("as recorded up to {:.2} s, then changed", at.secs()), &done))
}

/// Opens a recorder of a shared recording.
fn opener(recording: Recording, name: &'static str) -> OpenSink {
    Arc::new(move || recording.recorder(name).map(|r| Box::new(r) as _))
}

/// Time of the change.
fn moment(at: Option<f64>, recorded: &RecordedRun) -> Result<Time, ConfigError> {
    let at = at.unwrap_or(0.0);
    let end = recorded.until.secs();
    if (0.0..=end).contains(&at) {
        return Ok(Time::from_secs(at));
    }
    Err(ConfigError::plain(
        format!("--at {at}: the run has no such instant"),
        format!("give seconds between 0 and {end:.2}"),
    ))
}

/// Runs the recorded run again, drawn as `recorded`.
fn again(recorded: &RecordedRun, recording: &Recording) -> Result<(), Report> {
    let scratch = tempfile::tempdir().map_err(|e| Report::msg(e.to_string()))?;
    let folder = Folder::create("recorded", Some(scratch.path()))?;
    let (controls, receiver) = mpsc::channel(16);
    let (sink, verdict) = recorded.watch(None, controls)?;
    let extras =
        Extras { sinks: vec![sink], recorder: Some(opener(recording.clone(), "recorded")), ..Extras::default() };
    let done = run_with(recorded.compose()?, &folder, extras, receiver, |_| ())?;
    if let Err(difference) = verdict.after(&done) {
        eprintln!("warning: {difference}");
    }
    Ok(())
}

fn judged(verdict: &Result<u64, String>, praise: &str, done: &Done) -> ExitCode {
    match verdict {
        Ok(events) => {
            eprintln!("{praise}: {events} events equal; last hash {}", done.hash);
            ExitCode::SUCCESS
        }
        Err(difference) => {
            eprintln!("{difference}");
            ExitCode::FAILURE
        }
    }
}
