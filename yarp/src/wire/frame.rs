//! Messages on binary carriers (spec section 5.1): an index with block lengths, a command, a payload.

use super::command::TextCommand;

/// Error in the frame of a message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// There is no index at the start of a message.
    #[error("the peer sent no message index (expected YARP number 10); the connection can't be followed any more")]
    Index,
    /// A message longer than allowed.
    #[error(
        "the peer announced a message of {0} bytes, more than the limit of {1}; raise PortOptions::max_message if that is meant"
    )]
    TooLong(u64, usize),
    /// The blocks don't contain a command.
    #[error("the message's command is malformed")]
    TextCommand,
}

/// Positions of the parts of a message in the bytes it was read from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WireFrame {
    /// Command of the message.
    pub command: TextCommand,
    /// First byte of the payload.
    pub payload: usize,
    /// One past the last byte of the message.
    pub end: usize,
}

/// Number in a `YA....RP` group; `None` if it is not such a group.
pub fn number(bytes: &[u8; 8]) -> Option<i32> {
    match bytes {
        [b'Y', b'A', a, b, c, d, b'R', b'P'] => Some(i32::from_le_bytes([*a, *b, *c, *d])),
        _ => None,
    }
}

/// A `YA....RP` group.
pub fn numbered(number: i32) -> [u8; 8] {
    let [a, b, c, d] = number.to_le_bytes();
    [b'Y', b'A', a, b, c, d, b'R', b'P']
}

/// Total number of bytes of the message at the start of `bytes`, once its index has arrived.
pub fn length(bytes: &[u8], max: usize) -> Result<Option<usize>, FrameError> {
    let Some((first, rest)) = bytes.split_first_chunk::<8>() else {
        return if b"YA".starts_with(bytes.get(..2.min(bytes.len())).unwrap_or_default()) {
            Ok(None)
        } else {
            Err(FrameError::Index)
        };
    };
    if number(first) != Some(10) {
        return Err(FrameError::Index);
    }
    let Some(([inputs, outputs, ..], rest)) = rest.split_first_chunk::<10>() else { return Ok(None) };
    let (inputs, outputs) = (usize::from(*inputs), usize::from(*outputs));
    let Some(lengths) = rest.get(..4 * inputs) else { return Ok(None) };
    let mut total = 0_u64;
    for length in lengths.chunks_exact(4) {
        let length = length.first_chunk::<4>().map_or(-1, |l| i32::from_le_bytes(*l));
        total += u64::try_from(length).map_err(|_| FrameError::Index)?;
    }
    if total > max as u64 {
        return Err(FrameError::TooLong(total, max));
    }
    Ok(Some(18 + 4 * (inputs + outputs) + total as usize))
}

/// Parses the message at the start of `bytes`, with at most `max` bytes after the index. `None` if more bytes
/// are needed.
pub fn parse(bytes: &[u8], max: usize) -> Result<Option<WireFrame>, FrameError> {
    let Some(end) = length(bytes, max)? else { return Ok(None) };
    let Some(message) = bytes.get(..end) else { return Ok(None) };
    let blocks = match (message.get(8), message.get(9)) {
        (Some(inputs), Some(outputs)) => 18 + 4 * (usize::from(*inputs) + usize::from(*outputs)),
        _ => return Err(FrameError::Index),
    };
    let body = message.get(blocks..).unwrap_or_default();
    let Some(([a, b, c, d, mark, key, zero, one], rest)) = body.split_first_chunk::<8>() else {
        return Err(FrameError::TextCommand);
    };
    if (*mark, *zero, *one) != (b'~', 0, 1) {
        return Err(FrameError::TextCommand);
    }
    let text = usize::try_from(i32::from_le_bytes([*a, *b, *c, *d])).map_err(|_| FrameError::TextCommand)?;
    if *key != 0 {
        return Ok(Some(WireFrame { command: TextCommand::parse(&[*key]), payload: blocks + 8, end }));
    }
    let text_bytes = rest.get(..text).ok_or(FrameError::TextCommand)?;
    Ok(Some(WireFrame { command: TextCommand::parse(text_bytes), payload: blocks + 8 + text, end }))
}

/// Encodes a data (`d`, `D`) or administrative (`a`) message up to its payload of `length` bytes.
pub fn encode(key: u8, envelope: Option<&str>, length: usize) -> Vec<u8> {
    let text = envelope.map(|envelope| [&[key, b' '], envelope.as_bytes(), &[0]].concat());
    let command = command(key, text.as_deref());
    let mut out = index(&[command.len(), length]);
    out.extend_from_slice(&command);
    out
}

/// The quit message.
pub fn quit() -> Vec<u8> {
    let command = command(b'q', Some(b"q\0"));
    let mut out = index(&[command.len()]);
    out.extend_from_slice(&command);
    out
}

fn index(blocks: &[usize]) -> Vec<u8> {
    let mut out = numbered(10).to_vec();
    out.extend_from_slice(&[blocks.len() as u8, 1]);
    out.extend_from_slice(&[0xff; 8]);
    for block in blocks {
        out.extend_from_slice(&(*block as i32).to_le_bytes());
    }
    out.extend_from_slice(&[0; 4]);
    out
}

fn command(key: u8, text: Option<&[u8]>) -> Vec<u8> {
    let mut out = (text.map_or(0, <[u8]>::len) as i32).to_le_bytes().to_vec();
    out.extend_from_slice(&[b'~', if text.is_some() { 0 } else { key }, 0, 1]);
    out.extend_from_slice(text.unwrap_or_default());
    out
}

/// Number of bytes of the acknowledgment at the start of `bytes` (it may contain some that are discarded).
pub fn parse_ack(bytes: &[u8]) -> Result<Option<usize>, FrameError> {
    let Some(first) = bytes.first_chunk::<8>() else { return Ok(None) };
    match number(first).map(usize::try_from) {
        Some(Ok(extra)) if extra <= 4096 => Ok((bytes.len() >= 8 + extra).then_some(8 + extra)),
        _ => Err(FrameError::Index),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Verb;

    #[test]
    fn a_message_is_read_only_when_it_is_whole() {
        let mut bytes = encode(b'D', Some("12 1700000000.25"), 3);
        bytes.extend_from_slice(b"xyz");
        for cut in 0..bytes.len() {
            assert_eq!(parse(&bytes[..cut], 1000), Ok(None), "{cut}");
        }
        let frame = parse(&bytes, 1000).unwrap().unwrap();
        assert_eq!(frame.command.verb, Verb::Data(false));
        assert_eq!(frame.command.envelope.as_deref(), Some("12 1700000000.25"));
        assert_eq!((&bytes[frame.payload..frame.end], frame.end), (b"xyz".as_slice(), bytes.len()));
        assert_eq!(parse(&quit(), 1000).unwrap().unwrap().command.verb, Verb::Quit);
    }

    #[test]
    fn length_bombs_are_refused_by_their_index_alone() {
        let bytes = encode(b'd', None, 0x7fff_ffff);
        assert!(matches!(parse(&bytes, 1 << 20), Err(FrameError::TooLong(..))));
        let mut negative = encode(b'd', None, 0);
        negative[22..26].copy_from_slice(&(-1_i32).to_le_bytes());
        assert_eq!(parse(&negative, 1 << 20), Err(FrameError::Index));
        assert_eq!(parse(b"garbage!", 1 << 20), Err(FrameError::Index));
    }
}
