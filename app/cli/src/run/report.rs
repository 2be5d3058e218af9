//! The summary of a run, as a table for people and as JSON for programs.

use super::{Done, Folder};
use miette::{IntoDiagnostic, Report};
use mobee_contract::RestStep;
use mobee_model::Labels;
use mobee_runtime::system::Reason;
use serde_json::{Value, json};

/// Output options of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Output {
    /// The summary as JSON, on standard output.
    pub json: bool,
    /// Print only warnings during the run.
    pub quiet: bool,
    /// Print all counters, including those that are zero.
    pub verbose: bool,
}

/// The summary as JSON: the content of `summary.json`.
pub fn summary(done: &Done) -> Value {
    let end = &done.end;
    let wall = done.wall.as_secs_f64();
    // a resumed run spent a part of its time in an earlier process
    let passed = end.ended_at.since(done.began).as_secs_f64();
    let mut summary = json!({
        "reason": end.reason.to_string(),
        "simulated_s": end.ended_at.secs(),
        "wall_s": wall,
        "real_time_factor": if wall > 0.0 { passed / wall } else { 0.0 },
        "counters": end.counts,
        "journal_hash": done.whole.then_some(&done.hash),
        "complaints": done.complaints,
        "overload": done.overload.as_ref().map(|(what, _)| what),
    });
    if !end.counts.rest.is_empty() {
        summary["rest"] = end.counts.rest.iter().map(|(robot, step)| (robot.clone(), json!(rest(step)))).collect();
    }
    summary
}

/// The end of the motion to a robot's rest pose, as a phrase.
fn rest(step: &RestStep) -> String {
    match step {
        RestStep::Reached => "reached".into(),
        RestStep::Missed { why } => format!("not reached: {why}"),
        RestStep::Begun => "not reached".into(),
    }
}

/// The reason for the run's end, as a phrase.
fn reason(reason: Reason) -> &'static str {
    match reason {
        Reason::Done => "done: all agents have finished",
        Reason::Time => "time: the run reached its time limit",
        Reason::Interrupted => "stopped on request",
        Reason::GaveUp => "gave up: a part used up its restarts",
        Reason::NoJournal => "no journal: it could no longer be written",
    }
}

/// The rows of the counters: motions and contacts first, then all others that are not zero, or all if `verbose`.
fn counters(counts: &Value, verbose: bool) -> Vec<(String, String)> {
    const FIRST: [(&str, &str); 7] = [
        ("commits", "motions"),
        ("committed", "committed"),
        ("rolled_back", "rolled back"),
        ("faulted", "faulted"),
        ("stopped", "aborted on request"),
        ("contacts", "contacts"),
        ("hard_contacts", "hard contacts"),
    ];
    let number = |key: &str| counts[key].as_u64().unwrap_or_default();
    let deepest = counts["hard_contact_depth_mm"].as_f64().filter(|mm| *mm > 0.0);
    let text = |key: &str| match deepest.filter(|_| key == "hard_contacts") {
        Some(mm) => format!("{}, at most {mm:.1} mm deep", number(key)),
        None => number(key).to_string(),
    };
    let pushed = counts["push_n"].as_f64().map(|newtons| {
        let secs = counts["push_s"].as_f64().unwrap_or_default();
        ("pushed".to_owned(), format!("at most with {newtons:.1} N, for at most {secs:.2} s"))
    });
    // a motion is aborted at most by the end of the run: no row unless there is one
    let first = FIRST.iter().filter(|(key, _)| verbose || *key != "stopped" || number(key) > 0);
    let first = first.map(|(key, name)| ((*name).to_owned(), text(key)));
    let others = counts.as_object().into_iter().flatten().filter(|(key, value)| {
        let shown = value.as_u64().is_some_and(|n| n > 0) && *key != "samples";
        value.is_number()
            && !key.starts_with("push_")
            && !FIRST.iter().any(|(first, _)| first == key)
            && (verbose || shown)
    });
    first.chain(pushed).chain(others.map(|(key, value)| (key.replace('_', " "), value.to_string()))).collect()
}

/// Prints the summary.
///
/// # Errors
/// If the summary can't be formatted.
pub(super) fn print(
    done: &Done,
    folder: &Folder,
    output: Output,
    labels: &Labels,
    recent: &[String],
) -> Result<(), Report> {
    let mut summary = summary(done);
    if output.json {
        summary["folder"] = json!(folder.path());
        println!("{}", serde_json::to_string_pretty(&summary).into_diagnostic()?);
        return Ok(());
    }
    let row = |name: &str, value: String| println!("  {name:22} {}", labels.read(&value));
    println!("\n{}", folder.path().display());
    row("ended", reason(done.end.reason).into());
    let secs = done.end.ended_at.secs();
    let wall = done.wall.as_secs_f64();
    if done.real {
        row("duration", format!("{secs:.1} s ({:.1} min) by the run's clock", secs / 60.0));
        if done.began.secs() > 0.0 {
            row("of these resumed", format!("{wall:.1} s"));
        }
    } else {
        row("simulated", format!("{secs:.1} s ({:.1} min)", secs / 60.0));
        let factor = summary["real_time_factor"].as_f64().unwrap_or(0.0);
        row("wall clock", format!("{wall:.1} s, {factor:.0} times real time"));
    }
    for (name, value) in counters(&summary["counters"], output.verbose) {
        row(&name, value);
    }
    done.end.counts.failed_by().into_iter().for_each(|causes| row("failed by", causes));
    for (i, line) in recent.iter().enumerate() {
        row(if i == 0 { "last that failed" } else { "" }, line.clone());
    }
    for (robot, s) in &done.end.counts.done {
        row(robot, s.text.clone());
        for (name, value) in &s.figures {
            row(&format!("  {name}"), value.to_string());
        }
    }
    for (robot, step) in &done.end.counts.rest {
        match step {
            RestStep::Reached => row("rest pose", format!("{robot} rests there")),
            _ => row("attention", format!("{robot} holds where it is; rest pose {}", rest(step))),
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
    let is_there = folder.path().join(mobee_journal::journal::FILE).exists();
    if done.end.reason == Reason::NoJournal {
        println!("\n  the journal could no longer be written, so the robots were brought to rest");
    }
    if done.end.reason == Reason::NoJournal && is_there {
        println!("  once it can be: mobee run --resume {}", crate::terminal::shell_word(folder.path()));
    }
    if !is_there {
        return Ok(());
    }
    let path = crate::terminal::shell_word(folder.path());
    println!(
        "\n  mobee check {path}      verify the journal and the invariants\n  mobee view {path}       open the recording"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_show_what_happened_and_zeros_on_request_alone() {
        let counts = json!({
            "samples": 900, "commits": 3, "committed": 2, "rolled_back": 0, "faulted": 0, "stopped": 1, "contacts": 0,
            "hard_contacts": 2, "hard_contact_depth_mm": 1.5, "restarts": 0, "refused": 4, "gave_up": 0, "late": {"periods": 0}
        });
        let rows =
            |verbose| counters(&counts, verbose).into_iter().map(|(name, n)| format!("{name} {n}")).collect::<Vec<_>>();
        let shown = [
            "motions 3",
            "committed 2",
            "rolled back 0",
            "faulted 0",
            "aborted on request 1",
            "contacts 0",
            "hard contacts 2, at most 1.5 mm deep",
            "refused 4",
        ];
        assert_eq!(rows(false), shown);
        assert!(rows(true).contains(&"restarts 0".into()) && rows(true).contains(&"samples 900".into()));
    }
}
