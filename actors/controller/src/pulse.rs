//! The pulse: every sample travels one chain, and each link adds what it knows.
//!
//! ```text
//! driver ──> history ──> model ──────> reflex ──> supervise ──lease──> driver
//!   q         speed      contacts       free
//! ```
//!
//! A sample that reaches supervise proves that all five live; supervise then renews the driver's lease. A death
//! anywhere breaks the chain, the lease runs out, and the robot brakes without anybody being told. A watchdog of its
//! own would have to be trusted as much as what it watches.

use crate::look_ahead::Foreseen;
use crate::simultaneous::note;
use mobee_contract::{AnswerTime, Sample, Time};
use mobee_model::Contact;
use std::sync::Arc;

/// A sample and what is known of it.
#[derive(Clone, Debug)]
pub struct Pulse {
    /// The reading.
    pub sample: Sample,
    /// How long the board took to answer of late, if that is known (driver).
    pub answers: Option<AnswerTime>,
    /// Greatest motor speed over the last readings, rad/s; infinite while there are too few (history).
    pub speed: f64,
    /// Since when the readings have been equal bit for bit (history).
    pub unchanged: Time,
    /// Reflex pairs nearer than margin + 2 mm, by the newest readings of all robots (model).
    pub contacts: Arc<[Contact]>,
    /// The pairs of this robot and others that were as near since its last reading, where all were at one instant, each
    /// where it was nearest (model).
    pub together: Arc<[Contact]>,
    /// The pairs of this robot that would come nearer than its reserve if it were stopped now (model).
    pub foreseen: Arc<[Foreseen]>,
    /// The first violated constraint: part and clause (model).
    pub violated: Option<(usize, usize)>,
    /// By how much the constraint that holds least is violated, in the units of its clause (model).
    pub depth: f64,
    /// Counts the edits of the scene in which the contacts were looked for (model).
    pub epoch: u64,
    /// What the fields about the robot's shapes do to its motors, if it moves under forces and they do anything
    /// (model).
    pub push: Option<Arc<[f64]>>,
    /// Whether nothing touches the robot and no constraint is violated (reflex).
    pub free: bool,
}

impl Pulse {
    /// The pairs near the robot, each once. Of those with another robot for which `along` holds only what was so at one
    /// instant: of two readings that are not of one instant the one may be of a place that the other has left. Of all others
    /// the nearest that is known.
    pub fn near(&self, along: impl Fn(&Contact) -> bool) -> Arc<[Contact]> {
        let two = |c: &Contact| matches!((c.pair.0.robot(), c.pair.1.robot()), (Some(a), Some(b)) if a != b);
        if self.together.is_empty() && !self.contacts.iter().any(|c| two(c) && along(c)) {
            return self.contacts.clone();
        }
        let mut near: Vec<Contact> = self.contacts.iter().filter(|c| !(two(c) && along(c))).copied().collect();
        self.together.iter().for_each(|c| note(&mut near, c));
        near.into()
    }

    /// A reading of which nothing else is known yet.
    pub fn new(sample: Sample, none: &Arc<[Contact]>) -> Pulse {
        let unchanged = sample.at;
        Pulse {
            sample,
            answers: None,
            speed: f64::INFINITY,
            unchanged,
            contacts: none.clone(),
            together: none.clone(),
            foreseen: Arc::default(),
            violated: None,
            depth: 0.0,
            epoch: 0,
            push: None,
            free: false,
        }
    }
}
