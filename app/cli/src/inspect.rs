//! `mobee inspect`: figures of a run, from its journal alone.

use crate::narrate::labels_of;
use miette::{IntoDiagnostic, Report};
use mobee_compose::config::{Config, ConfigError};
use mobee_journal::check::summary;
use mobee_journal::journal::JournalError;
use mobee_model::Labels;
use mobee_recorder::RecordedPoses;
use std::fmt::Write;
use std::path::Path;

/// The figures of a run, as text or as JSON.
///
/// # Errors
/// If the journal can't be read, or was changed.
pub fn text(run: &Path, json: bool) -> Result<String, Report> {
    let s = summary(run).map_err(journal_error)?;
    let value = serde_json::to_value(&s).into_diagnostic()?;
    if json {
        return Ok(serde_json::to_string_pretty(&value).into_diagnostic()? + "\n");
    }
    let mut out = String::new();
    for (key, v) in value.as_object().into_iter().flatten() {
        let name = key.replace('_', " ");
        match v {
            serde_json::Value::Object(map) if map.is_empty() => {}
            serde_json::Value::Array(list) if list.is_empty() => {}
            serde_json::Value::Array(_) if key == "done" => s.done.iter().for_each(|(robot, figures)| {
                let _ = writeln!(out, "  {robot:22} {}", figures.text);
                for (name, value) in &figures.figures {
                    let _ = writeln!(out, "    {name:20} {value}");
                }
            }),
            serde_json::Value::Null => {}
            serde_json::Value::Object(map) => {
                let parts: Vec<String> = map.iter().map(|(k, n)| format!("{k} {n}")).collect();
                let _ = writeln!(out, "  {name:22} {}", parts.join(", "));
            }
            serde_json::Value::String(text) => {
                let _ = writeln!(out, "  {name:22} {text}");
            }
            other => {
                let _ = writeln!(out, "  {name:22} {other}");
            }
        }
    }
    // the journal's stable names of shapes are shown as labels
    let labels = if out.contains('#') { labels_of(run) } else { Labels::default() };
    Ok(labels.read(&out).into_owned())
}

/// Writes the poses of a run's recording as a table for the driver kind `replay`; returns a summary.
///
/// # Errors
/// If there is no such run, robot or recording, the file exists already, or it can't be written.
pub fn poses(run: &Path, robot: Option<&str>, file: &Path) -> Result<String, Report> {
    let (config, _) = Config::load_resolved(&run.join("config.json"))?;
    let names: Vec<&str> = config.robot.iter().map(|r| r.name.as_str()).collect();
    let robot = match (robot, names.as_slice()) {
        (Some(name), known) if known.contains(&name) => name,
        (None, [only]) => only,
        _ => {
            let what = "of which robot?";
            return Err(ConfigError::plain(what, format!("give --robot; there are: {}", names.join(", "))).into());
        }
    };
    let help = "the run must have been recorded; `mobee view` shows whether it was";
    let poses = RecordedPoses::read(&run.join("recording.rrd"), robot).map_err(|e| ConfigError::plain(e, help))?;
    let table = poses.table();
    let refused = |e: std::io::Error| {
        ConfigError::plain(
            format!("can't write {}: {e}", file.display()),
            "give a new file in a folder that can be written",
        )
    };
    let mut out = std::fs::File::create_new(file).map_err(refused)?;
    std::io::Write::write_all(&mut out, table.as_bytes()).map_err(refused)?;
    Ok(format!("{} poses of {robot} in {}", table.lines().count() - 1, file.display()))
}

/// A journal's error as a complaint.
pub fn journal_error(e: JournalError) -> ConfigError {
    ConfigError::plain(e.to_string(), "give the folder of a run, or its journal.jsonl as it was written")
}
