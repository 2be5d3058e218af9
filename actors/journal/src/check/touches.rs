//! Hard contacts, counted as episodes. An episode begins when a shape of a robot reaches distance zero to
//! another robot, an object or the robot itself. It ends when no shapes of the two are in contact any more,
//! however many touch in between.

use mobee_contract::{Event, SwapPart, SwapStep};
use mobee_model::{Contact, Pair, ShapeId};
use std::collections::BTreeMap;

/// A robot or an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum ContactBody {
    Robot(usize),
    Object(u32),
}

impl ContactBody {
    fn of(shape: ShapeId) -> ContactBody {
        match shape {
            ShapeId::Robot { robot, .. } => ContactBody::Robot(robot.into()),
            ShapeId::Object { object, .. } => ContactBody::Object(object),
        }
    }

    fn both(pair: &Pair) -> (ContactBody, ContactBody) {
        let a = ContactBody::of(pair.0);
        let b = ContactBody::of(pair.1);
        if a <= b { (a, b) } else { (b, a) }
    }
}

/// A hard contact as reported by one robot: the robot, and the names of the shapes.
type Reported = (String, (String, String));

/// Tracks the hard contacts of a run through its events.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Touches {
    /// Pairs that touched and are still in contact, by their two bodies.
    touching: BTreeMap<(ContactBody, ContactBody), BTreeMap<Reported, Pair>>,
    /// Number of episodes so far.
    pub episodes: u64,
    /// Greatest penetration depth so far, meters.
    pub depth: f64,
}

impl Touches {
    /// Takes the next event.
    ///
    /// # Returns
    /// True if an episode begins with it.
    pub fn note(&mut self, event: &Event) -> bool {
        match event {
            Event::HardContact { robot, contact, names } => {
                self.deepen(contact);
                let pairs = self.touching.entry(ContactBody::both(&contact.pair)).or_default();
                let begins = pairs.is_empty();
                pairs.insert((robot.clone(), names.clone()), contact.pair);
                self.episodes += u64::from(begins);
                return begins;
            }
            // Distances of the pairs after the robot has braked.
            Event::RetreatBegan { near, .. } => {
                let touches = |c: &&Contact| {
                    let pairs = self.touching.get(&ContactBody::both(&c.pair));
                    pairs.is_some_and(|pairs| pairs.values().any(|pair| *pair == c.pair))
                };
                let deepest: Vec<Contact> = near.iter().filter(touches).copied().collect();
                deepest.iter().for_each(|c| self.deepen(c));
            }
            Event::ContactEnded { robot, names, depth } => {
                self.depth = self.depth.max(depth.unwrap_or_default());
                let reported = (robot.clone(), names.clone());
                self.touching.retain(|_, pairs| {
                    pairs.remove(&reported);
                    !pairs.is_empty()
                });
            }
            // A restarted reflex does not report the end of a contact whose beginning it has not seen.
            Event::Restarted { .. } | Event::Resumed { .. } => self.touching.clear(),
            Event::Swap { part: SwapPart::Controller | SwapPart::Driver, step: SwapStep::TookOver { .. }, .. } => {
                self.touching.clear();
            }
            _ => {}
        }
        false
    }

    fn deepen(&mut self, contact: &Contact) {
        self.depth = self.depth.max(-contact.distance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    fn hard(robot: &str, node: u16, other: ShapeId, mm: f64) -> Event {
        let pair = (ShapeId::Robot { robot: 0, node, shape: 0 }, other);
        let contact = Contact { pair, distance: mm * 1e-3, points: [Point3::origin(); 2] };
        Event::HardContact { robot: robot.into(), contact, names: (format!("left/{node}"), format!("{other:?}")) }
    }

    fn ended(robot: &str, node: u16, other: ShapeId, depth: f64) -> Event {
        let names = (format!("left/{node}"), format!("{other:?}"));
        Event::ContactEnded { robot: robot.into(), names, depth: Some(depth * 1e-3) }
    }

    #[test]
    fn the_shapes_of_two_bodies_that_touch_at_once_are_one_contact() {
        let arm = ShapeId::Robot { robot: 1, node: 3, shape: 0 };
        let ball = ShapeId::Object { object: 0, shape: 0 };
        let mut touches = Touches::default();
        let begins: Vec<bool> = [
            hard("left", 1, arm, -0.5),
            hard("right", 1, arm, -0.5),
            hard("left", 2, arm, -1.0),
            hard("left", 2, ball, 0.0),
            ended("left", 1, arm, 7.0),
            ended("left", 2, arm, 2.0),
            hard("left", 1, arm, 0.0),
            ended("right", 1, arm, 0.5),
            ended("left", 1, arm, 0.1),
            hard("left", 1, arm, 0.0),
        ]
        .iter()
        .map(|event| touches.note(event))
        .collect();
        assert_eq!(begins, [true, false, false, true, false, false, false, false, false, true]);
        assert_eq!((touches.episodes, touches.depth), (3, 0.007));
    }
}
