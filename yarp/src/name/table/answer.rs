//! Forms of an answer, and their encodings.

use crate::name::text::{END, registration};
use crate::{Bottle, Contact, Dialect, Vocab};

/// The answer to `help`.
pub(super) const HELP: [&str; 14] = [
    "Here are some ways to use the name server:",
    "+ help",
    "+ list [$prefix]",
    "+ register $portname",
    "+ register $portname $carrier $ipAddress $portNumber",
    "  (if you want a field set automatically, write '...')",
    "+ unregister $portname",
    "+ query $portname",
    "+ set $portname $property $value",
    "+ get $portname $property",
    "+ check $portname $property",
    "+ route $port1 $port2",
    "+ runners",
    "  (to get a list of the yarprun ports)",
];

/// Answer of a name server.
#[derive(Clone, Debug, PartialEq)]
pub enum NameReply {
    /// Lines with a terminator, text on every carrier.
    Lines(Vec<String>),
    /// A bottle: one line in text, binary on binary carriers.
    Bottle(Bottle),
}

impl NameReply {
    /// The terminator alone.
    pub fn end() -> NameReply {
        NameReply::Lines(Vec::new())
    }

    /// `[ok]` or `[fail]`.
    pub fn done(ok: bool) -> NameReply {
        NameReply::Bottle(Bottle::of([Vocab::new(if ok { "ok" } else { "fail" })]))
    }

    /// The registration, if there is one.
    pub fn registration(contact: Option<&Contact>) -> NameReply {
        NameReply::Lines(contact.map(registration).into_iter().collect())
    }

    /// The list of ports as a bottle.
    pub fn ports(contacts: Vec<&Contact>) -> NameReply {
        contacts.into_iter().fold(Bottle::of(["ports"]), |all, c| all.with(port(Some(c)))).into()
    }

    /// Encodes the answer for text carriers and the plain form, with its line ends.
    pub fn text(&self) -> Vec<u8> {
        match self {
            NameReply::Lines(lines) => {
                lines.iter().map(String::as_str).chain([END]).flat_map(|l| [l, "\r\n"]).collect::<String>().into()
            }
            NameReply::Bottle(bottle) => {
                let mut text = bottle.to_text();
                text.extend_from_slice(b"\r\n");
                text
            }
        }
    }

    /// Encodes the answer for binary carriers: lines remain text (spec section 3.4).
    pub fn binary(&self, dialect: Dialect) -> Vec<u8> {
        match self {
            NameReply::Lines(_) => self.text(),
            NameReply::Bottle(bottle) => bottle.encode(dialect),
        }
    }
}

impl From<Bottle> for NameReply {
    fn from(bottle: Bottle) -> NameReply {
        NameReply::Bottle(bottle)
    }
}

/// A port as a bottle, or the error for an unknown one.
pub(super) fn port(contact: Option<&Contact>) -> Bottle {
    let port = Bottle::of(["port"]);
    match contact {
        None => port.with(Bottle::of(["error"]).with(-2).with("port not known")),
        Some(Contact { name, carrier, host, port: number }) => port
            .with(Bottle::of(["name", name]))
            .with(Bottle::of(["ip", host]))
            .with(Bottle::of(["port_number"]).with(i32::from(*number)))
            .with(Bottle::of(["carrier", carrier])),
    }
}
