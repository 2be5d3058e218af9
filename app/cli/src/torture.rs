//! `mobee torture`: the production actors in virtual time under seeded random faults, with all invariants checked in every run.
//!
//! ```text
//! seed ──plan──> faults ──trial──> run ──Checker──> nothing, or a violation ──shrink──> the shortest list of faults
//! ```

mod boards;
mod counted;
pub mod faults;
mod memory;
pub mod plan;
mod report;
pub mod shrink;
pub mod sight;
pub mod swaps;
pub mod trial;
mod wires;
mod witness;

pub use report::Tally;

use crate::run::Folder;
use faults::chosen;
use miette::Report;
use mobee_journal::journal::Journal;
use plan::{Planned, plan};
use shrink::shrink;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use trial::{TortureTrial, TrialResult};

/// Maximum duration of runs that are repeated twice to check I13, seconds.
const MAX_REPEATED_S: f64 = 600.0;

/// The arguments of `mobee torture`.
#[derive(Clone, Debug, clap::Args)]
pub struct TortureArgs {
    /// The behavior to torture. Its robots are always simulated; those behind YARP retain their driver.
    pub file: PathBuf,
    /// Number of seeds, one run each.
    #[arg(long, default_value_t = 200)]
    pub seeds: u64,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    pub first: u64,
    /// Only these kinds of faults, such as F1,F8 or usual,F29; `mild`: few, and of everyday kinds; `usual`: the default; `all`: swaps as well; `none`.
    #[arg(long, default_value = "", hide_default_value = true)]
    pub faults: String,
    /// Start no further seed after this many minutes.
    #[arg(long, value_name = "M")]
    pub minutes: Option<f64>,
    /// Simulated seconds per run; the last of them (more if needed) are free of faults.
    #[arg(long, default_value_t = 60.0)]
    pub secs: f64,
    /// Override a setting: --set robot.icub.agent.vertices=30
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Only these faults of each seed's list, by number, to reproduce a failure.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',')]
    pub only: Option<Vec<usize>>,
    /// Stop at the first seed that fails.
    #[arg(long)]
    pub stop: bool,
    /// Store the journals in this new folder.
    #[arg(long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
}

/// Runs a torture battery and prints its result.
///
/// # Errors
/// Complaints about the arguments or the configuration.
pub fn command(args: &TortureArgs) -> Result<ExitCode, Report> {
    if !(args.secs >= 10.0 && args.secs <= 1e6) {
        return Err(Report::msg(format!("{} s make no run: give 10 to 1000000", args.secs)));
    }
    let tally = torture(args, |line| println!("{line}"))?;
    println!("{tally}");
    Ok(if tally.is_good() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Runs the seeds one after the other; `report` receives a text for each failed seed, and the progress from time to
/// time.
///
/// # Errors
/// As for [`command`].
pub fn torture(args: &TortureArgs, mut report: impl FnMut(&str)) -> Result<Tally, Report> {
    let kinds = chosen(&args.faults).map_err(Report::msg)?;
    let trial = TortureTrial::load(&args.file, &args.set, args.secs, args.faults == "mild")?;
    #[expect(clippy::disallowed_methods, reason = "the real-time factor compares simulated time with the wall's")]
    let started = std::time::Instant::now();
    // the bound is measured with the usual faults
    let usual = args.faults.is_empty() || args.faults.starts_with("usual");
    let most_faulted = trial.most_faulted().filter(|_| usual && args.only.is_none());
    let mut tally = Tally { most_faulted, replaced: trial.replaced.clone(), ..Tally::default() };
    for seed in args.first..args.first.saturating_add(args.seeds) {
        if args.minutes.is_some_and(|m| started.elapsed().as_secs_f64() > 60.0 * m) {
            break;
        }
        let mut planned = plan(seed, &trial.facts, &kinds);
        if let Some(only) = &args.only {
            planned = planned.into_iter().enumerate().filter(|(i, _)| only.contains(i)).map(|(_, p)| p).collect();
        }
        let ran = one(&trial, seed, &planned, args.keep.as_deref())?;
        tally.add(&planned, &ran, started.elapsed());
        if !ran.violations.is_empty() {
            report(&failure(args, &trial, seed, &planned, &ran)?);
            tally.failed.push(seed);
            if args.stop {
                break;
            }
        }
        if tally.seeds.is_multiple_of(100) && tally.seeds < args.seeds {
            report(&tally.line());
        }
    }
    // a long run is not repeated
    if tally.seeds > 0 && tally.failed.is_empty() && args.secs <= MAX_REPEATED_S {
        tally.twice = again(args, &trial, &kinds)?;
    }
    Ok(tally)
}

fn one(trial: &TortureTrial, seed: u64, planned: &[Planned], keep: Option<&Path>) -> Result<TrialResult, Report> {
    let Some(dir) = keep else { return trial.run(seed, planned, Vec::new()) };
    let folder = Folder::create("torture", Some(&dir.join(format!("seed-{seed}"))))?;
    let journal = Journal::create(folder.path(), &serde_json::json!({ "torture": seed })).map_err(Report::msg)?;
    trial.run(seed, planned, vec![journal.sink(), trial.tracks(folder.path())?])
}

/// Checks I13: runs the first seed again, with journal and measured poses on disk. The hash must be the same and the
/// chain intact; returns further violations that a check of the files finds.
fn again(args: &TortureArgs, trial: &TortureTrial, kinds: &[&'static str]) -> Result<Vec<String>, Report> {
    let planned = plan(args.first, &trial.facts, kinds);
    let scratch = tempfile::tempdir().map_err(|e| Report::msg(e.to_string()))?;
    let journal = Journal::create(scratch.path(), &serde_json::Value::Null).map_err(Report::msg)?;
    let first = trial.run(args.first, &planned, Vec::new())?;
    let second = trial.run(args.first, &planned, vec![journal.sink(), trial.tracks(scratch.path())?])?;
    let mut wrong = Vec::new();
    if first.hash != second.hash || journal.hash() != second.hash {
        let a = first.hash;
        let b = second.hash;
        let c = journal.hash();
        wrong.push(format!(
            "I13 broken: seed {} ran twice, and its hashes are {a}, {b}, and {c} in a journal",
            args.first
        ));
    }
    match mobee_journal::check::check(scratch.path()) {
        Ok(report) => {
            let counted = report.violations.iter().filter(|v| counted::counts(v, &planned));
            wrong.extend(counted.map(|v| format!("in the journal of seed {}: {v}", args.first)))
        }
        Err(e) => wrong.push(format!("I13 broken: the journal of seed {} is not as it was written: {e}", args.first)),
    }
    Ok(wrong)
}

/// The report of a failed seed: the shortest list of faults, and the command that reproduces it.
fn failure(
    args: &TortureArgs,
    trial: &TortureTrial,
    seed: u64,
    planned: &[Planned],
    ran: &TrialResult,
) -> Result<String, Report> {
    let Some((invariant, what)) = ran.violations.first() else { return Ok(String::new()) };
    let numbered: Vec<(usize, Planned)> = match &args.only {
        Some(only) => only.iter().copied().zip(planned.iter().cloned()).collect(),
        None => planned.iter().cloned().enumerate().collect(),
    };
    let still = |part: &[(usize, Planned)]| {
        let faults: Vec<Planned> = part.iter().map(|(_, p)| p.clone()).collect();
        trial.run(seed, &faults, Vec::new()).is_ok_and(|ran| ran.violations.iter().any(|(i, _)| i == invariant))
    };
    let least = shrink(&numbered, still);
    let mut text = format!("seed {seed}: {what}\n");
    for (i, p) in &least {
        text += &format!("  {i:3} {} {}\n", p.at, p.what);
    }
    let only: Vec<String> = least.iter().map(|(i, _)| i.to_string()).collect();
    let file = args.file.display();
    let mut again = format!("mobee torture {file} --first {seed} --seeds 1 --secs {}", args.secs);
    if !args.faults.is_empty() {
        again += &format!(" --faults {}", args.faults);
    }
    for set in &args.set {
        again += &format!(" --set '{set}'");
    }
    // if the run fails without any fault, every list reproduces it
    if !only.is_empty() {
        again += &format!(" --only {}", only.join(","));
    }
    Ok(text + "  again: " + &again)
}
