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
}

impl Disk {
    /// Begins a file, with an index at its end if `index`.
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
        let book = Mutex::new(TransactionState { encoder: Some(encoder), file, good });
        Ok((Disk { book, trouble: trouble.clone() }, trouble))
    }

    fn lock(&self) -> MutexGuard<'_, TransactionState> {
        self.book.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LogSink for Disk {
    fn send(&self, message: LogMsg) {
        let mut book = self.lock();
        let Some(encoder) = book.encoder.as_mut() else { return };
        match encoder.append(&message) {
            Ok(bytes) => book.good += bytes,
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
