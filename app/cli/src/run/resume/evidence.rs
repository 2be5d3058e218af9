//! Checks that the other files of a run's folder agree with its journal. If two of them contradict each other, it is
//! unknown how the robot came to its place, and the run can't be resumed.

use mobee_compose::config::{ConfigError, differences};
use mobee_contract::{Pose, Time};
use mobee_model::Robot;
use mobee_model::file::{MIB, read_text};
use mobee_runtime::system::Past;
use serde_json::Value;
use std::io::ErrorKind;
use std::path::Path;

/// Maximum size of a summary, bytes.
const MAX_SUMMARY_BYTES: u64 = MIB;
/// Maximum number of differences in a complaint.
const MAX_DIFFERENCES: usize = 5;

/// The last hash of the journal according to the summary; `None` if no process of this run ended in order.
///
/// # Errors
/// If the summary was changed.
pub(super) fn summary_hash(dir: &Path) -> Result<Option<String>, ConfigError> {
    let file = dir.join("summary.json");
    let foreign = |what: String| {
        let help = "put the file back as it was written, or take it away to go by the journal alone";
        ConfigError::plain(format!("{}: {what}", file.display()), help)
    };
    let text = match read_text(&file, MAX_SUMMARY_BYTES) {
        Ok(text) => text,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(foreign(e.to_string())),
    };
    let value: Value = serde_json::from_str(&text).map_err(|e| foreign(e.to_string()))?;
    match value.get("journal_hash") {
        Some(Value::String(hash)) => Ok(Some(hash.clone())),
        // the disk was full before the journal's end
        Some(Value::Null) => Ok(None),
        _ => Err(foreign("it has no `journal_hash`".into())),
    }
}

/// Checks that the journal holds a run, and that it is the run of `config.json`.
///
/// # Errors
/// The contradiction to the journal.
pub(super) fn check_config(dir: &Path, past: &Past, stored: &Value) -> Result<(), ConfigError> {
    let journal = dir.join(mobee_journal::journal::FILE);
    if past.events == 0 {
        let what = format!("{} holds no event: nothing tells what this run was, and did", journal.display());
        let help = "use a copy of the journal that is whole; if the run ended as it began, run its configuration again";
        return Err(ConfigError::plain(what, help));
    }
    let Some(begun) = &past.begun else { return Ok(()) };
    let found = differences(begun, stored);
    if found.is_empty() {
        return Ok(());
    }
    let mut lines: Vec<String> = found.iter().take(MAX_DIFFERENCES).map(ToString::to_string).collect();
    if let Some(more @ 1..) = found.len().checked_sub(MAX_DIFFERENCES) {
        lines.push(format!("and {more} more"));
    }
    let what = format!("{} is not what the journal says that the run began with", dir.join("config.json").display());
    let help = "put the file back as it was written; what is to be otherwise from now on is given by --set";
    Err(ConfigError::plain(format!("{what}: {}", lines.join("; ")), help))
}

/// The complaint about a journal that ends before the hash in the summary.
pub(super) fn cut_off(dir: &Path, hash: &str) -> ConfigError {
    let what = format!(
        "{}: the journal ended with {hash} once, and no line of it has this hash: its end was cut off, or it is another run's",
        dir.join("summary.json").display()
    );
    ConfigError::plain(what, "use a copy of the run's folder that is whole")
}

/// The recorded poses of a robot, after a check that they belong to it.
///
/// # Errors
/// If they belong to a robot with another number of motors.
pub(super) fn of_robot(file: &Path, robot: &Robot, poses: Vec<(Time, Pose)>) -> Result<Vec<(Time, Pose)>, ConfigError> {
    match poses.iter().find(|(_, q)| q.len() != robot.motors.len()) {
        None => Ok(poses),
        Some((_, q)) => {
            let n = q.len();
            let own = robot.motors.len();
            let what = format!("{}: poses of {n} motors, and {} has {own}", file.display(), robot.name);
            Err(ConfigError::plain(what, "take the file away: the run goes on without what it recorded of its retreat"))
        }
    }
}
