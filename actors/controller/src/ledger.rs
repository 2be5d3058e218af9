//! The ledger: what must survive the death of any actor of a robot's controller.
//!
//! The rule is that an outcome is owed for what was accepted (I2): so the open transaction is written here before the
//! driver hears of it, and whoever comes after a death finds it. All else that cores hold may be lost, and is found
//! again by measuring.

use crate::distance;
use crate::history::HistoryCore;
use mobee_contract::{Cause, CommitId, Event, MotionEnd, Outcome, Pose, Status, Time};
use mobee_model::Contact;
use std::collections::{BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How an open transaction is driven, and when it must have ended, by the clock: a motion without an end would keep its
/// agent waiting, and the filter busy, for ever (I15).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// By moves of the board's own, of all its motors, or of some beside a stream of set-points for others.
    Move {
        /// When it must have ended.
        due: Time,
    },
    /// By set-points alone, for as long as their agents like.
    Stream,
    /// Along a reference trajectory that forces make (controllers of kind `fields`).
    Forces {
        /// When it must have ended.
        due: Time,
    },
    /// Straight and slowly out of a contact, watched; there is no pose to be taken back to.
    Escape {
        /// When it must have ended.
        due: Time,
    },
}

impl Motion {
    /// When it must have ended, if it must.
    pub fn due(self) -> Option<Time> {
        match self {
            Motion::Move { due } | Motion::Forces { due } | Motion::Escape { due } => Some(due),
            Motion::Stream => None,
        }
    }

    /// The same until then; a stream that a move joins is a move.
    #[must_use]
    pub fn until(self, due: Time) -> Motion {
        match self {
            Motion::Move { .. } | Motion::Stream => Motion::Move { due },
            Motion::Forces { .. } => Motion::Forces { due },
            Motion::Escape { .. } => Motion::Escape { due },
        }
    }
}

/// What is under way, as the ledger has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Underway {
    /// The commit.
    pub id: CommitId,
    /// Its safe pose; an escape has none.
    pub safe: Option<(Time, Pose)>,
    /// The motors that it has named, in order: during the retreat no other is written to.
    pub named: Arc<[usize]>,
    /// Where all motors had been sent when it began.
    pub places: Places,
}

impl Underway {
    /// Whether it leads out of a contact, and has nowhere to be taken back to.
    pub fn is_escape(&self) -> bool {
        self.safe.is_none()
    }
}

/// An open transaction.
#[derive(Clone, Debug, PartialEq)]
pub struct Open {
    /// Its number.
    pub id: CommitId,
    /// Who committed it.
    pub agent: Arc<str>,
    /// The whole target pose, rad. Of motors that it does not name: where they were.
    pub target: Pose,
    /// The motors that it has named, by its commit, its amendments and its set-points, in order. No other is written
    /// to.
    pub named: Arc<[usize]>,
    /// The safe pose and when it was read; an escape has none.
    pub safe: Option<(Time, Pose)>,
    /// When it was accepted or last amended.
    pub since: Time,
    /// How it is driven.
    pub motion: Motion,
    /// Why it will not reach its target, once that is known.
    pub cause: Option<Cause>,
    /// Whether a retreat has begun.
    pub retreated: bool,
}

impl Open {
    /// Names these motors, too.
    pub fn name(&mut self, motors: &[usize]) {
        if motors.iter().any(|m| !self.named.contains(m)) {
            let all: BTreeSet<usize> = self.named.iter().chain(motors).copied().collect();
            self.named = all.into_iter().collect();
        }
    }

    /// Which outcome it shows that the robot rests at `q` (I2): what was being taken back has not reached its target,
    /// not even where that lies beside the safe pose.
    pub fn shown_at(&self, q: &[f64], tolerance: f64) -> Outcome {
        let near = |pose: &Pose| distance(q, pose) <= tolerance;
        if !self.retreated && near(&self.target) {
            Outcome::Committed
        } else if self.safe.as_ref().is_some_and(|(_, safe)| near(safe)) {
            Outcome::RolledBack
        } else {
            Outcome::Faulted
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

/// A transaction that has got its outcome.
#[derive(Clone, Debug)]
pub struct Ended {
    /// What was open.
    pub open: Open,
    /// Its outcome.
    pub outcome: Outcome,
    /// Where the robot rests, rad.
    pub q: Pose,
}

impl Ended {
    /// What its agent is told: whether it has arrived. Where it rests otherwise is the journal's matter.
    pub fn end(&self) -> MotionEnd {
        if self.outcome == Outcome::Committed { MotionEnd::Reached } else { MotionEnd::Failed }
    }

    /// What the journal tells: the cause only of what failed.
    pub fn event(self, robot: String) -> Event {
        let Ended { open: Open { id, safe, cause, .. }, outcome, q } = self;
        let (safe, cause) = (safe.map(|(_, pose)| pose), cause.filter(|_| outcome != Outcome::Committed));
        Event::Outcome { robot, id, outcome, q, safe, cause }
    }
}

/// Where each motor was last sent, rad; nothing for one that never was. What rests is kept there, and not where its
/// encoder happens to read.
pub type Places = Arc<[Option<f64>]>;

/// Where a motor is to rest that was recorded at `q`: at its place, if it counts as being there, so that retreats to
/// one rest do not drift with the noise of its encoder. Half of the tolerance is left for that noise.
pub fn home(place: Option<f64>, q: f64, tolerance: f64) -> f64 {
    place.filter(|place| (place - q).abs() <= 0.5 * tolerance).unwrap_or(q)
}

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
            places: Vec::new().into(),
            safe: None,
            ends: VecDeque::new(),
        }
    }

    /// What is under way, for the reflex.
    pub fn motion(&self) -> Option<Underway> {
        let open = self.open.as_ref()?;
        let (safe, named, places) = (open.safe.clone(), open.named.clone(), self.places.clone());
        Some(Underway { id: open.id, safe, named, places })
    }

    /// A motion whose outcome was given before has been taken back after all.
    pub fn send_home(&mut self, motion: &Underway, tolerance: f64) {
        let Some((_, safe)) = &motion.safe else { return };
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
        let ended = Ended { open, outcome, q };
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

    /// What came into contact in a motion that failed by that, if it is remembered.
    pub fn contacts_of(&self, id: CommitId) -> Option<&[Contact]> {
        match self.ends.iter().rev().find(|ended| ended.id == id) {
            Some(PastEnd { end: MotionEnd::Failed, cause: Some(Cause::Contact(contacts)), .. }) => Some(contacts),
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
mod tests {
    use super::*;

    /// A motion of the second of three motors, from rest at 0.2 to 1.
    fn open(retreated: bool) -> Open {
        let safe = Some((Time::ZERO, vec![0.001, 0.2, 0.501].into()));
        let target = vec![0.001, 1.0, 2.0].into();
        let (named, agent) = (vec![1].into(), "a".into());
        let (since, motion) = (Time::ZERO, Motion::Move { due: Time::ZERO });
        Open { id: CommitId(1), agent, target, named, safe, since, motion, cause: None, retreated }
    }

    #[test]
    fn the_pose_shows_the_outcome() {
        let shown = |open: &Open, q: f64| open.shown_at(&[0.001, q, 2.0], 0.01);
        let (mut forth, mut back) = (open(false), open(true));
        for (q, outcome) in [(1.005, Outcome::Committed), (1.02, Outcome::Faulted)] {
            assert_eq!(shown(&forth, q), outcome);
            // what came to rest at the target during its retreat was not reached by the motion
            assert_eq!(shown(&back, q), Outcome::Faulted);
        }
        (forth.target, back.target) = (vec![0.0, 0.205, 0.5].into(), vec![0.0, 0.205, 0.5].into());
        assert_eq!(forth.shown_at(&[0.0, 0.2, 0.5], 0.01), Outcome::Committed);
        assert_eq!(back.shown_at(&[0.0, 0.2, 0.5], 0.01), Outcome::RolledBack);
        back.safe = None;
        assert_eq!(back.shown_at(&[0.0, 0.2, 0.5], 0.01), Outcome::Faulted);
    }

    #[test]
    fn what_is_settled_is_remembered_with_its_places() {
        let ledger = Ledger::new(1);
        let mut book = ledger.book();
        book.open = Some(open(false));
        assert_eq!(book.end_of(CommitId(1)), None);
        let q: Pose = vec![0.0, 0.999, 2.0].into();
        let ended = book.settle(None, q.clone(), 0.01).unwrap();
        assert_eq!((ended.outcome, ended.end()), (Outcome::Committed, MotionEnd::Reached));
        assert_eq!(
            (book.end_of(CommitId(1)), &book.places[..]),
            (Some(MotionEnd::Reached), &[None, Some(1.0), None][..])
        );
        assert!(book.settle(None, q.clone(), 0.01).is_none(), "one outcome");
        // as told, whatever the pose shows
        book.open = Some(Open { id: CommitId(2), ..open(false) });
        assert_eq!(book.settle(Some(Outcome::Faulted), q, 0.01).unwrap().end(), MotionEnd::Failed);
    }

    /// The journal is told why a motion failed, and never why one did not that nevertheless reached its target.
    #[test]
    fn a_cause_is_told_of_what_failed() {
        for outcome in [Outcome::Committed, Outcome::RolledBack, Outcome::Faulted] {
            let open = Open { cause: Some(Cause::Asked), ..open(false) };
            let event = Ended { open, outcome, q: vec![0.0; 3].into() }.event("r".into());
            let Event::Outcome { robot, cause, .. } = event else { panic!("{event:?}") };
            assert_eq!((robot.as_str(), cause.is_some()), ("r", outcome != Outcome::Committed), "{outcome:?}");
        }
    }

    /// An agent may ask what its motion ran into: of that motion alone, and only of one that failed by it.
    #[test]
    fn what_a_motion_ran_into_is_remembered() {
        use mobee_model::ShapeId;
        let contact = |object| {
            let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object, shape: 0 });
            Contact { pair, distance: 0.005, points: Default::default() }
        };
        let ledger = Ledger::new(1);
        let mut book = ledger.book();
        let mut end = |id: u64, cause: Cause, outcome| {
            book.open = Some(Open { id: CommitId(id), cause: Some(cause), ..open(false) });
            book.settle(Some(outcome), vec![0.0; 3].into(), 0.01);
        };
        end(1, Cause::Contact(vec![contact(1)]), Outcome::RolledBack);
        end(2, Cause::Contact(vec![contact(2), contact(3)]), Outcome::Faulted);
        end(3, Cause::Contact(vec![contact(4)]), Outcome::Committed);
        end(4, Cause::TargetMissed, Outcome::RolledBack);
        let met = [1, 2, 3, 4, 5].map(|id| book.contacts_of(CommitId(id)).map(<[Contact]>::to_vec));
        assert_eq!(met, [Some(vec![contact(1)]), Some(vec![contact(2), contact(3)]), None, None, None]);
    }

    #[test]
    fn where_the_robot_is_and_what_is_under_way_is_known() {
        let ledger = Ledger::new(1);
        let mut book = ledger.book();
        assert_eq!((book.motion(), book.last_known()), (None, None));
        book.open = Some(open(false));
        book.places = vec![None, Some(0.3), None].into();
        let motion = book.motion().unwrap();
        assert_eq!((motion.id, &motion.named[..], &motion.places), (CommitId(1), &[1][..], &book.places));
        assert_eq!(motion.safe, open(false).safe);
        assert_eq!(book.last_known(), Some(open(false).target), "nothing was recorded: where it was sent");
        let sample = mobee_contract::Sample { seq: 1, at: Time(1), q: vec![0.0, 0.4, 0.0].into(), done: vec![true; 3] };
        book.history.push(&mut crate::pulse::Pulse::new(sample, &Vec::new().into()), std::time::Duration::MAX);
        assert_eq!(book.last_known(), Some(vec![0.0, 0.4, 0.0].into()));
    }

    /// A retreat that succeeds after its outcome was given leaves the named motors at their places, or where they were
    /// safe.
    #[test]
    fn a_late_retreat_leaves_the_motors_at_home() {
        let ledger = Ledger::new(1);
        let mut book = ledger.book();
        book.open = Some(open(false));
        let mut motion = book.motion().unwrap();
        book.places = vec![Some(7.0), Some(8.0), Some(9.0)].into();
        motion.places = vec![None, Some(0.204), None].into();
        book.send_home(&motion, 0.01);
        assert_eq!(
            book.places[..],
            [Some(7.0), Some(0.204), Some(9.0)],
            "within half of the tolerance it is its place"
        );
        motion.places = vec![None, Some(0.206), None].into();
        book.send_home(&motion, 0.01);
        assert_eq!(book.places[..], [Some(7.0), Some(0.2), Some(9.0)]);
        book.send_home(&Underway { safe: None, ..motion }, 0.01);
        assert_eq!(book.places[..], [Some(7.0), Some(0.2), Some(9.0)]);
    }

    #[test]
    fn the_newest_hundred_ends_are_remembered() {
        let ledger = Ledger::new(1);
        let mut book = ledger.book();
        for id in 1..=150 {
            book.open = Some(Open { id: CommitId(id), ..open(false) });
            book.settle(Some(Outcome::Committed), vec![0.0; 3].into(), 0.01);
        }
        let end = |id| book.end_of(CommitId(id));
        assert_eq!((end(51), end(150)), (Some(MotionEnd::Reached), Some(MotionEnd::Reached)));
        assert_eq!(
            (end(50), end(151)),
            (Some(MotionEnd::Failed), Some(MotionEnd::Failed)),
            "forgotten, or never begun"
        );
    }

    /// Three motors of which the second and third were named; they had been sent to 0, nowhere and 0.5.
    #[test]
    fn places_are_those_that_the_outcome_leaves() {
        let mut open = Open { named: Vec::new().into(), ..open(false) };
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
