//! Robots that are taken back together follow their common past on one clock (I14).
//!
//! What was recorded of several robots at the same instants was free of contact between them. Each by itself, they
//! would be elsewhere on their ways than they were, and might touch. So a reflex whose robot rests asks here; those
//! that are about to rest are waited for; then one [`Plan`] gives each its way. While they drive, none is ahead of what
//! another has written: a robot that is late makes the others wait.
//!
//! On one clock they are, at each instant, where they were at one instant of the past: there the poses of all were free
//! of each other, whatever each one's own path looks like (I14).
//!
//! Of robots within each other's reach one party is on its way at a time. Who asks meanwhile, or tries a failed way again, goes
//! after it; those out of reach of all of them go when they like. One who drove into a party goes first: it waits until he is out of
//! its way. Where the ways cross, so that each waits for the other, all of them are given ways anew, together: what all have recorded
//! until then leads out; so, too, where one who drove into a party stands in its way once he is back. A robot of which nothing was heard for a second is counted out, so that nobody has to tell of a death; the others
//! stop then, and go on one by one.

mod party;
mod plan;

pub use plan::{Participant, Plan, RetreatPath};

use crate::history::{HistoryCore, HistoryTooShort};
use crate::ledger::{Extent, Places, SafePose};
use crate::{RELEASE, Rules};
use mobee_contract::{Pose, Time};
use mobee_model::Scene;
use party::{Member, Party};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A robot of which nothing was heard for so long does not come along: many periods, so that a thread that comes late
/// is not left behind, and short beside [`PATIENCE`], so that one that died costs the others little.
const LOST: Duration = Duration::from_secs(1);
/// How long others are waited for to come to rest: as long as the reflex gives a robot for that.
const PATIENCE: Duration = Duration::from_secs(3);
/// How many poses are checked per question: well below a control period's work, since the reflex that asks watches its
/// robot, too.
const SLICE: usize = 32;
/// The greatest margin that a controller can have, meters.
const GREATEST_MARGIN: f64 = 0.5;
/// By how many of its periods a robot may be behind the clock: it makes up for them in one step.
const BEHIND: f64 = 1.5;

/// What a reflex is answered.
#[derive(Clone, Debug)]
pub enum RetreatReply {
    /// Ask again at the next reading.
    Wait,
    /// Bring what was recorded, by [`JointRetreat::enroll`], and ask again.
    Bring,
    /// This is the way.
    Go(RetreatPath),
}

/// A robot that asked for its retreat.
#[derive(Clone, Debug, PartialEq)]
pub struct Asked {
    /// Its index in the scene.
    pub robot: usize,
    /// Its safe pose.
    pub safe: SafePose,
    /// Whether it is another try after a failed one.
    pub again: bool,
    /// The motors that its motion has named.
    pub named: Arc<[usize]>,
    /// Where its motors had been sent when the motion began.
    pub places: Places,
    /// How far back the motion is taken.
    pub extent: Extent,
    /// Whether it was stopped by something that no model knows.
    pub pressed: bool,
}

impl Asked {
    /// The robot with what it recorded, as it is now: the history goes on while others are waited for. `poses`: where all
    /// robots are now.
    ///
    /// # Errors
    /// If the history does not reach back to the safe pose.
    pub fn participant(
        self,
        rules: Arc<Rules>,
        history: &HistoryCore,
        scene: Arc<Scene>,
        poses: Vec<Pose>,
    ) -> Result<Participant, HistoryTooShort> {
        let Asked { robot, safe: SafePose { since, q: safe }, again, named, places, extent, pressed } = self;
        let (past, start) = history.past(since)?;
        let end = match extent {
            Extent::Whole | Extent::Stream => start,
            Extent::Stopped(at) => {
                let until = at - rules.undo;
                past.partition_point(|r| r.at <= until).saturating_sub(1).max(start)
            }
        };
        let mut participant =
            Participant { robot, rules, past, start, end, safe, again, pressed: false, named, places, scene, poses };
        if again {
            participant.without_detour();
        } else if pressed {
            participant.leave_straight();
        }
        Ok(participant)
    }
}

/// Shared by the reflexes of all robots. By default any robot may be within reach of any other.
#[derive(Debug, Default)]
pub struct JointRetreat(Mutex<State>);

/// What is behind the lock.
#[derive(Clone, Debug, Default)]
struct State {
    /// Who can never come near whom, by the robots' index in the scene.
    apart: Vec<(usize, usize)>,
    /// By the robots' index in the scene.
    presences: Vec<Presence>,
    /// Those that are on their way, each party together.
    parties: Vec<Party>,
    /// Those whose way is over because all begin anew, and who have not been given another yet.
    anew: Vec<usize>,
}

/// What is known of one robot.
#[derive(Clone, Debug, Default)]
enum Presence {
    /// It goes its own ways.
    #[default]
    Away,
    /// It was stopped, and does not rest yet; last heard of then.
    Coming(Time),
    /// It rests, since then, and asked; last then.
    Ready { since: Time, heard: Time, who: Participant },
}

impl JointRetreat {
    /// Of the robots of this scene. Those that can't come near each other, wherever their motors are, don't wait for each other.
    pub fn new(scene: &Scene) -> JointRetreat {
        let stands = |robot: usize| scene.base(robot).translation.vector;
        let robots = scene.robots().len();
        let pairs = (0..robots).flat_map(|b| (0..b).map(move |a| (a, b)));
        let far = |(a, b): &(usize, usize)| {
            (stands(*a) - stands(*b)).norm() > scene.reach(*a) + scene.reach(*b) + GREATEST_MARGIN + RELEASE
        };
        JointRetreat(Mutex::new(State { apart: pairs.filter(far).collect(), ..State::default() }))
    }

    /// What is behind the lock. A panic of somebody who held it leaves it usable: at worst somebody is counted out who
    /// is alive.
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The robot was stopped, to be taken back once it rests: whoever asks meanwhile waits for it. Said at each
    /// reading, so that one that died is not waited for.
    pub fn coming(&self, robot: usize, now: Time) {
        let mut state = self.state();
        if let Some(presence) = state.presence(robot) {
            *presence = Presence::Coming(now);
        }
    }

    /// The robot rests, and asks for its retreat: at each reading, until it is answered.
    pub fn ask(&self, robot: usize, now: Time) -> RetreatReply {
        self.state().ask(robot, now)
    }

    /// What [`RetreatReply::Bring`] asked for. From now on the robot is waited for no longer than three seconds.
    pub fn enroll(&self, who: Participant, now: Time) {
        let mut state = self.state();
        if let Some(presence) = state.presence(who.robot) {
            *presence = Presence::Ready { since: now, heard: now, who };
        }
    }

    /// The robot writes a set-point: it is `most` seconds on its way at most. Returns how far it is to be; nothing once
    /// somebody who is on the way with it was lost, or all are to have ways anew.
    pub fn step(&self, robot: usize, most: f64, now: Time) -> Option<f64> {
        let mut state = self.state();
        let party = state.party(robot)?;
        party.hear(robot, now)?;
        let elapsed = now.since(party.last).as_secs_f64();
        // no further than a step ahead of the slowest: who is late makes the others wait
        let ahead = |m: &Member| m.at + m.early + BEHIND * m.period;
        let reach = party.members.iter().map(ahead).fold(f64::INFINITY, f64::min);
        party.clock = (party.clock + elapsed).min(reach).max(party.clock);
        party.last = party.last.max(now);
        let clock = party.clock;
        let member = party.member(robot)?;
        member.at = member.at.max((clock - member.early).min(most));
        Some(member.at)
    }

    /// The robot has reached so many way-points: those who move from point to point meet at each. Returns whether all
    /// have; nothing once somebody was lost, or all are to have ways anew.
    pub fn reached(&self, robot: usize, points: usize, now: Time) -> Option<bool> {
        let mut state = self.state();
        let party = state.party(robot)?;
        party.hear(robot, now)?;
        let member = party.member(robot)?;
        member.at = member.at.max(points as f64);
        Some(party.members.iter().all(|m| m.at >= points as f64))
    }

    /// Whether two robots were given their ways together: the one passes the other as it did before. That holds until one of
    /// them is back, or goes no further.
    pub fn goes_along(&self, robot: usize, other: usize) -> bool {
        self.state().party(robot).is_some_and(|party| party.member(other).is_some())
    }

    /// The robot stays where it is on its way, for that robot and since then, and so do those who go along; or it goes on. Meanwhile
    /// others may go.
    pub fn wait(&self, robot: usize, whom: Option<(usize, Time)>) {
        self.state().party(robot).and_then(|party| party.member(robot)).into_iter().for_each(|m| m.waits = whom);
    }

    /// Whether another robot has been waiting on its way for longer than this one, which waits as well.
    pub fn waits_longer(&self, other: usize, robot: usize) -> bool {
        let mut state = self.state();
        let mut since =
            |robot| state.party(robot).and_then(|p| p.member(robot)).and_then(|m| m.waits).map(|(_, since)| since);
        matches!((since(other), since(robot)), (Some(theirs), Some(own)) if (theirs, other) < (own, robot))
    }

    /// The ways of two robots cross, each of which waits on its own for the other: those of both, and of all who go along, are over, and
    /// they ask for ways anew, together. Whether that is so.
    pub fn cross(&self, robot: usize, other: usize) -> bool {
        let mut state = self.state();
        let waits = |party: &Party, robot: usize| {
            party.members.iter().any(|m| m.robot == robot && !m.left && m.waits.is_some())
        };
        let of = |robot: usize| state.parties.iter().position(|p| waits(p, robot));
        match (of(robot), of(other)) {
            (Some(own), Some(theirs)) if own != theirs => {
                let both = state.parties.iter_mut().enumerate().filter(|(i, _)| [own, theirs].contains(i));
                both.for_each(|(_, party)| party.anew = true);
                true
            }
            _ => false,
        }
    }

    /// A robot that is back where its motion began touches another there, which waits on its way for it: then all who go along with
    /// either ask for ways anew, together, and it goes farther back if they can't pass it there. Whether that is so.
    pub fn stands_in_the_way(&self, robot: usize, other: usize) -> bool {
        let mut state = self.state();
        let waits = |m: &Member| m.robot == other && !m.left && m.waits.is_some_and(|(whom, _)| whom == robot);
        let is_in_the_way = state.parties.iter().any(|p| !p.is_of(robot) && p.members.iter().any(waits));
        if is_in_the_way {
            state.parties.iter_mut().filter(|p| p.is_of(robot) || p.is_of(other)).for_each(|party| party.anew = true);
        }
        is_in_the_way
    }

    /// Whether the robot's way is over because it crosses that of others, so that it is to ask for one anew.
    pub fn begins_anew(&self, robot: usize, now: Time) -> bool {
        let mut state = self.state();
        let Some(party) = state.party(robot).filter(|party| party.anew) else { return false };
        party.member(robot).into_iter().for_each(|m| m.heard = now);
        true
    }

    /// Whether a robot that is in the way of another's retreat is being taken back out of it, or anybody else near is on the way back:
    /// one party goes at a time.
    pub fn makes_room(&self, other: usize, robot: usize, now: Time) -> bool {
        let state = self.state();
        let stopped = match state.presences.get(other) {
            Some(Presence::Coming(heard) | Presence::Ready { heard, .. }) => now <= *heard + LOST,
            _ => false,
        };
        let goes = |m: &Member| !m.left && !m.is_lost(now) && state.is_near(m.robot, robot);
        stopped || state.parties.iter().filter(|p| !p.waits() && !p.is_of(robot)).any(|p| p.members.iter().any(goes))
    }

    /// Whether all that go along with this robot have written all of their ways, or go no further.
    pub fn is_over(&self, robot: usize, now: Time) -> bool {
        self.state().party(robot).is_none_or(|party| party.members.iter().all(|m| m.is_through() || m.is_lost(now)))
    }

    /// The robot is back, or goes no further. Of those who are still on their way, each hears of it at its next step,
    /// and stops; when nobody is left the party is over.
    pub fn leave(&self, robot: usize) {
        let mut state = self.state();
        if let Some(presence) = state.presence(robot) {
            *presence = Presence::Away;
        }
        state.anew.retain(|other| *other != robot);
        let party = state.party(robot);
        let anew = party.as_ref().is_some_and(|party| party.anew);
        party.and_then(|party| party.member(robot)).into_iter().for_each(|m| m.left = true);
        if anew {
            state.anew.push(robot);
        }
        state.parties.retain(|party| !party.members.iter().all(|m| m.left));
    }

    #[cfg(test)]
    pub(crate) fn fork(&self) -> JointRetreat {
        JointRetreat(Mutex::new(self.state().clone()))
    }
}

impl State {
    /// What is known of this robot; a robot that was never heard of is away.
    fn presence(&mut self, robot: usize) -> Option<&mut Presence> {
        if self.presences.len() <= robot {
            self.presences.resize_with(robot + 1, Presence::default);
        }
        self.presences.get_mut(robot)
    }

    /// The party that this robot is on its way with.
    fn party(&mut self, robot: usize) -> Option<&mut Party> {
        self.parties.iter_mut().find(|party| party.is_of(robot))
    }

    /// Whether one of two robots can ever come near the other.
    fn is_near(&self, a: usize, b: usize) -> bool {
        !self.apart.contains(&(a.min(b), a.max(b)))
    }

    /// The robots that this one goes with, waits for, or is waited for by: those near it, those near them, and so on, of
    /// whom any is stopped or on its way.
    fn about(&self, robot: usize) -> Vec<usize> {
        let on_their_way = self.parties.iter().flat_map(|p| p.members.iter().filter(|m| !m.left).map(|m| m.robot));
        let stopped = self.presences.iter().enumerate().filter(|(_, p)| !matches!(p, Presence::Away)).map(|(i, _)| i);
        let mut others: Vec<usize> = on_their_way.chain(stopped).collect();
        let mut about = vec![robot];
        let mut seen = 0;
        while let Some(one) = about.get(seen).copied() {
            let (near, far): (Vec<usize>, Vec<usize>) = others.iter().partition(|other| self.is_near(one, **other));
            about.extend(near.into_iter().filter(|other| *other != robot));
            (others, seen) = (far, seen + 1);
        }
        about
    }

    /// See [`JointRetreat::ask`]: the last of those who are ready to ask gathers the party.
    fn ask(&mut self, robot: usize, now: Time) -> RetreatReply {
        self.parties.retain(|party| !party.is_over(now));
        if let Some(party) = self.party(robot) {
            party.member(robot).into_iter().for_each(|member| member.heard = now);
            return party.proceed(robot, now).map_or(RetreatReply::Wait, RetreatReply::Go);
        }
        let Some(Presence::Ready { since, heard, who }) = self.presence(robot) else { return RetreatReply::Bring };
        *heard = now;
        // another try goes alone: the way that failed was a joint one, or something stood in it
        let (patient, alone) = (now < *since + PATIENCE, who.again);
        let about = self.about(robot);
        let coming = |presence: &Presence| matches!(presence, Presence::Coming(heard) if now <= *heard + LOST);
        let comes = |robot: &usize| self.presences.get(*robot).is_some_and(coming);
        // a party that waits may be waiting for this one, but what begins anew begins with all of them
        let goes = |robot: &usize| {
            let holds_up =
                |p: &&Party| p.anew && p.is_of(*robot) || !p.waits() && p.members.iter().any(|m| m.robot == *robot);
            self.parties.iter().any(|p| holds_up(&p))
        };
        if about.iter().any(goes) || (!alone && patient && about.iter().any(comes)) {
            return RetreatReply::Wait;
        }
        let mut participants = Vec::new();
        for (i, presence) in self.presences.iter_mut().enumerate().filter(|(i, _)| about.contains(i)) {
            let goes = |who: &Participant| if alone { i == robot } else { !who.again };
            match std::mem::take(presence) {
                Presence::Ready { heard, who, .. } if goes(&who) && now <= heard + LOST => participants.push(who),
                other => *presence = other,
            }
        }
        let goes = |robot: &usize| participants.iter().any(|who| who.robot == *robot);
        let anew = self.anew.iter().any(goes);
        self.anew.retain(|robot| !goes(robot));
        let slowest = participants.iter().map(|who| who.rules.follows()).max().unwrap_or_default();
        let members = participants.iter().map(|who| Member::new(who, slowest, now)).collect();
        let plan = Plan::new(participants).map(|plan| plan.anew(anew));
        let mut party = Party { plan, members, clock: 0.0, last: now, anew: false };
        let way = party.proceed(robot, now);
        self.parties.push(party);
        way.map_or(RetreatReply::Wait, RetreatReply::Go)
    }
}

#[cfg(test)]
pub(crate) mod tests;
