//! Carriers: protocols of messages over a connection (spec section 4).

use std::{fmt, str::FromStr};

/// Protocol of messages over a connection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Carrier {
    /// Binary messages, each acknowledged.
    #[default]
    Tcp,
    /// Binary messages without acknowledgments.
    FastTcp,
    /// Lines of text.
    Text,
    /// Lines of text, each message acknowledged.
    TextAck,
    /// Binary messages in datagrams: streams only, no replies (spec section 18).
    Udp,
}

/// A carrier that is not supported.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the carrier \"{0}\" is not supported; use tcp, fast_tcp, text, text_ack or udp")]
pub struct UnknownCarrier(pub String);

impl Carrier {
    /// All carriers.
    pub const ALL: [Carrier; 5] = [Carrier::Tcp, Carrier::FastTcp, Carrier::Text, Carrier::TextAck, Carrier::Udp];

    /// Name in contacts.
    pub const fn name(self) -> &'static str {
        match self {
            Carrier::Tcp => "tcp",
            Carrier::FastTcp => "fast_tcp",
            Carrier::Text => "text",
            Carrier::TextAck => "text_ack",
            Carrier::Udp => "udp",
        }
    }

    /// True if the listener acknowledges every message.
    pub const fn acknowledges(self) -> bool {
        matches!(self, Carrier::Tcp | Carrier::TextAck)
    }

    /// True if messages are lines of text.
    pub const fn is_text(self) -> bool {
        matches!(self, Carrier::Text | Carrier::TextAck)
    }

    /// Bytes of an acknowledgment; empty if there is none (spec section 6).
    pub const fn ack(self) -> &'static [u8] {
        match self {
            Carrier::Tcp => b"YA\0\0\0\0RP",
            Carrier::TextAck => b"<ACK>\r\n",
            _ => b"",
        }
    }
}

impl fmt::Display for Carrier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Carrier {
    type Err = UnknownCarrier;

    /// Parses a carrier's name. Modifiers (`tcp+send.x`) are plug-ins of the original and are refused.
    fn from_str(name: &str) -> Result<Carrier, UnknownCarrier> {
        Carrier::ALL.into_iter().find(|carrier| carrier.name() == name).ok_or_else(|| UnknownCarrier(name.to_owned()))
    }
}
