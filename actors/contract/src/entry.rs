//! The record of a run, as its sinks receive it.

use crate::{Event, Pose, SeenPicture, Time};
use mobee_model::{Contact, Scene};
use std::sync::Arc;

/// An entry for the journal and the recorder.
#[derive(Clone, Debug)]
pub enum Entry {
    /// An event: never dropped on the way to the journal.
    Event(Arc<Event>),
    /// Configuration at the sampling rate with the robot's present contacts, for a recorder; a journal ignores it.
    Pose {
        /// Index of the robot in the scene.
        robot: usize,
        /// Configuration, rad.
        q: Pose,
        /// Pairs closer than the margin.
        contacts: Arc<[Contact]>,
    },
    /// Image with the findings of a detector, for a recorder; a journal ignores it.
    Picture {
        /// Name of the camera in the run.
        camera: Arc<str>,
        /// Image and findings.
        seen: Arc<SeenPicture>,
    },
    /// The scene, at the start and after each edit, for a recorder; a journal ignores it.
    Scene(Arc<Scene>),
}

/// A recipient of all entries that causes no delays: it runs on its own thread behind a bounded queue.
pub trait Sink: Send {
    /// Writes one entry.
    ///
    /// # Errors
    /// A description with the remedy; the sink is then closed, and the run is notified.
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String>;
    /// Makes written entries durable; called when the queue is empty, periodically, and before the end.
    ///
    /// # Errors
    /// As for `write`.
    fn flush(&mut self) -> Result<(), String>;
    /// Entries were dropped on their way here: the next one does not directly follow the last.
    fn lost(&mut self) {}
}
