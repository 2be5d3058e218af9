//! Contacts with hysteresis: one begins below the margin and ends above margin + 2 mm.
//!
//! Distances are signed, meters, and move with the encoders' noise: with one threshold a robot that rests at the margin
//! would be in contact and free by turns, and the filter would open and close with it (I27). A contact is a *pair* of
//! shapes: which of its points is nearest may change as the robot slides along.

use crate::{DEEPER, RELEASE};
use mobee_model::{Contact, Pair};
use std::sync::Arc;

/// A present contact.
#[derive(Clone, Debug)]
struct Touch {
    /// As the newest reading has it.
    contact: Contact,
    /// Whether distance zero was told, or is not the robot's doing.
    hard: bool,
    /// Its greatest depth since it was told, meters.
    depth: Option<f64>,
}

impl Touch {
    fn ended(&self) -> EndedContact {
        EndedContact { pair: self.contact.pair, depth: self.depth }
    }
}

/// A contact that ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EndedContact {
    /// Of these shapes.
    pub pair: Pair,
    /// Its greatest depth if it was a hard contact, meters.
    pub depth: Option<f64>,
}

/// What a reading changed.
#[derive(Debug, Default)]
pub struct Changes {
    /// Contacts that began.
    pub began: Vec<Contact>,
    /// Contacts that ended.
    pub ended: Vec<EndedContact>,
    /// Contacts that reached distance zero by a motion of the robot.
    pub hard: Vec<Contact>,
}

/// The contacts of one robot.
#[derive(Clone, Debug)]
pub struct Contacts {
    /// Below this distance a contact begins, meters.
    margin: f64,
    /// The scene's count of edits in the reading before.
    epoch: u64,
    /// Those that began and have not ended, oldest first.
    present: Vec<Touch>,
    /// The same for others to keep: cloned with each pulse, made anew only when something changed.
    shown: Arc<[Contact]>,
}

impl Contacts {
    /// None yet; contacts begin below `margin`, meters.
    pub fn new(margin: f64) -> Contacts {
        Contacts { margin, epoch: 0, present: Vec::new(), shown: Vec::new().into() }
    }

    /// Takes in all pairs nearer than margin + 2 mm. `back`: whether the robot is being taken back, which is not
    /// followed to the hair: what it passed just beyond the margin touches only once it stops the retreat. `moving`:
    /// whether the robot may be the one who caused them; `epoch`: the scene they were found in, since what an edit puts
    /// onto the robot is not the robot's doing either.
    pub fn update(&mut self, near: &[Contact], back: bool, moving: bool, epoch: u64) -> Changes {
        let mut changes = Changes::default();
        let edited = std::mem::replace(&mut self.epoch, epoch) != epoch;
        // the usual case, a hundred times a second: nothing is made anew
        if near.is_empty() && self.present.is_empty() {
            return changes;
        }
        let (margin, ended) = (self.margin, &mut changes.ended);
        self.present.retain_mut(|touch| match near.iter().find(|c| c.pair == touch.contact.pair) {
            Some(c) if c.distance <= margin + RELEASE => {
                touch.contact = *c;
                true
            }
            _ => {
                ended.push(touch.ended());
                false
            }
        });
        let begins = if back { margin - DEEPER } else { margin };
        for c in near.iter().filter(|c| c.distance < begins) {
            if !self.present.iter().any(|t| t.contact.pair == c.pair) {
                self.present.push(Touch { contact: *c, hard: false, depth: None });
                changes.began.push(*c);
            }
        }
        // once per contact, however long it presses; one that an edit put there is never told
        for touch in self.present.iter_mut().filter(|t| t.contact.distance <= 0.0 && !t.hard) {
            touch.hard = true;
            if moving && !edited {
                touch.depth = Some(0.0);
                changes.hard.push(touch.contact);
            }
        }
        for Touch { contact, depth, .. } in &mut self.present {
            *depth = depth.map(|depth| depth.max(-contact.distance));
        }
        self.show();
        changes
    }

    /// The robot is back where it was free: pairs beyond the margin no longer count as touching. Returns those.
    pub fn settle(&mut self) -> Vec<EndedContact> {
        let margin = self.margin;
        let mut ended = Vec::new();
        self.present.retain(|t| {
            let stays = t.contact.distance < margin;
            if !stays {
                ended.push(t.ended());
            }
            stays
        });
        self.show();
        ended
    }

    /// What is present is what others are shown.
    fn show(&mut self) {
        self.shown = self.present.iter().map(|t| t.contact).collect();
    }

    /// The present contacts.
    pub fn present(&self) -> &Arc<[Contact]> {
        &self.shown
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use mobee_model::ShapeId;
    use nalgebra::Point3;

    pub(in crate::reflex) const MARGIN: f64 = 0.01;

    /// One of a robot's nodes and an object, at so many millimeters.
    pub(in crate::reflex) fn near(node: u16, mm: f64) -> Contact {
        let pair = (ShapeId::Robot { robot: 0, node, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        Contact { pair, distance: mm * 1e-3, points: [Point3::origin(); 2] }
    }

    /// What the next reading changes: how many contacts begin, end and are hard, and how many are present then.
    fn told(contacts: &mut Contacts, near: &[Contact], (back, moving, epoch): (bool, bool, u64)) -> [usize; 4] {
        let Changes { began, ended, hard } = contacts.update(near, back, moving, epoch);
        [began.len(), ended.len(), hard.len(), contacts.present().len()]
    }

    const MOVING: (bool, bool, u64) = (false, true, 0);

    #[test]
    fn a_contact_begins_below_the_margin_and_ends_beyond_two_millimeters_more() {
        let mut contacts = Contacts::new(MARGIN);
        let mut next = |mm: f64| told(&mut contacts, &[near(1, mm)], MOVING);
        assert_eq!(next(10.0), [0, 0, 0, 0], "the margin itself is free");
        assert_eq!(next(9.9), [1, 0, 0, 1]);
        assert_eq!(next(11.9), [0, 0, 0, 1]);
        assert_eq!(next(12.1), [0, 1, 0, 0]);
        assert_eq!(next(11.0), [0, 0, 0, 0]);
        assert_eq!(next(5.0), [1, 0, 0, 1]);
        assert_eq!(told(&mut contacts, &[], MOVING), [0, 1, 0, 0], "what is far is not told at all");
        assert_eq!(told(&mut contacts, &[], MOVING), [0, 0, 0, 0]);
    }

    #[test]
    fn pairs_are_told_apart() {
        let mut contacts = Contacts::new(MARGIN);
        assert_eq!(told(&mut contacts, &[near(1, 5.0), near(2, 20.0)], MOVING), [1, 0, 0, 1]);
        assert_eq!(told(&mut contacts, &[near(1, 5.0), near(2, 5.0)], MOVING), [1, 0, 0, 2]);
        assert_eq!(told(&mut contacts, &[near(2, 4.0)], MOVING), [0, 1, 0, 1]);
        assert_eq!(contacts.present()[..], [near(2, 4.0)], "at its newest distance");
    }

    /// Once per contact, only if the robot moved there by itself.
    #[test]
    fn distance_zero_is_told_once_and_as_the_robots_doing() {
        let mut contacts = Contacts::new(MARGIN);
        assert_eq!(told(&mut contacts, &[near(1, 1.0)], MOVING), [1, 0, 0, 1]);
        assert_eq!(told(&mut contacts, &[near(1, 0.0)], MOVING), [0, 0, 1, 1]);
        assert_eq!(told(&mut contacts, &[near(1, -1.0)], MOVING), [0, 0, 0, 1]);
        assert_eq!(told(&mut contacts, &[near(1, -1.0), near(2, -1.0)], (false, false, 0)), [1, 0, 0, 2], "it rests");
        assert_eq!(told(&mut contacts, &[near(1, -1.0), near(2, -1.0)], MOVING), [0, 0, 0, 2]);
        let edited = [near(1, -1.0), near(2, -1.0), near(3, -1.0)];
        assert_eq!(told(&mut contacts, &edited, (false, true, 1)), [1, 0, 0, 3], "an edit put it there");
    }

    #[test]
    fn a_hard_contact_ends_with_its_greatest_depth() {
        let mut contacts = Contacts::new(MARGIN);
        let depth = |contacts: &mut Contacts, mm: f64, moving: bool| {
            contacts.update(&[near(1, mm)], false, moving, 0).ended.first().map(|ended| ended.depth)
        };
        for mm in [5.0, -1.0, -4.0, -2.0, 3.0] {
            assert_eq!(depth(&mut contacts, mm, true), None);
        }
        assert_eq!(depth(&mut contacts, 20.0, true), Some(Some(0.004)));
        assert_eq!(depth(&mut contacts, -3.0, false), None, "pushed in at rest");
        assert_eq!(depth(&mut contacts, 20.0, true), Some(None));
    }

    #[test]
    fn on_the_retreat_a_contact_begins_a_millimeter_later() {
        let mut contacts = Contacts::new(MARGIN);
        assert_eq!(told(&mut contacts, &[near(1, 9.1)], (true, true, 0)), [0, 0, 0, 0]);
        assert_eq!(told(&mut contacts, &[near(1, 8.9), near(2, 11.0)], (true, true, 0)), [1, 0, 0, 1]);
        assert_eq!(told(&mut contacts, &[near(1, 10.0), near(2, 9.5)], MOVING), [1, 0, 0, 2]);
        let ended = [EndedContact { pair: near(1, 0.0).pair, depth: None }];
        assert_eq!(contacts.settle(), ended, "back, and not within the margin");
        assert_eq!(contacts.present()[..], [near(2, 9.5)]);
    }
}
