//! Joint retreat: robots that retreat together follow their common recorded past on one clock (I14).
//!
//! Configurations recorded at the same instants were free of contact between the robots. If each robot retreated
//! alone, they would be at other relative places and might touch. Therefore the reflex of a resting robot requests
//! its retreat here. The joint retreat waits for robots that are about to rest; then one [`JointRetreatPlan`] gives each robot
//! its path. During the retreat, no robot gets ahead of what another one has written: a late robot makes the others
//! wait.
//!
//! On the common clock the robots are, at each instant, where they were at one instant of the past. There, their
//! configurations were free of each other, whatever the path of each robot is (I14).
//!
//! Among robots within each other's reach, one retreat group moves at a time. Requests that arrive during a retreat,
//! and retries of failed retreats, are queued and run after it; robots out of reach of the whole group move at any
//! time. A robot that collides with a retreating group retreats first, and the group waits until it is out of the
//! way. If the retreat paths block each other, so that each waits for the other, all of these robots are replanned
//! together: their recordings up to then lead out. They are also replanned if a robot that collided with a group
//! still blocks it after its own retreat. A robot that is silent for a second is dropped from its group, so that no
//! death needs to be reported; the others then stop, and go on one by one.

mod bent;
mod group;
mod plan;

pub use plan::{JointRetreatPlan, Participant, RetreatPath};

use crate::history::{HistoryCore, HistoryTooShort};
use crate::ledger::{Extent, Places, SafePose, union};
use crate::{RELEASE, Rules};
use group::{GroupMember, RetreatGroup};
use mobee_contract::{Pose, Time};
use mobee_model::Scene;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Time without a sign of life after which a robot is dropped from its group. Many periods, so that a late thread is
/// not dropped, and short beside [`REST_TIMEOUT`], so that a dead robot delays the others only briefly.
const MEMBER_TIMEOUT: Duration = Duration::from_secs(1);
/// Longest wait for other robots to come to rest: as long as the reflex gives a robot for that.
const REST_TIMEOUT: Duration = Duration::from_secs(3);
/// Number of configurations checked per request: well below the work of a control period, since the requesting reflex
/// also watches its robot.
const CHECKS_PER_REQUEST: usize = 32;
/// Greatest margin that a controller can have, meters.
const MAX_MARGIN_M: f64 = 0.5;
/// Greatest lag of a robot behind the common clock, in its periods: it is made up for in one step.
const MAX_LAG_PERIODS: f64 = 1.5;

/// Answer to a reflex's request for a retreat.
#[derive(Clone, Debug)]
pub enum RetreatReply {
    /// Request again at the next reading.
    Wait,
    /// Hand over the recording with [`JointRetreat::enroll`], and request again.
    FetchRecording,
    /// Drive this path.
    Go(RetreatPath),
}

/// Request of a robot for its retreat.
#[derive(Clone, Debug, PartialEq)]
pub struct RetreatRequest {
    /// Index of the robot in the scene.
    pub robot: usize,
    /// Safe pose of the robot.
    pub safe: SafePose,
    /// True if this is a retry after a failed retreat.
    pub again: bool,
    /// Motors named by the motion.
    pub named: Arc<[usize]>,
    /// Commanded positions of the motors at the beginning of the motion.
    pub places: Places,
    /// Extent of the rollback.
    pub extent: Extent,
    /// True if the robot was stopped by something that is not in the model.
    pub pressed: bool,
}

impl RetreatRequest {
    /// Completes the request with the robot's recording up to now: the history goes on while the joint retreat waits
    /// for other robots. `poses`: present configurations of all robots.
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
        let RetreatRequest { robot, safe: SafePose { since, q: safe }, again, named, places, extent, pressed } = self;
        let (past, start) = history.past(since)?;
        let end = match extent {
            Extent::Whole | Extent::Stream => start,
            Extent::Stopped(at) => {
                let until = at - rules.undo;
                past.partition_point(|r| r.at <= until).saturating_sub(1).max(start)
            }
        };
        let bent = bent::bent_motors(&rules, &past, (start, &safe), pressed && !again);
        let named = union(&named, &bent);
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

/// Joint retreat of all robots, shared by their reflexes. By default any two robots count as within reach of each
/// other.
#[derive(Debug, Default)]
pub struct JointRetreat(Mutex<JointRetreatState>);

/// State behind the lock.
#[derive(Clone, Debug, Default)]
struct JointRetreatState {
    /// Pairs of robots that are never within a margin of each other, by their index in the scene.
    apart: Vec<(usize, usize)>,
    /// State of each robot, by its index in the scene.
    robot_states: Vec<RobotState>,
    /// Groups of robots that are retreating together.
    groups: Vec<RetreatGroup>,
    /// Robots whose path was cancelled for replanning, and that have not received another one yet.
    replan: Vec<usize>,
}

/// State of one robot.
#[derive(Clone, Debug, Default)]
enum RobotState {
    /// The robot is not involved in a retreat.
    #[default]
    Idle,
    /// The robot was stopped and does not rest yet; time of the last sign of life.
    Stopping(Time),
    /// The robot has been resting since `since`, and has requested its retreat; time of the last sign of life.
    Ready { since: Time, last_seen: Time, participant: Participant },
}

impl JointRetreat {
    /// Creates the joint retreat for the robots of this scene. Robots that are never within a margin of each other don't
    /// wait for each other.
    pub fn new(scene: &Scene) -> JointRetreat {
        let stands = |robot: usize| scene.base(robot).translation.vector;
        let robots = scene.robots().len();
        let pairs = (0..robots).flat_map(|b| (0..b).map(move |a| (a, b)));
        let far = |(a, b): &(usize, usize)| {
            (stands(*a) - stands(*b)).norm() > scene.reach(*a) + scene.reach(*b) + MAX_MARGIN_M + RELEASE
        };
        JointRetreat(Mutex::new(JointRetreatState {
            apart: pairs.filter(far).collect(),
            ..JointRetreatState::default()
        }))
    }

    /// Locks the state. A panic of a thread that held the lock leaves the state usable: at worst, a living robot is
    /// dropped.
    fn state(&self) -> MutexGuard<'_, JointRetreatState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Announces that the robot was stopped and will retreat once it rests: other requests wait for it. Repeated at
    /// each reading, so that the others don't wait for a dead robot.
    pub fn announce(&self, robot: usize, now: Time) {
        let mut state = self.state();
        if let Some(robot_state) = state.robot_state(robot) {
            *robot_state = RobotState::Stopping(now);
        }
    }

    /// Requests the retreat of a resting robot. Repeated at each reading until there is a path.
    pub fn request(&self, robot: usize, now: Time) -> RetreatReply {
        self.state().request(robot, now)
    }

    /// Enters the recording requested by [`RetreatReply::FetchRecording`]. From now on the robot waits for others at
    /// most three seconds.
    pub fn enroll(&self, participant: Participant, now: Time) {
        let mut state = self.state();
        if let Some(robot_state) = state.robot_state(participant.robot) {
            *robot_state = RobotState::Ready { since: now, last_seen: now, participant };
        }
    }

    /// Advances a robot to a set-point at `most` seconds on its path, at the latest. Returns the time on the path to
    /// write, or `None` if a robot of the group was lost or the group must be replanned.
    pub fn step(&self, robot: usize, most: f64, now: Time) -> Option<f64> {
        let mut state = self.state();
        let group = state.group(robot)?;
        group.refresh(robot, now)?;
        let elapsed = now.since(group.last).as_secs_f64();
        // At most a step ahead of the slowest robot: a late robot makes the others wait.
        let ahead = |m: &GroupMember| m.at + m.early + MAX_LAG_PERIODS * m.period;
        let reach = group.members.iter().map(ahead).fold(f64::INFINITY, f64::min);
        group.clock = (group.clock + elapsed).min(reach).max(group.clock);
        group.last = group.last.max(now);
        let clock = group.clock;
        let member = group.member(robot)?;
        member.at = member.at.max((clock - member.early).min(most));
        Some(member.at)
    }

    /// Records that the robot has reached this number of way-points: robots that move from point to point synchronize
    /// at each. Returns whether all have reached it, or `None` if a robot of the group was lost or the group must be
    /// replanned.
    pub fn reached(&self, robot: usize, points: usize, now: Time) -> Option<bool> {
        let mut state = self.state();
        let group = state.group(robot)?;
        group.refresh(robot, now)?;
        let member = group.member(robot)?;
        member.at = member.at.max(points as f64);
        Some(group.members.iter().all(|m| m.at >= points as f64))
    }

    /// Returns whether two robots are in the same retreat group: they pass each other as recorded. This holds until
    /// one of them is back, or goes no further.
    pub fn shares_group(&self, robot: usize, other: usize) -> bool {
        self.state().group(robot).is_some_and(|group| group.member(other).is_some())
    }

    /// Sets or clears the blocking robot that this one waits for, and the time since which it waits. Its group waits
    /// as well, and other groups may move.
    pub fn set_waiting(&self, robot: usize, blocker: Option<(usize, Time)>) {
        self.state().group(robot).and_then(|group| group.member(robot)).into_iter().for_each(|m| m.waits_for = blocker);
    }

    /// Returns whether another robot has been waiting on its path for longer than this one, which waits as well.
    pub fn waits_longer(&self, other: usize, robot: usize) -> bool {
        let mut state = self.state();
        let mut since =
            |robot| state.group(robot).and_then(|p| p.member(robot)).and_then(|m| m.waits_for).map(|(_, since)| since);
        matches!((since(other), since(robot)), (Some(theirs), Some(own)) if (theirs, other) < (own, robot))
    }

    /// Resolves a mutual wait: if two robots of different groups both wait, their paths cross, and both groups must
    /// be replanned together. Returns whether this is the case.
    pub fn resolve_mutual_wait(&self, robot: usize, other: usize) -> bool {
        let mut state = self.state();
        let waits = |group: &RetreatGroup, robot: usize| {
            group.members.iter().any(|m| m.robot == robot && !m.left && m.waits_for.is_some())
        };
        let of = |robot: usize| state.groups.iter().position(|p| waits(p, robot));
        match (of(robot), of(other)) {
            (Some(own), Some(theirs)) if own != theirs => {
                let both = state.groups.iter_mut().enumerate().filter(|(i, _)| [own, theirs].contains(i));
                both.for_each(|(_, group)| group.replan = true);
                true
            }
            _ => false,
        }
    }

    /// Handles a robot that is back at its safe pose and blocks `other`, whose retreat waits for it: both groups must
    /// be replanned together, and the robot retreats farther if they cannot pass it there. Returns whether this is
    /// the case.
    pub fn blocks_waiting_robot(&self, robot: usize, other: usize) -> bool {
        let mut state = self.state();
        let waits =
            |m: &GroupMember| m.robot == other && !m.left && m.waits_for.is_some_and(|(blocker, _)| blocker == robot);
        let is_blocking = state.groups.iter().any(|p| !p.is_of(robot) && p.members.iter().any(waits));
        if is_blocking {
            state.groups.iter_mut().filter(|p| p.is_of(robot) || p.is_of(other)).for_each(|group| group.replan = true);
        }
        is_blocking
    }

    /// Returns whether the robot's path was cancelled, so that it must request another one.
    pub fn must_replan(&self, robot: usize, now: Time) -> bool {
        let mut state = self.state();
        let Some(group) = state.group(robot).filter(|group| group.replan) else { return false };
        group.member(robot).into_iter().for_each(|m| m.last_seen = now);
        true
    }

    /// Returns whether a robot that blocks the retreat of `robot` is retreating itself, or any other robot within
    /// reach is retreating: one group moves at a time.
    pub fn makes_room(&self, other: usize, robot: usize, now: Time) -> bool {
        let state = self.state();
        let stopped = match state.robot_states.get(other) {
            Some(RobotState::Stopping(last_seen) | RobotState::Ready { last_seen, .. }) => {
                now <= *last_seen + MEMBER_TIMEOUT
            }
            _ => false,
        };
        let goes = |m: &GroupMember| !m.left && !m.is_lost(now) && state.is_near(m.robot, robot);
        stopped
            || state.groups.iter().filter(|p| !p.is_waiting() && !p.is_of(robot)).any(|p| p.members.iter().any(goes))
    }

    /// Returns whether all robots of this robot's group have written their whole path, or go no further.
    pub fn is_over(&self, robot: usize, now: Time) -> bool {
        self.state().group(robot).is_none_or(|group| group.members.iter().all(|m| m.is_through() || m.is_lost(now)))
    }

    /// Removes a robot that is back, or goes no further, from its group. The robots that are still retreating stop at
    /// their next step. The group ends when it is empty.
    pub fn leave(&self, robot: usize) {
        let mut state = self.state();
        if let Some(robot_state) = state.robot_state(robot) {
            *robot_state = RobotState::Idle;
        }
        state.replan.retain(|other| *other != robot);
        let group = state.group(robot);
        let replan = group.as_ref().is_some_and(|group| group.replan);
        group.and_then(|group| group.member(robot)).into_iter().for_each(|m| m.left = true);
        if replan {
            state.replan.push(robot);
        }
        state.groups.retain(|group| !group.members.iter().all(|m| m.left));
    }

    #[cfg(test)]
    pub(crate) fn fork(&self) -> JointRetreat {
        JointRetreat(Mutex::new(self.state().clone()))
    }
}

impl JointRetreatState {
    /// Mutable state of this robot; a robot without any report is away.
    fn robot_state(&mut self, robot: usize) -> Option<&mut RobotState> {
        if self.robot_states.len() <= robot {
            self.robot_states.resize_with(robot + 1, RobotState::default);
        }
        self.robot_states.get_mut(robot)
    }

    /// Group that this robot is retreating in.
    fn group(&mut self, robot: usize) -> Option<&mut RetreatGroup> {
        self.groups.iter_mut().find(|group| group.is_of(robot))
    }

    /// Returns whether two robots can ever be within a margin of each other.
    fn is_near(&self, a: usize, b: usize) -> bool {
        !self.apart.contains(&(a.min(b), a.max(b)))
    }

    /// Robots whose retreats interact with this one's: the robots within its reach that are stopped or retreating,
    /// those within their reach, and so on.
    fn interacting(&self, robot: usize) -> Vec<usize> {
        let on_their_way = self.groups.iter().flat_map(|p| p.members.iter().filter(|m| !m.left).map(|m| m.robot));
        let stopped =
            self.robot_states.iter().enumerate().filter(|(_, p)| !matches!(p, RobotState::Idle)).map(|(i, _)| i);
        let mut others: Vec<usize> = on_their_way.chain(stopped).collect();
        let mut interacting = vec![robot];
        let mut seen = 0;
        while let Some(one) = interacting.get(seen).copied() {
            let (near, far): (Vec<usize>, Vec<usize>) = others.iter().partition(|other| self.is_near(one, **other));
            interacting.extend(near.into_iter().filter(|other| *other != robot));
            others = far;
            seen += 1;
        }
        interacting
    }

    /// Implements [`JointRetreat::request`]: the request of the last robot that becomes ready forms the group.
    fn request(&mut self, robot: usize, now: Time) -> RetreatReply {
        self.groups.retain(|group| !group.is_over(now));
        if let Some(group) = self.group(robot) {
            group.member(robot).into_iter().for_each(|member| member.last_seen = now);
            return group.proceed(robot, now).map_or(RetreatReply::Wait, RetreatReply::Go);
        }
        let Some(RobotState::Ready { since, last_seen, participant }) = self.robot_state(robot) else {
            return RetreatReply::FetchRecording;
        };
        *last_seen = now;
        // A retry is planned for this robot alone: the path that failed was a joint one, or was obstructed.
        let patient = now < *since + REST_TIMEOUT;
        let alone = participant.again;
        let interacting = self.interacting(robot);
        let coming =
            |state: &RobotState| matches!(state, RobotState::Stopping(last_seen) if now <= *last_seen + MEMBER_TIMEOUT);
        let comes = |robot: &usize| self.robot_states.get(*robot).is_some_and(coming);
        // A waiting group may be waiting for this robot, but a group that is replanned includes all of its robots.
        let goes = |robot: &usize| {
            let holds_up = |p: &&RetreatGroup| {
                p.replan && p.is_of(*robot) || !p.is_waiting() && p.members.iter().any(|m| m.robot == *robot)
            };
            self.groups.iter().any(|p| holds_up(&p))
        };
        if interacting.iter().any(goes) || (!alone && patient && interacting.iter().any(comes)) {
            return RetreatReply::Wait;
        }
        let mut participants = Vec::new();
        for (i, robot_state) in self.robot_states.iter_mut().enumerate().filter(|(i, _)| interacting.contains(i)) {
            let goes = |participant: &Participant| if alone { i == robot } else { !participant.again };
            match std::mem::take(robot_state) {
                RobotState::Ready { last_seen, participant, .. }
                    if goes(&participant) && now <= last_seen + MEMBER_TIMEOUT =>
                {
                    participants.push(participant)
                }
                other => *robot_state = other,
            }
        }
        let goes = |robot: &usize| participants.iter().any(|participant| participant.robot == *robot);
        let replan = self.replan.iter().any(goes);
        self.replan.retain(|robot| !goes(robot));
        let slowest = participants.iter().map(|participant| participant.rules.follows()).max().unwrap_or_default();
        let members = participants.iter().map(|participant| GroupMember::new(participant, slowest, now)).collect();
        let plan = JointRetreatPlan::new(participants).map(|plan| plan.replan(replan));
        let mut group = RetreatGroup { plan, members, clock: 0.0, last: now, replan: false };
        let path = group.proceed(robot, now);
        self.groups.push(group);
        path.map_or(RetreatReply::Wait, RetreatReply::Go)
    }
}

#[cfg(test)]
pub(crate) mod tests;
