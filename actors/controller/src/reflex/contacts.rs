//! Contacts with hysteresis: one begins below the margin and ends above margin + 2 mm.
//!
//! Distances are signed, meters, and move with the encoders' noise: with one threshold a robot that rests at the margin
//! would be in contact and free by turns, and the filter would open and close with it (I27). A contact is a *pair* of
//! shapes: which of its points is nearest may change as the robot slides along.

use crate::{DEEPER, RELEASE};
use mobee_contract::Time;
use mobee_model::{Contact, Pair};
use std::collections::VecDeque;
use std::sync::Arc;

/// Of how many motions that came near something it is known how near.
const MOTIONS: usize = 64;

/// A present contact.
#[derive(Clone, Debug)]
struct Touch {
    /// As the newest reading has it.
    contact: Contact,
    /// Whether distance zero was told, or is not the robot's doing.
    hard: bool,
}

/// What a reading changed.
#[derive(Debug, Default)]
pub struct Changes {
    /// Contacts that began.
    pub began: Vec<Contact>,
    /// Pairs whose contact ended.
    pub ended: Vec<Pair>,
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
                ended.push(touch.contact.pair);
                false
            }
        });
        let begins = if back { margin - DEEPER } else { margin };
        for c in near.iter().filter(|c| c.distance < begins) {
            if !self.present.iter().any(|t| t.contact.pair == c.pair) {
                self.present.push(Touch { contact: *c, hard: false });
                changes.began.push(*c);
            }
        }
        // once per contact, however long it presses; one that an edit put there is never told
        for touch in self.present.iter_mut().filter(|t| t.contact.distance <= 0.0 && !t.hard) {
            touch.hard = true;
            if moving && !edited {
                changes.hard.push(touch.contact);
            }
        }
        self.show();
        changes
    }

    /// The robot is back where it was free: pairs beyond the margin no longer count as touching. Returns those.
    pub fn settle(&mut self) -> Vec<Pair> {
        let margin = self.margin;
        let mut ended = Vec::new();
        self.present.retain(|t| {
            let stays = t.contact.distance < margin;
            if !stays {
                ended.push(t.contact.pair);
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

/// How near pairs may come while the robot backs out of contact: none begins, none gets deeper than it has been.
///
/// The margin alone can't tell: a retreat begins in contact, so a watch that stops at the margin would stop every
/// retreat at once, and one that is off would push through whatever came into the way since (I9, I24).
#[derive(Clone, Debug, Default)]
pub struct Floors {
    /// What a pair may come to that has not been nearer, meters.
    margin: f64,
    /// The least distances that were read so far.
    least: Vec<Contact>,
}

impl Floors {
    /// From the pairs near the robot as it was stopped, or sets out.
    pub fn new(margin: f64, near: &[Contact]) -> Floors {
        Floors { margin, least: near.to_vec() }
    }

    /// The pairs near it in another reading, before it is taken back: the way leads through there again. The nearest of
    /// each pair counts.
    pub fn note(&mut self, near: &[Contact]) {
        for c in near {
            match self.least.iter_mut().find(|l| l.pair == c.pair) {
                Some(least) if least.distance <= c.distance => {}
                Some(least) => *least = *c,
                None => self.least.push(*c),
            }
        }
    }

    /// What else pairs have come to.
    pub fn join(&mut self, others: Floors) {
        self.note(&others.least);
    }

    /// The pairs that touched, each where it was nearest: what the journal tells a retreat to be from.
    pub fn touched(&self) -> Vec<Contact> {
        self.least.iter().filter(|c| c.distance < self.margin).copied().collect()
    }

    /// The first pair that is nearer than it may be, by more than [`DEEPER`]: what presses against something gives a
    /// little as it starts.
    pub fn broken<'a>(&self, near: &'a [Contact]) -> Option<&'a Contact> {
        near.iter().find(|c| {
            let start = self.least.iter().find(|l| l.pair == c.pair).map_or(self.margin, |l| l.distance);
            c.distance < start.min(self.margin) - DEEPER
        })
    }
}

/// How near pairs came in the robot's latest motions: a way back that leads through several of them passes there once more.
#[derive(Clone, Debug)]
pub struct Lately {
    /// What counts as near, meters.
    margin: f64,
    /// Of each motion, oldest first: the last reading in which something was near, and how near pairs came in it.
    motions: VecDeque<(Time, Floors)>,
}

impl Lately {
    /// None yet.
    pub fn new(margin: f64) -> Lately {
        Lately { margin, motions: VecDeque::new() }
    }

    /// A motion begins.
    pub fn begin(&mut self) {
        // one that came near nothing is not kept
        self.motions.pop_back_if(|(_, floors)| floors.least.is_empty());
        if self.motions.len() >= MOTIONS {
            self.motions.pop_front();
        }
        self.motions.push_back((Time::ZERO, Floors::new(self.margin, &[])));
    }

    /// The pairs near the robot in a reading of the newest motion.
    pub fn note(&mut self, near: &[Contact], at: Time) {
        let Some((last, floors)) = self.motions.back_mut() else { return };
        for c in near.iter().filter(|c| c.distance < self.margin) {
            *last = at;
            floors.note(std::slice::from_ref(c));
        }
    }

    /// How near pairs came in all motions that were near something since then.
    pub fn since(&self, time: Time) -> Floors {
        let mut all = Floors::new(self.margin, &[]);
        self.motions.iter().filter(|(last, _)| *last >= time).for_each(|(_, floors)| all.note(&floors.least));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::ShapeId;
    use nalgebra::Point3;

    const MARGIN: f64 = 0.01;

    /// One of a robot's nodes and an object, at so many millimeters.
    fn near(node: u16, mm: f64) -> Contact {
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
    fn on_the_retreat_a_contact_begins_a_millimeter_later() {
        let mut contacts = Contacts::new(MARGIN);
        assert_eq!(told(&mut contacts, &[near(1, 9.1)], (true, true, 0)), [0, 0, 0, 0]);
        assert_eq!(told(&mut contacts, &[near(1, 8.9), near(2, 11.0)], (true, true, 0)), [1, 0, 0, 1]);
        assert_eq!(told(&mut contacts, &[near(1, 10.0), near(2, 9.5)], MOVING), [1, 0, 0, 2]);
        assert_eq!(contacts.settle(), [near(1, 0.0).pair], "back, and not within the margin");
        assert_eq!(contacts.present()[..], [near(2, 9.5)]);
    }

    /// A way back through several motions may come as near as each of them did, and no nearer.
    #[test]
    fn what_was_passed_lately_is_known_of_each_motion() {
        let mut lately = Lately::new(MARGIN);
        lately.note(&[near(9, 1.0)], Time::ZERO);
        let at = Time::from_secs;
        for (secs, mm) in [(1.0, 4.0), (2.0, 6.0), (3.0, 20.0), (4.0, 8.0)] {
            lately.begin();
            lately.note(&[near(1, mm)], at(secs));
            lately.note(&[near(1, mm + 1.0), near(2, 30.0)], at(secs + 0.1));
            lately.note(&[], at(secs + 0.9));
        }
        let nearest =
            |lately: &Lately, secs: f64| lately.since(at(secs)).touched().first().map(|c| (c.distance * 1e3).round());
        assert_eq!(
            [0.0, 1.1, 1.5, 2.1, 2.5, 4.1, 4.5].map(|secs| nearest(&lately, secs)),
            [Some(4.0), Some(4.0), Some(6.0), Some(6.0), Some(8.0), Some(8.0), None]
        );
        for secs in 5..5 + MOTIONS {
            lately.begin();
            lately.note(&[near(1, 9.0)], at(secs as f64));
        }
        assert_eq!(nearest(&lately, 0.0), Some(9.0), "older ones are forgotten");
    }

    /// On its way out of contact the robot may come as near as it has been, and to the margin elsewhere; a millimeter
    /// is granted.
    #[test]
    fn nothing_comes_nearer_than_it_has_been() {
        let mut floors = Floors::new(MARGIN, &[near(1, 4.0), near(2, 15.0)]);
        let broken = |floors: &Floors, node, mm| floors.broken(&[near(9, 30.0), near(node, mm)]).map(|c| c.pair);
        let hit = |node| Some(near(node, 0.0).pair);
        assert_eq!((broken(&floors, 1, 3.1), broken(&floors, 1, 2.9)), (None, hit(1)));
        assert_eq!((broken(&floors, 2, 9.1), broken(&floors, 2, 8.9)), (None, hit(2)), "it was free");
        assert_eq!((broken(&floors, 3, 9.1), broken(&floors, 3, 8.9)), (None, hit(3)), "it was not near");
        let granted = Contact { distance: MARGIN - DEEPER, ..near(3, 0.0) };
        assert_eq!(floors.broken(&[granted]), None, "all of the millimeter");
        floors.note(&[near(1, 2.0), near(2, 16.0), near(3, 5.0)]);
        floors.note(&[near(1, 6.0)]);
        assert_eq!((broken(&floors, 1, 1.1), broken(&floors, 1, 0.9)), (None, hit(1)), "the deepest counts");
        assert_eq!((broken(&floors, 3, 4.1), broken(&floors, 3, 3.9)), (None, hit(3)));
        assert_eq!(floors.touched(), [near(1, 2.0), near(3, 5.0)]);
        assert_eq!(Floors::new(MARGIN, &[near(1, 10.0)]).touched(), []);
    }
}
