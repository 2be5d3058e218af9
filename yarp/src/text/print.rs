//! Printing of bottles as text.

use std::fmt;

use super::print_float;
use crate::{Bottle, Value, Vocab};

impl Bottle {
    /// Text form, with the same bytes that YARP prints.
    pub fn to_text(&self) -> Vec<u8> {
        let mut out = Vec::new();
        list(self, &mut out);
        out
    }
}

impl Value {
    /// Text form as an element of a bottle.
    pub fn to_text(&self) -> Vec<u8> {
        let mut out = Vec::new();
        value(self, &mut out);
        out
    }
}

/// The text form; bytes that are not UTF-8 are replaced (for the exact bytes see [`Bottle::to_text`]).
impl fmt::Display for Bottle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&String::from_utf8_lossy(&self.to_text()))
    }
}

/// As for [`Bottle`].
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&String::from_utf8_lossy(&self.to_text()))
    }
}

/// `[abc]`, or `true` and `false`.
impl fmt::Display for Vocab {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Value::Vocab(*self).fmt(f)
    }
}

fn list(bottle: &Bottle, out: &mut Vec<u8>) {
    for (i, element) in bottle.0.iter().enumerate() {
        if i > 0 {
            out.push(b' ');
        }
        value(element, out);
    }
}

fn value(value: &Value, out: &mut Vec<u8>) {
    match value {
        Value::Int8(x) => out.extend(x.to_string().bytes()),
        Value::Int16(x) => out.extend(x.to_string().bytes()),
        Value::Int32(x) => out.extend(x.to_string().bytes()),
        Value::Int64(x) => out.extend(x.to_string().bytes()),
        Value::Float32(x) => out.extend(print_float((*x).into()).bytes()),
        Value::Float64(x) => out.extend(print_float(*x).bytes()),
        Value::Vocab(x) => vocab(u64::from(x.0), out),
        Value::Vocab64(x) => vocab(*x, out),
        Value::String(x) => print_string(&x.0, out),
        Value::Blob(bytes) => {
            out.push(b'{');
            for (i, byte) in bytes.iter().enumerate() {
                if i > 0 {
                    out.push(b' ');
                }
                out.extend(byte.to_string().bytes());
            }
            out.push(b'}');
        }
        Value::List(x) | Value::Dict(x) => {
            out.push(b'(');
            list(x, out);
            out.push(b')');
        }
    }
}

fn vocab(code: u64, out: &mut Vec<u8>) {
    match code {
        0 => out.extend_from_slice(b"false"),
        0x31 => out.extend_from_slice(b"true"),
        _ => {
            out.push(b'[');
            out.extend(code.to_le_bytes().into_iter().filter(|b| *b != 0));
            out.push(b']');
        }
    }
}

/// Prints a string: bare if it is unambiguous, otherwise in quotes.
fn print_string(text: &[u8], out: &mut Vec<u8>) {
    let bare = |(i, b): (usize, &u8)| {
        b.is_ascii_alphabetic() || *b == b'_' || i > 0 && (b.is_ascii_digit() || matches!(b, b'.' | b'-'))
    };
    if !text.is_empty() && text != b"true" && text != b"false" && text.iter().enumerate().all(bare) {
        out.extend_from_slice(text);
        return;
    }
    out.push(b'"');
    for byte in text {
        match byte {
            b'\n' => out.extend_from_slice(b"\\n"),
            b'\r' => out.extend_from_slice(b"\\r"),
            0 => out.extend_from_slice(b"\\0"),
            b'\\' | b'"' => out.extend_from_slice(&[b'\\', *byte]),
            _ => out.push(*byte),
        }
    }
    out.push(b'"');
}
