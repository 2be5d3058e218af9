//! `mobee locator`: locators in files, trained on recorded views of known positions and evaluated on others.

mod best;
mod collect;
mod train;

use crate::remote_sensor::locator_process::{self, LocatorRunArgs};
use miette::{IntoDiagnostic, Report};
use mobee_compose::config::ConfigError;
use mobee_model::file::{MIB, read_text};
use mobee_sensing::locators::file::{LearnedPlaces, LocatorFile};
use mobee_sensing::locators::head::JOINTS;
use mobee_sensing::locators::rows::{ViewTable, parse};
use mobee_sensing::locators::score::{Errors, judge};
use mobee_sensing::locators::view::KnownView;
use serde_json::json;
use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Maximum size of a locator file, bytes.
const MAX_LOCATOR_BYTES: u64 = 16 * MIB;
/// Maximum size of a table of views, bytes.
const MAX_TABLE_BYTES: u64 = 32 * MIB;

/// The commands on locators.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum LocatorCommand {
    /// Train a locator on a table of recorded views of known positions.
    Train(train::LocatorTrainArgs),
    /// Extract a checked table of views of known positions from a run in which one robot looks at an object that
    /// another one holds.
    Collect(collect::CollectArgs),
    /// Train every kind on a run or a table, compare them on held-out places, store the best, and optionally swap it
    /// into a sensor of a running run.
    Best(best::BestArgs),
    /// Evaluate a locator on a table of views of known positions: by single views, and by all views of each place
    /// together.
    Eval {
        /// The locator.
        #[arg(long, value_name = "FILE")]
        locator: PathBuf,
        /// The table.
        #[arg(long, value_name = "FILE.csv")]
        data: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Run a sensor's locator in a process of its own over YARP, until Ctrl-C: regions come from `mobee detector run`,
    /// the configuration from the state ports of the robot's boards, and objects are moved in the world of a `mobee
    /// run`.
    Run(LocatorRunArgs),
    /// Show a trained locator.
    Show {
        /// The locator.
        file: PathBuf,
    },
}

/// Runs the command.
///
/// # Errors
/// If a file can't be read or written, or is invalid, with its place and the remedy.
pub fn command(command: &LocatorCommand) -> Result<(), Report> {
    crate::terminal::out(&done(command)?);
    Ok(())
}

/// Runs the words after `mobee locator`, and returns the output: for examples and tests.
///
/// # Errors
/// As for [`command`], and for words that are not a command.
pub fn example(words: &[&str]) -> Result<String, Box<dyn std::error::Error>> {
    #[derive(clap::Parser)]
    struct Words {
        #[command(subcommand)]
        command: LocatorCommand,
    }
    let words: Words = clap::Parser::try_parse_from(["locator"].iter().chain(words))?;
    Ok(done(&words.command)?)
}

fn done(command: &LocatorCommand) -> Result<String, Report> {
    Ok(match command {
        LocatorCommand::Train(args) => train::command(args)?,
        LocatorCommand::Collect(args) => collect::command(args)?,
        LocatorCommand::Best(args) => best::command(args)?,
        LocatorCommand::Eval { locator, data, json } => eval(&load(locator)?, data, *json)?,
        LocatorCommand::Show { file } => show(&load(file)?),
        LocatorCommand::Run(args) => locator_process::command(args).map(|()| String::new())?,
    })
}

fn load(path: &Path) -> Result<LocatorFile, ConfigError> {
    let text = read_text(path, MAX_LOCATOR_BYTES).map_err(|e| {
        let help = "give a locator as `mobee locator train` wrote it";
        ConfigError::plain(format!("can't read {}: {e}", path.display()), help)
    })?;
    LocatorFile::parse(&text).map_err(|e| ConfigError::plain(format!("{}: {}", path.display(), e.what), e.help))
}

/// A table, and the digest of its text.
fn table(path: &Path) -> Result<(ViewTable, String), ConfigError> {
    let text = read_text(path, MAX_TABLE_BYTES).map_err(|e| {
        let help = "give a table of recorded views, as comma-separated text";
        ConfigError::plain(format!("can't read {}: {e}", path.display()), help)
    })?;
    parsed_table(&path.display().to_string(), &text)
}

/// Parses a table and computes its digest; complaints use `name`.
fn parsed_table(name: &str, text: &str) -> Result<(ViewTable, String), ConfigError> {
    let table = parse(text).map_err(|e| ConfigError::plain(format!("{name}, line {}: {}", e.line, e.what), e.help))?;
    Ok((table, Sha256::digest(text.as_bytes()).iter().map(|b| format!("{b:02x}")).collect()))
}

fn eval(file: &LocatorFile, data: &Path, json: bool) -> Result<String, Report> {
    let known = table(data)?.0.known;
    let unclipped: Vec<KnownView> = known.iter().filter(|k| !k.view.is_clipped()).copied().collect();
    let ready = file.ready();
    let all = judge(&ready, &known);
    let unclipped = judge(&ready, &unclipped);
    if json {
        let text = json!({ "kind": file.kind(), "all": all, "unclipped": unclipped });
        return Ok(serde_json::to_string(&text).into_diagnostic()? + "\n");
    }
    let mut text = format!("{}, errors in mm\n", file.kind().name());
    let _ = writeln!(
        text,
        "{:32}{:>7}{:>9}{:>9}{:>9}{:>9}{:>12}",
        "", "asked", "located", "median", "mean", "95 %", "in region"
    );
    let rows: [(&str, &Errors); 4] = [
        ("single views, all", &all.single),
        ("single views, unclipped", &unclipped.single),
        ("all views of a place, all", &all.fused),
        ("all views of a place, unclipped", &unclipped.fused),
    ];
    for (name, e) in rows {
        let _ = writeln!(
            text,
            "{name:32}{:>7}{:>9}{:>9.1}{:>9.1}{:>9.1}{:>10.1} %",
            e.n,
            e.located,
            e.median_mm,
            e.mean_mm,
            e.p95_mm,
            100.0 * e.inside_95
        );
    }
    Ok(text)
}

fn show(file: &LocatorFile) -> String {
    let mut text = format!("{}, seed {}, learned from the table {}\n", file.kind().name(), file.seed, file.data);
    let model = match &file.learned {
        LearnedPlaces::Triangulate(t) => &t.model,
        LearnedPlaces::Calibrated(c) => &c.model,
        LearnedPlaces::Ensemble(e) => {
            let _ = writeln!(text, "{} networks", e.members.len());
            return text;
        }
        LearnedPlaces::Network(n) => {
            let units: usize = n.axes.iter().map(|a| a.hidden.len()).sum();
            let _ = writeln!(text, "{} networks, {units} hidden units", n.axes.len());
            return text;
        }
    };
    for (joint, offset) in JOINTS.iter().zip(model.offsets()) {
        let _ = writeln!(text, "{joint:12} reads {:+.2} deg too little", offset.to_degrees());
    }
    if let LearnedPlaces::Calibrated(c) = &file.learned {
        let deviation = c.noise.resting.diagonal().map(f64::sqrt);
        let _ = writeln!(
            text,
            "pixels scatter by {:.1} and {:.1} (left), {:.1} and {:.1} (right)",
            deviation[0], deviation[1], deviation[2], deviation[3]
        );
        let warp = if c.model.warp.is_some() { "warped: places left out are found better so" } else { "believed" };
        let _ = writeln!(
            text,
            "places are {warp}; {} of them, bandwidth {} m",
            c.workspace.places.len(),
            c.workspace.bandwidth
        );
    }
    text
}
