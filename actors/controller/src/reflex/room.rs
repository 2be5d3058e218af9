//! Room on the way back: a robot that is in the way of a retreat, and is itself being taken back, is waited for.
//!
//! A third robot may drive into those that are on their way back together: it is in nobody's recorded past. Its own reflex stops it and
//! takes it back out of the way, so that whoever it met need not give up: it stays where it is until the other is gone. If the other's
//! way back leads through here, both wait for each other: then all who are on their way begin anew, together.

use crate::joint_retreat::JointRetreat;
use mobee_contract::Time;
use mobee_model::Contact;
use std::time::Duration;

/// How long a robot that is in the way, and is not taken back, is waited for: its agent may get it out, and
/// escapes are slow.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long one is that waits as well, and did so before: the ways of two that wait for each other cross.
const GRACE: Duration = Duration::from_millis(200);
/// How often a retreat waits: whoever is met again and again does not make room.
const OFTEN: u32 = 5;

/// Whether, and for whom, a retreat waits.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Room {
    /// The robot that is in the way, by index, and when it made room last.
    waits: Option<(usize, Time)>,
    times: u32,
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
    /// What this contact that is nearer than it may be, if there is one, means for the retreat of a robot. `rests`: whether it rests
    /// where it was sent: braking, it leaves its path, each motor as it can.
    pub fn look(
        &mut self,
        broken: Option<&Contact>,
        rests: bool,
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
            if self.times == OFTEN {
                return Way::Blocked;
            }
            (self.waits, self.times) = (Some((other, now)), self.times + 1);
            return Way::Waits;
        };
        *whom = other.unwrap_or(*whom);
        if retreats.makes_room(*whom, robot, now) {
            *made = now;
            return Way::Stays;
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
fn another(contact: &Contact, robot: usize) -> Option<usize> {
    [contact.pair.0.robot(), contact.pair.1.robot()].into_iter().flatten().find(|r| *r != robot)
}
