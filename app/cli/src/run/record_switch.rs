//! A sink that can be switched off and on during the run.

use mobee_contract::{Entry, Sink, Time};
use mobee_runtime::tap::Kept;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Forwards entries while it is on. When it is switched on again, it first forwards the state of world and robots that
/// it missed.
pub(super) struct RecordSwitch<S> {
    sink: S,
    on: Arc<AtomicBool>,
    missed: Option<Kept>,
}

impl<S: Sink> RecordSwitch<S> {
    pub(super) fn new(sink: S, on: Arc<AtomicBool>) -> RecordSwitch<S> {
        RecordSwitch { sink, on, missed: None }
    }
}

impl<S: Sink> Sink for RecordSwitch<S> {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        if !self.on.load(Ordering::SeqCst) {
            self.missed.get_or_insert_default().note(at, entry);
            return Ok(());
        }
        for (at, entry) in self.missed.take().into_iter().flat_map(Kept::entries) {
            self.sink.write(at, &entry)?;
        }
        self.sink.write(at, entry)
    }

    fn flush(&mut self) -> Result<(), String> {
        self.sink.flush()
    }
}
