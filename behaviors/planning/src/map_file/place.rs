//! Positions of values in the text, for error messages.

use std::ops::Range;

/// Returns the span of a value of a JSON document at a path such as `edges[3].from`, or of the
/// closest enclosing value that exists. The text must be valid JSON.
pub fn span(text: &str, path: &str) -> Range<usize> {
    let path = path.replace('[', ".").replace(']', "");
    let mut reader = Reader { bytes: text.as_bytes(), at: 0 };
    let mut span = reader.value();
    for step in path.split('.').filter(|s| !s.is_empty()) {
        reader.at = span.start;
        match reader.child(step) {
            Some(inner) => span = inner,
            None => break,
        }
    }
    span
}

/// Returns the byte offset of a line and a column, both from 1, as counted by JSON parsers.
pub(super) fn byte(text: &str, line: usize, column: usize) -> usize {
    let start: usize = text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum();
    let mut at = (start + column.saturating_sub(1)).min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn peek(&self) -> u8 {
        self.bytes.get(self.at).copied().unwrap_or(0)
    }

    fn space(&mut self) {
        while self.peek().is_ascii_whitespace() {
            self.at += 1;
        }
    }

    /// Skips a value and returns its span.
    fn value(&mut self) -> Range<usize> {
        self.space();
        let start = self.at;
        let mut depth = 0_usize;
        while self.at < self.bytes.len() {
            match self.peek() {
                b'"' => {
                    self.string();
                    if depth == 0 {
                        break;
                    }
                    continue;
                }
                b'{' | b'[' => depth += 1,
                b'}' | b']' if depth <= 1 => {
                    self.at += usize::from(depth == 1);
                    break;
                }
                b'}' | b']' => depth -= 1,
                b',' if depth == 0 => break,
                byte if depth == 0 && byte.is_ascii_whitespace() => break,
                _ => {}
            }
            self.at += 1;
        }
        start..self.at
    }

    /// Skips a string and returns the text between its quotes.
    fn string(&mut self) -> &[u8] {
        self.at += 1;
        let start = self.at;
        while self.at < self.bytes.len() && self.peek() != b'"' {
            self.at += if self.peek() == b'\\' { 2 } else { 1 };
        }
        let end = self.at.min(self.bytes.len());
        self.at = (end + 1).min(self.bytes.len());
        self.bytes.get(start..end).unwrap_or_default()
    }

    /// Enters the value and returns the span of its child with this key or index.
    fn child(&mut self, step: &str) -> Option<Range<usize>> {
        let is_map = match self.peek() {
            b'{' => true,
            b'[' => false,
            _ => return None,
        };
        self.at += 1;
        for i in 0.. {
            self.space();
            let found = if is_map {
                if self.peek() != b'"' {
                    return None;
                }
                let found = self.string() == step.as_bytes();
                self.space();
                self.at += 1;
                found
            } else {
                if matches!(self.peek(), b']' | 0) {
                    return None;
                }
                step.parse() == Ok(i)
            };
            let span = self.value();
            if found {
                return Some(span);
            }
            self.space();
            if self.peek() != b',' {
                return None;
            }
            self.at += 1;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_found_past_strings_that_look_like_syntax() {
        let text = "{ \"a\": \"],\\\"}{\",\n \"edges\" : [ {\"from\": 1, \"to\":[2 , 3]},\n  7 ] ,\"b\":-1.5e3}";
        let at = |path: &str| &text[span(text, path)];
        assert_eq!(at("edges[0].from"), "1");
        assert_eq!((at("edges[0].to[1]"), at("edges[1]"), at("b")), ("3", "7", "-1.5e3"));
        assert_eq!((at("a"), at("edges[0].nothing")), ("\"],\\\"}{\"", "{\"from\": 1, \"to\":[2 , 3]}"));
        assert_eq!(at(""), text);
        assert_eq!((&text[byte(text, 2, 2)..][..7], byte(text, 99, 1)), ("\"edges\"", text.len()));
    }
}
