//! Strict reader of journals: checks the numbers, hashes and JSON of every line, and reports the place of the
//! first defect.

use super::seal::{self, Seal};
use super::{HashChain, VERSION};
use mobee_contract::{Event, Time};
use serde::Deserialize;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// Longest line, bytes.
const MAX_LINE_BYTES: u64 = 1 << 25;
/// Remedy for a line that is not as it was written.
const BROKEN: &str = "the journal was changed after it was written: use a copy that was not, or do the run again";
/// Text between a line's body and its hash in hexadecimal.
const HASH_KEY: &str = ",\"hash\":\"";

/// A line of a journal with a valid number and hash.
#[derive(Clone, Debug, PartialEq)]
pub struct JournalLine {
    /// Number of the line in the file, counted from 1.
    pub line: u64,
    /// Number of the event, counted from 0.
    pub n: u64,
    /// Time of the event on the run's clock.
    pub at: Time,
    /// The event.
    pub event: Event,
    /// Hash up to this line, in hexadecimal.
    pub hash: String,
}

/// Defect that ends the reading of a journal.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}:{line}:{column}: {what}; {help}", file.display())]
pub struct JournalError {
    /// The file.
    pub file: PathBuf,
    /// The line, counted from 1; 0 if the file could not be opened.
    pub line: u64,
    /// The column in bytes, counted from 1; 0 for the whole line.
    pub column: u64,
    /// Description of the defect.
    pub what: String,
    /// Remedy.
    pub help: String,
    /// True if the journal merely stops in mid-line, as a crash leaves it: all events before are valid.
    pub truncated: bool,
}

/// The lines of a journal; the first error is the last item.
#[derive(Debug)]
pub struct JournalLines {
    file: PathBuf,
    version: u32,
    reader: BufReader<File>,
    line: u64,
    n: u64,
    chain: HashChain,
    /// Its seal, if it has one.
    seal: Option<Seal>,
    /// True if its first line states that it has a seal.
    is_sealed: bool,
    /// Size of the valid lines, bytes.
    good: u64,
    failed: bool,
    text: Vec<u8>,
}

/// The first line.
#[derive(Deserialize)]
struct JournalHead {
    #[serde(default = "first_version")]
    version: u32,
    /// True if the journal has a seal, as in all runs since their files have digests.
    #[serde(default)]
    sealed: bool,
}

/// Version of journals that state none.
fn first_version() -> u32 {
    1
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    n: u64,
    t_ns: u64,
    event: Event,
    hash: String,
}

/// Opens a journal: its file, or the folder of its run.
///
/// # Errors
/// If it can't be opened.
pub fn read(path: &Path) -> Result<JournalLines, JournalError> {
    let file = if path.is_dir() { path.join(super::FILE) } else { path.to_path_buf() };
    let wrong = |what: String, help: &str| JournalError {
        file: file.clone(),
        line: 0,
        column: 0,
        what,
        help: help.into(),
        truncated: false,
    };
    let opened =
        mobee_model::file::open(&file).map_err(|e| wrong(e.to_string(), "name a run's folder or its journal"))?;
    let seal = seal::read(&file).map_err(|e| wrong(e, "take it away to go by the journal alone"))?;
    let reader = BufReader::with_capacity(1 << 16, opened);
    let version = first_version();
    let chain = HashChain::default();
    let is_sealed = false;
    let text = Vec::new();
    Ok(JournalLines { file, version, reader, line: 0, n: 0, chain, seal, is_sealed, good: 0, failed: false, text })
}

impl Iterator for JournalLines {
    type Item = Result<JournalLine, JournalError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let next = self.step().transpose();
        self.failed = matches!(next, None | Some(Err(_)));
        next
    }
}

impl JournalLines {
    /// Version of the journal from its first line: valid once a line was read.
    pub fn version(&self) -> u32 {
        self.version
    }

    /// The seal, if there is one, and whether the first line requires one.
    pub(crate) fn seal(&self) -> (Option<&Seal>, bool) {
        (self.seal.as_ref(), self.is_sealed)
    }

    /// Size of all valid lines so far, bytes, and the hash over them.
    pub(super) fn good(&self) -> (u64, HashChain) {
        (self.good, self.chain)
    }

    fn step(&mut self) -> Result<Option<JournalLine>, JournalError> {
        loop {
            self.line += 1;
            self.text.clear();
            let end = self.reader.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut self.text);
            end.map_err(|e| self.error(0, e.to_string(), "check the disk"))?;
            if self.text.is_empty() {
                self.shortened()?;
                return if self.line == 1 { Err(self.truncated()) } else { Ok(None) };
            }
            let is_cut = self.text.len() as u64 == MAX_LINE_BYTES;
            if self.text.pop() != Some(b'\n') {
                if is_cut {
                    // Lines follow perhaps: this is no end of the journal, at which a resumed run could continue.
                    let what = format!("the line is longer than {} MiB, which no event is", MAX_LINE_BYTES >> 20);
                    return Err(self.error(0, what, BROKEN));
                }
                self.shortened()?;
                return Err(self.truncated());
            }
            let text = std::mem::take(&mut self.text);
            let line = self.parse(&text);
            let bytes = text.len() as u64 + 1;
            self.text = text;
            let line = line?;
            self.good += bytes;
            match line {
                None => continue,
                some => return Ok(some),
            }
        }
    }

    /// Parses a line; `None` if it is the aside.
    fn parse(&mut self, bytes: &[u8]) -> Result<Option<JournalLine>, JournalError> {
        let text = std::str::from_utf8(bytes)
            .map_err(|e| self.error(e.valid_up_to() as u64 + 1, "this is not UTF-8 text", BROKEN))?;
        if self.line == 1 && text.starts_with("{\"aside\":") {
            let head: JournalHead =
                serde_json::from_str(text).map_err(|e| self.error(e.column() as u64, json(&e), BROKEN))?;
            if head.version > VERSION {
                let what = format!("this journal is of version {}; this program reads up to {VERSION}", head.version);
                return Err(self.error(0, what, "read it with the version of mobee that wrote it"));
            }
            (self.version, self.is_sealed) = (head.version, head.sealed);
            return Ok(None);
        }
        let raw: Raw = serde_json::from_str(text).map_err(|e| {
            let help = match e.classify() {
                serde_json::error::Category::Data => "read it with the version of mobee that wrote it",
                _ => BROKEN,
            };
            self.error(e.column() as u64, json(&e), help)
        })?;
        if raw.n != self.n {
            let what = format!("event {} stands where event {} should be: lines are missing or doubled", raw.n, self.n);
            return Err(self.error(6, what, BROKEN));
        }
        let at = text.rfind(HASH_KEY).unwrap_or(text.len());
        let chain = self.chain.next(text.get(..at).unwrap_or_default().as_bytes());
        let hash = chain.hex();
        if raw.hash != hash || text.get(at..) != Some(format!("{HASH_KEY}{hash}\"}}").as_str()) {
            let what = "the hash does not fit: this line, or the one before it, is not as it was written";
            return Err(self.error(at as u64 + HASH_KEY.len() as u64 + 1, what, BROKEN));
        }
        self.chain = chain;
        self.n += 1;
        if self.seal.as_ref().is_some_and(|seal| seal.events == self.n && seal.hash != hash) {
            return Err(self.error(0, "its seal was written for another journal", BROKEN));
        }
        Ok(Some(JournalLine { line: self.line, n: raw.n, at: Time(raw.t_ns), event: raw.event, hash }))
    }

    /// Error if the journal has fewer events than its seal.
    fn shortened(&self) -> Result<(), JournalError> {
        match &self.seal {
            Some(seal) if self.n < seal.events => {
                let what = format!(
                    "the journal ends after {} events, and {} were on the disk: its end was cut off",
                    self.n, seal.events
                );
                Err(self.error(0, what, "use a complete copy; no other file records what the robot did since"))
            }
            _ => Ok(()),
        }
    }

    fn truncated(&self) -> JournalError {
        let what = format!("the journal stops in mid-line: the run did not end in order; {} events are good", self.n);
        let help = "the events before this line can be used; do the run again for the rest";
        JournalError { truncated: true, ..self.error(self.text.len() as u64 + 1, what, help) }
    }

    fn error(&self, column: u64, what: impl Into<String>, help: &str) -> JournalError {
        JournalError {
            file: self.file.clone(),
            line: self.line,
            column,
            what: what.into(),
            help: help.into(),
            truncated: false,
        }
    }
}

/// Message of serde_json without its own line and column.
fn json(error: &serde_json::Error) -> String {
    let text = error.to_string();
    text.split(" at line ").next().unwrap_or_default().to_string()
}
