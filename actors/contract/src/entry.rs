//! Who is told what a run leaves behind, and in which form.

use crate::{Event, Pose, Time};
use mobee_model::{Contact, Scene};
use std::sync::Arc;

/// Something told to the journal and the recorder.
#[derive(Clone, Debug)]
pub enum Entry {
    /// An event: never dropped on the way to the journal.
    Event(Arc<Event>),
    /// A pose at the sampling rate with the robot's present contacts, for a recorder; a journal passes over it.
    Pose {
        /// Index of the robot in the scene.
        robot: usize,
        /// The pose, rad.
        q: Pose,
        /// Pairs nearer than the margin.
        contacts: Arc<[Contact]>,
    },
    /// The scene, at the start and whenever it was edited, for a recorder; a journal passes over it.
    Scene(Arc<Scene>),
}

/// Somebody who is told everything and stands in nobody's way: it lives on a thread of its own behind a bounded queue.
pub trait Sink: Send {
    /// Takes note of one entry.
    ///
    /// # Errors
    /// In words, with the remedy; the sink is then closed, and the run is told.
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String>;
    /// Makes what was written durable; called when the queue is empty, at times, and before the end.
    ///
    /// # Errors
    /// As for `write`.
    fn flush(&mut self) -> Result<(), String>;
    /// Entries were dropped on their way here: what comes next does not follow on what came before.
    fn lost(&mut self) {}
}
