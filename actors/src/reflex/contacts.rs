//! Contacts with hysteresis: one begins below the margin and ends above margin + 2 mm.

use crate::controller::{DEEPER, RELEASE};
use mobee_model::{Contact, Pair};
use std::sync::Arc;

/// A present contact.
#[derive(Clone, Debug)]
struct Touch {
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
    margin: f64,
    epoch: u64,
    present: Vec<Touch>,
    shown: Arc<[Contact]>,
}

impl Contacts {
    /// None yet.
    pub fn new(margin: f64) -> Contacts {
        Contacts { margin, epoch: 0, present: Vec::new(), shown: Vec::new().into() }
    }

    /// Takes in all pairs nearer than margin + 2 mm. `back`: whether the robot is being taken back, which is not followed to the
    /// hair: what it passed just beyond the margin touches only once it stops the way back. `moving`: whether the robot may be
    /// the one who caused them; `epoch`: the scene they were found in, since what an edit puts onto the robot is not the
    /// robot's doing either.
    pub fn update(&mut self, near: &[Contact], back: bool, moving: bool, epoch: u64) -> Changes {
        let mut changes = Changes::default();
        let edited = std::mem::replace(&mut self.epoch, epoch) != epoch;
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

    fn show(&mut self) {
        self.shown = self.present.iter().map(|t| t.contact).collect();
    }

    /// The present contacts.
    pub fn present(&self) -> &Arc<[Contact]> {
        &self.shown
    }
}

/// How near pairs may come while the robot backs out of contact: none begins, none gets deeper than it has been.
#[derive(Clone, Debug, Default)]
pub struct Floors {
    margin: f64,
    /// The least distances that were read so far.
    least: Vec<Contact>,
}

impl Floors {
    /// From the pairs near the robot as it was stopped, or sets out.
    pub fn new(margin: f64, near: &[Contact]) -> Floors {
        Floors { margin, least: near.to_vec() }
    }

    /// The pairs near it in another reading, before it is taken back: the way leads through there again.
    pub fn note(&mut self, near: &[Contact]) {
        for c in near {
            match self.least.iter_mut().find(|l| l.pair == c.pair) {
                Some(least) if least.distance <= c.distance => {}
                Some(least) => *least = *c,
                None => self.least.push(*c),
            }
        }
    }

    /// The pairs that touched, each where it was nearest.
    pub fn touched(&self) -> Vec<Contact> {
        self.least.iter().filter(|c| c.distance < self.margin).copied().collect()
    }

    /// The first pair that is nearer than it may be.
    pub fn broken<'a>(&self, near: &'a [Contact]) -> Option<&'a Contact> {
        near.iter().find(|c| {
            let start = self.least.iter().find(|l| l.pair == c.pair).map_or(self.margin, |l| l.distance);
            c.distance < start.min(self.margin) - DEEPER
        })
    }
}
