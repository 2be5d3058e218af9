//! Words and numbers of a bottle, parsed as by YARP's own programs: a vocab may come as a string, an integer
//! as a float.

use mobee_yarp::{Bottle, Text, Value};

/// A name or a verb, of any length: a string, or a vocab's letters.
pub(crate) fn name(value: Option<&Value>) -> Option<String> {
    let bytes = match value? {
        Value::String(Text(bytes)) => bytes.clone(),
        Value::Vocab(vocab) => vocab.0.to_le_bytes().into_iter().filter(|b| *b != 0).collect(),
        _ => return None,
    };
    String::from_utf8(bytes).ok()
}

/// A finite number.
pub(crate) fn number(value: Option<&Value>) -> Option<f64> {
    let number = match value? {
        Value::Int8(i) => f64::from(*i),
        Value::Int16(i) => f64::from(*i),
        Value::Int32(i) => f64::from(*i),
        Value::Int64(i) => *i as f64,
        Value::Float32(x) => f64::from(*x),
        Value::Float64(x) => *x,
        _ => return None,
    };
    Some(number).filter(|x| x.is_finite())
}

/// An integer value.
pub(crate) fn integer(value: Option<&Value>) -> Option<i64> {
    match value? {
        Value::Int8(i) => Some(i64::from(*i)),
        Value::Int16(i) => Some(i64::from(*i)),
        Value::Int32(i) => Some(i64::from(*i)),
        Value::Int64(i) => Some(*i),
        _ => None,
    }
}

/// All elements as finite numbers, or `None`.
pub(crate) fn numbers(values: &[Value]) -> Option<Vec<f64>> {
    values.iter().map(|v| number(Some(v))).collect()
}

/// Exactly `N` finite numbers.
pub(crate) fn exactly<const N: usize>(values: &[Value]) -> Option<[f64; N]> {
    numbers(values)?.try_into().ok()
}

/// A string as an element.
pub(crate) fn string(text: impl AsRef<str>) -> Value {
    Value::String(Text(text.as_ref().as_bytes().to_vec()))
}

/// A bottle of one string.
pub(crate) fn line(text: impl AsRef<str>) -> Bottle {
    Bottle(vec![string(text)])
}
