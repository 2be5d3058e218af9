//! The seal beside a journal: how much of it is known to be on the disk. A journal that was cut short at the end of a line is
//! good to its last hash, and only its seal tells that there was more.
//!
//! ```text
//! {"events":123,"hash":"9f86d081..."}            journal.seal: blanks up to 128 bytes, written at once over the one before
//! ```
//! It is written after the journal was forced to the disk (start, outcomes, end), and so is never ahead of it, whatever dies.

use mobee_contract::{Before, create_private};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A seal's length, bytes: one that is written over another leaves nothing of it.
const LENGTH: usize = 128;

/// What is known to be on the disk.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Seal {
    /// How many events.
    pub events: u64,
    /// The hash of the last of them, in hexadecimal.
    pub hash: String,
}

/// The seal of a journal's file.
pub(super) fn file(journal: &Path) -> PathBuf {
    journal.with_extension("seal")
}

/// The seal of a journal; `None` if there is none, as beside those of older versions.
///
/// # Errors
/// In words, if it can't be read, or is no seal.
pub(super) fn read(journal: &Path) -> Result<Option<Seal>, String> {
    let path = file(journal);
    let text = match mobee_model::file::read_text(&path, LENGTH as u64) {
        Ok(text) => text,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(format!("its seal {} can't be read: {e}", path.display())),
    };
    let seal = serde_json::from_str(&text).map_err(|_| format!("{} is no seal of a journal", path.display()))?;
    Ok(Some(seal))
}

/// The file of a seal, open.
#[derive(Debug)]
pub(super) struct Sealed(File);

impl Sealed {
    /// Opens the seal of a journal, and makes it where there is none.
    pub fn open(journal: &Path) -> std::io::Result<Sealed> {
        Ok(Sealed(create_private(&file(journal), Before::Keep)?))
    }

    /// Writes it.
    pub fn write(&mut self, seal: &Seal) -> std::io::Result<()> {
        let text = serde_json::to_string(seal)?;
        let bytes = format!("{text:<width$}\n", width = LENGTH - 1);
        self.0.seek(SeekFrom::Start(0))?;
        self.0.write_all(bytes.as_bytes())
    }
}
