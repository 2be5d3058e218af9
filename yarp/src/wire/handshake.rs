//! First bytes of a connection (spec section 4): the carrier, and the name of the initiator.

use super::{carrier::Carrier, frame, names::MAX_NAME};

/// Base number of the binary carriers.
const FAMILY: i32 = 7777;

/// First message of the initiator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hello {
    /// Requested carrier.
    pub carrier: Carrier,
    /// Name as sent; may contain modifiers after a blank.
    pub name: String,
}

impl Hello {
    /// The name without modifiers.
    pub fn bare(&self) -> &str {
        bare(&self.name)
    }
}

/// A sender's name without the modifiers after the first blank.
pub fn bare(name: &str) -> &str {
    name.split(' ').next().unwrap_or_default()
}

/// Reason why a handshake was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HandshakeError {
    /// The first 8 bytes select nothing known.
    #[error("the first 8 bytes {0:02x?} select no carrier; the peer does not speak YARP")]
    Unknown([u8; 8]),
    /// A carrier of YARP that is not supported.
    #[error("the peer wants the carrier number {0} (mcast, shmem, ...), which is not supported; use tcp")]
    Unsupported(i32),
    /// The name is empty, too long or contains control characters.
    #[error("the peer's name is empty, longer than {MAX_NAME} bytes or contains control characters")]
    Name,
    /// The peer requests a plug-in for its data.
    #[error("the peer asks for a port monitor, which is not supported; connect without \"portmonitor\"")]
    PortMonitor,
    /// The reply is invalid.
    #[error("the peer's reply to the handshake is none of YARP")]
    Reply,
}

/// The first 8 bytes of a name server's own text protocol (spec section 3.1), which ordinary ports refuse.
pub const NAME_SERVER: &[u8; 8] = b"NAME_SER";

/// Parses the initiator's hello; returns it with its number of bytes. `None` if more bytes are needed.
pub fn parse(bytes: &[u8]) -> Result<Option<(Hello, usize)>, HandshakeError> {
    let Some((first, rest)) = bytes.split_first_chunk::<8>() else { return Ok(None) };
    let (carrier, name, used) = match first {
        b"CONNECT " | b"CONNACK " => {
            let carrier = if first == b"CONNACK " { Carrier::TextAck } else { Carrier::Text };
            let Some(end) = rest.iter().take(MAX_NAME + 2).position(|b| *b == b'\n') else {
                return if rest.len() > MAX_NAME + 1 { Err(HandshakeError::Name) } else { Ok(None) };
            };
            let name = rest.get(..end).unwrap_or_default();
            (carrier, name.strip_suffix(b"\r").unwrap_or(name), 8 + end + 1)
        }
        _ => {
            let number = frame::number(first).ok_or(HandshakeError::Unknown(*first))?;
            let carrier = match number.wrapping_sub(FAMILY) {
                n @ 0..=255 if n & 15 == 3 && n & 128 != 0 => Carrier::Tcp,
                n @ 0..=255 if n & 15 == 3 => Carrier::FastTcp,
                0 | 128 => Carrier::Udp,
                n @ 0..=255 => return Err(HandshakeError::Unsupported(FAMILY + n)),
                _ => return Err(HandshakeError::Unknown(*first)),
            };
            let Some((length, rest)) = rest.split_first_chunk::<4>() else { return Ok(None) };
            let length = usize::try_from(i32::from_le_bytes(*length)).map_err(|_| HandshakeError::Name)?;
            if !(1..=MAX_NAME + 1).contains(&length) {
                return Err(HandshakeError::Name);
            }
            let Some(name) = rest.get(..length) else { return Ok(None) };
            (carrier, name.strip_suffix(b"\0").unwrap_or(name), 12 + length)
        }
    };
    let name = std::str::from_utf8(name).map_err(|_| HandshakeError::Name)?;
    if bare(name).is_empty() || name.chars().any(char::is_control) {
        return Err(HandshakeError::Name);
    }
    if name.split_once(' ').is_some_and(|(_, modifiers)| modifiers.contains("portmonitor")) {
        return Err(HandshakeError::PortMonitor);
    }
    Ok(Some((Hello { carrier, name: name.to_owned() }, used)))
}

/// Encodes the initiator's hello.
pub fn encode(carrier: Carrier, name: &str) -> Vec<u8> {
    let number = match carrier {
        Carrier::Text => return format!("CONNECT {name}\r\n").into_bytes(),
        Carrier::TextAck => return format!("CONNACK {name}\r\n").into_bytes(),
        Carrier::Tcp => FAMILY + 3 + 128,
        Carrier::FastTcp => FAMILY + 3,
        Carrier::Udp => FAMILY,
    };
    let mut out = frame::numbered(number).to_vec();
    out.extend_from_slice(&(name.len() as i32 + 1).to_le_bytes());
    out.extend_from_slice(name.as_bytes());
    out.push(0);
    out
}

/// Encodes the listener's reply: its own port number (for udp the number of the new UDP socket), or a
/// welcome.
pub fn reply(hello: &Hello, port: u16) -> Vec<u8> {
    match hello.carrier {
        Carrier::Text | Carrier::TextAck => format!("Welcome {}\r\n", hello.name).into_bytes(),
        _ => frame::numbered(i32::from(port)).to_vec(),
    }
}

/// Parses the listener's reply; returns its port number (0 on text carriers), and its number of bytes.
pub fn parse_reply(carrier: Carrier, bytes: &[u8]) -> Result<Option<(i32, usize)>, HandshakeError> {
    if carrier.is_text() {
        return match bytes.iter().position(|b| *b == b'\n') {
            Some(end) if bytes.starts_with(b"Welcome ") => Ok(Some((0, end + 1))),
            None if bytes.len() <= MAX_NAME + 16 => Ok(None),
            _ => Err(HandshakeError::Reply),
        };
    }
    let Some(first) = bytes.first_chunk::<8>() else { return Ok(None) };
    frame::number(first).map(|number| Some((number, 8))).ok_or(HandshakeError::Reply)
}

/// Answer of a listener to bytes that select no carrier, before it closes.
pub const NOT_FOUND: &str = "* Error. Protocol not found.\r\n\
    * Hello. You appear to be trying to communicate with a YARP Port.\r\n\
    * The first 8 bytes sent to a YARP Port are critical for identifying the\r\n\
    * protocol you wish to speak.\r\n\
    * The first 8 bytes you sent were not associated with any particular protocol.\r\n\
    * If you are a human, try typing \"CONNECT foo\" followed by a <RETURN>.\r\n\
    * The 8 bytes \"CONNECT \" correspond to a simple text-mode protocol.\r\n\
    * Goodbye.\r\n";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_written_are_read_back() {
        for carrier in Carrier::ALL {
            let bytes = encode(carrier, "/foo");
            for cut in 0..bytes.len() {
                assert_eq!(parse(&bytes[..cut]), Ok(None), "{carrier} {cut}");
            }
            let (hello, used) = parse(&bytes).unwrap().unwrap();
            assert_eq!((hello.carrier, hello.name.as_str(), used), (carrier, "/foo", bytes.len()));
            let answer = reply(&hello, 10003);
            let number = if carrier.is_text() { 0 } else { 10003 };
            assert_eq!(parse_reply(carrier, &answer), Ok(Some((number, answer.len()))));
        }
    }

    #[test]
    fn bad_hellos_are_refused_before_their_name_is_read() {
        assert!(matches!(parse(b"BOGUS   "), Err(HandshakeError::Unknown(_))));
        let mut bytes = frame::numbered(7908).to_vec();
        bytes.extend_from_slice(&i32::MAX.to_le_bytes());
        assert_eq!(parse(&bytes), Err(HandshakeError::Name));
        assert_eq!(parse(&frame::numbered(7778)), Err(HandshakeError::Unsupported(7778)));
        assert_eq!(parse(&[b"CONNECT ".as_slice(), &[b'x'; 2000]].concat()), Err(HandshakeError::Name));
        let monitored = encode(Carrier::Tcp, "/a (send portmonitor) (file x)");
        assert_eq!(parse(&monitored), Err(HandshakeError::PortMonitor));
    }
}
