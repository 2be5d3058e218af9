//! The tags of values on the wire (spec section 9).

use crate::{Dialect, Value};

/// The bit that every list has; what is below it is the tag its elements share.
pub const LIST: i32 = 256;
/// A dictionary.
pub const DICT: i32 = 768;

/// The type of one scalar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
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

impl Kind {
    const ALL: [Kind; 10] = [
        Kind::Int8,
        Kind::Int16,
        Kind::Int32,
        Kind::Int64,
        Kind::Float32,
        Kind::Float64,
        Kind::Vocab,
        Kind::Vocab64,
        Kind::String,
        Kind::Blob,
    ];

    /// Its number on the wire. A long vocab has none in 3.x, where it is cut to a short one.
    pub const fn tag(self, dialect: Dialect) -> i32 {
        match (self, dialect) {
            (Kind::Int8, _) => 32,
            (Kind::Int16, _) => 64,
            (Kind::Int32, _) => 1,
            (Kind::Int64, _) => 17,
            (Kind::Float32, Dialect::V3) => 128,
            (Kind::Float32, Dialect::V4) => 10,
            (Kind::Float64, Dialect::V3) => 10,
            (Kind::Float64, Dialect::V4) => 20,
            (Kind::Vocab, _) | (Kind::Vocab64, Dialect::V3) => 9,
            (Kind::Vocab64, Dialect::V4) => 18,
            (Kind::String, _) => 4,
            (Kind::Blob, _) => 12,
        }
    }

    /// The type of a number on the wire.
    pub fn of_tag(tag: i32, dialect: Dialect) -> Option<Kind> {
        Kind::ALL.into_iter().find(|kind| kind.tag(dialect) == tag)
    }

    /// The type of a value; a list has none.
    pub fn of(value: &Value) -> Option<Kind> {
        Some(match value {
            Value::Int8(_) => Kind::Int8,
            Value::Int16(_) => Kind::Int16,
            Value::Int32(_) => Kind::Int32,
            Value::Int64(_) => Kind::Int64,
            Value::Float32(_) => Kind::Float32,
            Value::Float64(_) => Kind::Float64,
            Value::Vocab(_) => Kind::Vocab,
            Value::Vocab64(_) => Kind::Vocab64,
            Value::String(_) => Kind::String,
            Value::Blob(_) => Kind::Blob,
            Value::List(_) | Value::Dict(_) => return None,
        })
    }

    /// The fewest bytes that one takes, its tag not counted.
    pub const fn least(self) -> usize {
        match self {
            Kind::Int8 => 1,
            Kind::Int16 => 2,
            Kind::Int32 | Kind::Float32 | Kind::Vocab | Kind::String | Kind::Blob => 4,
            Kind::Int64 | Kind::Float64 | Kind::Vocab64 => 8,
        }
    }
}
