//! Messages on text carriers (spec section 5.2): a line with the key, and a line of bottle text that
//! continues while a quote or bracket is open or a line ends in a backslash.

use super::command::TextCommand;

/// A message longer than allowed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the peer sent a text message of more than {0} bytes without an end; raise PortOptions::max_message if that is meant"
)]
pub struct LineError(pub usize);

/// A message as text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextMessage {
    /// Command of the message.
    pub command: TextCommand,
    /// The payload without its end of line; empty if the command has none.
    pub payload: Vec<u8>,
    /// Number of bytes of the message.
    pub end: usize,
}

/// Finds the end of a message in bytes that arrive gradually; each byte is processed once.
#[derive(Clone, Debug, Default)]
pub struct Scanner {
    seen: usize,
    head: Option<(TextCommand, usize)>,
    body: OpenBrackets,
}

/// Open quotes and brackets in a line of bottle text.
#[derive(Clone, Copy, Debug, Default)]
struct OpenBrackets {
    depth: u32,
    quoted: bool,
    escaped: bool,
}

impl OpenBrackets {
    /// Processes one byte; `true` if the text ends with it.
    fn step(&mut self, byte: u8) -> bool {
        match byte {
            b'\n' if self.escaped || self.quoted || self.depth > 0 => self.escaped = false,
            b'\n' => return true,
            b'\r' if self.escaped => {}
            _ if self.escaped => self.escaped = false,
            b'\\' => self.escaped = true,
            b'"' => self.quoted = !self.quoted,
            b'(' | b'{' if !self.quoted => self.depth += 1,
            b')' | b'}' if !self.quoted => self.depth = self.depth.saturating_sub(1),
            _ => {}
        }
        false
    }
}

impl Scanner {
    /// Parses the message at the start of `bytes`, which must begin with the bytes passed before. After a
    /// message the scanner is reset.
    pub fn parse(&mut self, bytes: &[u8], max: usize) -> Result<Option<TextMessage>, LineError> {
        while let Some(byte) = bytes.get(self.seen) {
            self.seen += 1;
            if self.seen > max {
                return Err(LineError(max));
            }
            let ended = if self.head.is_some() { self.body.step(*byte) } else { *byte == b'\n' };
            if !ended {
                continue;
            }
            match self.head.take() {
                None => {
                    let command = TextCommand::parse(trimmed(bytes.get(..self.seen).unwrap_or_default()));
                    if command.has_payload() {
                        self.head = Some((command, self.seen));
                        continue;
                    }
                    let end = self.seen;
                    *self = Scanner::default();
                    return Ok(Some(TextMessage { command, payload: Vec::new(), end }));
                }
                Some((command, start)) => {
                    let payload = joined(trimmed(bytes.get(start..self.seen).unwrap_or_default()));
                    let end = self.seen;
                    *self = Scanner::default();
                    return Ok(Some(TextMessage { command, payload, end }));
                }
            }
        }
        Ok(None)
    }
}

/// Number of bytes of one line of bottle text (a reply), end of line included.
pub fn reply_end(bytes: &[u8]) -> Option<usize> {
    let mut body = OpenBrackets::default();
    bytes.iter().position(|byte| body.step(*byte)).map(|end| end + 1)
}

/// Encodes a message with the key `d`, `D` or `a`.
pub fn encode(key: u8, envelope: Option<&str>, text: &[u8]) -> Vec<u8> {
    let mut out = vec![key];
    if let Some(envelope) = envelope {
        out.push(b' ');
        out.extend_from_slice(envelope.as_bytes());
    }
    out.extend_from_slice(b"\r\n");
    out.extend_from_slice(text);
    out.extend_from_slice(b"\r\n");
    out
}

/// A line without its end.
pub fn trimmed(line: &[u8]) -> &[u8] {
    let line = line.strip_suffix(b"\n").unwrap_or(line);
    line.strip_suffix(b"\r").unwrap_or(line)
}

/// Joins lines by single line feeds; after a trailing backslash the backslash and the line feed are removed.
fn joined(text: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(text.len());
    let mut lines = text.split(|b| *b == b'\n').peekable();
    while let Some(line) = lines.next() {
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        let more = lines.peek().is_some();
        let escapes = line.iter().rev().take_while(|b| **b == b'\\').count() % 2 == 1;
        match line {
            [line @ .., b'\\'] if more && escapes => out.extend_from_slice(line),
            _ => out.extend_from_slice(line),
        }
        if more && !escapes {
            out.push(b'\n');
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Verb;

    fn read(text: &str) -> Option<TextMessage> {
        let mut scanner = Scanner::default();
        let mut last = None;
        for cut in 0..=text.len() {
            last = scanner.parse(&text.as_bytes()[..cut], 1000).unwrap();
            if last.is_some() {
                break;
            }
        }
        last
    }

    #[test]
    fn lines_end_where_nothing_is_open() {
        let line = read("d 7 12.5\r\nhello (1\r\n2) \"a\nb\" c\\\r\nd\r\nrest").unwrap();
        assert_eq!(line.command.envelope.as_deref(), Some("7 12.5"));
        assert_eq!(line.payload, b"hello (1\n2) \"a\nb\" cd");
        assert_eq!(read("*\n").unwrap().command.verb, Verb::Describe);
        assert_eq!(read("d\r\n(open\r\n"), None);
        assert!(Scanner::default().parse(&[b'x'; 2000], 1000).is_err());
        assert_eq!(reply_end(b"(a\r\nb)\r\nc"), Some(8));
    }
}
