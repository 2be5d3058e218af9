//! A pair of head and body, as received by the port `command:i` of a board (spec section 13).

use super::{shape, vector};
use crate::{Bottle, DecodeError, Dialect, Value};

/// Encodes a pair.
pub fn encode(head: &Bottle, body: &[f64], dialect: Dialect) -> Vec<u8> {
    let mut out = Vec::new();
    vector::put_head(0, 2, &mut out);
    head.encode_into(dialect, &mut out);
    vector::put_f64(body, dialect, &mut out);
    out
}

/// Decodes a pair to head and body.
///
/// # Errors
/// The bytes are not a bottle of two lists, the second of numbers.
pub fn decode(bytes: &[u8], dialect: Dialect) -> Result<(Bottle, Vec<f64>), DecodeError> {
    from_bottle(&Bottle::decode(bytes, dialect)?)
}

/// Head and body of a pair that was received as text: `(head) (body)`.
///
/// # Errors
/// It is not two lists, the second of numbers.
pub fn from_bottle(bottle: &Bottle) -> Result<(Bottle, Vec<f64>), DecodeError> {
    let [Value::List(head), Value::List(body)] = bottle.0.as_slice() else {
        return Err(shape("a pair", "it is not a list of two lists, the head and the body"));
    };
    Ok((head.clone(), vector::from_bottle(body)?))
}

/// Converts a pair to a bottle, for its text.
pub fn to_bottle(head: &Bottle, body: &[f64]) -> Bottle {
    Bottle::of([head.clone(), Bottle::of(body.iter().copied())])
}
