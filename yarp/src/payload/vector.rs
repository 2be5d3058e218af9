//! Vectors of numbers: lists of one kind, which contain their kind even when empty.

use super::shape;
use crate::bottle::tag::{LIST, ScalarType};
use crate::{Bottle, DecodeError, Dialect};

/// Encodes a vector of floats.
pub fn encode(values: &[f64], dialect: Dialect) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + 8 * values.len());
    put_f64(values, dialect, &mut out);
    out
}

/// Encodes a vector of integers.
pub fn encode_i32(values: &[i32]) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + 4 * values.len());
    put_i32(values, &mut out);
    out
}

/// Decodes a vector of floats. Integers and narrow floats, which text contains, are converted; an empty
/// vector is accepted, unlike by YARP's own readers.
///
/// # Errors
/// The bytes are not a bottle, or it contains anything but numbers.
pub fn decode(bytes: &[u8], dialect: Dialect) -> Result<Vec<f64>, DecodeError> {
    from_bottle(&Bottle::decode(bytes, dialect)?)
}

/// Decodes a vector of integers.
///
/// # Errors
/// The bytes are not a bottle, or it contains anything but integers of 32 bits.
pub fn decode_i32(bytes: &[u8], dialect: Dialect) -> Result<Vec<i32>, DecodeError> {
    i32_from_bottle(&Bottle::decode(bytes, dialect)?)
}

/// Numbers of a bottle, which a text carrier transports instead of a vector.
///
/// # Errors
/// It contains anything but numbers.
pub fn from_bottle(bottle: &Bottle) -> Result<Vec<f64>, DecodeError> {
    bottle.numbers().ok_or_else(|| shape("a vector", "it has an element that is no number"))
}

/// Integers of a bottle.
///
/// # Errors
/// It contains anything but integers of 32 bits.
pub fn i32_from_bottle(bottle: &Bottle) -> Result<Vec<i32>, DecodeError> {
    let integer = |value: &crate::Value| value.as_i64().and_then(|x| i32::try_from(x).ok());
    let all: Option<_> = bottle.iter().map(integer).collect();
    all.ok_or_else(|| shape("a vector of integers", "it has an element that is no integer of 32 bits"))
}

pub(super) fn put_f64(values: &[f64], dialect: Dialect, out: &mut Vec<u8>) {
    put_head(ScalarType::Float64.tag(dialect), values.len(), out);
    out.extend(values.iter().flat_map(|x| x.to_le_bytes()));
}

pub(super) fn put_f32(values: &[f64], dialect: Dialect, out: &mut Vec<u8>) {
    put_head(ScalarType::Float32.tag(dialect), values.len(), out);
    out.extend(values.iter().flat_map(|x| (*x as f32).to_le_bytes()));
}

pub(super) fn put_i32(values: &[i32], out: &mut Vec<u8>) {
    // integers have the same tag in both dialects
    put_head(ScalarType::Int32.tag(Dialect::V3), values.len(), out);
    out.extend(values.iter().flat_map(|x| x.to_le_bytes()));
}

/// Writes the word of a list and its count.
pub(super) fn put_head(shared: i32, len: usize, out: &mut Vec<u8>) {
    out.extend((LIST + shared).to_le_bytes());
    out.extend(i32::try_from(len).unwrap_or(i32::MAX).to_le_bytes());
}
