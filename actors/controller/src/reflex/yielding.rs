//! Yielding during a retreat: a retreat waits for another robot that blocks it and is retreating itself.
//!
//! A third robot may drive into a retreating group: it is in no robot's recorded past. Its own reflex stops it and
//! moves it out of the way, so that the robot that it met need not abort. That robot waits, on its path or at its
//! end, until the other is gone. If the other's retreat path leads through here, both wait for each other: then all
//! retreating robots are replanned together, and likewise if the other still blocks the path after its own retreat.

use crate::joint_retreat::JointRetreat;
use mobee_contract::Time;
use mobee_model::Contact;
use std::time::Duration;

/// Longest wait for a blocking robot that does not retreat: its agent may move it away, and escapes are slow.
const YIELD_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest wait of a retreat in total, while blocking robots come and go: one of them may be retreating repeatedly.
const MAX_WAIT: Duration = Duration::from_secs(30);
/// Longest wait for a robot that waits as well, and has waited for longer: the paths of two robots that wait for each
/// other cross.
const MUTUAL_WAIT_TIMEOUT: Duration = Duration::from_millis(200);
/// Greatest number of waits of a retreat: a robot that is met repeatedly does not make room.
const MAX_WAITS: u32 = 5;
/// Greatest number of waits for foreseen contacts: a retreat approaches another robot in several steps.
const MAX_FORESEEN_WAITS: u32 = 40;

/// Waiting state of a retreat.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RetreatYield {
    /// Index of the blocking robot, and the last time at which it made room.
    waits: Option<(usize, Time)>,
    /// Beginning of the wait.
    since: Time,
    times: u32,
    foreseen: u32,
}

/// Consequence of a reading for a retreat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum YieldDecision {
    /// The retreat goes on.
    Proceed,
    /// The retreat starts to wait.
    StartWait,
    /// The retreat still waits.
    StillWaiting,
    /// The retreat has waited and goes on now.
    Resume,
    /// The retreat cannot go on.
    Blocked,
}

impl RetreatYield {
    /// Robot that the retreat waits for, and the beginning of the wait, for this or an earlier robot.
    pub fn waits(&self) -> Option<(usize, Time)> {
        self.waits.map(|(blocker, _)| (blocker, self.since))
    }

    /// Decides whether the retreat of `robot` goes on, waits or is blocked. `broken`: contact below its floor, if
    /// any. `foreseen`: whether that contact is only predicted. `rests`: whether the robot rests at its set-point; a
    /// braking robot leaves its path, since each motor brakes at its own rate.
    pub fn decide(
        &mut self,
        broken: Option<&Contact>,
        (foreseen, rests): (bool, bool),
        robot: usize,
        retreats: &JointRetreat,
        now: Time,
    ) -> YieldDecision {
        let other = broken.and_then(|c| another(c, robot));
        if broken.is_some() && other.is_none() {
            return YieldDecision::Blocked;
        }
        let Some((blocker, made)) = &mut self.waits else {
            let Some(other) = other else { return YieldDecision::Proceed };
            let (times, most) =
                if foreseen { (&mut self.foreseen, MAX_FORESEEN_WAITS) } else { (&mut self.times, MAX_WAITS) };
            if *times == most {
                return YieldDecision::Blocked;
            }
            *times += 1;
            self.waits = Some((other, now));
            self.since = now;
            return YieldDecision::StartWait;
        };
        *blocker = other.unwrap_or(*blocker);
        if retreats.makes_room(*blocker, robot, now) {
            *made = now;
            return if now < self.since + MAX_WAIT { YieldDecision::StillWaiting } else { YieldDecision::Blocked };
        }
        let patience = if retreats.waits_longer(*blocker, robot) { MUTUAL_WAIT_TIMEOUT } else { YIELD_TIMEOUT };
        if other.is_none() && rests {
            self.waits = None;
            YieldDecision::Resume
        } else if now < *made + patience || retreats.resolve_mutual_wait(robot, *blocker) {
            YieldDecision::StillWaiting
        } else {
            YieldDecision::Blocked
        }
    }
}

/// Returns the other robot of a contact of this one.
pub(super) fn another(contact: &Contact, robot: usize) -> Option<usize> {
    [contact.pair.0.robot(), contact.pair.1.robot()].into_iter().flatten().find(|r| *r != robot)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::ShapeId;

    /// A blocking robot that retreats repeatedly and does not leave: the waiting retreat aborts, and not before
    /// `MAX_WAIT`.
    #[test]
    fn a_retreat_does_not_wait_for_ever() {
        let retreats = JointRetreat::default();
        let of = |robot| ShapeId::Robot { robot, node: 0, shape: 0 };
        let contact = Contact { pair: (of(0), of(1)), distance: 0.005, points: Default::default() };
        let mut yielding = RetreatYield::default();
        let mut look = |secs: u64| {
            let now = Time(secs * 1_000_000_000);
            retreats.announce(1, now);
            yielding.decide(Some(&contact), (false, true), 0, &retreats, now)
        };
        assert_eq!(look(7), YieldDecision::StartWait);
        assert!((8..37).all(|secs| look(secs) == YieldDecision::StillWaiting));
        assert_eq!(look(37), YieldDecision::Blocked);
    }
}
