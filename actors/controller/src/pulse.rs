//! The pulse: each sample passes through one chain, and each link adds what it computes.
//!
//! ```text
//! driver ──> history ──> model ──────> reflex ──> supervise ──lease──> driver
//!   q         speed      contacts       free
//! ```
//!
//! A sample that reaches Supervise proves that all five links are alive; Supervise then renews the driver's lease. If
//! any link dies, the chain breaks, the lease expires and the robot brakes without any notification. A separate
//! watchdog would have to be as trustworthy as the chain it watches.

use crate::history::BridgedGap;
use crate::load_model::Unexplained;
use crate::look_ahead::Foreseen;
use crate::simultaneous::note;
use mobee_contract::{AnswerTime, Sample, Time};
use mobee_model::Contact;
use std::sync::Arc;

/// A sample and everything derived from it.
#[derive(Clone, Debug)]
pub struct Pulse {
    /// The reading.
    pub sample: Sample,
    /// Recent answer time of the board, if it is measured (driver).
    pub answers: Option<AnswerTime>,
    /// Load of each motor that the arm's weight does not explain, where the board reports loads (driver).
    pub unexplained: Arc<[Option<Unexplained>]>,
    /// Greatest motor speed over the last readings, rad/s; infinite while there are too few readings (history).
    pub speed: f64,
    /// BridgedGap over the gap before this reading, if there was one (history).
    pub bridged: Option<BridgedGap>,
    /// Time since which the readings have been equal bit for bit (history).
    pub unchanged: Time,
    /// Reflex pairs closer than margin + 2 mm, by the newest readings of all robots (model).
    pub contacts: Arc<[Contact]>,
    /// Pairs of this robot and other robots that were closer than margin + 2 mm since its last reading, evaluated at
    /// common instants; each at its least distance (model).
    pub together: Arc<[Contact]>,
    /// Pairs of this robot that would get closer than its braking clearance if it were stopped now (model).
    pub foreseen: Arc<[Foreseen]>,
    /// First violated constraint: indices of part and clause (model).
    pub violated: Option<(usize, usize)>,
    /// Depth of the worst constraint violation, in the units of its clause (model).
    pub depth: f64,
    /// Edit count of the scene in which the contacts were computed (model).
    pub epoch: u64,
    /// Effect of the fields around the robot's shapes on its motors, if the robot moves under forces and the effect is
    /// not zero (model).
    pub push: Option<Arc<[f64]>>,
    /// True if nothing touches the robot and no constraint is violated (reflex).
    pub free: bool,
}

impl Pulse {
    /// Returns the pairs near the robot, each once. Among pairs with another robot, those for which `along` holds are
    /// taken only from common instants: two readings of different instants may show one robot where the other no longer
    /// is. Of all other pairs the smallest known distance is taken.
    pub fn near(&self, along: impl Fn(&Contact) -> bool) -> Arc<[Contact]> {
        let two = |c: &Contact| matches!((c.pair.0.robot(), c.pair.1.robot()), (Some(a), Some(b)) if a != b);
        if self.together.is_empty() && !self.contacts.iter().any(|c| two(c) && along(c)) {
            return self.contacts.clone();
        }
        let mut near: Vec<Contact> = self.contacts.iter().filter(|c| !(two(c) && along(c))).copied().collect();
        self.together.iter().for_each(|c| note(&mut near, c));
        near.into()
    }

    /// A pulse with only the reading filled in.
    pub fn new(sample: Sample, none: &Arc<[Contact]>) -> Pulse {
        let unchanged = sample.at;
        Pulse {
            sample,
            answers: None,
            unexplained: Arc::default(),
            speed: f64::INFINITY,
            bridged: None,
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
