//! The journal, the tamper-evident record of a run: one JSON line per event, chained by a hash.
//!
//! ```text
//! {"aside":{"build":"0.1.0",...},"version":2}                                not hashed: may differ between equal runs
//! {"n":0,"t_ns":0,"event":{"event":"started",...},"hash":"9f86d081..."}
//! {"n":1,"t_ns":20000000,"event":{"event":"enabled",...},"hash":"60303ae2..."}
//! ```
//!
//! `hash` is the SHA-256 of the previous line's hash (32 bytes, initially zeros) and this line's text up to
//! `,"hash"`. A changed, lost, duplicated or moved line is therefore detected, and the last hash identifies the
//! whole run: two runs in virtual time with the same seed end with the same hash. Times are nanoseconds of the
//! run's clock; wall time, paths and build names go into the aside. Numbers are written with full precision;
//! serde_json reads them back to within the last bit.
//!
//! The description of the run and every outcome of a commit are on disk before the next event is written
//! (fsync), and the seal beside the journal records that. A crash loses at most a last, unfinished line.
//!
//! Before each outcome, and twice a second, the journal checks that its file is still in its folder and has its
//! full length. Text that is written to a removed file is lost, so a run without a journal is brought to rest.
//! A folder may be renamed.

mod read;
mod seal;
pub use read::{JournalError, JournalLine, JournalLines, read};
pub(crate) use seal::{Seal, read as read_seal};

use super::files;
use mobee_contract::{Before, Entry, Event, Sink, Time, create_private};
use rustix::fs::{AtFlags, fstat, statat};
use seal::Sealed;
use sha2::{Digest, Sha256};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Name of the journal in a run's folder.
pub const FILE: &str = "journal.jsonl";
/// Version of the journals that this program writes. Version 1 stated none; since 2 commits list their motors
/// and the speeds allowed to them.
pub const VERSION: u32 = 2;
/// Start of a warning that replaces an event with numbers that are not finite, which JSON can't represent.
pub const NOT_FINITE: &str = "numbers that are not finite in: ";
/// Size of the buffered lines at which they are written to the file, bytes.
const BUFFER_BYTES: usize = 1 << 16;

/// A running hash over lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct HashChain([u8; 32]);

impl HashChain {
    fn next(self, body: &[u8]) -> HashChain {
        HashChain(Sha256::new().chain_update(self.0).chain_update(body).finalize().into())
    }

    fn hex(self) -> String {
        self.0.iter().map(|b| format!("{b:02x}")).collect()
    }
}

/// A journal that is being written. Clones share it: one remains to reopen its sink and to read the final hash.
#[derive(Clone, Debug)]
pub struct Journal {
    path: PathBuf,
    /// Handle of its folder, which may be renamed.
    folder: Arc<File>,
    state: Arc<Mutex<JournalState>>,
}

#[derive(Debug)]
struct JournalState {
    file: File,
    seal: Sealed,
    /// Bytes of the file that are complete lines.
    len: u64,
    /// Lines that are not in the file yet.
    gathered: Vec<u8>,
    n: u64,
    chain: HashChain,
}

impl Journal {
    /// Creates a journal in the folder `dir`, which must exist. `aside` is written first and is not hashed.
    ///
    /// # Errors
    /// If the folder already has one, or it can't be written.
    pub fn create(dir: &Path, aside: &serde_json::Value) -> Result<Journal, String> {
        let path = dir.join(FILE);
        let file = create_private(&path, Before::Refuse).map_err(|e| match e.kind() {
            std::io::ErrorKind::AlreadyExists => {
                format!("{} exists already: a journal is never overwritten; choose another folder", path.display())
            }
            _ => format!("{}: {e}; choose a folder that can be written", path.display()),
        })?;
        let head = serde_json::json!({ "aside": aside, "sealed": true, "version": VERSION });
        let mut gathered = head.to_string().into_bytes();
        gathered.push(b'\n');
        let begin = || -> std::io::Result<(File, JournalState)> {
            claim(&file)?;
            let seal = Sealed::open(&path)?;
            let mut state = JournalState { file, seal, len: 0, gathered, n: 0, chain: HashChain::default() };
            state.spill(true)?;
            Ok((File::open(dir)?, state))
        };
        let (folder, state) = begin().map_err(|e| {
            // Leave no unfinished files.
            let _ = (std::fs::remove_file(&path), std::fs::remove_file(seal::file(&path)));
            refused(&path, &e)
        })?;
        Ok(Journal { path, folder: Arc::new(folder), state: Arc::new(Mutex::new(state)) })
    }

    /// Opens the journal of a run that is resumed. Every line is verified and passed to `past`; an unfinished
    /// line at the end, as a crash leaves it, is cut off.
    ///
    /// # Errors
    /// If it can't be read, its hash chain is broken, or it can't be appended to.
    pub fn resume(dir: &Path, mut past: impl FnMut(&JournalLine)) -> Result<Journal, JournalError> {
        let path = dir.join(FILE);
        let refused = |e: std::io::Error| JournalError {
            file: path.clone(),
            line: 0,
            column: 0,
            what: e.to_string(),
            help: "see that the run's folder can be written, and that no other process uses it".into(),
            truncated: false,
        };
        let file = OpenOptions::new().write(true).open(&path);
        if let Ok(file) = &file {
            claim(file).map_err(|e| JournalError {
                help: "wait for its end, or end it: mobee ctl stop".into(),
                ..refused(e)
            })?;
        }
        let mut lines = read(&path)?;
        let mut n = 0;
        for line in lines.by_ref() {
            match line {
                Ok(line) => {
                    n = line.n + 1;
                    past(&line);
                }
                Err(e) if e.truncated => {}
                Err(e) => return Err(e),
            }
        }
        let (len, chain) = lines.good();
        let file = file.map_err(refused)?;
        file.set_len(len).map_err(refused)?;
        let seal = Sealed::open(&path).map_err(refused)?;
        let folder = File::open(dir).map_err(refused)?;
        let state = JournalState { file, seal, len, gathered: Vec::new(), n, chain };
        Ok(Journal { path, folder: Arc::new(folder), state: Arc::new(Mutex::new(state)) })
    }

    /// Returns a sink that writes the journal. A new one continues where the last one failed.
    pub fn sink(&self) -> Box<dyn Sink> {
        Box::new(self.clone())
    }

    /// Checks that the file is in its folder and has its full length.
    ///
    /// # Errors
    /// The state of the file, in words.
    pub fn is_in_place(&self) -> Result<(), String> {
        self.lock().is_in_place(&self.folder).map_err(|what| self.gone(what))
    }

    /// Seals the run's files: writes their digests beside the journal, and the digest of those into its seal.
    /// Call it after the run has ended in order and all files are written.
    ///
    /// # Errors
    /// If a file can't be read, or the digests can't be written.
    pub fn seal_files(&self, dir: &Path) -> Result<(), String> {
        let explain = |e: std::io::Error| format!("{}: {e}; damage to this run's files can't be noticed", files::FILE);
        let digest = files::write(dir).map_err(explain)?;
        let mut state = self.lock();
        let seal = Seal { files: Some(digest), ..state.sealed() };
        state.seal.write(&seal).map_err(explain)
    }

    fn gone(&self, what: &str) -> String {
        format!(
            "{} {what} while the run was under way: what the robots do can't be recorded any more",
            self.path.display()
        )
    }

    /// Hash of the last line, in hexadecimal: the final hash once the taps have finished.
    pub fn hash(&self) -> String {
        self.lock().chain.hex()
    }

    /// Number of events so far.
    pub fn events(&self) -> u64 {
        self.lock().n
    }

    /// True if all lines are in the file; false on a full disk, or if the file was removed.
    pub fn is_whole(&self) -> bool {
        let state = self.lock();
        state.gathered.is_empty() && state.is_in_place(&self.folder).is_ok()
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn lock(&self) -> MutexGuard<'_, JournalState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn explain(&self, error: std::io::Error) -> String {
        refused(&self.path, &error)
    }
}

/// Locks the journal for as long as its file is open, so that one process writes it. No-op on a file system
/// without locks.
fn claim(file: &File) -> std::io::Result<()> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            Err(std::io::Error::other("the run goes on: another process writes its journal"))
        }
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
    }
}

fn refused(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {error}; make room on the disk or check its permissions", path.display())
}

/// Hash of a journal that is not written: two equal runs end with the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fingerprint {
    n: u64,
    chain: HashChain,
}

impl Fingerprint {
    /// Adds the next event.
    pub fn add(&mut self, at: Time, event: &Event) {
        let text = event_text(event).unwrap_or_else(|complaint| complaint);
        self.chain = self.chain.next(body(self.n, at, &text).as_bytes());
        self.n += 1;
    }

    /// Hash of the last line, in hexadecimal, as [`Journal::hash`] returns it.
    pub fn hex(self) -> String {
        self.chain.hex()
    }
}

/// The hashed part of a line.
fn body(n: u64, at: Time, event: &str) -> String {
    format!(r#"{{"n":{n},"t_ns":{},"event":{event}"#, at.0)
}

impl Sink for Journal {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        let Entry::Event(event) = entry else { return Ok(()) };
        let text = event_text(event)?;
        let mut state = self.lock();
        let before = (state.gathered.len(), state.n, state.chain);
        let durable = matches!(
            **event,
            Event::Started { .. }
                | Event::Resumed { .. }
                | Event::Found { .. }
                | Event::Outcome { .. }
                | Event::Ended { .. }
        );
        if durable {
            state.is_in_place(&self.folder).map_err(|what| self.gone(what))?;
        }
        state.append(at, &text);
        if durable || state.gathered.len() >= BUFFER_BYTES {
            let end = state.spill(durable);
            if end.is_err() {
                // The event will be passed to the next sink: roll the state back.
                let (len, n, chain) = before;
                state.gathered.truncate(len);
                (state.n, state.chain) = (n, chain);
            }
            return end.map_err(|e| self.explain(e));
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), String> {
        self.is_in_place()?;
        let end = self.lock().spill(false);
        end.map_err(|e| self.explain(e))
    }
}

impl JournalState {
    fn append(&mut self, at: Time, event: &str) {
        let body = body(self.n, at, event);
        self.chain = self.chain.next(body.as_bytes());
        self.n += 1;
        let line = format!("{body},\"hash\":\"{}\"}}\n", self.chain.hex());
        self.gathered.extend_from_slice(line.as_bytes());
    }

    /// Seal of the current state.
    fn sealed(&self) -> Seal {
        Seal { events: self.n, hash: self.chain.hex(), files: None, is_whole: true }
    }

    /// Checks that the file is in its folder and has its full length.
    fn is_in_place(&self, folder: &File) -> Result<(), &'static str> {
        let own = fstat(&self.file).map_err(|_| "can't be read")?;
        match statat(folder, FILE, AtFlags::SYMLINK_NOFOLLOW) {
            Ok(there) if (there.st_dev, there.st_ino) != (own.st_dev, own.st_ino) => Err("was replaced"),
            Ok(there) if u64::try_from(there.st_size).unwrap_or(0) < self.len => Err("was truncated"),
            Ok(_) => Ok(()),
            Err(_) => Err("was removed"),
        }
    }

    /// Writes the buffered lines. If that fails the file may end with an unfinished line, which the next try
    /// overwrites.
    fn spill(&mut self, durable: bool) -> std::io::Result<()> {
        if !self.gathered.is_empty() {
            self.file.seek(SeekFrom::Start(self.len))?;
            self.file.write_all(&self.gathered)?;
        }
        if durable {
            self.file.sync_data()?;
            let seal = self.sealed();
            self.seal.write(&seal)?;
        }
        self.len += self.gathered.len() as u64;
        self.gathered.clear();
        Ok(())
    }
}

/// JSON of an event. If it can't be read back, because a number is not finite, JSON of a warning that contains
/// it.
fn event_text(event: &Event) -> Result<String, String> {
    let text = serde_json::to_string(event).map_err(|e| format!("an event can't be written as JSON: {e}"))?;
    if !text.contains("null") || serde_json::from_str::<Event>(&text).is_ok() {
        return Ok(text);
    }
    let warning = Event::Warning { text: format!("{NOT_FINITE}{text}") };
    serde_json::to_string(&warning).map_err(|e| format!("an event can't be written as JSON: {e}"))
}
