//! Administrative commands (spec section 7): from a command and a view of the port to the reply, or to the
//! action that the port has to take before it can reply.

use super::Carrier;
use crate::{Bottle, Contact, Text, Value, Vocab};

/// One connection as the commands report it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Peer {
    /// Name of the other side.
    pub name: String,
    /// Carrier of the connection.
    pub carrier: Carrier,
}

/// View of a port for the commands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PortView {
    /// Name of the port.
    pub name: String,
    /// Address of the port as a URI.
    pub address: String,
    /// True if it receives data.
    pub is_input: bool,
    /// True if it may have outputs.
    pub is_output: bool,
    /// True if it answers requests.
    pub is_rpc: bool,
    /// Connections from others, including the one that carries the command.
    pub inputs: Vec<Peer>,
    /// Connections to others.
    pub outputs: Vec<Peer>,
    /// User properties, in the order set.
    pub properties: Vec<(Text, Value)>,
}

/// Action required by a command.
#[derive(Clone, Debug, PartialEq)]
pub enum AdminReply {
    /// Reply at once.
    Reply(Bottle),
    /// Add an output, then reply [`added`] or the reason of the failure.
    Add {
        /// The other side as given (with the carrier of the two-argument form), for the reply.
        given: String,
        /// Contact of the other side.
        contact: Contact,
    },
    /// Remove the output to this name, or else the input from it, then reply [`removed`].
    Remove(String),
    /// Set (or with `None` remove) a user property, then reply `[ok]`.
    Set(Text, Option<Value>),
}

/// Outcome of adding an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Added {
    /// Connected.
    Yes,
    /// The name server has no such name, or there is no name server.
    Unknown,
    /// Not reachable, refused, or a carrier that is not supported.
    Refused,
    /// This port has no outputs.
    NoOutputs,
}

/// Connection that was removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Removed {
    /// One to the name.
    Output,
    /// One from the name.
    Input,
    /// No such connection.
    None,
}

/// Determines the action required by `command`.
pub fn answer(view: &PortView, command: &Bottle) -> AdminReply {
    let word = |i: usize| command.0.get(i).and_then(Value::as_vocab);
    let text = |i: usize| command.0.get(i).and_then(Value::as_text).map(|t| t.into_owned());
    let is = |i: usize, letters: &str| word(i) == Some(Vocab::new(letters));
    if is(0, "ver") {
        let numbers = [1, 2, 3].map(Value::Int32);
        return AdminReply::Reply(Bottle(std::iter::once(vocab("ver")).chain(numbers).collect()));
    }
    if is(0, "help") {
        return AdminReply::Reply(Bottle(
            std::iter::once(vocab("many")).chain(HELP.iter().copied().map(string)).collect(),
        ));
    }
    if is(0, "add") {
        let Some(name) = text(1) else { return unknown() };
        let mut contact = Contact::parse(&name);
        let mut given = name;
        if let Some(carrier) = text(2) {
            contact.carrier = carrier;
            given = contact.to_string();
        }
        return AdminReply::Add { given, contact };
    }
    if is(0, "del") {
        return text(1).map_or_else(unknown, AdminReply::Remove);
    }
    if is(0, "list") {
        let peers = if is(1, "out") { &view.outputs } else { &view.inputs };
        if !is(1, "out") && !is(1, "in") {
            return unknown();
        }
        return AdminReply::Reply(match text(2) {
            None => Bottle(peers.iter().map(|peer| string(&peer.name)).collect()),
            Some(name) => peers.iter().find(|p| p.name == name).map_or_else(Bottle::default, |peer| {
                let (from, to) = if is(1, "out") { (&view.name, &peer.name) } else { (&peer.name, &view.name) };
                let mut details = vec![pair("from", from), pair("to", to), pair("carrier", peer.carrier.name())];
                if peer.carrier == Carrier::Udp {
                    details.push(list(vec![string("connectionless"), Value::Int32(1)]));
                }
                Bottle(details)
            }),
        });
    }
    if is(0, "prop") {
        return property(view, command);
    }
    if is(0, "set") || is(0, "get") {
        let set = is(0, "set");
        let out = is(1, "out");
        let (Some(name), true) = (text(2), out || is(1, "in")) else { return unknown() };
        let peers = if out { &view.outputs } else { &view.inputs };
        if peers.iter().any(|peer| peer.name == name) {
            let to = if out { "to" } else { "from" };
            let done = Bottle(vec![Value::Int32(0), string(&format!("Configured connection {to} {name}\r\n"))]);
            return AdminReply::Reply(if set { done } else { Bottle(vec![list(Vec::new())]) });
        }
        let to = if out { "to" } else { "from" };
        return refuse(&format!("Could not find an incoming connection {to} {name}\r\n"));
    }
    if is(0, "atch") || is(0, "dtch") {
        return AdminReply::Reply(Bottle(vec![vocab("fail"), string(NO_MONITOR)]));
    }
    unknown()
}

fn property(view: &PortView, command: &Bottle) -> AdminReply {
    let word = |i: usize| command.0.get(i).and_then(Value::as_vocab);
    let key = command.0.get(2).and_then(Value::as_text).map(|t| t.into_owned());
    if word(1) == Some(Vocab::new("get")) {
        return AdminReply::Reply(match key {
            None => {
                Bottle(view.properties.iter().map(|(k, v)| list(vec![Value::String(k.clone()), v.clone()])).collect())
            }
            Some(key) if key == view.name => process(view),
            Some(key) if view.outputs.iter().chain(&view.inputs).any(|peer| peer.name == key) => {
                Bottle(vec![list(vec![string("sched"), list(Vec::new())]), list(vec![string("qos"), list(Vec::new())])])
            }
            Some(key) => {
                let known = view.properties.iter().find(|(k, _)| k.0 == key.as_bytes());
                known.map_or_else(Bottle::default, |(_, value)| Bottle(vec![value.clone()]))
            }
        });
    }
    match (word(1) == Some(Vocab::new("set")), key) {
        // Scheduling and quality of service: accepted and not acted on (spec section 18).
        (true, Some(key)) if key.starts_with('/') => AdminReply::Reply(ok()),
        (true, Some(key)) => AdminReply::Set(Text(key.into_bytes()), command.0.get(3).cloned()),
        _ => unknown(),
    }
}

/// Reply of `[prop] [get]` about the process; scheduling is the default of the system.
fn process(view: &PortView) -> Bottle {
    let number = |key: &str, n: i64| list(vec![string(key), i32::try_from(n).map_or(Value::Int64(n), Value::Int32)]);
    let pid = i64::from(std::process::id());
    let program = std::env::args().next().unwrap_or_default();
    let program = program.rsplit('/').next().unwrap_or_default();
    let host = Contact::parse(&view.address).host;
    let group = |key: &str, inside: Vec<Value>| list(vec![string(key), list(inside)]);
    Bottle(vec![
        group("sched", vec![number("policy", 0), number("priority", 0), number("tid", pid)]),
        group(
            "process",
            vec![
                pair("arguments", ""),
                pair("name", program),
                number("pid", pid),
                number("policy", 0),
                number("priority", 0),
            ],
        ),
        group("platform", vec![pair("hostname", &host), pair("os", "Linux")]),
        group(
            "port",
            vec![
                number("is_input", view.is_input.into()),
                number("is_output", view.is_output.into()),
                number("is_rpc", view.is_rpc.into()),
                pair("type", ""),
            ],
        ),
    ])
}

/// The reply to `[add]`.
pub fn added(me: &str, given: &str, how: Added) -> Bottle {
    let (code, text) = match how {
        Added::Yes => (0, format!("Added connection from {me} to {given}\r\n")),
        Added::Unknown => (-1, format!("Do not know how to connect to {given}\r\n")),
        Added::Refused => (-1, format!("Cannot connect to {given}\r\n")),
        Added::NoOutputs => (-1, "Outputs not allowed\r\n".to_owned()),
    };
    Bottle(vec![Value::Int32(code), string(&text)])
}

/// The reply to `[del]`.
pub fn removed(me: &str, name: &str, how: Removed) -> Bottle {
    let (code, text) = match how {
        Removed::Output => (0, format!("Removed connection from {me} to {name}\r\n")),
        Removed::Input => (0, format!("Removing connection from {name} to {me}\r\n")),
        Removed::None => (
            -1,
            format!(
                "Could not find an outgoing connection to {name}\r\nCould not find an incoming connection from {name}\r\n"
            ),
        ),
    };
    Bottle(vec![Value::Int32(code), string(&text)])
}

/// `[ok]`.
pub fn ok() -> Bottle {
    Bottle(vec![vocab("ok")])
}

/// The lines that `*` answers on text carriers.
pub fn describe(view: &PortView) -> String {
    let me = &view.name;
    let mut out = format!("This is {me} at {}\r\n", view.address);
    for Peer { name, carrier } in &view.outputs {
        out += &format!("There is an output connection from {me} to {name} using {carrier}\r\n");
    }
    if view.outputs.is_empty() {
        out += "There are no outgoing connections\r\n";
    }
    for Peer { name, carrier } in &view.inputs {
        out += &format!("There is an input connection from {name} to {me} using {carrier}\r\n");
    }
    if view.inputs.is_empty() {
        out += "There are no incoming connections\r\n";
    }
    out
}

/// The lines that an unknown key gets on text carriers.
pub const NOT_UNDERSTOOD: &str =
    "Port command not understood.\r\nType d to send data to the port's owner.\r\nType ? for help.\r\n";

/// The lines that `?` answers on text carriers.
pub const KEYS: &str = "This is a YARP port. The keys are:\r\n\
    d          data follows on the next line, with a reply\r\n\
    D          data follows on the next line, without a reply\r\n\
    a          an administrative command follows on the next line, such as [help]\r\n\
    *          describe this port\r\n\
    /name      add an output to that port\r\n\
    !/name     remove the output to that port\r\n\
    ~/name     remove the input from that port\r\n\
    q          end this connection\r\n\
    ?          this help\r\n";

fn unknown() -> AdminReply {
    AdminReply::Reply(Bottle(vec![vocab("fail"), string("send [help] for list of valid commands")]))
}

fn refuse(text: &str) -> AdminReply {
    AdminReply::Reply(Bottle(vec![Value::Int32(-1), string(text)]))
}

fn vocab(letters: &str) -> Value {
    Value::Vocab(Vocab::new(letters))
}

fn string(text: &str) -> Value {
    Value::String(Text(text.as_bytes().to_vec()))
}

fn list(values: Vec<Value>) -> Value {
    Value::List(Bottle(values))
}

fn pair(key: &str, value: &str) -> Value {
    list(vec![string(key), string(value)])
}

const NO_MONITOR: &str = "Portmonitor carrier modifier cannot be find or it is not enabled in YARP!";

const HELP: [&str; 20] = [
    "[help]                  # give this help",
    "[ver]                   # report protocol version information",
    "[add] $portname         # add an output connection",
    "[add] $portname $car    # add an output with a given protocol",
    "[del] $portname         # remove an input or output connection",
    "[list] [in]             # list input connections",
    "[list] [out]            # list output connections",
    "[list] [in]  $portname  # give details for input",
    "[list] [out] $portname  # give details for output",
    "[prop] [get]            # get all user-defined port properties",
    "[prop] [get] $prop      # get a user-defined port property (prop, val)",
    "[prop] [set] $prop $val # set a user-defined port property (prop, val)",
    "[prop] [get] $portname  # get Qos properties of a connection to/from a port",
    "[prop] [set] $portname  # set Qos properties of a connection to/from a port",
    "[prop] [get] $cur_port  # get information about current process (e.g., scheduling priority, pid)",
    "[prop] [set] $cur_port  # set properties of the current process (e.g., scheduling priority, pid)",
    "[atch] [out] $prop      # attach a portmonitor plug-in to the port's output",
    "[atch] [in]  $prop      # attach a portmonitor plug-in to the port's input",
    "[dtch] [out]            # detach portmonitor plug-in from the port's output",
    "[dtch] [in]             # detach portmonitor plug-in from the port's input",
];
