//! The summary of a run, as a table for people and as JSON for programs.

use super::{Done, Folder};
use miette::{IntoDiagnostic, Report};
use mobee_actors::system::Reason;
use serde_json::{Value, json};

/// The summary as JSON: what `summary.json` holds.
pub fn summary(done: &Done) -> Value {
    let end = &done.end;
    let simulated = end.ended_at.secs();
    let wall = done.wall.as_secs_f64();
    json!({
        "reason": end.reason.to_string(),
        "simulated_s": simulated,
        "wall_s": wall,
        "real_time_factor": if wall > 0.0 { simulated / wall } else { 0.0 },
        "counters": end.counts,
        "journal_hash": done.whole.then_some(&done.hash),
        "complaints": done.complaints,
        "overload": done.overload.as_ref().map(|(what, _)| what),
    })
}

/// Prints it.
///
/// # Errors
/// None but those of formatting.
pub fn print(done: &Done, folder: &Folder, as_json: bool) -> Result<(), Report> {
    let mut summary = summary(done);
    if as_json {
        summary["folder"] = json!(folder.path());
        println!("{}", serde_json::to_string_pretty(&summary).into_diagnostic()?);
        return Ok(());
    }
    let row = |name: &str, value: String| println!("  {name:22} {value}");
    println!("\n{}", folder.path().display());
    row("ended", done.end.reason.to_string());
    row("simulated", format!("{:.1} s ({:.1} min)", done.end.ended_at.secs(), done.end.ended_at.secs() / 60.0));
    row(
        "wall clock",
        format!(
            "{:.1} s, {:.0} times real time",
            done.wall.as_secs_f64(),
            summary["real_time_factor"].as_f64().unwrap_or(0.0)
        ),
    );
    for (name, value) in summary["counters"].as_object().into_iter().flatten().filter(|(_, v)| v.is_number()) {
        row(&name.replace('_', " "), value.to_string());
    }
    for (robot, s) in &done.end.counts.done {
        row(robot, s.text.clone());
        for (name, value) in &s.figures {
            row(&format!("  {name}"), value.to_string());
        }
    }
    for (name, why) in &done.end.counts.down {
        row("attention", format!("{name} is down: {why}"));
    }
    row("journal", done.hash.clone());
    for c in &done.complaints {
        row("attention", c.clone());
    }
    if let Some((what, _)) = &done.overload {
        row("attention", what.clone());
    }
    let path = folder.path().display();
    let is_there = folder.path().join(mobee_actors::record::journal::FILE).exists();
    if done.end.reason == Reason::NoJournal {
        println!("\n  the journal could no longer be written, so the robots were brought to rest");
    }
    if done.end.reason == Reason::NoJournal && is_there {
        println!("  once it can be: mobee run --resume {path}");
    }
    if !is_there {
        return Ok(());
    }
    println!(
        "\n  mobee check {path}      verify the journal and the invariants\n  mobee view {path}       open the recording"
    );
    Ok(())
}
