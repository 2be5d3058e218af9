//! Encoding of bottles to bytes.

use super::tag::{DICT, LIST, ScalarType};
use crate::{Bottle, Dialect, Value};

impl Bottle {
    /// Binary form, with the same bytes that YARP writes: a list of one kind of scalar contains the kind
    /// once.
    pub fn encode(&self, dialect: Dialect) -> Vec<u8> {
        let mut out = Vec::new();
        self.encode_into(dialect, &mut out);
        out
    }

    /// As [`Bottle::encode`], appended to `out`.
    pub fn encode_into(&self, dialect: Dialect, out: &mut Vec<u8>) {
        let shared = self.shared_tag(dialect);
        put(out, LIST + shared);
        put_len(out, self.0.len());
        for value in &self.0 {
            if shared == 0 {
                match (value, ScalarType::of(value)) {
                    (Value::Dict(_), _) => put(out, DICT),
                    (_, Some(kind)) => put(out, kind.tag(dialect)),
                    (_, None) => {} // a list's own first word is its tag
                }
            }
            scalar(value, dialect, out);
        }
    }

    /// Tag that all elements share, or 0.
    fn shared_tag(&self, dialect: Dialect) -> i32 {
        let mut tags = self.0.iter().map(|value| ScalarType::of(value).map_or(0, |kind| kind.tag(dialect)));
        let Some(first) = tags.next() else { return 0 };
        if tags.all(|tag| tag == first) { first } else { 0 }
    }
}

fn scalar(value: &Value, dialect: Dialect, out: &mut Vec<u8>) {
    match value {
        Value::Int8(x) => out.extend(x.to_le_bytes()),
        Value::Int16(x) => out.extend(x.to_le_bytes()),
        Value::Int32(x) => out.extend(x.to_le_bytes()),
        Value::Int64(x) => out.extend(x.to_le_bytes()),
        Value::Float32(x) => out.extend(x.to_le_bytes()),
        Value::Float64(x) => out.extend(x.to_le_bytes()),
        Value::Vocab(x) => out.extend(x.0.to_le_bytes()),
        Value::Vocab64(x) => match dialect {
            Dialect::V3 => out.extend((*x as u32).to_le_bytes()),
            Dialect::V4 => out.extend(x.to_le_bytes()),
        },
        Value::String(x) => bytes(&x.0, out),
        Value::Blob(x) => bytes(x, out),
        Value::List(x) | Value::Dict(x) => x.encode_into(dialect, out),
    }
}

fn bytes(bytes: &[u8], out: &mut Vec<u8>) {
    put_len(out, bytes.len());
    out.extend_from_slice(bytes);
}

fn put(out: &mut Vec<u8>, word: i32) {
    out.extend(word.to_le_bytes());
}

/// Writes a count. The wire is limited to 2^31, which no reader accepts.
fn put_len(out: &mut Vec<u8>, len: usize) {
    put(out, i32::try_from(len).unwrap_or(i32::MAX));
}
