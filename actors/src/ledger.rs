//! The ledger: what must survive the death of any actor of a robot's controller.

use crate::history::HistoryCore;
use mobee_contract::{Cause, CommitId, MotionEnd, Pose, Status, Time};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// An open transaction.
#[derive(Clone, Debug, PartialEq)]
pub struct Open {
    /// Its number.
    pub id: CommitId,
    /// Who committed it.
    pub agent: Arc<str>,
    /// The whole target pose, rad.
    pub target: Pose,
    /// The safe pose and when it was read; an escape has none.
    pub safe: Option<(Time, Pose)>,
    /// When it was accepted or last amended.
    pub since: Time,
    /// When it must have ended.
    pub due: Time,
    /// Why it will not reach its target, once that is known.
    pub cause: Option<Cause>,
}

impl Open {
    /// Whether it is an escape from a hold.
    pub fn is_escape(&self) -> bool {
        self.safe.is_none()
    }
}

/// How many ends of motions are remembered.
const ENDS: usize = 100;

/// The state that outlives the actors.
#[derive(Clone, Debug)]
pub struct Book {
    /// The open transaction.
    pub open: Option<Open>,
    /// The number of the last accepted commit.
    pub last_id: u64,
    /// The filter's state.
    pub status: Status,
    /// Where a motion under forces leads now: the fields are asked there, not where the readings are, which lag behind.
    pub ahead: Option<Pose>,
    /// The recorded poses.
    pub history: HistoryCore,
    /// An actor that died since supervise last looked.
    pub died: Option<String>,
    /// The safe pose last taken: kept while the robot counts as being there, so that rollbacks do not drift.
    pub safe: Option<Pose>,
    /// How the newest motions ended, oldest first.
    ends: VecDeque<(CommitId, MotionEnd)>,
}

impl Book {
    /// Closes the open transaction and remembers how it ended, in one step: nobody sees it neither open nor ended.
    pub fn close(&mut self, id: CommitId, end: MotionEnd) {
        self.open = None;
        if self.ends.len() >= ENDS {
            self.ends.pop_front();
        }
        self.ends.push_back((id, end));
    }

    /// How a motion ended; `None` while it is under way. Those too old to be remembered, and any that never was, failed.
    pub fn end_of(&self, id: CommitId) -> Option<MotionEnd> {
        if self.open.as_ref().is_some_and(|open| open.id == id) {
            return None;
        }
        let ended = self.ends.iter().rev().find(|(i, _)| *i == id);
        Some(ended.map_or(MotionEnd::Failed, |(_, end)| *end))
    }
}

/// A robot's ledger. Cheap to clone; all clones are one.
#[derive(Clone, Debug)]
pub struct Ledger(Arc<Mutex<Book>>);

impl Ledger {
    /// An empty ledger with a history of this length.
    pub fn new(history: usize) -> Ledger {
        let history = HistoryCore::new(history);
        let book = Book {
            open: None,
            last_id: 0,
            status: Status::Starting,
            ahead: None,
            history,
            died: None,
            safe: None,
            ends: VecDeque::new(),
        };
        Ledger(Arc::new(Mutex::new(book)))
    }

    /// The book. A panic of somebody who held it leaves it readable: each entry is written in one step.
    pub fn book(&self) -> MutexGuard<'_, Book> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
