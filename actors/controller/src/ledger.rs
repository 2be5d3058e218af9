//! The ledger: what must survive the death of any actor of a robot's controller.
//!
//! The rule is that an outcome is owed for what was accepted (I2): so the open transaction is written here before the
//! driver hears of it, and whoever comes after a death finds it. All else that cores hold may be lost, and is found
//! again by measuring.

mod transaction;

pub use transaction::{Ended, Extent, Motion, Open, Places, SafePose, Underway, home};

use crate::history::HistoryCore;
use mobee_contract::{Cause, CommitId, MotionEnd, Outcome, Pose, Status};
use mobee_model::Contact;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How many ends of motions are remembered: for agents that ask late. A bound, since a ledger lives as long as its
/// robot's controller, for days.
const ENDS: usize = 100;

/// The state that outlives the actors.
#[derive(Clone, Debug)]
pub struct TransactionState {
    /// The open transaction.
    pub open: Option<Open>,
    /// The number of the last accepted commit; they count up over restarts, so that none stands for two.
    pub last_id: u64,
    /// The filter's state.
    pub status: Status,
    /// Where a motion under forces leads now: the fields are asked there, not where the readings are, which lag behind.
    pub ahead: Option<Pose>,
    /// The recorded poses.
    pub history: HistoryCore,
    /// An actor that died since supervise last looked.
    pub died: Option<String>,
    /// The open transaction whose agent died since supervise last looked.
    pub orphan: Option<CommitId>,
    /// Whether a person has halted the robot: from the request until its release, whatever dies meanwhile.
    pub halted: bool,
    /// Whether the journal has that.
    pub halt_told: bool,
    /// Where the motors were last sent, as the last transaction left them.
    pub places: Places,
    /// The safe pose last taken: kept while the robot counts as being there, so that rollbacks do not drift.
    pub safe: Option<Pose>,
    /// How the newest motions ended, oldest first.
    ends: VecDeque<PastEnd>,
}

/// How a motion ended.
#[derive(Clone, Debug)]
struct PastEnd {
    /// Which.
    id: CommitId,
    /// What its agent was told.
    end: MotionEnd,
    /// Why it failed, if it is known; what came into contact, for one.
    cause: Option<Cause>,
}

impl TransactionState {
    /// An empty one with a history of this length.
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
            halt_told: false,
            places: Vec::new().into(),
            safe: None,
            ends: VecDeque::new(),
        }
    }

    /// Notes that an agent died: if it owns the open transaction, supervise cancels that before it decides anything else (I18).
    pub fn note_agent_death(&mut self, agent: &str) {
        let owned = self.open.as_ref().filter(|open| &*open.agent == agent);
        self.orphan = owned.map(|open| open.id).or(self.orphan);
    }

    /// What is under way, for the reflex.
    pub fn motion(&self) -> Option<Underway> {
        let open = self.open.as_ref()?;
        let (safe, named, places) = (open.safe.clone(), open.named.clone(), self.places.clone());
        let pressed = matches!(open.cause, Some(Cause::Stall { .. } | Cause::ExternalTorque { .. }));
        Some(Underway { id: open.id, safe, named, places, extent: open.extent, pressed })
    }

    /// A motion whose outcome was given before has been taken back after all.
    pub fn send_home(&mut self, motion: &Underway, tolerance: f64) {
        let Some(SafePose { q: safe, .. }) = &motion.safe else { return };
        let place = |m: usize| motion.places.get(m).copied().flatten();
        let rests = |(m, old): (usize, &Option<f64>)| match safe.get(m).filter(|_| motion.named.contains(&m)) {
            Some(safe) => Some(home(place(m), *safe, tolerance)),
            None => *old,
        };
        self.places = self.places.iter().enumerate().map(rests).collect();
    }

    /// Gives the open transaction its one outcome (I2), with the robot at rest at `q`: as told, or as the pose shows.
    /// Its end and the motors' places are remembered in the same step, so that nobody sees it neither open nor ended.
    pub fn settle(&mut self, told: Option<Outcome>, q: Pose, tolerance: f64) -> Option<Ended> {
        let open = self.open.take()?;
        let outcome = told.unwrap_or_else(|| open.shown_at(&q, tolerance));
        self.places = open.places_after(&self.places, outcome, &q, tolerance);
        let ended = Ended { open, outcome, q, measured: told.is_none() };
        if self.ends.len() >= ENDS {
            self.ends.pop_front();
        }
        self.ends.push_back(PastEnd { id: ended.open.id, end: ended.end(), cause: ended.open.cause.clone() });
        Some(ended)
    }

    /// Where the robot is, as far as anybody knows: its newest recorded pose, or where the open transaction sent it.
    pub fn last_known(&self) -> Option<Pose> {
        let recorded = self.history.newest().map(|r| r.q.clone());
        recorded.or_else(|| self.open.as_ref().map(|open| open.target.clone()))
    }

    /// How a motion ended; `None` while it is under way. Those too old to be remembered, and any that never was,
    /// failed.
    pub fn end_of(&self, id: CommitId) -> Option<MotionEnd> {
        if self.open.as_ref().is_some_and(|open| open.id == id) {
            return None;
        }
        let ended = self.ends.iter().rev().find(|ended| ended.id == id);
        Some(ended.map_or(MotionEnd::Failed, |ended| ended.end))
    }

    /// The motor that something held or pushed in a motion that failed by that, if it is remembered.
    pub fn stalled_in(&self, id: CommitId) -> Option<&str> {
        match &self.ends.iter().rev().find(|ended| ended.id == id)?.cause {
            Some(Cause::Stall { motor, .. } | Cause::ExternalTorque { motor, .. }) => Some(motor),
            _ => None,
        }
    }

    /// What came into contact in a motion that failed by that, if it is remembered.
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

/// A robot's ledger. Cheap to clone; all clones are one.
#[derive(Clone, Debug)]
pub struct Ledger(Arc<Mutex<TransactionState>>);

impl Ledger {
    /// An empty ledger with a history of this length.
    pub fn new(history: usize) -> Ledger {
        Ledger(Arc::new(Mutex::new(TransactionState::new(history))))
    }

    /// The book. A panic of somebody who held it leaves it readable: each entry is written in one step.
    pub fn book(&self) -> MutexGuard<'_, TransactionState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests;
