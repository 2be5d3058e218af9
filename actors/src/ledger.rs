//! The ledger: what must survive the death of any actor of a robot's controller.

use crate::history::HistoryCore;
use crate::reflex::Motion;
use mobee_contract::{Cause, CommitId, MotionEnd, Outcome, Pose, Status, Time};
use std::collections::{BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// An open transaction.
#[derive(Clone, Debug, PartialEq)]
pub struct Open {
    /// Its number.
    pub id: CommitId,
    /// Who committed it.
    pub agent: Arc<str>,
    /// The whole target pose, rad. Of motors that it does not name: where they were.
    pub target: Pose,
    /// The motors that it has named, by its commit, its amendments and its set-points, in order. No other is written to.
    pub named: Arc<[usize]>,
    /// The safe pose and when it was read; an escape has none.
    pub safe: Option<(Time, Pose)>,
    /// When it was accepted or last amended.
    pub since: Time,
    /// When it must have ended.
    pub due: Time,
    /// Why it will not reach its target, once that is known.
    pub cause: Option<Cause>,
    /// Whether a way back has begun.
    pub retreated: bool,
}

impl Open {
    /// Whether it is an escape from a hold.
    pub fn is_escape(&self) -> bool {
        self.safe.is_none()
    }
}

impl Open {
    /// Names these motors, too.
    pub fn name(&mut self, motors: &[usize]) {
        if motors.iter().any(|m| !self.named.contains(m)) {
            let all: BTreeSet<usize> = self.named.iter().chain(motors).copied().collect();
            self.named = all.into_iter().collect();
        }
    }

    /// The places of all motors once it has ended so, with the robot at rest at `q`. `places` are those from before it.
    pub fn places_after(&self, places: &[Option<f64>], outcome: Outcome, q: &[f64], tolerance: f64) -> Places {
        let mut places = places.to_vec();
        places.resize(q.len(), None);
        for m in self.named.iter() {
            let (Some(place), Some(q)) = (places.get_mut(*m), q.get(*m)) else { continue };
            let safe = || self.safe.as_ref().and_then(|(_, safe)| safe.get(*m)).copied();
            let rests = match outcome {
                Outcome::Committed => self.target.get(*m).copied(),
                Outcome::RolledBack => safe().map(|safe| home(*place, safe, tolerance)),
                Outcome::Faulted => None,
            };
            *place = rests.or(Some(*q));
        }
        places.into()
    }
}

/// Where each motor was last sent, rad; nothing for one that never was. What rests is kept there, and not where its encoder
/// happens to read.
pub type Places = Arc<[Option<f64>]>;

/// Where a motor is to rest that was recorded at `q`: at its place, if it counts as being there, so that ways back to one
/// rest do not drift with the noise of its encoder. Half of the tolerance is left for that noise.
pub fn home(place: Option<f64>, q: f64, tolerance: f64) -> f64 {
    place.filter(|place| (place - q).abs() <= 0.5 * tolerance).unwrap_or(q)
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
    /// Where the motors were last sent, as the last transaction left them.
    pub places: Places,
    /// The safe pose last taken: kept while the robot counts as being there, so that rollbacks do not drift.
    pub safe: Option<Pose>,
    /// How the newest motions ended, oldest first.
    ends: VecDeque<(CommitId, MotionEnd)>,
}

impl Book {
    /// What is under way, for the reflex.
    pub fn motion(&self) -> Option<Motion> {
        let open = self.open.as_ref()?;
        let (safe, named, places) = (open.safe.clone(), open.named.clone(), self.places.clone());
        Some(Motion { id: open.id, safe, named, places })
    }

    /// A motion whose outcome was given before has been taken back after all.
    pub fn send_home(&mut self, motion: &Motion, tolerance: f64) {
        let Some((_, safe)) = &motion.safe else { return };
        let place = |m: usize| motion.places.get(m).copied().flatten();
        let rests = |(m, old): (usize, &Option<f64>)| match safe.get(m).filter(|_| motion.named.contains(&m)) {
            Some(safe) => Some(home(place(m), *safe, tolerance)),
            None => *old,
        };
        self.places = self.places.iter().enumerate().map(rests).collect();
    }

    /// Closes the open transaction, whose motors have these places from now on, and remembers how it ended, in one step: nobody
    /// sees it neither open nor ended.
    pub fn close(&mut self, id: CommitId, end: MotionEnd, places: Places) {
        self.open = None;
        self.places = places;
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
            places: Vec::new().into(),
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Three motors of which the second and third were named; they had been sent to 0, nowhere and 0.5.
    #[test]
    fn places_are_those_that_the_outcome_leaves() {
        let safe = Some((Time::ZERO, vec![0.001, 0.2, 0.501].into()));
        let target = vec![0.001, 1.0, 2.0].into();
        let since = (Time::ZERO, Time::ZERO);
        let named: Arc<[usize]> = Vec::new().into();
        let mut open = Open {
            id: CommitId(1),
            agent: "a".into(),
            target,
            named,
            safe,
            since: since.0,
            due: since.1,
            cause: None,
            retreated: false,
        };
        open.name(&[2]);
        open.name(&[1, 2]);
        assert_eq!(open.named[..], [1, 2]);
        let before = [Some(0.0), None, Some(0.5)];
        let after = |outcome, q: [f64; 3]| open.places_after(&before, outcome, &q, 0.01).to_vec();
        assert_eq!(after(Outcome::Committed, [0.0, 0.999, 2.001]), [Some(0.0), Some(1.0), Some(2.0)]);
        assert_eq!(after(Outcome::RolledBack, [0.0, 0.201, 0.499]), [Some(0.0), Some(0.2), Some(0.5)]);
        assert_eq!(after(Outcome::Faulted, [0.0, 0.7, 0.9]), [Some(0.0), Some(0.7), Some(0.9)]);
        // never commanded, and not named now
        assert_eq!(open.places_after(&[], Outcome::Faulted, &[0.0, 0.7, 0.9], 0.01).to_vec()[0], None);
    }
}
