//! Units of prismatic joints: boards use meters, and programs that use degrees and millimeters convert only
//! here.
//!
//! ```text
//! ours: deg, deg/s, deg/s^2; mm, mm/s, mm/s^2   ──to_wire──>     the wire: deg ...; m, m/s, m/s^2
//!                                               <──from_wire──
//! ```
//! Positions, speeds, accelerations, targets, references and limits are converted alike, because all of them
//! are lengths of the same joint. Torques, currents, duty cycles and all other values pass unchanged.

use super::ask::{Ask, Get, Set};
use super::{AxisFacts, Joints, Streamed};
use crate::{Bottle, Value, Vocab};
use std::sync::Arc;

/// Kind of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum JointKind {
    /// Revolute: degrees on both sides.
    #[default]
    Revolute,
    /// Prismatic: meters on the wire, millimeters in our units.
    Prismatic,
    /// Unknown: treated as revolute.
    Unknown,
}

impl JointKind {
    /// Number that boards send: four letters as an integer.
    pub fn code(self) -> i32 {
        let letters = match self {
            JointKind::Revolute => "atrv",
            JointKind::Prismatic => "atpr",
            JointKind::Unknown => "unkn",
        };
        Vocab::new(letters).0 as i32
    }

    /// Kind of a number that boards send.
    pub fn from_code(code: i32) -> JointKind {
        [JointKind::Revolute, JointKind::Prismatic].into_iter().find(|k| k.code() == code).unwrap_or(JointKind::Unknown)
    }

    /// Converts our number to the wire's: millimeters become meters.
    pub fn to_wire(self, ours: f64) -> f64 {
        if self == JointKind::Prismatic { ours / MILLI } else { ours }
    }

    /// Converts the wire's number to ours: meters become millimeters.
    pub fn from_wire(self, theirs: f64) -> f64 {
        if self == JointKind::Prismatic { theirs * MILLI } else { theirs }
    }
}

/// Millimeters in a meter.
const MILLI: f64 = 1000.0;

/// A conversion of one number.
type Convert = fn(JointKind, f64) -> f64;

/// Kinds of a board's joints, which determine the conversion of its numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Units(Arc<[JointKind]>);

impl Units {
    /// Units of joints of these kinds, in the board's order. Joints beyond them are treated as revolute.
    pub fn new(kinds: impl IntoIterator<Item = JointKind>) -> Units {
        Units(kinds.into_iter().collect())
    }

    /// Number of joints.
    pub fn axes(&self) -> usize {
        self.0.len()
    }

    /// Kind of a joint.
    pub fn kind(&self, joint: usize) -> JointKind {
        self.0.get(joint).copied().unwrap_or_default()
    }

    /// Converts a request to the wire's units.
    pub fn ask_to_wire(&self, ask: &Ask) -> Ask {
        self.convert_all(ask.clone(), JointKind::to_wire)
    }

    /// Converts a request to our units.
    pub fn ask_from_wire(&self, ask: Ask) -> Ask {
        self.convert_all(ask, JointKind::from_wire)
    }

    /// Converts setpoints to the wire's units.
    pub fn streamed_to_wire(&self, command: Streamed) -> Streamed {
        self.streamed(command, JointKind::to_wire)
    }

    /// Converts setpoints to our units.
    pub fn streamed_from_wire(&self, command: Streamed) -> Streamed {
        self.streamed(command, JointKind::from_wire)
    }

    /// Converts the answer to a query to our units. Values that are not numbers of a joint's motion are
    /// unchanged.
    pub fn answer_from_wire(&self, ask: &Ask, answer: Bottle) -> Bottle {
        let (joints, places) = match ask {
            Ask::Get(Get::Values(_, joints)) => (joints.clone(), 2..3),
            Ask::Get(Get::Limits(joint) | Get::SpeedLimits(joint)) => (Joints::One(*joint), 2..4),
            _ => return answer,
        };
        let mut answer = answer;
        let kinds = self.of(&joints);
        for place in answer.0.get_mut(places).unwrap_or_default() {
            let slots: Vec<&mut Value> = match place {
                Value::List(list) => list.0.iter_mut().collect(),
                one => vec![one],
            };
            for (slot, kind) in slots.into_iter().zip(&kinds).filter(|(_, kind)| **kind == JointKind::Prismatic) {
                if let Some(number) = slot.as_f64() {
                    *slot = Value::Float64(kind.from_wire(number));
                }
            }
        }
        answer
    }

    /// Converts facts of a joint to our units.
    pub fn facts_from_wire(&self, joint: usize, facts: &AxisFacts) -> AxisFacts {
        let ours = |v: f64| self.kind(joint).from_wire(v);
        AxisFacts {
            name: facts.name.clone(),
            kind: facts.kind,
            limits: facts.limits.map(|(min, max)| (ours(min), ours(max))),
            max_speed: facts.max_speed.map(ours),
        }
    }

    fn convert_all(&self, mut ask: Ask, convert: Convert) -> Ask {
        let Ask::Set(set) = &mut ask else { return ask };
        match set {
            Set::Move { joints, values, .. }
            | Set::Speed(joints, values)
            | Set::Acceleration(joints, values)
            | Set::Encoders(joints, values) => self.convert(joints, values, convert),
            Set::Velocity(values) => self.convert(&Joints::All, values, convert),
            Set::Limits(joint, min, max) | Set::SpeedLimits(joint, min, max) => {
                let kind = self.kind(*joint);
                (*min, *max) = (convert(kind, *min), convert(kind, *max));
            }
            Set::Stop(_) | Set::ResetEncoders(_) | Set::Mode(..) | Set::Interaction(..) => {}
        }
        ask
    }

    fn streamed(&self, mut command: Streamed, convert: Convert) -> Streamed {
        match &mut command {
            Streamed::Velocity(joints, values) | Streamed::Direct(joints, values) => {
                self.convert(joints, values, convert);
            }
            Streamed::Move(values) => self.convert(&Joints::All, values, convert),
        }
        command
    }

    fn convert(&self, joints: &Joints, values: &mut [f64], convert: Convert) {
        for (value, kind) in values.iter_mut().zip(self.of(joints)) {
            *value = convert(kind, *value);
        }
    }

    /// Kinds of these joints, in the order of their values.
    fn of(&self, joints: &Joints) -> Vec<JointKind> {
        match joints {
            Joints::One(joint) => vec![self.kind(*joint)],
            Joints::All => self.0.to_vec(),
            Joints::Group(group) => group.iter().map(|joint| self.kind(*joint)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::Quantity;

    fn units() -> Units {
        Units::new([JointKind::Revolute, JointKind::Prismatic, JointKind::Unknown])
    }

    /// All orders with numbers: prismatic joints use meters on the wire, revolute joints are unchanged, and
    /// converting back gives the original.
    #[test]
    fn orders_count_meters_where_a_joint_slides() {
        let group = || Joints::Group(vec![1, 0]);
        let moves = |joints, values, relative| Set::Move { joints, values, relative };
        let cases = [
            (moves(group(), vec![250.0, 30.0], false), "[set] [posg] 2 (1 0) (0.25 30.0)"),
            (moves(Joints::One(1), vec![-250.0], true), "[set] [rel] 1 -0.25"),
            (moves(Joints::All, vec![1.0, 500.0, 1.0], false), "[set] [poss] (1.0 0.5 1.0)"),
            (Set::Velocity(vec![10.0, 500.0, 10.0]), "[set] [vmos] (10.0 0.5 10.0)"),
            (Set::Speed(group(), vec![125.0, 8.0]), "[set] [velg] 2 (1 0) (0.125 8.0)"),
            (Set::Acceleration(group(), vec![125.0, 8.0]), "[set] [accg] 2 (1 0) (0.125 8.0)"),
            (Set::Encoders(Joints::One(1), vec![500.0]), "[set] [enc] 1 0.5"),
            (Set::Limits(1, 0.0, 1500.0), "[set] [llim] 1 0.0 1.5"),
            (Set::SpeedLimits(1, 0.0, 500.0), "[set] [vlim] 1 0.0 0.5"),
            (Set::Limits(0, -90.0, 90.0), "[set] [llim] 0 -90.0 90.0"),
        ];
        for (set, written) in cases {
            let ours = Ask::Set(set);
            let wire = units().ask_to_wire(&ours);
            assert_eq!(wire.bottle().to_string(), written);
            assert_eq!(units().ask_from_wire(wire), ours);
        }
    }

    #[test]
    fn set_points_count_meters_where_a_joint_slides() {
        let group = Joints::Group(vec![2, 1]);
        for make in [Streamed::Velocity, Streamed::Direct] {
            let ours = make(group.clone(), vec![7.0, 125.0]);
            let wire = units().streamed_to_wire(ours.clone());
            assert_eq!(wire, make(group.clone(), vec![7.0, 0.125]));
            assert_eq!(units().streamed_from_wire(wire), ours);
        }
        let all = Streamed::Move(vec![7.0, 125.0, 7.0]);
        assert_eq!(units().streamed_to_wire(all), Streamed::Move(vec![7.0, 0.125, 7.0]));
    }

    /// Answers have their numbers in several places; modes, names and stamps are not converted.
    #[test]
    fn answers_count_millimeters_where_a_joint_slides() {
        let read = |get: Get, wire: &str| {
            let answer = Bottle::parse(wire, crate::Dialect::V3).unwrap();
            units().answer_from_wire(&Ask::Get(get), answer).to_string()
        };
        let quantities = [Quantity::Encoder, Quantity::EncoderSpeed, Quantity::EncoderAcceleration, Quantity::Target]
            .into_iter()
            .chain([Quantity::ReferenceSpeed, Quantity::ReferenceAcceleration, Quantity::Velocity, Quantity::Direct]);
        for quantity in quantities {
            let all = Get::Values(quantity, Joints::All);
            let wire = "[is] [x] (0.5 0.5 0.5) [tsta] 1 2.0 [ok]";
            assert_eq!(read(all, wire), "[is] [x] (0.5 500.0 0.5) [tsta] 1 2.0 [ok]");
            let one = Get::Values(quantity, Joints::One(1));
            assert_eq!(read(one, "[is] [x] 0.25 [tsta] 1 2.0 [ok]"), "[is] [x] 250.0 [tsta] 1 2.0 [ok]");
        }
        let pair = "[is] [llim] -0.5 1.5 [tsta] 1 2.0 [ok]";
        assert_eq!(read(Get::Limits(1), pair), "[is] [llim] -500.0 1500.0 [tsta] 1 2.0 [ok]");
        assert_eq!(read(Get::SpeedLimits(0), pair), pair);
        assert_eq!(read(Get::Done(Joints::All), "[is] [dons] 1 [tsta] 1 2.0 [ok]"), "[is] [dons] 1 [tsta] 1 2.0 [ok]");
        assert_eq!(read(Get::Limits(1), "[fail]"), "[fail]");
        let facts = AxisFacts {
            name: "rail".into(),
            kind: JointKind::Prismatic,
            limits: Some((-0.5, 1.5)),
            max_speed: Some(0.25),
        };
        let ours = units().facts_from_wire(1, &facts);
        assert_eq!((ours.limits, ours.max_speed), (Some((-500.0, 1500.0)), Some(250.0)));
        assert_eq!(units().facts_from_wire(0, &facts), facts);
    }
}
