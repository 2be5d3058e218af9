//! Parsing of text to bottles.

use super::lines::OpenQuotes;
use super::{TextError, number};
use crate::{Bottle, DecodeLimits, Dialect, Text, Value, Vocab};

impl Bottle {
    /// Parses a text as a bottle. Almost every text is valid: an open part at its end is dropped, as by YARP
    /// (see [`crate::text::is_complete`] to refuse it).
    ///
    /// # Errors
    /// The text is beyond [`DecodeLimits::DEFAULT`].
    pub fn parse(text: impl AsRef<[u8]>, dialect: Dialect) -> Result<Bottle, TextError> {
        Bottle::parse_within(text, dialect, DecodeLimits::DEFAULT)
    }

    /// As [`Bottle::parse`], with custom limits.
    ///
    /// # Errors
    /// The text is beyond the limits.
    pub fn parse_within(text: impl AsRef<[u8]>, dialect: Dialect, limits: DecodeLimits) -> Result<Bottle, TextError> {
        let text = text.as_ref();
        if text.len() > limits.max_bytes {
            return Err(TextError::TooLong { limit: limits.max_bytes });
        }
        Parser { dialect, limits, elements: 0 }.list(text, 0)
    }
}

struct Parser {
    dialect: Dialect,
    limits: DecodeLimits,
    elements: usize,
}

impl Parser {
    fn list(&mut self, text: &[u8], depth: usize) -> Result<Bottle, TextError> {
        if depth > self.limits.max_depth {
            return Err(TextError::TooDeep { limit: self.limits.max_depth });
        }
        let mut values = Vec::new();
        for token in TextTokens::of(text) {
            self.elements += 1;
            if self.elements > self.limits.max_elements {
                return Err(TextError::TooMany { limit: self.limits.max_elements });
            }
            values.push(self.value(token, depth)?);
        }
        Ok(Bottle(values))
    }

    fn value(&mut self, token: &[u8], depth: usize) -> Result<Value, TextError> {
        if token == b"null" {
            return Ok(Vocab::new("null").into());
        }
        if let Some(number) = number::parse(token) {
            return Ok(number);
        }
        Ok(match token.first() {
            Some(b'(') => Value::List(self.list(inner(token), depth + 1)?),
            Some(b'[') => self.vocab(inner(token)),
            Some(b'{') => Value::Blob(TextTokens::of(inner(token)).map(byte).collect()),
            Some(b'"') => Value::String(Text(unescape(inner(token)))),
            _ => match unescape(token) {
                word if word == b"true" => true.into(),
                word if word == b"false" => false.into(),
                word => Value::String(Text(word)),
            },
        })
    }

    fn vocab(&self, letters: &[u8]) -> Value {
        if self.dialect == Dialect::V3 || letters.len() <= 4 {
            return Vocab::from_bytes(letters).into();
        }
        let mut code = [0; 8];
        for (to, from) in code.iter_mut().zip(letters) {
            *to = *from;
        }
        Value::Vocab64(u64::from_le_bytes(code))
    }
}

/// A token without its first and its last character.
fn inner(token: &[u8]) -> &[u8] {
    match token {
        [_, inner @ .., _] => inner,
        _ => &[],
    }
}

/// One byte of a blob: the low bits of a number, or 0 for other tokens.
fn byte(token: &[u8]) -> u8 {
    match number::parse(token) {
        Some(Value::Int32(x)) => x as u8,
        Some(Value::Int64(x)) => x as u8,
        Some(Value::Float64(x)) => x as i32 as u8,
        _ => 0,
    }
}

fn unescape(text: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.iter();
    while let Some(byte) = bytes.next() {
        match byte {
            b'\\' => match bytes.next() {
                Some(b'n') => out.push(b'\n'),
                Some(b'r') => out.push(b'\r'),
                Some(b'0') => out.push(0),
                Some(other) => out.push(*other),
                None => {}
            },
            other => out.push(*other),
        }
    }
    out
}

/// Parts of a text between its separators, without a part that is open at the end.
struct TextTokens<'a> {
    text: &'a [u8],
}

impl<'a> TextTokens<'a> {
    fn of(text: &'a [u8]) -> TextTokens<'a> {
        TextTokens { text }
    }
}

impl<'a> Iterator for TextTokens<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let separator = |b: &u8| matches!(b, b' ' | b'\t' | b'\n' | b'\r' | b',');
        let start = self.text.iter().position(|b| !separator(b))?;
        let text = self.text.get(start..)?;
        let mut open = OpenQuotes::default();
        for (i, byte) in text.iter().enumerate() {
            let escaped = open.take(*byte);
            if !escaped && separator(byte) && open.closed() {
                self.text = text.get(i + 1..).unwrap_or_default();
                return text.get(..i);
            }
        }
        self.text = &[];
        (open.closed() && !open.escaped()).then_some(text)
    }
}
