//! Address of a port: its name, carrier, host and number, and its URI (spec section 2).

use std::fmt;

/// Address of a port, or the known part of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Contact {
    /// Name of the port, such as `/icub/head/state:o`; empty if only the address is known.
    pub name: String,
    /// Carrier, such as `tcp`; empty if none was given. Modifiers (`+send...`) are retained.
    pub carrier: String,
    /// Host; empty if only the name is known.
    pub host: String,
    /// Port number; 0 if unknown.
    pub port: u16,
}

impl Contact {
    /// Contact of a registered port.
    pub fn new(name: &str, carrier: &str, host: &str, port: u16) -> Contact {
        Contact { name: name.into(), carrier: carrier.into(), host: host.into(), port }
    }

    /// Parses the forms that users and ports write: `/name`, `carrier://name`, `carrier://host:number/name`.
    /// Never fails: a text that is not an address is a name.
    pub fn parse(text: &str) -> Contact {
        if text.starts_with('/') {
            return Contact { name: text.into(), ..Contact::default() };
        }
        let cut = text.find("://").map(|i| (i, 3)).or_else(|| text.find(":/").map(|i| (i, 2)));
        let Some((carrier, rest)) = cut.and_then(|(i, n)| Some((text.get(..i)?, text.get(i + n..)?))) else {
            return Contact { name: text.into(), ..Contact::default() };
        };
        let (first, tail) = rest.split_once('/').map_or((rest, None), |(a, b)| (a, Some(b)));
        let address = first.rsplit_once(':').and_then(|(host, n)| Some((host, n.parse::<u16>().ok()?)));
        match address {
            Some((host, port)) if !host.is_empty() => Contact {
                name: tail.filter(|t| !t.is_empty()).map(|t| format!("/{t}")).unwrap_or_default(),
                carrier: if carrier.is_empty() { "tcp".into() } else { carrier.into() },
                host: host.into(),
                port,
            },
            _ => Contact { name: format!("/{rest}"), carrier: carrier.into(), host: String::new(), port: 0 },
        }
    }

    /// The carrier without its modifiers: `tcp` of `tcp+send.portmonitor`.
    pub fn bare_carrier(&self) -> &str {
        self.carrier.split('+').next().unwrap_or_default()
    }
}

/// The URI: `tcp://host:number/` with an address, else `carrier:/` and the name, else the name alone.
impl fmt::Display for Contact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Contact { name, carrier, host, port } = self;
        match (host.is_empty(), carrier.is_empty()) {
            (false, true) => write!(f, "tcp://{host}:{port}/"),
            (false, false) => write!(f, "{carrier}://{host}:{port}/"),
            (true, false) => write!(f, "{carrier}:/{name}"),
            (true, true) => f.write_str(name),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_forms_of_the_specification() {
        assert_eq!(Contact::parse("/a/rpc:i"), Contact::new("/a/rpc:i", "", "", 0));
        assert_eq!(Contact::parse("tcp://reader"), Contact::new("/reader", "tcp", "", 0));
        assert_eq!(Contact::parse("tcp:/reader"), Contact::new("/reader", "tcp", "", 0));
        assert_eq!(Contact::parse("udp://p/rpc:i"), Contact::new("/p/rpc:i", "udp", "", 0));
        assert_eq!(Contact::parse("tcp://127.0.0.1:10003/"), Contact::new("", "tcp", "127.0.0.1", 10003));
        assert_eq!(Contact::parse("://h:7/x/y"), Contact::new("/x/y", "tcp", "h", 7));
        assert_eq!(Contact::parse("anon_rpc"), Contact::new("anon_rpc", "", "", 0));
        assert_eq!(Contact::parse("tcp+send.portmonitor://x").bare_carrier(), "tcp");
        assert_eq!(Contact::parse("tcp://x:99999").name, "/x:99999");
    }

    #[test]
    fn prints_what_it_read() {
        for text in ["/a/rpc:i", "tcp://reader", "udp://p/rpc:i", "tcp://127.0.0.1:10003/"] {
            assert_eq!(Contact::parse(text).to_string(), text);
        }
    }
}
