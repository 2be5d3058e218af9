//! Extended state of a board, as sent by the port `stateExt:o` (spec section 14).

use super::{shape, vector};
use crate::bottle::tag::ScalarType;
use crate::{Bottle, DecodeError, Dialect, Value, Vocab};

/// One quantity of all joints, in the board's order, with its validity.
#[derive(Clone, Debug, PartialEq)]
pub struct JointField<T = f64> {
    /// One value per joint, also if the board does not know it.
    pub values: Vec<T>,
    /// True if the board marks the values as valid.
    pub valid: bool,
}

impl<T> JointField<T> {
    /// Valid values.
    pub fn known(values: Vec<T>) -> JointField<T> {
        JointField { values, valid: true }
    }

    /// This number of invalid values.
    pub fn unknown(axes: usize) -> JointField<T>
    where
        T: Clone + Default,
    {
        JointField { values: vec![T::default(); axes], valid: false }
    }

    /// The values, if they are valid.
    pub fn valid(&self) -> Option<&[T]> {
        self.valid.then_some(self.values.as_slice())
    }
}

impl<T> Default for JointField<T> {
    fn default() -> JointField<T> {
        JointField { values: Vec::new(), valid: false }
    }
}

/// State that a board reports of its joints, in the board's units: degrees (meters for prismatic joints) and
/// seconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointData {
    /// Joint positions.
    pub position: JointField,
    /// Joint speeds.
    pub velocity: JointField,
    /// Joint accelerations.
    pub acceleration: JointField,
    /// Motor positions.
    pub motor_position: JointField,
    /// Motor speeds.
    pub motor_velocity: JointField,
    /// Motor accelerations.
    pub motor_acceleration: JointField,
    /// Torques.
    pub torque: JointField,
    /// Duty cycles (single precision on the wire in 4.x).
    pub pwm: JointField,
    /// Currents.
    pub current: JointField,
    /// Control modes, as integers that are vocabs.
    pub control_modes: JointField<i32>,
    /// Interaction modes, as integers that are vocabs.
    pub interaction_modes: JointField<i32>,
    /// Temperatures (4.x only, single precision on the wire; 3.x does not send them).
    pub temperature: JointField,
}

const WHAT: &str = "joint data";
const OK: Vocab = Vocab::new("ok");
const FAIL: Vocab = Vocab::new("fail");

impl JointData {
    /// Number of joints.
    pub fn axes(&self) -> usize {
        self.position.values.len()
    }

    fn floats(&self) -> [&JointField; 9] {
        [
            &self.position,
            &self.velocity,
            &self.acceleration,
            &self.motor_position,
            &self.motor_velocity,
            &self.motor_acceleration,
            &self.torque,
            &self.pwm,
            &self.current,
        ]
    }

    /// Bytes of the message: 22 elements in 3.x, 24 in 4.x.
    pub fn encode(&self, dialect: Dialect) -> Vec<u8> {
        let v4 = dialect == Dialect::V4;
        let mut out = Vec::with_capacity(400 + 100 * self.axes());
        vector::put_head(0, if v4 { 24 } else { 22 }, &mut out);
        for (i, field) in self.floats().into_iter().enumerate() {
            match v4 && i == 7 {
                true => vector::put_f32(&field.values, dialect, &mut out),
                false => vector::put_f64(&field.values, dialect, &mut out),
            }
            put_flag(field.valid, &mut out);
        }
        for field in [&self.control_modes, &self.interaction_modes] {
            vector::put_i32(&field.values, &mut out);
            put_flag(field.valid, &mut out);
        }
        if v4 {
            vector::put_f32(&self.temperature.values, dialect, &mut out);
            put_flag(self.temperature.valid, &mut out);
        }
        out
    }

    /// Decodes a state.
    ///
    /// # Errors
    /// The bytes are not a bottle of this number of fields, each with its flag.
    pub fn decode(bytes: &[u8], dialect: Dialect) -> Result<JointData, DecodeError> {
        JointData::from_bottle(&Bottle::decode(bytes, dialect)?)
    }

    /// Converts a bottle to a state; its length gives the YARP version.
    ///
    /// # Errors
    /// As [`JointData::decode`].
    pub fn from_bottle(bottle: &Bottle) -> Result<JointData, DecodeError> {
        if bottle.len() != 22 && bottle.len() != 24 {
            return Err(shape(WHAT, format!("it has {} elements, not 22 (YARP 3) or 24 (YARP 4)", bottle.len())));
        }
        let mut fields = bottle.0.chunks_exact(2);
        let mut next = || match fields.next() {
            Some([Value::List(values), Value::Vocab(flag)]) => Ok((values, *flag == OK)),
            _ => Err(shape(WHAT, "its elements are not lists, each with its flag")),
        };
        let mut float =
            || next().and_then(|(values, valid)| Ok(JointField { values: vector::from_bottle(values)?, valid }));
        let mut data = JointData {
            position: float()?,
            velocity: float()?,
            acceleration: float()?,
            motor_position: float()?,
            motor_velocity: float()?,
            motor_acceleration: float()?,
            torque: float()?,
            pwm: float()?,
            current: float()?,
            ..JointData::default()
        };
        let mut modes =
            || next().and_then(|(values, valid)| Ok(JointField { values: vector::i32_from_bottle(values)?, valid }));
        data.control_modes = modes()?;
        data.interaction_modes = modes()?;
        if bottle.len() == 24 {
            let (values, valid) = next()?;
            data.temperature = JointField { values: vector::from_bottle(values)?, valid };
        }
        Ok(data)
    }

    /// Converts to a bottle, for its text.
    ///
    /// # Errors
    /// There are more joints than a message may have.
    pub fn to_bottle(&self, dialect: Dialect) -> Result<Bottle, DecodeError> {
        Bottle::decode(&self.encode(dialect), dialect)
    }
}

fn put_flag(valid: bool, out: &mut Vec<u8>) {
    out.extend(ScalarType::Vocab.tag(Dialect::V3).to_le_bytes());
    out.extend(if valid { OK } else { FAIL }.0.to_le_bytes());
}
