//! A transaction while it is open, and its end: how it is driven, which motors it names, and which outcome a measured
//! pose shows (I2).

use crate::distance;
use mobee_contract::{Cause, CommitId, Event, MotionEnd, Outcome, Pose, Time};
use std::collections::BTreeSet;
use std::sync::Arc;

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

/// Where a transaction is taken back to: a pose at which the robot rested, free of contact (I4).
#[derive(Clone, Debug, PartialEq)]
pub struct SafePose {
    /// When it was read: from then on the history has the path back to it.
    pub since: Time,
    /// The pose, rad.
    pub q: Pose,
}

/// What is under way, as the ledger has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Underway {
    /// The commit.
    pub id: CommitId,
    /// Its safe pose; an escape has none.
    pub safe: Option<SafePose>,
    /// The motors that it has named, in order: during the retreat no other is written to.
    pub named: Arc<[usize]>,
    /// Where all motors had been sent when it began.
    pub places: Places,
    /// How far back it is taken.
    pub extent: Extent,
    /// Whether something that no model knows stopped it: its motors push that until the retreat has taken them off it.
    pub pressed: bool,
}

/// How far back a motion is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// To its safe pose: a move to a target takes part in it, or what stopped it gives no place before it as free.
    Whole,
    /// By as much as the rules say, since it consists of set-points that led where they led: it is under way.
    Stream,
    /// The same, from where it was when it was stopped.
    Stopped(Time),
}

impl Extent {
    /// The same of a motion that is stopped now.
    #[must_use]
    pub fn stopped(self, at: Time) -> Extent {
        if self == Extent::Stream { Extent::Stopped(at) } else { self }
    }
}

impl Underway {
    /// A move of the first motor, which was never sent anywhere, back to this safe pose.
    #[cfg(test)]
    pub(crate) fn of_one_motor(id: u64, safe: Option<SafePose>) -> Underway {
        let (named, places) = (vec![0].into(), vec![None].into());
        Underway { id: CommitId(id), safe, named, places, extent: Extent::Whole, pressed: false }
    }

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
    /// Its safe pose; an escape has none.
    pub safe: Option<SafePose>,
    /// When it was accepted or last amended.
    pub since: Time,
    /// How it is driven.
    pub motion: Motion,
    /// Why it will not reach its target, once that is known.
    pub cause: Option<Cause>,
    /// Whether a retreat has begun.
    pub retreated: bool,
    /// How far back it is taken.
    pub extent: Extent,
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
        } else if self.safe.as_ref().is_some_and(|safe| near(&safe.q)) {
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
            let safe = || self.safe.as_ref().and_then(|safe| safe.q.get(*m)).copied();
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
    /// Whether that pose shows its outcome, which supervise did not decide: it was cut off.
    pub measured: bool,
}

impl Ended {
    /// What its agent is told: whether it has arrived. Where it rests otherwise is the journal's matter.
    pub fn end(&self) -> MotionEnd {
        if self.outcome == Outcome::Committed { MotionEnd::Reached } else { MotionEnd::Failed }
    }

    /// The events of its end: of one that was cut off at its target, where that lies, since a stream leads it on without an
    /// event for each set-point; then the outcome, with the cause only of what failed.
    pub fn events(self, robot: String) -> Vec<Event> {
        let Ended { open: Open { id, target, safe, cause, extent, .. }, outcome, q, measured } = self;
        let committed = outcome == Outcome::Committed;
        let stream = extent != Extent::Whole;
        let amended = Event::Amended { robot: robot.clone(), id, target, motors: Vec::new(), stream };
        let (safe, cause) = (safe.map(|safe| safe.q), cause.filter(|_| !committed));
        let ended = Event::Outcome { robot, id, outcome, q, safe, cause };
        (measured && committed).then_some(amended).into_iter().chain([ended]).collect()
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
