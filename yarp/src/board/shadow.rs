//! State of a board, and every answer that follows from it (spec section 12.2).

use super::JointKind;
use super::ask::{Ask, Get, Quantity};
use super::joints::{Joints, floats, int, vocab_list};
use super::{mode, reply, words};
use crate::{Bottle, Stamp, Value, Vocab};

/// One joint of a [`Shadow`] in the units of the wire: deg, deg/s, deg/s^2; m, m/s, m/s^2 for prismatic
/// joints.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowAxis {
    /// Name of the joint.
    pub name: String,
    /// Kind of the joint.
    pub kind: JointKind,
    /// Lower limit.
    pub min: f64,
    /// Upper limit.
    pub max: f64,
    /// Greatest speed; the least is reported as 0.
    pub max_speed: f64,
    /// Encoder.
    pub q: f64,
    /// Encoder speed.
    pub speed: f64,
    /// Encoder acceleration.
    pub acc: f64,
    /// Target of the last position move.
    pub target: f64,
    /// Reference speed of position moves.
    pub ref_speed: f64,
    /// Reference acceleration of position moves.
    pub ref_acc: f64,
    /// Control mode.
    pub mode: Vocab,
    /// Interaction mode.
    pub interaction: Vocab,
    /// Motion done.
    pub done: bool,
    /// Last commanded velocity.
    pub vel_ref: f64,
    /// Last position-direct setpoint.
    pub direct_ref: f64,
    /// Torque that the joint exerts, N m (N for prismatic joints); `None` if the board does not measure it.
    pub torque: Option<f64>,
}

impl ShadowAxis {
    /// A stiff revolute joint at rest at `q`, in position mode, with a tenth of the greatest speed as reference.
    pub fn at_rest(name: impl Into<String>, min: f64, max: f64, max_speed: f64, q: f64) -> ShadowAxis {
        ShadowAxis {
            name: name.into(),
            kind: JointKind::Revolute,
            min,
            max,
            max_speed,
            q,
            speed: 0.0,
            acc: 0.0,
            target: q,
            ref_speed: 0.1 * max_speed,
            ref_acc: max_speed,
            mode: mode::POSITION,
            interaction: mode::STIFF,
            done: true,
            vel_ref: 0.0,
            direct_ref: q,
            torque: None,
        }
    }

    /// Changes the kind of the joint, and converts its numbers from our units to the wire's.
    pub fn count_as(&mut self, kind: JointKind) {
        self.kind = kind;
        let numbers = [&mut self.min, &mut self.max, &mut self.max_speed, &mut self.q, &mut self.speed, &mut self.acc];
        let set = [&mut self.target, &mut self.ref_speed, &mut self.ref_acc, &mut self.vel_ref, &mut self.direct_ref];
        for number in numbers.into_iter().chain(set) {
            *number = kind.to_wire(*number);
        }
    }

    fn reading(&self, reading: Quantity) -> f64 {
        match reading {
            Quantity::Encoder => self.q,
            Quantity::EncoderSpeed => self.speed,
            Quantity::EncoderAcceleration => self.acc,
            Quantity::Target => self.target,
            Quantity::ReferenceSpeed => self.ref_speed,
            Quantity::ReferenceAcceleration => self.ref_acc,
            Quantity::Velocity => self.vel_ref,
            Quantity::Direct => self.direct_ref,
        }
    }
}

/// State of a board, in degrees (meters for prismatic joints) and its joint order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shadow {
    /// Joints of the board.
    pub axes: Vec<ShadowAxis>,
}

impl Shadow {
    /// Answer to a query that can be answered from the state; `[fail]` for a joint that does not exist,
    /// `[nak]` for fewer than two words. `None` if it is not a known query.
    ///
    /// `stamp` belongs to this answer; a board counts its answers.
    pub fn answer(&self, request: &Bottle, stamp: Stamp) -> Option<Bottle> {
        if request.0.len() < 2 {
            return Some(reply::nak());
        }
        let ask = Ask::parse(request)?;
        if !ask.fits(self.axes.len()) {
            return matches!(ask, Ask::Get(_)).then(reply::fail);
        }
        let Ask::Get(get) = ask else { return None };
        let mut to = Vec::with_capacity(8);
        // codes are echoed as received: a string stays a string
        let echo = |to: &mut Vec<Value>, nth: usize| {
            to.push(Value::Vocab(words::IS));
            to.extend(request.0.get(nth).cloned());
        };
        match &get {
            Get::Version => {
                let version = [1, 9, 0].map(Value::Int32);
                let code = request.0.get(1).cloned();
                return Some(Bottle(code.into_iter().chain(version).chain([Value::Vocab(words::OK)]).collect()));
            }
            // the reply for one joint's mode has its number instead of the code, and those for interaction
            // modes have neither
            Get::Modes(Joints::One(_)) => echo(&mut to, 3),
            Get::Modes(_) => echo(&mut to, 2),
            Get::Interactions(_) => {}
            _ => echo(&mut to, 1),
        }
        self.values(&get, &mut to)?;
        to.extend([
            Value::Vocab(words::STAMP),
            Value::Int32(stamp.count as i32),
            Value::Float64(stamp.time),
            Value::Vocab(words::OK),
        ]);
        Some(Bottle(to))
    }

    fn values(&self, get: &Get, to: &mut Vec<Value>) -> Option<()> {
        let n = self.axes.len();
        let axis = |j: &usize| self.axes.get(*j);
        match get {
            Get::Version => return None,
            Get::Axes | Get::Motors | Get::MotorEncoders => to.push(int(n)),
            Get::Name(j) => to.push(Value::String(crate::Text(axis(j)?.name.clone().into_bytes()))),
            Get::Kind(j) => to.push(Value::Int32(axis(j)?.kind.code())),
            Get::Limits(j) => to.extend([axis(j)?.min, axis(j)?.max].map(Value::Float64)),
            Get::SpeedLimits(j) => to.extend([0.0, axis(j)?.max_speed].map(Value::Float64)),
            Get::Done(joints) => {
                let done = joints.on(n)?.iter().filter_map(axis).all(|a| a.done);
                to.push(Value::Int32(i32::from(done)));
            }
            Get::Values(reading, Joints::One(j)) => to.push(Value::Float64(axis(j)?.reading(*reading))),
            Get::Values(reading, joints) => {
                let values: Vec<f64> = joints.on(n)?.iter().filter_map(axis).map(|a| a.reading(*reading)).collect();
                to.push(floats(&values));
            }
            Get::Modes(joints) => to.push(self.vocabs(joints, |a| a.mode)?),
            Get::Interactions(joints) => to.push(self.vocabs(joints, |a| a.interaction)?),
        }
        Some(())
    }

    fn vocabs(&self, joints: &Joints, of: impl Fn(&ShadowAxis) -> Vocab) -> Option<Value> {
        let all: Vec<Vocab> = joints.on(self.axes.len())?.iter().filter_map(|j| self.axes.get(*j)).map(of).collect();
        match (joints, all.as_slice()) {
            (Joints::One(_), [one]) => Some(Value::Vocab(*one)),
            _ => Some(vocab_list(&all)),
        }
    }
}
