//! Messages of several lines: a line that ends in a backslash, or in an open quote, parenthesis or brace, is
//! continued.

use super::TextError;

/// Parser state of a text: open quotes and brackets.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OpenQuotes {
    quoted: bool,
    escaped: bool,
    round: i64,
    curly: i64,
}

impl OpenQuotes {
    /// Processes the next byte; true if it is literal, because it is escaped.
    pub fn take(&mut self, byte: u8) -> bool {
        if self.escaped {
            self.escaped = false;
            return true;
        }
        match byte {
            b'\\' => self.escaped = true,
            b'"' => self.quoted = !self.quoted,
            _ if self.quoted => {}
            b'(' => self.round += 1,
            b')' => self.round -= 1,
            b'{' => self.curly += 1,
            b'}' => self.curly -= 1,
            _ => {}
        }
        false
    }

    /// True if the next byte is literal.
    pub fn escaped(&self) -> bool {
        self.escaped
    }

    /// True if nothing is open.
    pub fn closed(&self) -> bool {
        !self.quoted && self.round == 0 && self.curly == 0
    }
}

/// True if the message ends with this line.
pub fn is_complete(line: &[u8]) -> bool {
    let mut open = OpenQuotes::default();
    for byte in line {
        open.take(*byte);
    }
    open.closed() && line.last() != Some(&b'\\')
}

/// Joins lines to messages, without processing any byte twice.
#[derive(Clone, Debug, Default)]
pub struct LineJoiner {
    text: Vec<u8>,
    open: OpenQuotes,
    going_on: bool,
}

impl LineJoiner {
    /// Adds a line, without its line end. Returns the message when it is complete.
    ///
    /// # Errors
    /// The message gets longer than `limit` bytes; it is discarded.
    pub fn push(&mut self, line: &[u8], limit: usize) -> Result<Option<Vec<u8>>, TextError> {
        if self.text.len() + line.len() >= limit {
            *self = LineJoiner::default();
            return Err(TextError::TooLong { limit });
        }
        if self.going_on {
            self.text.push(b'\n');
            self.open.take(b'\n');
        }
        let (line, joined) = match line {
            [rest @ .., b'\\'] => (rest, true),
            _ => (line, false),
        };
        for byte in line {
            self.open.take(*byte);
        }
        self.text.extend_from_slice(line);
        if !joined && self.open.closed() {
            return Ok(Some(std::mem::take(self).text));
        }
        self.going_on = !joined;
        Ok(None)
    }

    /// True if a message has begun that is not complete.
    pub fn is_open(&self) -> bool {
        self.going_on || !self.text.is_empty()
    }
}
