//! Safe display of text from files and from the network.
//!
//! Names come from files and from the network, and end up in terminals. A name that moves the cursor could overwrite
//! the message that warns of it; one that reverses the writing direction looks like another name.

use std::borrow::Cow;
use std::fmt::Write;

/// True for characters that move, hide or reorder the text around them instead of being displayed: control characters,
/// line separators, and those that change the writing direction.
pub fn is_hidden(c: char) -> bool {
    // Besides controls: joiners and zero-width marks, line separators, and characters that reverse the writing
    // direction, with which one name could look like another.
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

/// The text with each hidden character escaped, as in `\u001b`; newlines and tabs are preserved.
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

/// Maximum length of a message, characters: text quoted in it may be of any length.
const MAX_MESSAGE_CHARS: usize = 4000;

/// A message for display: printable, and cut to a readable length.
pub fn readable(message: &str) -> String {
    match message.char_indices().nth(MAX_MESSAGE_CHARS) {
        None => printable(message).into_owned(),
        Some((end, _)) => printable(&message[..end]).into_owned() + "…",
    }
}

/// Appends a character as a JSON escape, which TOML accepts, too.
pub fn digits(out: &mut String, c: char) {
    let _ = write!(out, "\\u{:04x}", u32::from(c));
}

/// Message about a hidden character in a name or another value, if it contains one.
pub fn hidden_in(text: &str) -> Option<String> {
    let c = text.chars().find(|c| is_hidden(*c))?;
    Some(format!("this contains a hidden character, U+{:04X}", u32::from(c)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hidden_characters_are_escaped() {
        assert_eq!(printable("a\u{1b}[31mb\u{202e}c\u{9b}d\r\n\té→"), "a\\u001b[31mb\\u202ec\\u009bd\\u000d\n\té→");
        assert!(matches!(printable("plain\n"), Cow::Borrowed(_)));
        assert_eq!(hidden_in("k\u{202e}evil").as_deref(), Some("this contains a hidden character, U+202E"));
        assert_eq!(hidden_in("é → 機"), None);
    }
}
