//! An unfinished build: the trials so far, one per line, in a file beside the map. An interrupted build replays them.

use mobee_compose::config::ConfigError;
use mobee_compose::maps::BUILDER_VERSION;
use mobee_model::file::{MIB, read};
use mobee_planning::table_map::Trial;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Maximum size of the file, bytes.
const MAX_PART_BYTES: u64 = 256 * MIB;
/// Number of lines that are written at a time: so many are lost at most.
const LINES_PER_WRITE: usize = 50;

/// The first line.
#[derive(Serialize, Deserialize)]
struct Head {
    version: u32,
    inputs: String,
}

/// The open file.
pub(super) struct Part {
    path: PathBuf,
    file: File,
    waiting: Vec<u8>,
    lines: usize,
}

impl Part {
    /// Path of the unfinished build of a map.
    pub(super) fn beside(map: &Path) -> PathBuf {
        let mut name = map.as_os_str().to_owned();
        name.push(".part");
        PathBuf::from(name)
    }

    /// Opens or creates the file. Returns the trials in it; drops an incomplete last line.
    ///
    /// # Errors
    /// If it belongs to other settings, is damaged, or can't be read or written.
    pub(super) fn open(map: &Path, inputs: &str) -> Result<(Part, Vec<Trial>), ConfigError> {
        let path = Part::beside(map);
        let no = |e: std::io::Error| unwritable(&path, &e);
        if !path.exists() {
            let mut file = File::create(&path).map_err(no)?;
            let head = Head { version: BUILDER_VERSION, inputs: inputs.to_owned() };
            writeln!(file, "{}", serde_json::to_string(&head).unwrap_or_default()).map_err(no)?;
            return Ok((Part { path, file, waiting: Vec::new(), lines: 0 }, Vec::new()));
        }
        let bytes = read(&path, MAX_PART_BYTES).map_err(no)?;
        let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |end| end + 1);
        let text = String::from_utf8_lossy(bytes.get(..whole).unwrap_or_default()).into_owned();
        let mut lines = text.lines();
        let head: Option<Head> = lines.next().and_then(|line| serde_json::from_str(line).ok());
        if head.is_none_or(|head| head.version != BUILDER_VERSION || head.inputs != inputs) {
            let what = format!("{} is of a build with other settings, or of another robot or world", path.display());
            return Err(ConfigError::plain(what, "go on with those, or remove the file to start over"));
        }
        let mut trials = Vec::new();
        for (number, line) in (2..).zip(lines) {
            trials.push(serde_json::from_str(line).map_err(|e| damaged(&path, number, &e.to_string()))?);
        }
        let mut file = File::options().write(true).open(&path).map_err(no)?;
        file.set_len(whole as u64).and_then(|()| file.seek(SeekFrom::End(0))).map_err(no)?;
        Ok((Part { path, file, waiting: Vec::new(), lines: 0 }, trials))
    }

    /// Records a trial.
    ///
    /// # Errors
    /// If the file can't be written.
    pub(super) fn note(&mut self, trial: &Trial) -> Result<(), ConfigError> {
        self.waiting.extend(serde_json::to_string(trial).unwrap_or_default().into_bytes());
        self.waiting.push(b'\n');
        self.lines += 1;
        if self.lines < LINES_PER_WRITE {
            return Ok(());
        }
        self.lines = 0;
        let waiting = std::mem::take(&mut self.waiting);
        self.file.write_all(&waiting).map_err(|e| unwritable(&self.path, &e))
    }

    /// Removes the file once the map is written.
    pub(super) fn remove(self) -> Result<(), ConfigError> {
        std::fs::remove_file(&self.path).map_err(|e| unwritable(&self.path, &e))
    }

    /// A complaint about the line of a trial; trials count from 0.
    pub(super) fn damaged(&self, trial: usize, why: &str) -> ConfigError {
        damaged(&self.path, trial + 2, why)
    }
}

fn damaged(path: &Path, line: usize, why: &str) -> ConfigError {
    let what = format!("{}:{line}: {why}", path.display());
    ConfigError::plain(what, "the file is damaged: remove it to start the build over")
}

fn unwritable(path: &Path, e: &std::io::Error) -> ConfigError {
    ConfigError::plain(format!("can't write {}: {e}", path.display()), "check the folder's space and permissions")
}
