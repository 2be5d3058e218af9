//! Room on the way back: a robot that is in the way of a retreat, and is itself being taken back, is waited for.
//!
//! A third robot may drive into those that are on their way back together: it is in nobody's recorded past. Its own reflex stops it and
//! takes it back out of the way, so that whoever it met need not give up: it stays where it is until the other is gone, on its way or at
//! its end. If the other's way back leads through here, both wait for each other: then all who are on their way begin anew, together; so
//! they do where it stands in the way once it is back.

use crate::joint_retreat::JointRetreat;
use mobee_contract::Time;
use mobee_model::Contact;
use std::time::Duration;

/// How long a robot that is in the way, and is not taken back, is waited for: its agent may get it out, and
/// escapes are slow.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long a retreat waits in all, while others come and go: one of them may be taken back again and again.
const LONGEST: Duration = Duration::from_secs(30);
/// How long one is that waits as well, and did so before: the ways of two that wait for each other cross.
const GRACE: Duration = Duration::from_millis(200);
/// How often a retreat waits: whoever is met again and again does not make room.
const OFTEN: u32 = 5;
/// The same of one that is foreseen, and not met: the retreat approaches in several pieces.
const OFTEN_FORESEEN: u32 = 40;

/// Whether, and for whom, a retreat waits.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Room {
    /// The robot that is in the way, by index, and when it made room last.
    waits: Option<(usize, Time)>,
    /// Since when it waits.
    since: Time,
    times: u32,
    foreseen: u32,
}

/// What a reading means for a retreat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    /// It goes on.
    Free,
    /// It waits from now on.
    Waits,
    /// It still waits.
    Stays,
    /// It has waited, and goes on now.
    GoesOn,
    /// It can't go on.
    Blocked,
}

impl Room {
    /// For whom it waits, and since when it does for whoever it was.
    pub fn waits(&self) -> Option<(usize, Time)> {
        self.waits.map(|(whom, _)| (whom, self.since))
    }

    /// What this contact that is nearer than it may be, if there is one, means for the retreat of a robot. `foreseen`: whether it is
    /// only ahead. `rests`: whether the robot rests where it was sent: braking, it leaves its path, each motor as it can.
    pub fn look(
        &mut self,
        broken: Option<&Contact>,
        (foreseen, rests): (bool, bool),
        robot: usize,
        retreats: &JointRetreat,
        now: Time,
    ) -> Way {
        let other = broken.and_then(|c| another(c, robot));
        if broken.is_some() && other.is_none() {
            return Way::Blocked;
        }
        let Some((whom, made)) = &mut self.waits else {
            let Some(other) = other else { return Way::Free };
            let (times, most) = if foreseen { (&mut self.foreseen, OFTEN_FORESEEN) } else { (&mut self.times, OFTEN) };
            if *times == most {
                return Way::Blocked;
            }
            *times += 1;
            (self.waits, self.since) = (Some((other, now)), now);
            return Way::Waits;
        };
        *whom = other.unwrap_or(*whom);
        if retreats.makes_room(*whom, robot, now) {
            *made = now;
            return if now < self.since + LONGEST { Way::Stays } else { Way::Blocked };
        }
        let patience = if retreats.waits_longer(*whom, robot) { GRACE } else { PATIENCE };
        if other.is_none() && rests {
            self.waits = None;
            Way::GoesOn
        } else if now < *made + patience || retreats.cross(robot, *whom) {
            Way::Stays
        } else {
            Way::Blocked
        }
    }
}

/// The other robot of a contact of this one.
pub(super) fn another(contact: &Contact, robot: usize) -> Option<usize> {
    [contact.pair.0.robot(), contact.pair.1.robot()].into_iter().flatten().find(|r| *r != robot)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::ShapeId;

    /// Whoever is in the way is taken back again and again, and does not leave: what waits for it gives up, and only then.
    #[test]
    fn a_retreat_does_not_wait_for_ever() {
        let retreats = JointRetreat::default();
        let of = |robot| ShapeId::Robot { robot, node: 0, shape: 0 };
        let contact = Contact { pair: (of(0), of(1)), distance: 0.005, points: Default::default() };
        let mut room = Room::default();
        let mut look = |secs: u64| {
            let now = Time(secs * 1_000_000_000);
            retreats.coming(1, now);
            room.look(Some(&contact), (false, true), 0, &retreats, now)
        };
        assert_eq!(look(7), Way::Waits);
        assert!((8..37).all(|secs| look(secs) == Way::Stays));
        assert_eq!(look(37), Way::Blocked);
    }
}
