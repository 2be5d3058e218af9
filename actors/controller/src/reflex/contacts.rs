//! Contacts with hysteresis: one begins below the margin and ends above margin + 2 mm.
//!
//! Distances are signed, meters, and contain encoder noise. With a single threshold, a robot that rests at the margin
//! would alternate between contact and free, and the filter would open and close with it (I27). A contact is a *pair*
//! of shapes: its nearest points may change as the robot slides along.

use crate::{DEEPER, RELEASE};
use mobee_model::{Contact, Pair};
use std::sync::Arc;

/// A present contact.
#[derive(Clone, Debug)]
struct PresentContact {
    /// Contact in the newest reading.
    contact: Contact,
    /// True if distance zero was reported, or was not caused by the robot.
    hard: bool,
    /// Greatest depth since distance zero was reported, meters.
    depth: Option<f64>,
}

impl PresentContact {
    fn ended(&self) -> EndedContact {
        EndedContact { pair: self.contact.pair, depth: self.depth }
    }
}

/// Contact that ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EndedContact {
    /// Its shapes.
    pub pair: Pair,
    /// Greatest depth of a hard contact, meters.
    pub depth: Option<f64>,
}

/// Changes by one reading.
#[derive(Debug, Default)]
pub struct Changes {
    /// Contacts that began.
    pub began: Vec<Contact>,
    /// Contacts that ended.
    pub ended: Vec<EndedContact>,
    /// Contacts that reached distance zero by a motion of the robot.
    pub hard: Vec<Contact>,
}

/// Contacts of one robot.
#[derive(Clone, Debug)]
pub struct Contacts {
    /// Distance below which a contact begins, meters.
    margin: f64,
    /// Edit count of the scene in the previous reading.
    epoch: u64,
    /// Contacts that began and have not ended, oldest first.
    present: Vec<PresentContact>,
    /// The same contacts in a shared slice: cloned with each pulse, rebuilt only on changes.
    shown: Arc<[Contact]>,
}

impl Contacts {
    /// Creates an empty set; contacts begin below `margin`, meters.
    pub fn new(margin: f64) -> Contacts {
        Contacts { margin, epoch: 0, present: Vec::new(), shown: Vec::new().into() }
    }

    /// Processes a reading with all pairs closer than margin + 2 mm.
    ///
    /// `back`: whether the robot is retreating. The recorded path is not followed exactly: a pair that was passed
    /// just beyond the margin begins only at the distance that would stop the retreat. `moving`: whether the robot
    /// itself may have caused the contacts. `epoch`: edit count of the scene; an edit that places an object at the
    /// robot is not caused by the robot either.
    pub fn update(&mut self, near: &[Contact], back: bool, moving: bool, epoch: u64) -> Changes {
        let mut changes = Changes::default();
        let edited = std::mem::replace(&mut self.epoch, epoch) != epoch;
        // The usual case, a hundred times per second: rebuild nothing.
        if near.is_empty() && self.present.is_empty() {
            return changes;
        }
        let margin = self.margin;
        let ended = &mut changes.ended;
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
                self.present.push(PresentContact { contact: *c, hard: false, depth: None });
                changes.began.push(*c);
            }
        }
        // Once per contact, regardless of its duration; never for a contact that an edit placed there.
        for touch in self.present.iter_mut().filter(|t| t.contact.distance <= 0.0 && !t.hard) {
            touch.hard = true;
            if moving && !edited {
                touch.depth = Some(0.0);
                changes.hard.push(touch.contact);
            }
        }
        for PresentContact { contact, depth, .. } in &mut self.present {
            *depth = depth.map(|depth| depth.max(-contact.distance));
        }
        self.show();
        changes
    }

    /// Ends the contacts beyond the margin, since the robot is back at its safe pose, where it was free. Returns
    /// them.
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

    /// Rebuilds the shared slice.
    fn show(&mut self) {
        self.shown = self.present.iter().map(|t| t.contact).collect();
    }

    /// Present contacts.
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

    /// A contact of one of a robot's nodes and an object, at this distance in millimeters.
    pub(in crate::reflex) fn near(node: u16, mm: f64) -> Contact {
        let pair = (ShapeId::Robot { robot: 0, node, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        Contact { pair, distance: mm * 1e-3, points: [Point3::origin(); 2] }
    }

    /// Counts of the contacts that the reading begins, ends and makes hard, and of those present after it.
    fn counts(contacts: &mut Contacts, near: &[Contact], (back, moving, epoch): (bool, bool, u64)) -> [usize; 4] {
        let Changes { began, ended, hard } = contacts.update(near, back, moving, epoch);
        [began.len(), ended.len(), hard.len(), contacts.present().len()]
    }

    const MOVING: (bool, bool, u64) = (false, true, 0);

    #[test]
    fn a_contact_begins_below_the_margin_and_ends_beyond_two_millimeters_more() {
        let mut contacts = Contacts::new(MARGIN);
        let mut next = |mm: f64| counts(&mut contacts, &[near(1, mm)], MOVING);
        assert_eq!(next(10.0), [0, 0, 0, 0], "the margin itself is free");
        assert_eq!(next(9.9), [1, 0, 0, 1]);
        assert_eq!(next(11.9), [0, 0, 0, 1]);
        assert_eq!(next(12.1), [0, 1, 0, 0]);
        assert_eq!(next(11.0), [0, 0, 0, 0]);
        assert_eq!(next(5.0), [1, 0, 0, 1]);
        assert_eq!(counts(&mut contacts, &[], MOVING), [0, 1, 0, 0], "a distant pair is not in the reading");
        assert_eq!(counts(&mut contacts, &[], MOVING), [0, 0, 0, 0]);
    }

    #[test]
    fn pairs_are_distinguished() {
        let mut contacts = Contacts::new(MARGIN);
        assert_eq!(counts(&mut contacts, &[near(1, 5.0), near(2, 20.0)], MOVING), [1, 0, 0, 1]);
        assert_eq!(counts(&mut contacts, &[near(1, 5.0), near(2, 5.0)], MOVING), [1, 0, 0, 2]);
        assert_eq!(counts(&mut contacts, &[near(2, 4.0)], MOVING), [0, 1, 0, 1]);
        assert_eq!(contacts.present()[..], [near(2, 4.0)], "at its newest distance");
    }

    /// Once per contact, and only if the robot moved there itself.
    #[test]
    fn distance_zero_is_reported_once_and_only_if_caused_by_the_robot() {
        let mut contacts = Contacts::new(MARGIN);
        assert_eq!(counts(&mut contacts, &[near(1, 1.0)], MOVING), [1, 0, 0, 1]);
        assert_eq!(counts(&mut contacts, &[near(1, 0.0)], MOVING), [0, 0, 1, 1]);
        assert_eq!(counts(&mut contacts, &[near(1, -1.0)], MOVING), [0, 0, 0, 1]);
        assert_eq!(counts(&mut contacts, &[near(1, -1.0), near(2, -1.0)], (false, false, 0)), [1, 0, 0, 2], "it rests");
        assert_eq!(counts(&mut contacts, &[near(1, -1.0), near(2, -1.0)], MOVING), [0, 0, 0, 2]);
        let edited = [near(1, -1.0), near(2, -1.0), near(3, -1.0)];
        assert_eq!(counts(&mut contacts, &edited, (false, true, 1)), [1, 0, 0, 3], "an edit put it there");
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
        assert_eq!(counts(&mut contacts, &[near(1, 9.1)], (true, true, 0)), [0, 0, 0, 0]);
        assert_eq!(counts(&mut contacts, &[near(1, 8.9), near(2, 11.0)], (true, true, 0)), [1, 0, 0, 1]);
        assert_eq!(counts(&mut contacts, &[near(1, 10.0), near(2, 9.5)], MOVING), [1, 0, 0, 2]);
        let ended = [EndedContact { pair: near(1, 0.0).pair, depth: None }];
        assert_eq!(contacts.settle(), ended, "back, and not within the margin");
        assert_eq!(contacts.present()[..], [near(2, 9.5)]);
    }
}
