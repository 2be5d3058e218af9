//! Tags of values on the wire (spec section 9).

use crate::{Dialect, Value};

/// Bit of every list; the bits below it are the tag that its elements share.
pub const LIST: i32 = 256;
/// A dictionary.
pub const DICT: i32 = 768;

/// Type of one scalar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScalarType {
    Int8,
    Int16,
    Int32,
    Int64,
    Float32,
    Float64,
    Vocab,
    Vocab64,
    String,
    Blob,
}

impl ScalarType {
    const ALL: [ScalarType; 10] = [
        ScalarType::Int8,
        ScalarType::Int16,
        ScalarType::Int32,
        ScalarType::Int64,
        ScalarType::Float32,
        ScalarType::Float64,
        ScalarType::Vocab,
        ScalarType::Vocab64,
        ScalarType::String,
        ScalarType::Blob,
    ];

    /// Its number on the wire. A long vocab has none in 3.x, where it is truncated to a short one.
    pub const fn tag(self, dialect: Dialect) -> i32 {
        match (self, dialect) {
            (ScalarType::Int8, _) => 32,
            (ScalarType::Int16, _) => 64,
            (ScalarType::Int32, _) => 1,
            (ScalarType::Int64, _) => 17,
            (ScalarType::Float32, Dialect::V3) => 128,
            (ScalarType::Float32, Dialect::V4) => 10,
            (ScalarType::Float64, Dialect::V3) => 10,
            (ScalarType::Float64, Dialect::V4) => 20,
            (ScalarType::Vocab, _) | (ScalarType::Vocab64, Dialect::V3) => 9,
            (ScalarType::Vocab64, Dialect::V4) => 18,
            (ScalarType::String, _) => 4,
            (ScalarType::Blob, _) => 12,
        }
    }

    /// Type of a number on the wire.
    pub fn of_tag(tag: i32, dialect: Dialect) -> Option<ScalarType> {
        ScalarType::ALL.into_iter().find(|kind| kind.tag(dialect) == tag)
    }

    /// Type of a value; a list has none.
    pub fn of(value: &Value) -> Option<ScalarType> {
        Some(match value {
            Value::Int8(_) => ScalarType::Int8,
            Value::Int16(_) => ScalarType::Int16,
            Value::Int32(_) => ScalarType::Int32,
            Value::Int64(_) => ScalarType::Int64,
            Value::Float32(_) => ScalarType::Float32,
            Value::Float64(_) => ScalarType::Float64,
            Value::Vocab(_) => ScalarType::Vocab,
            Value::Vocab64(_) => ScalarType::Vocab64,
            Value::String(_) => ScalarType::String,
            Value::Blob(_) => ScalarType::Blob,
            Value::List(_) | Value::Dict(_) => return None,
        })
    }

    /// Least number of bytes of a value, without its tag.
    pub const fn least(self) -> usize {
        match self {
            ScalarType::Int8 => 1,
            ScalarType::Int16 => 2,
            ScalarType::Int32 | ScalarType::Float32 | ScalarType::Vocab | ScalarType::String | ScalarType::Blob => 4,
            ScalarType::Int64 | ScalarType::Float64 | ScalarType::Vocab64 => 8,
        }
    }
}
