//! Content of YARP messages: values and bottles.

use std::borrow::Cow;
use std::fmt;

/// Four letters as one integer, the first letter in the lowest byte; YARP's keywords (`[get]`, `[ok]`).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Vocab(pub u32);

impl Vocab {
    /// Vocab of up to four letters; further ones are cut off, as by YARP 3.x.
    pub const fn new(letters: &str) -> Vocab {
        Vocab::from_bytes(letters.as_bytes())
    }

    /// As [`Vocab::new`], for letters received over the wire.
    pub const fn from_bytes(letters: &[u8]) -> Vocab {
        let mut code = 0;
        let mut i = 0;
        while i < letters.len() && i < 4 {
            code |= (letters[i] as u32) << (8 * i);
            i += 1;
        }
        Vocab(code)
    }

    /// Letters, without the NULs of the padding.
    pub fn letters(self) -> Vec<u8> {
        self.0.to_le_bytes().into_iter().filter(|b| *b != 0).collect()
    }
}

impl fmt::Debug for Vocab {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[{}]", self.letters().escape_ascii())
    }
}

/// One element of a [`Bottle`].
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// 8-bit integer.
    Int8(i8),
    /// 16-bit integer.
    Int16(i16),
    /// 32-bit integer.
    Int32(i32),
    /// 64-bit integer.
    Int64(i64),
    /// 32-bit float.
    Float32(f32),
    /// 64-bit float.
    Float64(f64),
    /// A word of up to four letters.
    Vocab(Vocab),
    /// A word of up to eight letters (4.x), the first letter in the lowest byte.
    Vocab64(u64),
    /// Text. YARP does not specify its encoding; bytes that are not UTF-8 are retained.
    String(Text),
    /// Bytes.
    Blob(Vec<u8>),
    /// A list.
    List(Bottle),
    /// A dictionary: its entries as written, each a list of a key and its value (or values).
    Dict(Bottle),
}

impl Value {
    /// Converts to an integer: every width of integer, a vocab's code, a float that is whole.
    pub fn as_i64(&self) -> Option<i64> {
        // the bounds of i64 as floats: the upper one is exclusive, being rounded up to 2^63
        let whole = |x: f64| (x.trunc() == x && x >= i64::MIN as f64 && x < i64::MAX as f64).then_some(x as i64);
        match *self {
            Value::Int8(x) => Some(x.into()),
            Value::Int16(x) => Some(x.into()),
            Value::Int32(x) => Some(x.into()),
            Value::Int64(x) => Some(x),
            Value::Vocab(x) => Some(i64::from(x.0 as i32)),
            Value::Float32(x) => whole(x.into()),
            Value::Float64(x) => whole(x),
            _ => None,
        }
    }

    /// Converts to a number: every float and every integer.
    pub fn as_f64(&self) -> Option<f64> {
        match *self {
            Value::Int8(x) => Some(x.into()),
            Value::Int16(x) => Some(x.into()),
            Value::Int32(x) => Some(x.into()),
            Value::Int64(x) => Some(x as f64),
            Value::Float32(x) => Some(x.into()),
            Value::Float64(x) => Some(x),
            _ => None,
        }
    }

    /// Converts a string to text; bytes that are not UTF-8 are replaced.
    pub fn as_text(&self) -> Option<Cow<'_, str>> {
        match self {
            Value::String(text) => Some(text.to_str()),
            _ => None,
        }
    }

    /// Converts to a vocab: a vocab, or a string of at most four letters (boards accept both, spec section
    /// 7).
    pub fn as_vocab(&self) -> Option<Vocab> {
        match self {
            Value::Vocab(vocab) => Some(*vocab),
            Value::String(text) if (1..=4).contains(&text.0.len()) => Some(Vocab::from_bytes(&text.0)),
            _ => None,
        }
    }

    /// Converts to a list: a list, or the entries of a dictionary.
    pub fn as_list(&self) -> Option<&Bottle> {
        match self {
            Value::List(list) | Value::Dict(list) => Some(list),
            _ => None,
        }
    }
}

macro_rules! from {
    ($($from:ty => $to:expr;)*) => {$(
        impl From<$from> for Value {
            fn from(x: $from) -> Value {
                ($to)(x)
            }
        }
    )*};
}
from! {
    i8 => Value::Int8;
    i16 => Value::Int16;
    i32 => Value::Int32;
    i64 => Value::Int64;
    f32 => Value::Float32;
    f64 => Value::Float64;
    bool => |x| Value::Vocab(Vocab(if x { u32::from(b'1') } else { 0 }));
    Vocab => Value::Vocab;
    &str => |x| Value::String(Text::from(x));
    String => |x| Value::String(Text::from(x));
    Text => Value::String;
    Vec<u8> => Value::Blob;
    Bottle => Value::List;
}

/// A string as bytes, since the wire specifies no encoding.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Text(pub Vec<u8>);

impl Text {
    /// Text for people: bytes that are not UTF-8 are replaced.
    pub fn to_str(&self) -> Cow<'_, str> {
        String::from_utf8_lossy(&self.0)
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Text {
        Text(text.as_bytes().to_vec())
    }
}

impl From<String> for Text {
    fn from(text: String) -> Text {
        Text(text.into_bytes())
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.to_str())
    }
}

/// A list of values: the message of YARP.
///
/// ```
/// use mobee_yarp::{Bottle, Dialect, Vocab};
/// let mut ask = Bottle::of([Vocab::new("get"), Vocab::new("llim")]);
/// ask.push(3);
/// assert_eq!(ask.to_string(), "[get] [llim] 3");
/// assert_eq!(Bottle::decode(&ask.encode(Dialect::V3), Dialect::V3).unwrap(), ask);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bottle(pub Vec<Value>);

impl Bottle {
    /// Creates an empty bottle.
    pub const fn new() -> Bottle {
        Bottle(Vec::new())
    }

    /// Creates a bottle of values that are all of the same Rust type.
    pub fn of<V: Into<Value>>(values: impl IntoIterator<Item = V>) -> Bottle {
        values.into_iter().collect()
    }

    /// Adds a value at the end, and returns the bottle for the next.
    pub fn push(&mut self, value: impl Into<Value>) -> &mut Self {
        self.0.push(value.into());
        self
    }

    /// Returns the bottle with a value added at the end.
    pub fn with(mut self, value: impl Into<Value>) -> Bottle {
        self.push(value);
        self
    }

    /// Value at an index, if there is one.
    pub fn get(&self, index: usize) -> Option<&Value> {
        self.0.get(index)
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// True if it has no values.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Values in order.
    pub fn iter(&self) -> std::slice::Iter<'_, Value> {
        self.0.iter()
    }

    /// All values as numbers; `None` if one is not a number.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        self.0.iter().map(Value::as_f64).collect()
    }

    /// Values after the key in the list `(key value ...)`, the form of YARP's properties (`port (name "/x")
    /// (port_number 10003)`).
    pub fn find(&self, key: &str) -> Option<&[Value]> {
        self.0.iter().filter_map(Value::as_list).find_map(|list| match list.0.split_first() {
            Some((Value::String(name), rest)) if name.0 == key.as_bytes() => Some(rest),
            _ => None,
        })
    }
}

impl<V: Into<Value>> FromIterator<V> for Bottle {
    fn from_iter<I: IntoIterator<Item = V>>(values: I) -> Bottle {
        Bottle(values.into_iter().map(Into::into).collect())
    }
}

impl<'a> IntoIterator for &'a Bottle {
    type Item = &'a Value;
    type IntoIter = std::slice::Iter<'a, Value>;
    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

/// Version of YARP: the two differ in the tags of floats, and can't be distinguished on the wire (spec
/// section 1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dialect {
    /// YARP 3.
    #[default]
    V3,
    /// YARP 4.
    V4,
}
