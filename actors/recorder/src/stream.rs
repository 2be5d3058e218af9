//! The thread's way into Rerun: one stream, one timeline, errors in words.

use mobee_contract::Time;
use rerun::{AsComponents, RecordingStream, SerializedComponentColumn, TimeColumn};

/// The timeline of everything: seconds of the run.
pub(crate) const TIMELINE: &str = "sim_time";

/// What writing something gives.
pub(crate) type Written = Result<(), String>;

/// A recording stream, below which entity it is written, and the time that its next entries bear.
pub(crate) struct Stream {
    pub(crate) rec: RecordingStream,
    /// Before all entities: empty, or `NAME/`.
    pub(crate) root: String,
}

impl Stream {
    /// Sets the time of all that is logged from now on.
    pub(crate) fn at(&self, time: Time) {
        self.rec.set_duration_secs(TIMELINE, time.secs());
    }

    /// Logs at the present time.
    pub(crate) fn log(&self, path: &str, what: &dyn AsComponents) -> Written {
        self.rec.log(self.below(path), what).map_err(|e| in_words(path, &e))
    }

    /// Logs for all times.
    pub(crate) fn log_static(&self, path: &str, what: &dyn AsComponents) -> Written {
        self.rec.log_static(self.below(path), what).map_err(|e| in_words(path, &e))
    }

    /// Sends whole columns over many times (nanoseconds of the run) at once: many times cheaper than row by row.
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

impl Stream {
    fn below(&self, path: &str) -> String {
        format!("{}{path}", self.root)
    }
}

/// A failed write in words.
pub(crate) fn in_words(path: &str, error: &dyn std::fmt::Display) -> String {
    format!("the recording can't take {path}: {error}")
}
