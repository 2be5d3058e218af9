//! The ledger: what must survive the death of any actor of a robot's controller.

use crate::history::HistoryCore;
use mobee_contract::{Cause, CommitId, Pose, Status, Time};
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

/// The state that outlives the actors.
#[derive(Debug)]
pub struct Book {
    /// The open transaction.
    pub open: Option<Open>,
    /// The number of the last accepted commit.
    pub last_id: u64,
    /// The filter's state.
    pub status: Status,
    /// The recorded poses.
    pub history: HistoryCore,
    /// An actor that died since supervise last looked.
    pub died: Option<String>,
    /// The safe pose last taken: kept as long as fresh readings confirm it, so that rollbacks do not drift.
    pub safe: Option<Pose>,
}

/// A robot's ledger. Cheap to clone; all clones are one.
#[derive(Clone, Debug)]
pub struct Ledger(Arc<Mutex<Book>>);

impl Ledger {
    /// An empty ledger with a history of this length.
    pub fn new(history: usize) -> Ledger {
        let history = HistoryCore::new(history);
        let book = Book { open: None, last_id: 0, status: Status::Starting, history, died: None, safe: None };
        Ledger(Arc::new(Mutex::new(book)))
    }

    /// The book. A panic of somebody who held it leaves it readable: each entry is written in one step.
    pub fn book(&self) -> MutexGuard<'_, Book> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
