//! `mobee inspect`: a run in figures, from its journal alone.

use crate::config::ConfigError;
use miette::{IntoDiagnostic, Report};
use mobee_actors::check::summary;
use mobee_actors::journal::JournalError;
use std::fmt::Write;
use std::path::Path;

/// The figures of a run, for people or as JSON.
///
/// # Errors
/// If the journal can't be read, or is not as it was written.
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
    Ok(out)
}

/// A journal's complaint as one of ours.
pub fn journal_error(e: JournalError) -> ConfigError {
    ConfigError::plain(e.to_string(), "give the folder of a run, or its journal.jsonl as it was written")
}
