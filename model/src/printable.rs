//! Text that a terminal, a log or a person takes for what it is.
//!
//! Names come from files and from the network, and end in terminals. One that moves the cursor could write over the message that
//! warns of it; one that reverses the order of writing looks like another name.

use std::borrow::Cow;
use std::fmt::Write;

/// Whether a character moves, hides or reorders what stands around it rather than being shown: control characters, separators
/// of lines, and those that change the direction of writing.
pub fn is_hidden(c: char) -> bool {
    // Beyond controls: joiners and marks of no width, separators of lines, and whatever reverses the order of writing, so that
    // a name could look like another.
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

/// Text with each hidden character in digits, as in `\u001b`; ends of lines and tabs stay.
pub fn printable(text: &str) -> Cow<'_, str> {
    let bad = |c: char| is_hidden(c) && c != '\n' && c != '\t';
    if !text.contains(bad) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if bad(c) {
            digits(&mut out, c);
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

/// Longer messages are cut, characters: what is quoted in them may be of any length.
const LONGEST: usize = 4000;

/// A message for people: printable, and not too long to be read.
pub fn readable(message: &str) -> String {
    match message.char_indices().nth(LONGEST) {
        None => printable(message).into_owned(),
        Some((end, _)) => printable(&message[..end]).into_owned() + "…",
    }
}

/// A character in digits, in the way of JSON, which TOML understands, too.
pub(crate) fn digits(out: &mut String, c: char) {
    let _ = write!(out, "\\u{:04x}", u32::from(c));
}

/// What is wrong with text that is a name or another value, if it holds a hidden character.
pub fn hidden_in(text: &str) -> Option<String> {
    let c = text.chars().find(|c| is_hidden(*c))?;
    Some(format!("this contains a hidden character, U+{:04X}", u32::from(c)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_but_text_gets_through() {
        assert_eq!(printable("a\u{1b}[31mb\u{202e}c\u{9b}d\r\n\té→"), "a\\u001b[31mb\\u202ec\\u009bd\\u000d\n\té→");
        assert!(matches!(printable("plain\n"), Cow::Borrowed(_)));
        assert_eq!(hidden_in("k\u{202e}evil").as_deref(), Some("this contains a hidden character, U+202E"));
        assert_eq!(hidden_in("é → 機"), None);
    }
}
