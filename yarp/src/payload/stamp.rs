//! Count and time of a message (spec section 11).

use super::shape;
use crate::text::general;
use crate::{Bottle, DecodeError, Dialect, Value};

/// Count and time of a message, which travel in its envelope.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stamp {
    /// Count of the message; 0 follows after `i32::MAX`.
    pub count: u32,
    /// Time, seconds since 1970 or since a simulation began.
    pub time: f64,
}

impl Stamp {
    /// Stamp of the next message.
    pub fn next(self, time: f64) -> Stamp {
        let count = if self.count >= i32::MAX.unsigned_abs() { 0 } else { self.count + 1 };
        Stamp { count, time }
    }

    /// The envelope: `COUNT TIME`.
    pub fn envelope(self) -> String {
        format!("{} {}", self.count, general(self.time, 15))
    }

    /// Parses an envelope; `None` if it is not a stamp. A third element (the frame of older headers) is
    /// ignored.
    pub fn from_envelope(envelope: &str) -> Option<Stamp> {
        // an envelope is short: a longer text is not a stamp
        let short = envelope.len() <= 1000;
        short.then(|| Bottle::parse(envelope, Dialect::V3).ok()).flatten().and_then(|it| Stamp::from_bottle(&it).ok())
    }

    /// Encodes the stamp as a payload.
    pub fn encode(self, dialect: Dialect) -> Vec<u8> {
        self.to_bottle().encode(dialect)
    }

    /// Decodes the stamp of a payload.
    ///
    /// # Errors
    /// The bytes are not a bottle of a count and a time.
    pub fn decode(bytes: &[u8], dialect: Dialect) -> Result<Stamp, DecodeError> {
        Stamp::from_bottle(&Bottle::decode(bytes, dialect)?)
    }

    /// Converts to a bottle of a count and a time.
    pub fn to_bottle(self) -> Bottle {
        Bottle::new().with(i32::try_from(self.count).unwrap_or(i32::MAX)).with(self.time)
    }

    /// Converts a bottle to a stamp.
    ///
    /// # Errors
    /// It does not begin with a non-negative count and a finite time.
    pub fn from_bottle(bottle: &Bottle) -> Result<Stamp, DecodeError> {
        let count = bottle.get(0).and_then(Value::as_i64).and_then(|count| i32::try_from(count).ok());
        let count = count.and_then(|count| u32::try_from(count).ok());
        let time = bottle.get(1).and_then(Value::as_f64).filter(|time| time.is_finite());
        match (count, time) {
            (Some(count), Some(time)) => Ok(Stamp { count, time }),
            _ => Err(shape("a stamp", "it is not a count and a time")),
        }
    }
}
