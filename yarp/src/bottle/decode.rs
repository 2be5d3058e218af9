//! Decoding of bottles from bytes. The bytes are hostile: every length is checked before memory is allocated
//! for it.

use super::DecodeLimits;
use super::tag::{DICT, LIST, ScalarType};
use crate::{Bottle, Dialect, Text, Value, Vocab};

/// Error in the bytes of a bottle.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The bytes end too early.
    #[error("the message ends at byte {at}, where {needed} more bytes belong; was it cut off?")]
    Short {
        /// Position of the end.
        at: usize,
        /// Least number of missing bytes.
        needed: usize,
    },
    /// The first word is not that of a list.
    #[error("no bottle: word {word} at byte {at} where a list begins (256 and the tag of its elements)")]
    NoList {
        /// Word found.
        word: i32,
        /// Its position.
        at: usize,
    },
    /// An element of unknown type.
    #[error("unknown tag {tag} at byte {at}; if the other side is of the other YARP (3 or 4), set the dialect")]
    UnknownTag {
        /// Tag found.
        tag: i32,
        /// Its position.
        at: usize,
    },
    /// An invalid length or count.
    #[error("length {length} at byte {at} is not between 0 and {limit}")]
    Length {
        /// Length found.
        length: i64,
        /// Its position.
        at: usize,
        /// Upper limit.
        limit: usize,
    },
    /// Too many nested lists.
    #[error("more than {limit} lists in lists at byte {at}")]
    TooDeep {
        /// Position.
        at: usize,
        /// Upper limit.
        limit: usize,
    },
    /// The bottle ends before the bytes do.
    #[error("{extra} bytes behind the end of the message at byte {at}")]
    Trailing {
        /// End of the bottle.
        at: usize,
        /// Number of bytes that follow.
        extra: usize,
    },
    /// A bottle of an unexpected shape.
    #[error("not {what}: {why}")]
    Shape {
        /// Expected content.
        what: &'static str,
        /// Description of the error.
        why: String,
    },
}

impl Bottle {
    /// Decodes a bottle from all of these bytes.
    ///
    /// # Errors
    /// The bytes are not a bottle, or one beyond [`DecodeLimits::DEFAULT`].
    pub fn decode(bytes: &[u8], dialect: Dialect) -> Result<Bottle, DecodeError> {
        Bottle::decode_within(bytes, dialect, DecodeLimits::DEFAULT)
    }

    /// As [`Bottle::decode`], with custom limits.
    ///
    /// # Errors
    /// The bytes are not a bottle, or one beyond the limits.
    pub fn decode_within(bytes: &[u8], dialect: Dialect, limits: DecodeLimits) -> Result<Bottle, DecodeError> {
        let mut input = BottleReader::new(bytes, dialect, limits)?;
        let bottle = input.bottle()?;
        input.end()?;
        Ok(bottle)
    }

    /// Decodes a bottle at the start of these bytes, and returns it with its length in bytes, or `None` if
    /// more bytes are needed (a reply has no length prefix, spec section 6).
    ///
    /// # Errors
    /// No further bytes can make it a bottle within [`DecodeLimits::DEFAULT`].
    pub fn decode_prefix(bytes: &[u8], dialect: Dialect) -> Result<Option<(Bottle, usize)>, DecodeError> {
        Bottle::decode_prefix_within(bytes, dialect, DecodeLimits::DEFAULT)
    }

    /// As [`Bottle::decode_prefix`], with custom limits.
    ///
    /// # Errors
    /// No further bytes can make it a bottle within the limits.
    pub fn decode_prefix_within(
        bytes: &[u8],
        dialect: Dialect,
        limits: DecodeLimits,
    ) -> Result<Option<(Bottle, usize)>, DecodeError> {
        let whole = bytes.len() > limits.max_bytes;
        let mut input = BottleReader::new(bytes.get(..limits.max_bytes).unwrap_or(bytes), dialect, limits)?;
        match input.bottle() {
            Ok(bottle) => Ok(Some((bottle, input.at))),
            Err(DecodeError::Short { .. }) if !whole => Ok(None),
            Err(error) => Err(error),
        }
    }
}

/// Reader of bytes.
pub(crate) struct BottleReader<'a> {
    bytes: &'a [u8],
    /// Position of the next byte.
    pub at: usize,
    dialect: Dialect,
    limits: DecodeLimits,
    depth: usize,
    elements: usize,
}

impl<'a> BottleReader<'a> {
    pub fn new(bytes: &'a [u8], dialect: Dialect, limits: DecodeLimits) -> Result<BottleReader<'a>, DecodeError> {
        if bytes.len() > limits.max_bytes {
            return Err(DecodeError::Length { length: wide(bytes.len()), at: 0, limit: limits.max_bytes });
        }
        Ok(BottleReader { bytes, at: 0, dialect, limits, depth: 0, elements: 0 })
    }

    pub fn take(&mut self, n: usize) -> Result<&'a [u8], DecodeError> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let Some(taken) = rest.get(..n) else {
            return Err(DecodeError::Short { at: self.bytes.len(), needed: n - rest.len() });
        };
        self.at += n;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    pub fn word(&mut self) -> Result<i32, DecodeError> {
        Ok(i32::from_le_bytes(self.array()?))
    }

    /// A length, at most `limit`.
    pub fn length(&mut self, limit: usize) -> Result<usize, DecodeError> {
        let at = self.at;
        let word = self.word()?;
        match usize::try_from(word) {
            Ok(length) if length <= limit => Ok(length),
            _ => Err(DecodeError::Length { length: word.into(), at, limit }),
        }
    }

    pub fn end(&self) -> Result<(), DecodeError> {
        match self.bytes.len() - self.at {
            0 => Ok(()),
            extra => Err(DecodeError::Trailing { at: self.at, extra }),
        }
    }

    /// A top-level list: its word, its count, its elements.
    pub fn bottle(&mut self) -> Result<Bottle, DecodeError> {
        let at = self.at;
        match self.word()? {
            DICT => Err(DecodeError::NoList { word: DICT, at }),
            word if word & LIST != 0 && word >> 9 == 0 => self.list(word, at),
            word => Err(DecodeError::NoList { word, at }),
        }
    }

    fn list(&mut self, word: i32, at: usize) -> Result<Bottle, DecodeError> {
        if self.depth > self.limits.max_depth {
            return Err(DecodeError::TooDeep { at, limit: self.limits.max_depth });
        }
        let shared = match word & (LIST - 1) {
            0 => None,
            tag => Some(ScalarType::of_tag(tag, self.dialect).ok_or(DecodeError::UnknownTag { tag, at })?),
        };
        let count = self.length(self.limits.max_elements - self.elements)?;
        self.elements += count;
        // the least number of bytes of the elements must be present before memory is allocated for them
        let least = count.saturating_mul(shared.map_or(4, ScalarType::least));
        let rest = self.bytes.len() - self.at;
        if least > rest {
            return Err(DecodeError::Short { at: self.bytes.len(), needed: least - rest });
        }
        self.depth += 1;
        let mut values = Vec::with_capacity(count);
        for _ in 0..count {
            values.push(match shared {
                Some(kind) => self.scalar(kind)?,
                None => self.tagged()?,
            });
        }
        self.depth -= 1;
        Ok(Bottle(values))
    }

    fn tagged(&mut self) -> Result<Value, DecodeError> {
        let at = self.at;
        let tag = self.word()?;
        if tag == DICT {
            // a dictionary contains another top-level list, with a word of its own
            if self.depth > self.limits.max_depth {
                return Err(DecodeError::TooDeep { at, limit: self.limits.max_depth });
            }
            return Ok(Value::Dict(self.bottle()?));
        }
        if tag & LIST != 0 && tag >> 9 == 0 {
            return Ok(Value::List(self.list(tag, at)?));
        }
        let kind = ScalarType::of_tag(tag, self.dialect).ok_or(DecodeError::UnknownTag { tag, at })?;
        self.scalar(kind)
    }

    fn scalar(&mut self, kind: ScalarType) -> Result<Value, DecodeError> {
        Ok(match kind {
            ScalarType::Int8 => Value::Int8(i8::from_le_bytes(self.array()?)),
            ScalarType::Int16 => Value::Int16(i16::from_le_bytes(self.array()?)),
            ScalarType::Int32 => Value::Int32(i32::from_le_bytes(self.array()?)),
            ScalarType::Int64 => Value::Int64(i64::from_le_bytes(self.array()?)),
            ScalarType::Float32 => Value::Float32(f32::from_le_bytes(self.array()?)),
            ScalarType::Float64 => Value::Float64(f64::from_le_bytes(self.array()?)),
            ScalarType::Vocab => Value::Vocab(Vocab(u32::from_le_bytes(self.array()?))),
            ScalarType::Vocab64 => Value::Vocab64(u64::from_le_bytes(self.array()?)),
            ScalarType::String => Value::String(Text(self.bytes()?)),
            ScalarType::Blob => Value::Blob(self.bytes()?),
        })
    }

    fn bytes(&mut self) -> Result<Vec<u8>, DecodeError> {
        let length = self.length(self.limits.max_bytes)?;
        Ok(self.take(length)?.to_vec())
    }
}

fn wide(n: usize) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}
