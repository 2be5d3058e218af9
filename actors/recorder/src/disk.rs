//! The recording's file, written on Rerun's own thread. An error is noted where the recorder finds it, and the file then
//! ends with its last whole message.
//!
//! Rerun's own file sink ends its thread at the first error, tells nobody, and keeps a flush that was asked for meanwhile
//! waiting for ever.

use mobee_contract::{Before, create_private};
use rerun::external::re_log_encoding::{CrateVersion, Encoder, EncodingOptions};
use rerun::log::LogMsg;
use rerun::sink::{LogSink, SinkFlushError};
use std::fs::File;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

/// So many messages are indexed at most: Rerun's index has a row of some hundred columns for each of them (two kilobytes) in memory until the
/// file is closed. A longer file has none.
const MAX_INDEXED: u64 = 8192;

/// Why a file could not be written on, once that has happened.
pub(crate) type Trouble = Arc<OnceLock<String>>;

/// A file that is being written.
pub(crate) struct Disk {
    book: Mutex<TransactionState>,
    trouble: Trouble,
}

struct TransactionState {
    /// `None` after an error.
    encoder: Option<Encoder<File>>,
    file: File,
    /// Bytes of whole messages.
    good: u64,
    /// Messages that the index still takes.
    indexed: u64,
}

impl Disk {
    /// Begins a file, with an index at its end if `index`, unless it gets too long for one.
    ///
    /// # Errors
    /// If it can't be written, in words.
    pub(crate) fn create(path: &Path, index: bool) -> Result<(Disk, Trouble), String> {
        let file = create_private(path, Before::Empty).map_err(|e| e.to_string())?;
        let second = file.try_clone().map_err(|e| e.to_string())?;
        let options = EncodingOptions::PROTOBUF_COMPRESSED;
        let mut encoder = Encoder::new_eager(CrateVersion::LOCAL, options, second).map_err(|e| e.to_string())?;
        if !index {
            encoder.do_not_emit_footer();
        }
        let good = file.metadata().map_err(|e| e.to_string())?.len();
        let trouble = Trouble::default();
        let book = Mutex::new(TransactionState { encoder: Some(encoder), file, good, indexed: MAX_INDEXED });
        Ok((Disk { book, trouble: trouble.clone() }, trouble))
    }

    fn lock(&self) -> MutexGuard<'_, TransactionState> {
        self.book.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LogSink for Disk {
    fn send(&self, message: LogMsg) {
        let mut book = self.lock();
        let book = &mut *book;
        let Some(encoder) = book.encoder.as_mut() else { return };
        match encoder.append(&message) {
            Ok(bytes) => {
                if book.indexed == 0 {
                    encoder.do_not_emit_footer();
                }
                book.indexed = book.indexed.saturating_sub(1);
                book.good += bytes;
            }
            Err(e) => {
                let _ = self.trouble.set(e.to_string());
                // without its writer it can't add an end to half a message
                let _ = book.encoder.take().map(Encoder::into_inner);
                let _ = book.file.set_len(book.good);
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

    /// What a run of eight hours sends, for each second of real time one message of each of its entities: memory stays flat.
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
        // an index ends with the mark that the file begins with
        let has_index = |bytes: &[u8]| bytes[bytes.len() - 64..].windows(4).any(|end| *end == bytes[..4]);
        assert!(has_index(&short) && !has_index(&long));
    }
}
