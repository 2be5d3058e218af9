//! Commands of messages to a port, the same on all carriers (spec section 5).

use super::names::is_rooted;

/// Greatest length of an envelope, bytes; longer ones are dropped.
pub const MAX_ENVELOPE: usize = 4096;

/// Command of a message to the port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verb {
    /// Data for the port's owner; `true` if a reply is allowed.
    Data(bool),
    /// An administrative command follows as a bottle.
    Admin,
    /// The sender ends the connection.
    Quit,
    /// Describe the port.
    Describe,
    /// List the commands.
    Help,
    /// Add an output to this port.
    AddOutput(String),
    /// Remove the output to this port.
    RemoveOutput(String),
    /// Remove the input from this port.
    RemoveInput(String),
    /// Anything else.
    Unknown,
}

/// A verb with its envelope.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextCommand {
    /// Verb of the command.
    pub verb: Verb,
    /// The envelope of a data message.
    pub envelope: Option<String>,
}

impl TextCommand {
    /// Parses the text of a command: the first character is the key.
    pub fn parse(text: &[u8]) -> TextCommand {
        let text = text.strip_suffix(b"\0").unwrap_or(text);
        let name = |skip: usize| {
            let name = String::from_utf8_lossy(text.get(skip..).unwrap_or_default()).into_owned();
            is_rooted(&name).then_some(name)
        };
        let verb = match text.first() {
            Some(b'd') => Verb::Data(true),
            Some(b'D') => Verb::Data(false),
            Some(b'a') => Verb::Admin,
            Some(b'q') => Verb::Quit,
            Some(b'*') => Verb::Describe,
            Some(b'?') => Verb::Help,
            Some(b'/') => name(0).map_or(Verb::Unknown, Verb::AddOutput),
            Some(b'!') => name(1).map_or(Verb::Unknown, Verb::RemoveOutput),
            Some(b'~') => name(1).map_or(Verb::Unknown, Verb::RemoveInput),
            _ => Verb::Unknown,
        };
        let envelope = match (&verb, text.get(1), text.get(2..)) {
            (Verb::Data(_), Some(b' '), Some(envelope)) if !envelope.is_empty() && envelope.len() <= MAX_ENVELOPE => {
                Some(String::from_utf8_lossy(envelope).into_owned())
            }
            _ => None,
        };
        TextCommand { verb, envelope }
    }

    /// True if a payload follows on text carriers.
    pub fn has_payload(&self) -> bool {
        matches!(self.verb, Verb::Data(_) | Verb::Admin)
    }
}
