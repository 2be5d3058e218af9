//! I14: while several robots are retreating, no contact between two of them begins.
//!
//! A pair that touched as they were stopped may part and touch again: the way leads past there once more, and is watched (I9).

use super::{Found, Invariant};
use crate::record::journal::JournalLine;
use mobee_contract::Event;
use mobee_model::{Contact, ShapeId};

#[derive(Default)]
pub(super) struct Together {
    /// In the scene's order.
    robots: Vec<Robot>,
}

struct Robot {
    name: String,
    /// While it is retreating: the pairs that touched before.
    back: Option<Vec<Contact>>,
    /// Whether it stays where it is meanwhile: what comes near then is another's doing.
    waits: bool,
}

impl Together {
    fn turn(&mut self, name: &str, back: Option<Vec<Contact>>) {
        self.robots.iter_mut().filter(|r| r.name == name).for_each(|r| {
            r.back.clone_from(&back);
            r.waits = false;
        });
    }

    fn waits(&mut self, name: &str, waits: bool) {
        self.robots.iter_mut().filter(|r| r.name == name).for_each(|r| r.waits = waits);
    }

    /// The robot that a shape belongs to, if that is retreating.
    fn back(&self, shape: ShapeId) -> Option<(&Robot, &Vec<Contact>)> {
        let robot = self.robots.get(shape.robot()?)?;
        Some((robot, robot.back.as_ref().filter(|_| !robot.waits)?))
    }
}

impl Invariant for Together {
    fn on(&mut self, line: &JournalLine, found: &mut Found<'_>) {
        match &line.event {
            Event::Robot { robot, .. } if self.robots.iter().all(|r| r.name != *robot) => {
                self.robots.push(Robot { name: robot.clone(), back: None, waits: false });
            }
            Event::RetreatBegan { robot, near, .. } => self.turn(robot, Some(near.clone())),
            Event::RetreatWaits { robot, .. } => self.waits(robot, true),
            Event::RetreatGoesOn { robot } => self.waits(robot, false),
            Event::Disabled { robot, .. } | Event::RetreatStopped { robot, .. } | Event::Outcome { robot, .. } => {
                self.turn(robot, None);
            }
            Event::ContactBegan { contact, names: (a, b), .. } => {
                let pair = contact.pair;
                let (Some((one, of_one)), Some((other, of_other))) = (self.back(pair.0), self.back(pair.1)) else {
                    return;
                };
                if one.name != other.name && !of_one.iter().chain(of_other).any(|c| c.pair == pair) {
                    let mm = contact.distance * 1e3;
                    let (one, other) = (&one.name, &other.name);
                    found.say(format!("{a} and {b} came to {mm:.1} mm while {one} and {other} were retreating"));
                }
            }
            _ => {}
        }
    }
}
