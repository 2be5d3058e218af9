//! The recording's file, written on Rerun's own thread. An error is stored for the recorder, and the file then
//! ends with its last complete message.
//!
//! Rerun's own file sink ends its thread at the first error without reporting it, and a flush that was
//! requested then never returns.

use mobee_contract::{Before, create_private};
use rerun::external::re_log_encoding::{CrateVersion, Encoder, EncodingOptions};
use rerun::log::LogMsg;
use rerun::sink::{LogSink, SinkFlushError};
use std::fs::File;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

/// Most messages that are indexed: until the file is closed, Rerun's index takes two kilobytes of memory for
/// each of them (a row of some hundred columns). A longer file has no index.
const MAX_INDEXED: u64 = 8192;

/// Error that ended the writing of a file, once it has happened.
pub(crate) type DiskTrouble = Arc<OnceLock<String>>;

/// A file that is being written.
pub(crate) struct Disk {
    state: Mutex<FileState>,
    trouble: DiskTrouble,
}

struct FileState {
    /// `None` after an error.
    encoder: Option<Encoder<File>>,
    file: File,
    /// Size of the complete messages, bytes.
    good: u64,
    /// Number of messages that the index can still take.
    indexed: u64,
}

impl Disk {
    /// Creates a file, with an index at its end if `index`, unless it gets too long for one.
    ///
    /// # Errors
    /// If it can't be written, as a message.
    pub(crate) fn create(path: &Path, index: bool) -> Result<(Disk, DiskTrouble), String> {
        let file = create_private(path, Before::Empty).map_err(|e| e.to_string())?;
        let second = file.try_clone().map_err(|e| e.to_string())?;
        let options = EncodingOptions::PROTOBUF_COMPRESSED;
        let mut encoder = Encoder::new_eager(CrateVersion::LOCAL, options, second).map_err(|e| e.to_string())?;
        if !index {
            encoder.do_not_emit_footer();
        }
        let good = file.metadata().map_err(|e| e.to_string())?.len();
        let trouble = DiskTrouble::default();
        let state = Mutex::new(FileState { encoder: Some(encoder), file, good, indexed: MAX_INDEXED });
        Ok((Disk { state, trouble: trouble.clone() }, trouble))
    }

    fn lock(&self) -> MutexGuard<'_, FileState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LogSink for Disk {
    fn send(&self, message: LogMsg) {
        let mut state = self.lock();
        let state = &mut *state;
        let Some(encoder) = state.encoder.as_mut() else { return };
        match encoder.append(&message) {
            Ok(bytes) => {
                if state.indexed == 0 {
                    encoder.do_not_emit_footer();
                }
                state.indexed = state.indexed.saturating_sub(1);
                state.good += bytes;
            }
            Err(e) => {
                let _ = self.trouble.set(e.to_string());
                // Without its writer the encoder can't append an end to an incomplete message.
                let _ = state.encoder.take().map(Encoder::into_inner);
                let _ = state.file.set_len(state.good);
            }
        }
    }

    fn flush_blocking(&self, _timeout: Duration) -> Result<(), SinkFlushError> {
        self.trouble.get().map_or(Ok(()), |why| Err(SinkFlushError::failed(why)))
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        if let Some(mut encoder) = self.lock().encoder.take()
            && let Err(e) = encoder.finish()
        {
            let _ = self.trouble.set(e.to_string());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rerun::{RecordingStreamBuilder, Scalars, TextLog};

    /// Resident memory of this process, kilobytes.
    fn resident() -> u64 {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).unwrap();
        line.split_whitespace().next().unwrap().parse().unwrap()
    }

    /// An eight-hour run with one message per entity and second of real time: the memory stays flat.
    #[test]
    fn memory_stays_bounded_however_long_a_file_gets() {
        let (rec, storage) = RecordingStreamBuilder::new("test").memory().unwrap();
        for entity in 0..40 {
            rec.log(format!("a/{entity}"), &TextLog::new("a line")).unwrap();
            rec.log(format!("b/{entity}"), &Scalars::single(1.0)).unwrap();
        }
        let messages = storage.take();
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, rounds: u64| {
            let (disk, trouble) = Disk::create(&dir.path().join(name), true).unwrap();
            let warm = 2 * MAX_INDEXED / messages.len() as u64;
            let mut before = 0;
            for round in 0..rounds {
                if round == warm {
                    before = resident();
                }
                messages.iter().for_each(|message| disk.send(message.clone()));
            }
            let grown = resident().saturating_sub(before);
            drop(disk);
            assert_eq!(trouble.get(), None);
            (grown, std::fs::read(dir.path().join(name)).unwrap())
        };
        let (grown, long) = write("long.rrd", 600);
        assert!(grown < 4_000, "{grown} kB");
        let (_, short) = write("short.rrd", 2);
        // An index ends with the mark that the file begins with.
        let has_index = |bytes: &[u8]| bytes[bytes.len() - 64..].windows(4).any(|end| *end == bytes[..4]);
        assert!(has_index(&short) && !has_index(&long));
    }
}
