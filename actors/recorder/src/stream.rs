//! The thread's connection to Rerun: one stream, one timeline, errors as messages.

use mobee_contract::Time;
use rerun::{AsComponents, RecordingStream, SerializedComponentColumn, TimeColumn};

/// Timeline of all data: seconds of the run.
pub(crate) const TIMELINE: &str = "sim_time";

/// Result of a write; the error is a message.
pub(crate) type Written = Result<(), String>;

/// A recording stream, with the entity below which it writes and the time of its next entries.
pub(crate) struct EntityStream {
    pub(crate) rec: RecordingStream,
    /// Prefix of all entities: empty, or `NAME/`.
    pub(crate) root: String,
}

impl EntityStream {
    /// Sets the time of all following entries.
    pub(crate) fn at(&self, time: Time) {
        self.rec.set_duration_secs(TIMELINE, time.secs());
    }

    /// Logs an entity at the present time.
    pub(crate) fn log(&self, path: &str, what: &dyn AsComponents) -> Written {
        self.rec.log(self.below(path), what).map_err(|e| in_words(path, &e))
    }

    /// Logs an entity for all times.
    pub(crate) fn log_static(&self, path: &str, what: &dyn AsComponents) -> Written {
        self.rec.log_static(self.below(path), what).map_err(|e| in_words(path, &e))
    }

    /// Sends whole columns over many times (nanoseconds of the run): many times cheaper than row by row.
    pub(crate) fn columns(
        &self,
        path: &str,
        times: &[i64],
        columns: impl IntoIterator<Item = SerializedComponentColumn>,
    ) -> Written {
        let times = TimeColumn::new_duration_nanos(TIMELINE, times.iter().copied());
        self.rec.send_columns(self.below(path), [times], columns).map_err(|e| in_words(path, &e))
    }
}

impl EntityStream {
    fn below(&self, path: &str) -> String {
        format!("{}{path}", self.root)
    }
}

/// Message of a failed write.
pub(crate) fn in_words(path: &str, error: &dyn std::fmt::Display) -> String {
    format!("the recording can't take {path}: {error}")
}
