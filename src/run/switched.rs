//! A sink that can be switched off and on again while the run goes on.

use mobee_actors::record::tap::Kept;
use mobee_contract::{Entry, Sink, Time};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Passes on what it is told while it is on. What became of the world and the robots
/// meanwhile is told when it is switched on again.
pub(super) struct Switched<S> {
    sink: S,
    on: Arc<AtomicBool>,
    missed: Option<Kept>,
}

impl<S: Sink> Switched<S> {
    pub(super) fn new(sink: S, on: Arc<AtomicBool>) -> Switched<S> {
        Switched { sink, on, missed: None }
    }
}

impl<S: Sink> Sink for Switched<S> {
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
