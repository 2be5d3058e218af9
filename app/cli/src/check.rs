//! `mobee check`: checks a configuration before it runs, or a journal after the run.

use crate::inspect::journal_error;
use crate::narrate::labels_of;
use miette::{IntoDiagnostic, Report, WrapErr};
use mobee_compose::config::{Config, ConfigError};
use mobee_compose::{Composition, compose};
use mobee_controller::RELEASE;
use mobee_journal::check::{JudgedFiles, JudgedPoses, check, judged, wants_poses};
use mobee_model::Labels;
use mobee_model::file::{self, MIB};
use mobee_planning::roadmap::Roadmap;
use mobee_planning::roadmap::verdict::judge;
use std::io::ErrorKind;
use std::path::Path;
use std::process::ExitCode;

/// Maximum size of the roadmap in a run's folder, bytes.
const MAX_ROADMAP_BYTES: u64 = 64 * MIB;

/// Checks a run's folder, a journal, or a configuration file at `path`.
///
/// # Errors
/// If it can't be read, or was changed.
pub fn command(path: &Path, set: &[String], edges: bool) -> Result<ExitCode, Report> {
    let is_run = path.is_dir() || path.extension().is_some_and(|e| e == "jsonl");
    if !is_run {
        if !path.exists() {
            let remedy = "give the folder of a run, its journal.jsonl, or a configuration file";
            return Err(ConfigError::plain(format!("there is nothing at {}", path.display()), remedy).into());
        }
        let c = mobee_compose::read(path, set)?;
        for w in &c.warnings {
            println!("warning: {w}");
        }
        for (robot, pose) in &c.resolved_goals {
            println!("{robot}: {pose}");
        }
        println!("{}: ready to run ({})", path.display(), contents(&c));
        return Ok(ExitCode::SUCCESS);
    }
    let report = check(path).map_err(journal_error)?;
    println!("{} events, chain intact, hash {}", report.events, report.hash);
    match &report.ended {
        Some(reason) => println!("the run ended in order: {reason}"),
        None => println!("the run did not end in order; open commits and links are not judged"),
    }
    print_poses(&report.poses);
    print_files(&report.files);
    if report.hard.episodes > 0 {
        println!("{}", report.hard);
    }
    // the journal's stable names of shapes are shown as labels
    let labels = if report.violations.is_empty() { Labels::default() } else { labels_of(path) };
    for v in &report.violations {
        println!("{}", labels.read(&v.to_string()));
    }
    let mut good = report.violations.is_empty() && !report.is_damaged();
    if report.violations.is_empty() {
        println!("{}", verdict(&report.poses));
    }
    if edges {
        good &= judge_edges(path)?;
    }
    match report.truncated {
        Some(e) => Err(journal_error(e).into()),
        None => Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE }),
    }
}

/// Prints the number of measured poses, and the robots without any.
fn print_poses(poses: &JudgedPoses) {
    let JudgedPoses { readings, missing, wrong, .. } = poses;
    if *readings > 0 {
        println!("{readings} measured poses");
    }
    if !missing.is_empty() {
        let robots = missing.join(", ");
        let not = wants_poses();
        println!("no measured poses of {robots} beside the journal: {not} are not judged there");
    }
    for why in wrong {
        println!("attention: {why}");
    }
}

/// The invariants that hold, and those that could be judged only in part.
fn verdict(poses: &JudgedPoses) -> String {
    let holds = |poses: bool| format!("invariants {} hold", judged(poses));
    match (poses.readings > 0, poses.wrong.is_empty() && poses.missing.is_empty()) {
        (true, false) => {
            format!("{}; {} where there are measured poses, not all along (see above)", holds(false), wants_poses())
        }
        (any, _) => holds(any),
    }
}

/// Prints the state of the run's files since its end.
fn print_files(files: &JudgedFiles) {
    let JudgedFiles { whole, damage, unjudged } = files;
    match unjudged {
        Some(why) => println!("whether files of the run are damaged is not judged: {why}"),
        None => println!("{whole} files as they were when the run ended"),
    }
    for what in damage {
        println!("damage: {what}");
    }
}

fn contents(c: &Composition) -> String {
    let robots: Vec<String> = c.config.robot.iter().map(|r| r.name.clone()).collect();
    format!("robots: {}; {} objects; {} scripted steps", robots.join(", "), c.scene.objects().count(), c.script.len())
}

/// Judges every driven edge of a run's roadmaps by an offline check of its straight line, and prints the result.
fn judge_edges(run: &Path) -> Result<bool, Report> {
    let dir = if run.is_dir() { run } else { run.parent().unwrap_or(Path::new(".")) };
    let stored = dir.join("config.json");
    let (config, source) = Config::load_resolved(&stored)?;
    let c = compose(config, &source)?;
    // the world at the end of the run: the script was over before the last edges were driven
    let scene = c.script.iter().fold(c.scene.clone(), |scene, step| scene.edit(&step.edit).unwrap_or(scene));
    let labels = Labels::new(c.scene.robots());
    let mut good = true;
    for (i, r) in c.config.robot.iter().enumerate() {
        let file = dir.join(format!("roadmap-{}.json", r.name));
        let text = match file::read_text(&file, MAX_ROADMAP_BYTES) {
            Ok(text) => text,
            Err(e) if e.kind() == ErrorKind::NotFound => continue,
            Err(e) => {
                let what = format!("can't read {}: {e}", file.display());
                return Err(ConfigError::plain(what, "give the folder of a run, as it was written").into());
            }
        };
        let value: serde_json::Value =
            serde_json::from_str(&text).into_diagnostic().wrap_err(file.display().to_string())?;
        let map = Roadmap::import(&value, &c.scene.robots()[i]).map_err(|e| {
            ConfigError::plain(format!("{}: {e}", file.display()), "give the folder of a run, as it was written")
        })?;
        let report = judge(&map, &scene, i, &scene.home(), r.controller.margin_mm * 1e-3 + RELEASE);
        println!(
            "edges of {}: {} agree with the offline check of their straight line, {} borderline, {} disagree",
            r.name,
            report.agree,
            report.borderline.len(),
            report.disagree.len()
        );
        for e in report.borderline.iter().chain(&report.disagree) {
            println!(
                "  {} -> {}: driven {}, offline {} ({:.1} mm, {})",
                e.from,
                e.to,
                if e.reached { "to its end" } else { "and rolled back" },
                if e.free { "free" } else { "blocked" },
                e.distance * 1e3,
                e.pair.as_deref().map_or("nothing near".into(), |pair| labels.read(pair))
            );
        }
        if c.robots[i].controller.drive.is_straight() {
            good &= report.disagree.is_empty();
        } else {
            println!("  ({} is not driven straight, so these need not agree)", r.name);
        }
    }
    Ok(good)
}
