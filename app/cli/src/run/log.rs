//! The newest events of a run as sentences, for `mobee ctl log` and for clients that wait for the end of a motion.

use crate::narrate::{Narrator, timed};
use mobee_contract::{Entry, Event, Outcome, Sink, Time};
use mobee_model::Scene;
use mobee_runtime::tap::{Pictures, SinkSpec};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Lines that are stored.
const MAX_LINES: usize = 1000;
/// Ends of motions that are stored.
const MAX_ENDS: usize = 200;

/// The newest lines. Cheap to clone; all clones are one.
#[derive(Clone, Debug, Default)]
pub(crate) struct LogBook(Arc<Mutex<Lines>>);

#[derive(Debug, Default)]
struct Lines {
    /// The number of the next line.
    next: u64,
    lines: VecDeque<String>,
    ends: VecDeque<(String, u64, Outcome, String)>,
    /// The last event `Done` of an agent, as a sentence.
    done: Option<String>,
}

impl LogBook {
    fn lines(&self) -> MutexGuard<'_, Lines> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The lines from this number on, and the number of the next. Skips lines that are no longer stored.
    pub(crate) fn from(&self, first: u64) -> (u64, Vec<String>) {
        let lines = self.lines();
        let oldest = lines.next - lines.lines.len() as u64;
        let skip = usize::try_from(first.saturating_sub(oldest)).unwrap_or(usize::MAX);
        (lines.next, lines.lines.iter().skip(skip).cloned().collect())
    }

    /// The newest lines, and the number of the next.
    pub(crate) fn last(&self, most: usize) -> (u64, Vec<String>) {
        let first = self.lines().next.saturating_sub(most as u64);
        self.from(first)
    }

    /// The outcome of a robot's motion as a sentence, if it has ended and is stored.
    pub(crate) fn end_of(&self, robot: &str, id: u64) -> Option<(Outcome, String)> {
        let lines = self.lines();
        let found = lines.ends.iter().rev().find(|(r, i, ..)| r == robot && *i == id);
        found.map(|(_, _, outcome, text)| (*outcome, text.clone()))
    }

    /// The last event `Done` of an agent as a sentence, if there is one.
    pub(crate) fn done(&self) -> Option<String> {
        self.lines().done.clone()
    }

    /// The sink that fills the log.
    pub(super) fn sink(&self, scene: &Arc<Scene>) -> SinkSpec {
        let book = self.clone();
        let scene = scene.clone();
        SinkSpec {
            pictures: Pictures::None,
            name: "log".into(),
            essential: false,
            // scenes come with the poses, and contain the names of objects
            poses: Some(SCENE_INTERVAL),
            capacity: super::QUEUE_ENTRIES,
            patience: Duration::from_secs(3),
            open: Some(Arc::new(move || Ok(Box::new(Log { book: book.clone(), narrator: Narrator::new(&scene) })))),
        }
    }
}

/// Interval of the poses that a sink of sentences receives: it needs the scenes only.
pub(super) const SCENE_INTERVAL: Duration = Duration::from_secs(3600);

struct Log {
    book: LogBook,
    narrator: Narrator,
}

impl Sink for Log {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        match entry {
            Entry::Scene(scene) => self.narrator.edited(scene),
            Entry::Event(event) => {
                let Some(line) = self.narrator.line(event) else { return Ok(()) };
                let mut lines = self.book.lines();
                if let Some(end) = Narrator::ended(event) {
                    if lines.ends.len() >= MAX_ENDS {
                        lines.ends.pop_front();
                    }
                    lines.ends.push_back((end.robot, end.id, end.outcome, line.text.clone()));
                }
                if let Event::Done { .. } = &**event {
                    lines.done = Some(line.text.clone());
                }
                if lines.lines.len() >= MAX_LINES {
                    lines.lines.pop_front();
                }
                lines.lines.push_back(timed(at, &line.text));
                lines.next += 1;
            }
            _ => {}
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}
