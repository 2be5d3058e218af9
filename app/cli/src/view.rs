//! `mobee view RUN`: starts the Rerun viewer on a run's recording, if it is installed.

use mobee_compose::config::ConfigError;
use mobee_recorder::Settings;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The viewer that reads what our recorder writes: the version of the SDK that the workspace pins.
pub(crate) const VIEWER_VERSION: &str = "0.36.3";

/// The recording of a run's folder, or the file itself.
///
/// # Errors
/// If there is no such file.
pub fn recording(run: &Path) -> Result<PathBuf, ConfigError> {
    let file = if run.is_dir() { run.join("recording.rrd") } else { run.to_owned() };
    if file.is_file() {
        return Ok(file);
    }
    Err(ConfigError::plain(
        format!("there is no recording at {}", file.display()),
        "give the folder of a run that was made without --no-record; they are under `runs/`",
    ))
}

/// Starts the viewer and returns at once.
///
/// # Errors
/// If there is no recording, or no viewer, with the way to install it.
pub fn open(run: &Path) -> Result<String, ConfigError> {
    let file = recording(run)?;
    let advice = format!(
        "install the viewer with `pip install rerun-sdk=={v}` (or `cargo install rerun-cli --version {v}`), then `rerun {}`",
        file.display(),
        v = VIEWER_VERSION
    );
    match Command::new("rerun").arg(&file).spawn() {
        Ok(_) => Ok(format!("rerun {}", file.display())),
        Err(e) => Err(ConfigError::plain(format!("the viewer `rerun` can't be started: {e}"), advice)),
    }
}

/// Settings of a recording that is no run's: of a robot, a map or a path, made from the file `source`.
pub(crate) fn recording_settings(path: &Path, name: &str, source: &Path) -> Settings {
    Settings {
        path: path.to_owned(),
        name: name.to_owned(),
        config: source.display().to_string(),
        build: env!("CARGO_PKG_VERSION").to_owned(),
        live: None,
        index: true,
        names: Vec::new(),
        unknown: Vec::new(),
    }
}
