//! I14: while several robots are retreating, no contact between two of them begins.
//!
//! A pair that was in contact when the robots were stopped may separate and touch again: the retreat path
//! passes that point a second time, and I9 watches it. An arm whose joints deflect under load sags differently on
//! the way back: its contacts count below half of the margin, as for I9.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::{CommandKind, Event, Writer};
use mobee_model::{Contact, ShapeId};

#[derive(Default)]
pub(super) struct Together {
    /// Robots in the scene's order.
    robots: Vec<JointRetreatWatch>,
}

struct JointRetreatWatch {
    name: String,
    /// Distance below which a contact with it counts, meters.
    counts: f64,
    /// While it is retreating: the pairs that were near at the start.
    back: Option<Vec<Contact>>,
    /// Length of its path: configurations, and the bits of the seconds. They are equal for the robots of one
    /// plan, and for no others.
    plan: (usize, u64),
    /// True while it, and the robots of its plan with it, wait for a robot that blocks the path: a contact is
    /// then caused by that one.
    waits: bool,
    /// True if its reflex stopped it for a new start: the robots of its plan separate, each at its own time.
    stopped: bool,
}

impl Together {
    fn set_retreat(&mut self, name: &str, back: Option<Vec<Contact>>) {
        self.of(name, |r| {
            r.back.clone_from(&back);
            (r.waits, r.stopped) = (false, false);
        });
    }

    fn of(&mut self, name: &str, change: impl FnMut(&mut JointRetreatWatch)) {
        self.robots.iter_mut().filter(|r| r.name == name).for_each(change);
    }

    /// The robot of a shape with the pairs near at its start, if it is retreating and in motion.
    fn back(&self, shape: ShapeId) -> Option<(&JointRetreatWatch, &Vec<Contact>)> {
        let robot = self.robots.get(shape.robot()?)?;
        let holds_up = |r: &JointRetreatWatch| r.back.is_some() && r.waits && r.plan == robot.plan;
        let rests = robot.stopped || self.robots.iter().any(holds_up);
        Some((robot, robot.back.as_ref().filter(|_| !rests)?))
    }
}

impl Invariant for Together {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, margin, deflection, .. } if self.robots.iter().all(|r| r.name != *robot) => {
                self.robots.push(JointRetreatWatch {
                    name: robot.clone(),
                    counts: if *deflection > 0.0 { 0.5 * margin } else { f64::INFINITY },
                    back: None,
                    plan: (0, 0),
                    waits: false,
                    stopped: false,
                });
            }
            Event::RetreatBegan { robot, near, poses, secs, .. } => {
                self.set_retreat(robot, Some(near.clone()));
                self.of(robot, |r| r.plan = (*poses, secs.to_bits()));
            }
            Event::RetreatWaits { robot, .. } => self.of(robot, |r| r.waits = true),
            Event::Command { robot, writer: Writer::Reflex, kind: CommandKind::Stop, .. } => {
                self.of(robot, |r| r.stopped = true);
            }
            Event::RetreatGoesOn { robot } => self.of(robot, |r| r.waits = false),
            Event::Disabled { robot, .. } | Event::RetreatStopped { robot, .. } | Event::Outcome { robot, .. } => {
                self.set_retreat(robot, None);
            }
            Event::ContactBegan { contact, names: (a, b), .. } => {
                let pair = contact.pair;
                let (Some((one, of_one)), Some((other, of_other))) = (self.back(pair.0), self.back(pair.1)) else {
                    return;
                };
                let counts = contact.distance < one.counts.min(other.counts);
                if counts && one.name != other.name && !of_one.iter().chain(of_other).any(|c| c.pair == pair) {
                    let mm = contact.distance * 1e3;
                    let one = &one.name;
                    let other = &other.name;
                    found.report(format!("{a} and {b} came to {mm:.1} mm while {one} and {other} were retreating"));
                }
            }
            _ => {}
        }
    }
}
