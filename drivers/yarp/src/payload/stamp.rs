//! When a message was made (spec section 11).

use super::shape;
use crate::text::general;
use crate::{Bottle, DecodeError, Dialect, Value};

/// The number and the time of a message, which travel in its envelope.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stamp {
    /// The number of the message; 0 follows after `i32::MAX`.
    pub count: u32,
    /// Seconds, since 1970 or since a simulation began.
    pub time: f64,
}

impl Stamp {
    /// The stamp of the message after this one.
    pub fn next(self, time: f64) -> Stamp {
        let count = if self.count >= i32::MAX.unsigned_abs() { 0 } else { self.count + 1 };
        Stamp { count, time }
    }

    /// The envelope: `COUNT TIME`.
    pub fn envelope(self) -> String {
        format!("{} {}", self.count, general(self.time, 15))
    }

    /// The stamp in an envelope; `None` if it is none. A third element (the frame of older headers) is ignored.
    pub fn from_envelope(envelope: &str) -> Option<Stamp> {
        // an envelope is short: what is longer is no stamp
        let short = envelope.len() <= 1000;
        short.then(|| Bottle::parse(envelope, Dialect::V3).ok()).flatten().and_then(|it| Stamp::from_bottle(&it).ok())
    }

    /// The stamp as a payload.
    pub fn encode(self, dialect: Dialect) -> Vec<u8> {
        self.to_bottle().encode(dialect)
    }

    /// The stamp of a payload.
    ///
    /// # Errors
    /// If the bytes are no bottle of a count and a time.
    pub fn decode(bytes: &[u8], dialect: Dialect) -> Result<Stamp, DecodeError> {
        Stamp::from_bottle(&Bottle::decode(bytes, dialect)?)
    }

    /// As a bottle of a count and a time.
    pub fn to_bottle(self) -> Bottle {
        Bottle::new().with(i32::try_from(self.count).unwrap_or(i32::MAX)).with(self.time)
    }

    /// The stamp that a bottle means.
    ///
    /// # Errors
    /// If it does not begin with a count that is not negative and a finite time.
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
