//! Retreat group: robots that retreat together on one clock, their progress, and the detection of lost robots.

use super::{CHECKS_PER_REQUEST, JointRetreatPlan, MEMBER_TIMEOUT, Participant, RetreatPath};
use mobee_contract::Time;
use std::time::Duration;

/// Robots that retreat together.
#[derive(Clone, Debug)]
pub(super) struct RetreatGroup {
    /// Plan, while it is being checked.
    pub(super) plan: Option<JointRetreatPlan>,
    /// Robots of the group.
    pub(super) members: Vec<GroupMember>,
    /// Common clock: seconds on the path.
    pub(super) clock: f64,
    /// Time at which the clock was last advanced; in the future until the first set-point is due.
    pub(super) last: Time,
    /// True if the group must be replanned, since its path crosses that of another group: its robots stop and request
    /// new paths.
    pub(super) replan: bool,
}

/// A robot of a retreat group.
#[derive(Clone, Debug)]
pub(super) struct GroupMember {
    /// Index in the scene.
    pub(super) robot: usize,
    /// Control period, s.
    pub(super) period: f64,
    /// Time from a command to its effect in the readings.
    pub(super) reaction: Duration,
    /// Time by which the robot follows its set-points sooner than the slowest robot, seconds. Its set-points are
    /// delayed by this time, so that all robots are at one instant of the past.
    pub(super) early: f64,
    /// Time of its last request or set-point.
    pub(super) last_seen: Time,
    /// Path, until the robot has taken it.
    pub(super) path: Option<RetreatPath>,
    /// Progress on the path: seconds, or number of way-points.
    pub(super) at: f64,
    /// Length of the path in the unit of `at`; infinite before the path is planned.
    pub(super) end: f64,
    /// Robot outside the group that blocks this one, and the time since which this one waits for it.
    pub(super) waits_for: Option<(usize, Time)>,
    /// True if the robot is back, or goes no further.
    pub(super) left: bool,
}

impl GroupMember {
    /// A robot at the beginning of its path.
    pub(super) fn new(participant: &Participant, slowest: Duration, now: Time) -> GroupMember {
        GroupMember {
            robot: participant.robot,
            period: participant.rules.period.as_secs_f64(),
            reaction: participant.rules.reaction(),
            early: slowest.saturating_sub(participant.rules.follows()).as_secs_f64(),
            last_seen: now,
            path: None,
            at: 0.0,
            end: f64::INFINITY,
            waits_for: None,
            left: false,
        }
    }

    /// Returns whether the robot has taken its path and written all of it.
    pub(super) fn is_through(&self) -> bool {
        self.path.is_none() && self.at >= self.end
    }

    /// Returns whether the others must stop relying on this robot. A robot that has written its whole path may fall
    /// silent.
    pub(super) fn is_lost(&self, now: Time) -> bool {
        !self.is_through() && (self.left || now > self.last_seen + MEMBER_TIMEOUT)
    }
}

impl RetreatGroup {
    /// Robot of this index, if it is in the group and has not left.
    pub(super) fn member(&mut self, robot: usize) -> Option<&mut GroupMember> {
        self.members.iter_mut().find(|m| m.robot == robot && !m.left)
    }

    /// Returns whether this robot is in the group and has not left.
    pub(super) fn is_of(&self, robot: usize) -> bool {
        self.members.iter().any(|m| m.robot == robot && !m.left)
    }

    /// Returns whether the group waits.
    pub(super) fn is_waiting(&self) -> bool {
        self.members.iter().any(|m| m.waits_for.is_some() && !m.left)
    }

    /// Records a sign of life of the robot. Returns `None` if another robot is lost, or the group must be replanned.
    pub(super) fn refresh(&mut self, robot: usize, now: Time) -> Option<()> {
        self.member(robot)?.last_seen = now;
        (!self.replan && !self.members.iter().any(|m| m.is_lost(now))).then_some(())
    }

    /// Returns whether the group has ended. A robot that has written its whole path is still notified of a
    /// replanning, if it is alive.
    pub(super) fn is_over(&self, now: Time) -> bool {
        let is_out = |m: &GroupMember| {
            if self.replan { m.left || now > m.last_seen + MEMBER_TIMEOUT } else { m.is_through() || m.is_lost(now) }
        };
        self.members.iter().all(is_out)
    }

    /// Checks the next part of the plan. Returns the robot's path once the whole plan is checked.
    pub(super) fn proceed(&mut self, robot: usize, now: Time) -> Option<RetreatPath> {
        if let Some(plan) = &mut self.plan {
            if !plan.check(CHECKS_PER_REQUEST) {
                return None;
            }
            let paths = plan.paths();
            self.plan = None;
            for (member, path) in self.members.iter_mut().zip(paths) {
                member.end = path.end();
                member.path = Some(path);
            }
            // The first set-point is due when all robots have their path and their boards are in the right mode.
            let reaction = self.members.iter().map(|m| m.reaction).max().unwrap_or_default();
            let period = self.members.iter().map(|m| m.period).fold(0.0, f64::max);
            let notify = if self.members.len() > 1 { Duration::from_secs_f64(period) } else { Duration::ZERO };
            self.last = now + reaction + notify;
        }
        self.member(robot)?.path.take()
    }
}
