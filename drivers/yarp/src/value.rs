//! What a YARP message is made of: values and bottles.

use std::fmt;

/// Four letters as one integer, the first letter in the lowest byte; YARP's words (`[get]`, `[ok]`).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Vocab(pub u32);

impl Vocab {
    /// The vocab of up to four letters; more are cut, as YARP 3.x does.
    pub const fn new(letters: &str) -> Vocab {
        let bytes = letters.as_bytes();
        let mut code = 0;
        let mut i = 0;
        while i < bytes.len() && i < 4 {
            code |= (bytes[i] as u32) << (8 * i);
            i += 1;
        }
        Vocab(code)
    }
}

impl fmt::Debug for Vocab {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letters: String = self.0.to_le_bytes().iter().filter(|b| **b != 0).map(|b| *b as char).collect();
        write!(f, "[{letters}]")
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
    /// Text. YARP does not say in what encoding; bytes that are no UTF-8 are kept as they came.
    String(Text),
    /// Bytes.
    Blob(Vec<u8>),
    /// A list.
    List(Bottle),
    /// A dictionary, in the order written.
    Dict(Vec<(Value, Value)>),
}

/// A string as bytes, since the wire promises no encoding.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Text(pub Vec<u8>);

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", String::from_utf8_lossy(&self.0))
    }
}

/// A list of values: the message of YARP.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bottle(pub Vec<Value>);

/// Which YARP is spoken: the two differ in the tags of floats, and can't be told apart on the wire (spec section 1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dialect {
    /// YARP 3.
    #[default]
    V3,
    /// YARP 4.
    V4,
}
