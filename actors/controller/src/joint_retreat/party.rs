//! Robots that go back together, on one clock: who they are, how far each is, and when nobody counts on them any more.

use super::{LOST, Participant, Plan, RetreatPath, SLICE};
use mobee_contract::Time;
use std::time::Duration;

/// Robots that go back together.
#[derive(Clone, Debug)]
pub(super) struct Party {
    /// While it is being checked.
    pub(super) plan: Option<Plan>,
    /// Those who go.
    pub(super) members: Vec<Member>,
    /// Seconds on the way, of all.
    pub(super) clock: f64,
    /// When it was last advanced; in the future until the first set-point is due.
    pub(super) last: Time,
    /// Whether its way crosses that of another party: its members stop, and ask for ways anew.
    pub(super) anew: bool,
}

/// One of them.
#[derive(Clone, Debug)]
pub(super) struct Member {
    /// Its index in the scene.
    pub(super) robot: usize,
    /// Its control period, s.
    pub(super) period: f64,
    /// How long its board takes to show the effect of a command.
    pub(super) reaction: Duration,
    /// By how much sooner than the slowest of them it follows its set-points, seconds: so much later they are written, that
    /// all are at one place of the past at once.
    pub(super) early: f64,
    /// When it last asked or wrote.
    pub(super) heard: Time,
    /// Until it has been taken.
    pub(super) way: Option<RetreatPath>,
    /// How far it is: seconds, or way-points; and how far it has to go.
    pub(super) at: f64,
    /// See `at`; without end before its way is known.
    pub(super) end: f64,
    /// For whom it stays where it is, and since when: a robot that does not go along is in its way.
    pub(super) waits: Option<(usize, Time)>,
    /// Whether it is back, or goes no further.
    pub(super) left: bool,
}

impl Member {
    /// At the beginning of its way.
    pub(super) fn new(who: &Participant, slowest: Duration, now: Time) -> Member {
        Member {
            robot: who.robot,
            period: who.rules.period.as_secs_f64(),
            reaction: who.rules.reaction(),
            early: slowest.saturating_sub(who.rules.follows()).as_secs_f64(),
            heard: now,
            way: None,
            at: 0.0,
            end: f64::INFINITY,
            waits: None,
            left: false,
        }
    }

    /// Whether it has taken its way and written all of it.
    pub(super) fn is_through(&self) -> bool {
        self.way.is_none() && self.at >= self.end
    }

    /// Whether the others must not count on it any more: one that is through may fall silent.
    pub(super) fn is_lost(&self, now: Time) -> bool {
        !self.is_through() && (self.left || now > self.heard + LOST)
    }
}

impl Party {
    /// This robot, if it goes along and has not left.
    pub(super) fn member(&mut self, robot: usize) -> Option<&mut Member> {
        self.members.iter_mut().find(|m| m.robot == robot && !m.left)
    }

    /// Whether this robot is on its way with it.
    pub(super) fn is_of(&self, robot: usize) -> bool {
        self.members.iter().any(|m| m.robot == robot && !m.left)
    }

    /// Whether it stays where it is.
    pub(super) fn waits(&self) -> bool {
        self.members.iter().any(|m| m.waits.is_some() && !m.left)
    }

    /// The robot lives. Nothing if another does not, or if all are to begin anew.
    pub(super) fn hear(&mut self, robot: usize, now: Time) -> Option<()> {
        self.member(robot)?.heard = now;
        (!self.anew && !self.members.iter().any(|m| m.is_lost(now))).then_some(())
    }

    /// Whether nobody counts on it any more. Who is through hears that it begins anew, if he lives.
    pub(super) fn is_over(&self, now: Time) -> bool {
        let is_out =
            |m: &Member| if self.anew { m.left || now > m.heard + LOST } else { m.is_through() || m.is_lost(now) };
        self.members.iter().all(is_out)
    }

    /// Checks a little more; the robot's way once all has been checked.
    pub(super) fn proceed(&mut self, robot: usize, now: Time) -> Option<RetreatPath> {
        if let Some(plan) = &mut self.plan {
            if !plan.check(SLICE) {
                return None;
            }
            let ways = plan.ways();
            self.plan = None;
            for (member, way) in self.members.iter_mut().zip(ways) {
                member.end = way.end();
                member.way = Some(way);
            }
            // all have heard of it, and their boards are prepared, before the first set-point is due
            let reaction = self.members.iter().map(|m| m.reaction).max().unwrap_or_default();
            let period = self.members.iter().map(|m| m.period).fold(0.0, f64::max);
            let hear = if self.members.len() > 1 { Duration::from_secs_f64(period) } else { Duration::ZERO };
            self.last = now + reaction + hear;
        }
        self.member(robot)?.way.take()
    }
}
