//! Printing and parsing of numbers as in C.

use crate::Value;

/// Prints a float as bottles do: `%.21g`, with `.0` appended to numbers that look like integers.
pub fn print_float(x: f64) -> String {
    if x.is_nan() {
        return "nan".into();
    }
    let mut text = general(x, 21);
    if x.is_finite() && !text.contains(['.', 'e']) {
        text.push_str(".0");
    }
    text
}

/// Prints a float as C's `%.{digits}g` does: with this number of significant digits, without trailing zeros.
pub fn general(x: f64, digits: usize) -> String {
    if !x.is_finite() {
        return if x.is_nan() {
            "nan"
        } else if x < 0.0 {
            "-inf"
        } else {
            "inf"
        }
        .into();
    }
    let digits = digits.max(1);
    let scientific = format!("{:.*e}", digits - 1, x);
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let sign = if mantissa.starts_with('-') { "-" } else { "" };
    let all: String = mantissa.chars().filter(char::is_ascii_digit).collect();
    let significant = all.trim_end_matches('0');
    if exponent < -4 || i64::from(exponent) >= i64::try_from(digits).unwrap_or(i64::MAX) {
        let (first, rest) = significant.split_at_checked(1).unwrap_or(("0", ""));
        let point = if rest.is_empty() { "" } else { "." };
        let direction = if exponent < 0 { '-' } else { '+' };
        return format!("{sign}{first}{point}{rest}e{direction}{:02}", exponent.unsigned_abs());
    }
    let Ok(before) = usize::try_from(exponent) else {
        let zeros = usize::try_from(-exponent - 1).unwrap_or(0);
        return format!("{sign}0.{}{significant}", "0".repeat(zeros));
    };
    let (whole, rest) = all.split_at_checked(before + 1).unwrap_or((&all, ""));
    let rest = rest.trim_end_matches('0');
    let point = if rest.is_empty() { "" } else { "." };
    format!("{sign}{whole}{point}{rest}")
}

/// Parses a token as a number; `None` if it is a string.
pub(super) fn parse(token: &[u8]) -> Option<Value> {
    let text = std::str::from_utf8(token).ok()?;
    match text {
        "inf" => return Some(Value::Float64(f64::INFINITY)),
        "-inf" => return Some(Value::Float64(f64::NEG_INFINITY)),
        "nan" => return Some(Value::Float64(f64::NAN)),
        "." => return None,
        _ => {}
    }
    if !matches!(token.first()?, b'0'..=b'9' | b'+' | b'-' | b'.') {
        return None;
    }
    if is_float(token)? {
        return Some(Value::Float64(float(text)));
    }
    let integer = integer(token);
    Some(i32::try_from(integer).map_or(Value::Int64(integer), Value::Int32))
}

/// True if a token looks like a float, false if like an integer; `None` if it does not look like a number.
/// YARP checks the letters only, so that `1-2`, `-` and `1e5e` are numbers too.
fn is_float(token: &[u8]) -> Option<bool> {
    let mut hex_at = None;
    let mut float = false;
    let (mut points, mut signs) = (0, 0);
    let mut preamble = true;
    for (i, byte) in token.iter().enumerate() {
        match byte {
            b'.' => {
                points += 1;
                float = true;
            }
            b'e' | b'E' if hex_at.is_none() => float = true,
            _ => {}
        }
        if preamble {
            match byte {
                b'x' | b'X' => {
                    hex_at = Some(i);
                    continue;
                }
                b'0' => continue,
                b'+' | b'-' => {
                    signs += 1;
                    continue;
                }
                _ => preamble = false,
            }
        }
        match byte {
            b'0'..=b'9' | b'.' | b'e' | b'E' | b'+' | b'-' => {}
            b'a'..=b'f' | b'A'..=b'F' if hex_at.is_some() => {}
            _ => return None,
        }
    }
    let long = hex_at.is_some_and(|at| token.len() - (at + 1) > 8);
    (points <= 1 && signs <= 1 && !long).then_some(float)
}

/// Parses an integer as C's `strtoll` does with base 0: hexadecimal after `0x`, octal after `0`, up to the
/// first other letter, saturated to 64 bits.
fn integer(token: &[u8]) -> i64 {
    let (negative, rest) = match token {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, token),
    };
    let (base, digits) = match rest {
        [b'0', b'x' | b'X', digits @ ..] => (16, digits),
        [b'0', digits @ ..] => (8, digits),
        _ => (10, rest),
    };
    let mut value: i64 = 0;
    for digit in digits.iter().map_while(|b| char::from(*b).to_digit(base)) {
        let digit = i64::from(digit);
        // built downward, since the least integer has no positive counterpart
        value = value.saturating_mul(i64::from(base)).saturating_sub(digit);
    }
    if negative { value } else { value.checked_neg().unwrap_or(i64::MAX) }
}

/// Parses a float as C's `strtod` does if it accepts the whole token, else 0. Overflow gives infinity.
fn float(text: &str) -> f64 {
    let (negative, rest) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let value = match rest.strip_prefix("0x").or_else(|| rest.strip_prefix("0X")) {
        Some(digits) => hexadecimal(digits),
        None if rest.starts_with(['+', '-']) => None,
        None => rest.parse().ok(),
    };
    match value {
        Some(value) if negative => -value,
        Some(value) => value,
        None => 0.0,
    }
}

/// Parses at most eight hexadecimal digits with an optional point.
fn hexadecimal(digits: &str) -> Option<f64> {
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    if whole.is_empty() && fraction.is_empty() {
        return None;
    }
    let mut value = 0.0;
    for digit in whole.chars().chain(fraction.chars()) {
        value = value * 16.0 + f64::from(digit.to_digit(16)?);
    }
    Some(value / 16f64.powi(i32::try_from(fraction.len()).ok()?))
}
