//! The ledger: the state that must survive the death of any actor of a robot's controller.
//!
//! Each accepted commit must get an outcome (I2). Therefore the open transaction is recorded here before the driver
//! receives it, and a restarted actor finds it. All other state of the cores may be lost, and is recovered by
//! measuring.

mod transaction;

pub use transaction::{EndedTransaction, Extent, Motion, Open, Places, SafePose, Underway, home, union};

use crate::history::CommandedPath;
use crate::history::HistoryCore;
use crate::pulse::Pulse;
use mobee_contract::{Cause, CommitId, MotionEnd, Outcome, Pose, Status};
use mobee_model::Contact;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Number of remembered motion ends, for agents that query late. Bounded, since a ledger lives as long as its robot's
/// controller, for days.
const ENDS: usize = 100;

/// State that outlives the actors.
#[derive(Clone, Debug)]
pub struct TransactionState {
    /// Open transaction.
    pub open: Option<Open>,
    /// Number of the last accepted commit. Numbers increase over restarts, so that each is unique.
    pub last_id: u64,
    /// State of the filter.
    pub status: Status,
    /// Present reference configuration of a motion under forces: the fields are evaluated there, not at the lagging
    /// readings.
    pub ahead: Option<Pose>,
    /// Recorded configurations.
    pub history: HistoryCore,
    /// Actor that died since Supervise last checked.
    pub died: Option<String>,
    /// Open transaction whose agent died since Supervise last checked.
    pub orphan: Option<CommitId>,
    /// True if a person has halted the robot: from the request until the release, also across deaths of actors.
    pub halted: bool,
    /// True if the halt has been journaled.
    pub halt_journaled: bool,
    /// Commanded positions of the motors after the last transaction.
    pub places: Places,
    /// Last safe pose: it is retained while the robot is close to it, so that rollbacks do not drift.
    pub safe: Option<Pose>,
    /// Ends of the newest motions, oldest first.
    ends: VecDeque<PastEnd>,
}

/// End of a motion.
#[derive(Clone, Debug)]
struct PastEnd {
    /// Commit of the motion.
    id: CommitId,
    /// Result reported to its agent.
    end: MotionEnd,
    /// Cause of a failure, if it is known, such as the contacts.
    cause: Option<Cause>,
}

impl TransactionState {
    /// Creates an empty state with a history of this length.
    pub fn new(history: usize) -> TransactionState {
        TransactionState {
            open: None,
            last_id: 0,
            status: Status::Starting,
            ahead: None,
            history: HistoryCore::new(history),
            died: None,
            orphan: None,
            halted: false,
            halt_journaled: false,
            places: Vec::new().into(),
            safe: None,
            ends: VecDeque::new(),
        }
    }

    /// Records a pulse's configuration in the history. A gap in the readings is bridged by the path that the open
    /// motion was commanded. `stale`: greatest age of a fresh reading.
    pub fn record(&mut self, pulse: &mut Pulse, stale: Duration) {
        let commanded = match self.open.as_ref().map(|open| (open.motion, &open.target)) {
            Some((Motion::Move { .. }, target)) => CommandedPath::Straight(target.clone()),
            Some((Motion::Stream | Motion::Forces { .. }, _)) => CommandedPath::Setpoints,
            Some((Motion::Escape { .. }, _)) | None => CommandedPath::Unknown,
        };
        self.history.record(pulse, stale, &commanded);
    }

    /// Records the death of an agent: if it owns the open transaction, Supervise cancels that before any other
    /// decision (I18).
    pub fn note_agent_death(&mut self, agent: &str) {
        let owned = self.open.as_ref().filter(|open| &*open.agent == agent);
        self.orphan = owned.map(|open| open.id).or(self.orphan);
    }

    /// Motion in progress, for the reflex.
    pub fn motion(&self) -> Option<Underway> {
        let open = self.open.as_ref()?;
        let safe = open.safe.clone();
        let named = open.named.clone();
        let places = self.places.clone();
        let pressed = matches!(open.cause, Some(Cause::Stall { .. } | Cause::ExternalTorque { .. }));
        Some(Underway { id: open.id, safe, named, places, extent: open.extent, pressed })
    }

    /// Updates the commanded positions after a retry has rolled back a motion whose outcome was settled before.
    pub fn send_home(&mut self, motion: &Underway, tolerance: f64) {
        let Some(SafePose { q: safe, .. }) = &motion.safe else { return };
        let place = |m: usize| motion.places.get(m).copied().flatten();
        let rests = |(m, old): (usize, &Option<f64>)| match safe.get(m).filter(|_| motion.named.contains(&m)) {
            Some(safe) => Some(home(place(m), *safe, tolerance)),
            None => *old,
        };
        self.places = self.places.iter().enumerate().map(rests).collect();
    }

    /// Settles the open transaction with its single outcome (I2), with the robot at rest at `q`: the given outcome,
    /// or the one shown by `q`. Its end and the commanded positions are recorded in the same step, so that it is
    /// always either open or ended.
    pub fn settle(&mut self, given: Option<Outcome>, q: Pose, tolerance: f64) -> Option<EndedTransaction> {
        let open = self.open.take()?;
        let outcome = given.unwrap_or_else(|| open.shown_at(&q, tolerance));
        self.places = open.places_after(&self.places, outcome, &q, tolerance);
        let ended = EndedTransaction { open, outcome, q, measured: given.is_none() };
        if self.ends.len() >= ENDS {
            self.ends.pop_front();
        }
        self.ends.push_back(PastEnd { id: ended.open.id, end: ended.end(), cause: ended.open.cause.clone() });
        Some(ended)
    }

    /// Latest configuration of the robot: the newest recorded one, or else the target of the open transaction.
    pub fn last_known(&self) -> Option<Pose> {
        let recorded = self.history.newest().map(|r| r.q.clone());
        recorded.or_else(|| self.open.as_ref().map(|open| open.target.clone()))
    }

    /// Returns the end of a motion; `None` while it is in progress. Motions that are too old to be remembered, or
    /// never existed, count as failed.
    pub fn end_of(&self, id: CommitId) -> Option<MotionEnd> {
        if self.open.as_ref().is_some_and(|open| open.id == id) {
            return None;
        }
        let ended = self.ends.iter().rev().find(|ended| ended.id == id);
        Some(ended.map_or(MotionEnd::Failed, |ended| ended.end))
    }

    /// Motor that was held or pushed in a motion that failed by that, if the motion is remembered.
    pub fn stalled_in(&self, id: CommitId) -> Option<&str> {
        match &self.ends.iter().rev().find(|ended| ended.id == id)?.cause {
            Some(Cause::Stall { motor, .. } | Cause::ExternalTorque { motor, .. }) => Some(motor),
            _ => None,
        }
    }

    /// Contacts of a motion that failed by them, if the motion is remembered.
    pub fn contacts_of(&self, id: CommitId) -> Option<&[Contact]> {
        match self.ends.iter().rev().find(|ended| ended.id == id) {
            Some(PastEnd {
                end: MotionEnd::Failed,
                cause: Some(Cause::Contact(contacts) | Cause::Foreseen(contacts)),
                ..
            }) => Some(contacts),
            _ => None,
        }
    }
}

/// Ledger of a robot. Cheap to clone; all clones share the same state.
#[derive(Clone, Debug)]
pub struct Ledger(Arc<Mutex<TransactionState>>);

impl Ledger {
    /// Creates an empty ledger with a history of this length.
    pub fn new(history: usize) -> Ledger {
        Ledger(Arc::new(Mutex::new(TransactionState::new(history))))
    }

    /// Locks the state. A panic of a thread that held the lock leaves it readable: each entry is written in one step.
    pub fn book(&self) -> MutexGuard<'_, TransactionState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests;
