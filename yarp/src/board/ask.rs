//! A parsed request to a board's `rpc:i` (spec section 12.2).

use super::joints::{CodeSuffix, Joints, floats, index, int, numbers, vocab_list, vocabs};
use super::words;
use crate::{Bottle, Value, Vocab};

/// Part of the RPC that a board for arms needs: its queries and orders.
#[derive(Clone, Debug, PartialEq)]
pub enum Ask {
    /// A query; it changes nothing.
    Get(Get),
    /// An order.
    Set(Set),
}

/// Queries.
#[derive(Clone, Debug, PartialEq)]
pub enum Get {
    /// Version of the protocol.
    Version,
    /// Number of axes.
    Axes,
    /// Number of motors (`mtnm`).
    Motors,
    /// Number of motor encoders (`mnum`).
    MotorEncoders,
    /// Name of a joint.
    Name(usize),
    /// Kind of a joint.
    Kind(usize),
    /// Position limits of a joint.
    Limits(usize),
    /// Speed limits of a joint.
    SpeedLimits(usize),
    /// One number per joint.
    Values(Quantity, Joints),
    /// True if all these joints have done their motion.
    Done(Joints),
    /// Control modes.
    Modes(Joints),
    /// Interaction modes.
    Interactions(Joints),
}

/// Quantity with one number per joint: in degrees here, in meters for prismatic joints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Encoder, deg.
    Encoder,
    /// Encoder speed, deg/s.
    EncoderSpeed,
    /// Encoder acceleration, deg/s^2.
    EncoderAcceleration,
    /// Target of position moves, deg.
    Target,
    /// Reference speed of position moves, deg/s.
    ReferenceSpeed,
    /// Reference acceleration of position moves, deg/s^2.
    ReferenceAcceleration,
    /// Commanded velocity, deg/s.
    Velocity,
    /// Position-direct setpoint, deg.
    Direct,
}

/// Orders. Degrees, or meters for prismatic joints. Lists of values have the joints' length where that is
/// known without the board ([`Ask::fits`] checks the rest).
#[derive(Clone, Debug, PartialEq)]
pub enum Set {
    /// A position move, deg.
    Move {
        /// Joints.
        joints: Joints,
        /// Targets, or distances if `relative`.
        values: Vec<f64>,
        /// True if the values are relative to the present positions.
        relative: bool,
    },
    /// A velocity move of all joints, deg/s. (Over RPC only all exist.)
    Velocity(Vec<f64>),
    /// Stop.
    Stop(Joints),
    /// Reference speeds, deg/s.
    Speed(Joints, Vec<f64>),
    /// Reference accelerations, deg/s^2.
    Acceleration(Joints, Vec<f64>),
    /// Control modes.
    Mode(Joints, Vec<Vocab>),
    /// Interaction modes.
    Interaction(Joints, Vec<Vocab>),
    /// Position limits of a joint, deg.
    Limits(usize, f64, f64),
    /// Speed limits of a joint, deg/s.
    SpeedLimits(usize, f64, f64),
    /// Sets encoders to zero.
    ResetEncoders(Joints),
    /// Sets encoders, deg.
    Encoders(Joints, Vec<f64>),
}

const READINGS: [(Quantity, Vocab); 8] = [
    (Quantity::Encoder, Vocab::new("enc")),
    (Quantity::EncoderSpeed, Vocab::new("esp")),
    (Quantity::EncoderAcceleration, Vocab::new("eac")),
    (Quantity::Target, Vocab::new("pos")),
    (Quantity::ReferenceSpeed, Vocab::new("vel")),
    (Quantity::ReferenceAcceleration, Vocab::new("acc")),
    (Quantity::Velocity, Vocab::new("vmo")),
    (Quantity::Direct, Vocab::new("dpo")),
];
const DONE: Vocab = Vocab::new("don");
const MOVE: Vocab = Vocab::new("pos");
const RELATIVE: Vocab = Vocab::new("rel");
const STOP: Vocab = Vocab::new("sto");
const SPEED: Vocab = Vocab::new("vel");
const ACCELERATION: Vocab = Vocab::new("acc");
const VELOCITY: Vocab = Vocab::new("vmo");
const ENCODER: Vocab = Vocab::new("enc");
const RESET: Vocab = Vocab::new("ere");
const MODES: [Vocab; 3] = [Vocab::new("cmod"), Vocab::new("cmds"), Vocab::new("cmog")];
const INTERACTIONS: [Vocab; 3] = [Vocab::new("mode"), Vocab::new("mods"), Vocab::new("modg")];

impl Ask {
    /// Parses a request. `None` if it is unknown, or if it can be recognized as malformed without the board;
    /// the answer is then [`super::reply::unknown`], or that of another layer (amplifiers, torques, PIDs,
    /// calibration).
    ///
    /// Vocabs may be strings of up to four letters, numbers of any kind. Anything after a complete request is
    /// ignored.
    pub fn parse(request: &Bottle) -> Option<Ask> {
        let (verb, words) = request.0.split_first()?;
        let (code, words) = words.split_first()?;
        let verb = verb.as_vocab()?;
        let code = code.as_vocab()?;
        if verb == words::GET {
            Get::parse(code, words).map(Ask::Get)
        } else if verb == words::SET {
            Set::parse(code, words).map(Ask::Set)
        } else {
            None
        }
    }

    /// True if joints and lists fit a board with this number of axes: every index exists, and "all" lists
    /// have exactly its length.
    pub fn fits(&self, axes: usize) -> bool {
        let known = |joints: &Joints| joints.on(axes).is_some();
        let filled = |joints: &Joints, n: usize| joints.on(axes).is_some_and(|j| j.len() == n);
        match self {
            Ask::Get(get) => match get {
                Get::Version | Get::Axes | Get::Motors | Get::MotorEncoders => true,
                Get::Name(j) | Get::Kind(j) | Get::Limits(j) | Get::SpeedLimits(j) => *j < axes,
                Get::Values(_, joints) | Get::Done(joints) | Get::Modes(joints) | Get::Interactions(joints) => {
                    known(joints)
                }
            },
            Ask::Set(set) => match set {
                Set::Move { joints, values, .. }
                | Set::Speed(joints, values)
                | Set::Acceleration(joints, values)
                | Set::Encoders(joints, values) => filled(joints, values.len()),
                Set::Velocity(values) => values.len() == axes,
                Set::Mode(joints, modes) | Set::Interaction(joints, modes) => filled(joints, modes.len()),
                Set::Stop(joints) | Set::ResetEncoders(joints) => known(joints),
                Set::Limits(j, ..) | Set::SpeedLimits(j, ..) => *j < axes,
            },
        }
    }

    /// The request as the original client writes it.
    pub fn bottle(&self) -> Bottle {
        let mut to = Vec::new();
        match self {
            Ask::Get(get) => get.write(&mut to),
            Ask::Set(set) => set.write(&mut to),
        }
        Bottle(to)
    }
}

impl Get {
    fn parse(code: Vocab, words: &[Value]) -> Option<Get> {
        let joint = || words.first().and_then(index);
        match code {
            words::PROTOCOL => return Some(Get::Version),
            words::AXES => return Some(Get::Axes),
            words::MOTORS => return Some(Get::Motors),
            words::MOTOR_ENCODERS => return Some(Get::MotorEncoders),
            words::NAME => return joint().map(Get::Name),
            words::KIND => return joint().map(Get::Kind),
            words::LIMITS => return joint().map(Get::Limits),
            words::SPEED_LIMITS => return joint().map(Get::SpeedLimits),
            words::CONTROL_MODE => return nested(MODES, words).map(|(joints, _)| Get::Modes(joints)),
            words::INTERACTION => return nested(INTERACTIONS, words).map(|(joints, _)| Get::Interactions(joints)),
            _ => {}
        }
        let (family, shape) = CodeSuffix::of(code)?;
        let (joints, _) = Joints::read(shape, words)?;
        if family == DONE {
            return Some(Get::Done(joints));
        }
        let (reading, _) = READINGS.iter().find(|(_, f)| *f == family)?;
        let grouped = matches!(joints, Joints::Group(_));
        let encoder = matches!(reading, Quantity::Encoder | Quantity::EncoderSpeed | Quantity::EncoderAcceleration);
        (!(grouped && encoder)).then_some(Get::Values(*reading, joints))
    }

    fn write(&self, to: &mut Vec<Value>) {
        to.push(Value::Vocab(words::GET));
        let mut word = |code: Vocab, joint: Option<usize>| {
            to.push(Value::Vocab(code));
            to.extend(joint.map(int));
        };
        match self {
            Get::Version => word(words::PROTOCOL, None),
            Get::Axes => word(words::AXES, None),
            Get::Motors => word(words::MOTORS, None),
            Get::MotorEncoders => word(words::MOTOR_ENCODERS, None),
            Get::Name(j) => word(words::NAME, Some(*j)),
            Get::Kind(j) => word(words::KIND, Some(*j)),
            Get::Limits(j) => word(words::LIMITS, Some(*j)),
            Get::SpeedLimits(j) => word(words::SPEED_LIMITS, Some(*j)),
            Get::Values(reading, joints) => {
                let family = READINGS.iter().find(|(r, _)| r == reading).map_or(Vocab(0), |(_, f)| *f);
                write_family(to, family, joints);
            }
            Get::Done(joints) => write_family(to, DONE, joints),
            Get::Modes(joints) => write_nested(to, words::CONTROL_MODE, MODES, joints),
            Get::Interactions(joints) => write_nested(to, words::INTERACTION, INTERACTIONS, joints),
        }
    }
}

impl Set {
    fn parse(code: Vocab, words: &[Value]) -> Option<Set> {
        match code {
            words::CONTROL_MODE => {
                let (joints, rest) = nested(MODES, words)?;
                let modes = modes(&joints, rest)?;
                return Some(Set::Mode(joints, modes));
            }
            words::INTERACTION => {
                let (joints, rest) = nested(INTERACTIONS, words)?;
                let modes = modes(&joints, rest)?;
                return Some(Set::Interaction(joints, modes));
            }
            words::LIMITS | words::SPEED_LIMITS => {
                let [joint, min, max, ..] = words else { return None };
                let joint = index(joint)?;
                let min = min.as_f64()?;
                let max = max.as_f64()?;
                let limits = if code == words::LIMITS { Set::Limits } else { Set::SpeedLimits };
                return Some(limits(joint, min, max));
            }
            _ => {}
        }
        let (family, shape) = CodeSuffix::of(code)?;
        let (joints, rest) = Joints::read(shape, words)?;
        let values = |joints: &Joints| values(joints, rest);
        match family {
            MOVE => Some(Set::Move { values: values(&joints)?, joints, relative: false }),
            RELATIVE => Some(Set::Move { values: values(&joints)?, joints, relative: true }),
            STOP => Some(Set::Stop(joints)),
            SPEED => Some(Set::Speed(joints.clone(), values(&joints)?)),
            ACCELERATION => Some(Set::Acceleration(joints.clone(), values(&joints)?)),
            VELOCITY if shape == CodeSuffix::All => values(&joints).map(Set::Velocity),
            ENCODER if shape != CodeSuffix::Group => Some(Set::Encoders(joints.clone(), values(&joints)?)),
            RESET if shape != CodeSuffix::Group => Some(Set::ResetEncoders(joints)),
            _ => None,
        }
    }

    fn write(&self, to: &mut Vec<Value>) {
        to.push(Value::Vocab(words::SET));
        match self {
            Set::Move { joints, values, relative } => {
                write_values(to, if *relative { RELATIVE } else { MOVE }, joints, values);
            }
            Set::Velocity(values) => write_values(to, VELOCITY, &Joints::All, values),
            Set::Stop(joints) => write_family(to, STOP, joints),
            Set::Speed(joints, values) => write_values(to, SPEED, joints, values),
            Set::Acceleration(joints, values) => write_values(to, ACCELERATION, joints, values),
            Set::Encoders(joints, values) => write_values(to, ENCODER, joints, values),
            Set::ResetEncoders(joints) => write_family(to, RESET, joints),
            Set::Mode(joints, modes) => {
                write_nested(to, words::CONTROL_MODE, MODES, joints);
                write_modes(to, joints, modes);
            }
            Set::Interaction(joints, modes) => {
                write_nested(to, words::INTERACTION, INTERACTIONS, joints);
                write_modes(to, joints, modes);
            }
            Set::Limits(joint, min, max) | Set::SpeedLimits(joint, min, max) => {
                let code = if matches!(self, Set::Limits(..)) { words::LIMITS } else { words::SPEED_LIMITS };
                to.extend([Value::Vocab(code), int(*joint), Value::Float64(*min), Value::Float64(*max)]);
            }
        }
    }
}

/// The code within `[icmd]` or `[intm]`, and its joints.
fn nested(codes: [Vocab; 3], words: &[Value]) -> Option<(Joints, &[Value])> {
    let (code, rest) = words.split_first()?;
    Joints::read(CodeSuffix::among(code.as_vocab()?, codes)?, rest)
}

/// Values of these joints: a number for one, otherwise a list.
fn values(joints: &Joints, words: &[Value]) -> Option<Vec<f64>> {
    let first = words.first()?;
    let values = if joints.shape() == CodeSuffix::One { vec![first.as_f64()?] } else { numbers(first)? };
    joints.count().is_none_or(|n| n == values.len()).then_some(values)
}

fn modes(joints: &Joints, words: &[Value]) -> Option<Vec<Vocab>> {
    let first = words.first()?;
    let modes = if joints.shape() == CodeSuffix::One { vec![first.as_vocab()?] } else { vocabs(first)? };
    joints.count().is_none_or(|n| n == modes.len()).then_some(modes)
}

fn write_family(to: &mut Vec<Value>, family: Vocab, joints: &Joints) {
    to.push(Value::Vocab(joints.shape().code(family)));
    joints.write(to);
}

fn write_values(to: &mut Vec<Value>, family: Vocab, joints: &Joints, values: &[f64]) {
    write_family(to, family, joints);
    match (joints, values) {
        (Joints::One(_), [value]) => to.push(Value::Float64(*value)),
        _ => to.push(floats(values)),
    }
}

fn write_nested(to: &mut Vec<Value>, verb: Vocab, codes: [Vocab; 3], joints: &Joints) {
    to.extend([Value::Vocab(verb), Value::Vocab(joints.shape().pick(codes))]);
    joints.write(to);
}

fn write_modes(to: &mut Vec<Value>, joints: &Joints, modes: &[Vocab]) {
    match (joints, modes) {
        (Joints::One(_), [mode]) => to.push(Value::Vocab(*mode)),
        _ => to.push(vocab_list(modes)),
    }
}
