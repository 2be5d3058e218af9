//! The seal beside a journal: how much of it is known to be on the disk. A journal that was cut short at the end of a line is
//! good to its last hash, and only its seal tells that there was more.
//!
//! ```text
//! {"events":123,"hash":"9f86d081...","files":"4e07..."}  journal.seal: blanks up to 256 bytes, written at once over the one before
//! ```
//! It is written after the journal was forced to the disk (start, outcomes, end), and so is never ahead of it, whatever dies. The last one of
//! a run that ended in order has the digest of the digests of its files, too ([`crate::record::files`]).

use mobee_contract::{Before, create_private};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A seal's length, bytes: one that is written over another leaves nothing of it.
const LENGTH: usize = 256;
/// The same of seals without digests, as older versions wrote them.
const OLD_LENGTH: usize = 128;

/// What is known to be on the disk.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Seal {
    /// How many events.
    pub events: u64,
    /// The hash of the last of them, in hexadecimal.
    pub hash: String,
    /// The digest of the digests of the run's files, in hexadecimal, once it has ended in order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub files: Option<String>,
    /// Whether its file is as a run writes it, to the byte.
    #[serde(skip)]
    pub is_whole: bool,
}

impl Seal {
    /// Its file's text.
    fn text(&self, length: usize) -> std::io::Result<String> {
        Ok(format!("{:<width$}\n", serde_json::to_string(self)?, width = length - 1))
    }
}

/// The seal of a journal's file.
pub(super) fn file(journal: &Path) -> PathBuf {
    journal.with_extension("seal")
}

/// The seal of a journal; `None` if there is none, as beside those of older versions.
///
/// # Errors
/// In words, if it can't be read, or is no seal.
pub(crate) fn read(journal: &Path) -> Result<Option<Seal>, String> {
    let path = file(journal);
    let text = match mobee_model::file::read_text(&path, LENGTH as u64) {
        Ok(text) => text,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(format!("its seal {} can't be read: {e}", path.display())),
    };
    let seal: Seal = serde_json::from_str(&text).map_err(|_| format!("{} is no seal of a journal", path.display()))?;
    let is_whole = [LENGTH, OLD_LENGTH].iter().any(|length| seal.text(*length).is_ok_and(|written| written == text));
    Ok(Some(Seal { is_whole, ..seal }))
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
        self.0.seek(SeekFrom::Start(0))?;
        self.0.write_all(seal.text(LENGTH)?.as_bytes())
    }
}
