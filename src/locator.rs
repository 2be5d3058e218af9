//! `mobee locator`: locators in files, learned from recorded views of known places and judged by others.

mod best;
mod collect;
mod train;

use crate::config::ConfigError;
use crate::outside::placing::{self, LocatorRunArgs};
use miette::{IntoDiagnostic, Report};
use mobee_behaviors::locators::file::{LearnedPlaces, LocatorFile};
use mobee_behaviors::locators::head::JOINTS;
use mobee_behaviors::locators::rows::{ViewTable, parse};
use mobee_behaviors::locators::score::{Errors, judge};
use mobee_behaviors::locators::view::KnownView;
use mobee_model::file::{MIB, read_text};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// How long a locator file may be, and a table, bytes.
const LONGEST: (u64, u64) = (16 * MIB, 32 * MIB);

/// What to do with locators.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum LocatorCommand {
    /// Learn from a table of recorded views of known places.
    Train(train::LocatorTrainArgs),
    /// Take a table of views of known places from a run in which one robot looks at what another one holds, and check it.
    Collect(collect::CollectArgs),
    /// Learn every kind from a run or a table, compare them by whole places held out, keep the best, and put it into a sensor of a run that
    /// is going.
    Best(best::BestArgs),
    /// Judge a locator by a table of views of known places: by single views, and by all views of each place together.
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
    /// Place what the detectors of a sensor see, in a process of its own over YARP, until Ctrl-C: regions come from `mobee detector run`, the
    /// pose from the state ports of the robot's boards, and objects are moved in the world of a `mobee run`.
    Run(LocatorRunArgs),
    /// Show what a locator has learned.
    Show {
        /// The locator.
        file: PathBuf,
    },
}

/// Does it.
///
/// # Errors
/// If a file can't be read or written, or is not what it should be, with place and remedy.
pub fn command(command: &LocatorCommand) -> Result<(), Report> {
    crate::terminal::out(&done(command)?);
    Ok(())
}

/// Does what the words after `mobee locator` say, and returns what it says: for examples and tests.
///
/// # Errors
/// As for [`command`], and words that are no command.
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
        LocatorCommand::Run(args) => placing::command(args).map(|()| String::new())?,
    })
}

fn load(path: &Path) -> Result<LocatorFile, ConfigError> {
    let text = read_text(path, LONGEST.0).map_err(|e| {
        let help = "give a locator as `mobee locator train` wrote it";
        ConfigError::plain(format!("can't read {}: {e}", path.display()), help)
    })?;
    LocatorFile::parse(&text).map_err(|e| ConfigError::plain(format!("{}: {}", path.display(), e.what), e.help))
}

/// A table, and the digest of its text.
fn table(path: &Path) -> Result<(ViewTable, String), ConfigError> {
    let text = read_text(path, LONGEST.1).map_err(|e| {
        let help = "give a table of recorded views, as comma-separated text";
        ConfigError::plain(format!("can't read {}: {e}", path.display()), help)
    })?;
    understood(&path.display().to_string(), &text)
}

/// A table of this text, which complaints call so, and the text's digest.
fn understood(name: &str, text: &str) -> Result<(ViewTable, String), ConfigError> {
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
        let said = json!({ "kind": file.kind(), "all": all, "unclipped": unclipped });
        return Ok(serde_json::to_string(&said).into_diagnostic()? + "\n");
    }
    let mut said = format!("{}, errors in mm\n", file.kind().name());
    let _ = writeln!(
        said,
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
            said,
            "{name:32}{:>7}{:>9}{:>9.1}{:>9.1}{:>9.1}{:>10.1} %",
            e.n,
            e.located,
            e.median_mm,
            e.mean_mm,
            e.p95_mm,
            100.0 * e.inside_95
        );
    }
    Ok(said)
}

fn show(file: &LocatorFile) -> String {
    let mut said = format!("{}, seed {}, learned from the table {}\n", file.kind().name(), file.seed, file.data);
    let model = match &file.learned {
        LearnedPlaces::Triangulate(t) => &t.model,
        LearnedPlaces::Calibrated(c) => &c.model,
        LearnedPlaces::Ensemble(e) => {
            let _ = writeln!(said, "{} networks", e.members.len());
            return said;
        }
        LearnedPlaces::Network(n) => {
            let units: usize = n.axes.iter().map(|a| a.hidden.len()).sum();
            let _ = writeln!(said, "{} networks, {units} hidden units", n.axes.len());
            return said;
        }
    };
    for (joint, offset) in JOINTS.iter().zip(model.offsets()) {
        let _ = writeln!(said, "{joint:12} reads {:+.2} deg too little", offset.to_degrees());
    }
    if let LearnedPlaces::Calibrated(c) = &file.learned {
        let deviation = c.noise.resting.diagonal().map(f64::sqrt);
        let _ = writeln!(
            said,
            "pixels scatter by {:.1} and {:.1} (left), {:.1} and {:.1} (right)",
            deviation[0], deviation[1], deviation[2], deviation[3]
        );
        let warp = if c.model.warp.is_some() { "warped: places left out are found better so" } else { "believed" };
        let _ = writeln!(
            said,
            "places are {warp}; {} of them, bandwidth {} m",
            c.workspace.places.len(),
            c.workspace.bandwidth
        );
    }
    said
}
