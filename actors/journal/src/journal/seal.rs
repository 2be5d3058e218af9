//! The seal beside a journal: the part of it that is known to be on disk. The hashes of a journal that was cut
//! at the end of a line are valid; only its seal shows that there was more.
//!
//! ```text
//! {"events":123,"hash":"9f86d081...","files":"4e07..."}  journal.seal: padded with blanks to 256 bytes, overwritten in one write
//! ```
//! It is written after the journal was synced to disk (start, outcomes, end), and therefore is never ahead of
//! it, even after a crash. The last seal of a run that ended in order also has the digest of the digests of its
//! files ([`crate::files`]).

use mobee_contract::{Before, create_private};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Size of a seal, bytes: one that overwrites another leaves nothing of it.
const LENGTH: usize = 256;
/// Size of seals without digests, as older versions wrote them, bytes.
const OLD_LENGTH: usize = 128;

/// The part of a journal that is known to be on disk.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Seal {
    /// Number of events.
    pub events: u64,
    /// Hash of the last of them, in hexadecimal.
    pub hash: String,
    /// Digest of the digests of the run's files, in hexadecimal, once the run has ended in order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub files: Option<String>,
    /// True if its file is byte for byte as a run writes it.
    #[serde(skip)]
    pub is_whole: bool,
}

impl Seal {
    /// Text of its file.
    fn text(&self, length: usize) -> std::io::Result<String> {
        Ok(format!("{:<width$}\n", serde_json::to_string(self)?, width = length - 1))
    }
}

/// Path of the seal of a journal.
pub(super) fn file(journal: &Path) -> PathBuf {
    journal.with_extension("seal")
}

/// Reads the seal of a journal; `None` if it does not exist, as for older versions.
///
/// # Errors
/// As a message, if it can't be read or is not a seal.
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

/// The open file of a seal.
#[derive(Debug)]
pub(super) struct Sealed(File);

impl Sealed {
    /// Opens the seal of a journal, and creates it if it does not exist.
    pub fn open(journal: &Path) -> std::io::Result<Sealed> {
        Ok(Sealed(create_private(&file(journal), Before::Keep)?))
    }

    /// Writes the seal over the previous one.
    pub fn write(&mut self, seal: &Seal) -> std::io::Result<()> {
        self.0.seek(SeekFrom::Start(0))?;
        self.0.write_all(seal.text(LENGTH)?.as_bytes())
    }
}
