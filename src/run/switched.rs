//! A sink that can be switched off and on again while the run goes on.

use mobee_contract::{Entry, Sink, Time};
use mobee_model::Scene;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Passes on what it is told while it is on. What the world became meanwhile is told when it is switched on again.
pub(super) struct Switched<S> {
    sink: S,
    on: Arc<AtomicBool>,
    missed: Option<(Time, Arc<Scene>)>,
}

impl<S: Sink> Switched<S> {
    pub(super) fn new(sink: S, on: Arc<AtomicBool>) -> Switched<S> {
        Switched { sink, on, missed: None }
    }
}

impl<S: Sink> Sink for Switched<S> {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        if !self.on.load(Ordering::SeqCst) {
            if let Entry::Scene(scene) = entry {
                self.missed = Some((at, scene.clone()));
            }
            return Ok(());
        }
        if let Some((at, scene)) = self.missed.take() {
            self.sink.write(at, &Entry::Scene(scene))?;
        }
        self.sink.write(at, entry)
    }

    fn flush(&mut self) -> Result<(), String> {
        self.sink.flush()
    }
}
