//! One connection to the name server: the plain form, or a port's carriers (spec sections 3.1 and 3.4).

use super::SharedNameServer;
use crate::guests::LastMessage;
use crate::name::text::{LONGEST_LINE, REQUEST};
use crate::name::{NameReply, NameTable};
use crate::remote::{self, Holder};
use crate::wire::{Carrier, Verb, admin, frame, handshake, line};
use crate::{Bottle, Contact, Dialect, Value, auth};
use std::io;
use std::net::SocketAddr;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

/// Bytes that a peer has sent and that are not parsed yet.
struct IncomingBytes {
    stream: TcpStream,
    bytes: Vec<u8>,
}

impl IncomingBytes {
    /// Waits for more bytes; `false` at the end of the stream.
    async fn more(&mut self, limit: std::time::Duration) -> io::Result<bool> {
        let late = |_| io::Error::new(io::ErrorKind::TimedOut, "it said nothing for too long");
        let mut chunk = [0; 4096];
        let n = timeout(limit, self.stream.read(&mut chunk)).await.map_err(late)??;
        self.bytes.extend_from_slice(chunk.get(..n).unwrap_or_default());
        Ok(n > 0)
    }

    async fn send(&mut self, bytes: &[u8], limit: std::time::Duration) -> io::Result<()> {
        let late = |_| io::Error::new(io::ErrorKind::TimedOut, "it does not read its answer");
        timeout(limit, self.stream.write_all(bytes)).await.map_err(late)?
    }
}

/// Serves a connection to its end.
pub(super) async fn run(
    mut stream: TcpStream,
    peer: SocketAddr,
    shared: &SharedNameServer,
    activity: &LastMessage,
) -> io::Result<()> {
    let peer = peer.ip().to_canonical().to_string();
    stream.set_nodelay(true)?;
    if let Some(key) = &shared.options.auth {
        auth::accept(&mut stream, key).await?;
    }
    let limit = shared.options.timeout;
    let mut incoming = IncomingBytes { stream, bytes: Vec::new() };
    while incoming.bytes.len() < 8 {
        if !incoming.more(limit).await? {
            return Ok(());
        }
    }
    if incoming.bytes.starts_with(handshake::NAME_SERVER) {
        return plain(incoming, &peer, shared, activity).await;
    }
    let hello = loop {
        match handshake::parse(&incoming.bytes) {
            Ok(Some((hello, used))) => {
                incoming.bytes.drain(..used);
                break hello;
            }
            Ok(None) if incoming.more(limit).await? => {}
            Ok(None) => return Ok(()),
            Err(e) => {
                let text = format!("* Error. Protocol not found.\r\n* This is a YARP name server: {e}.\r\n");
                return incoming.send(text.as_bytes(), limit).await;
            }
        }
    };
    if hello.carrier == Carrier::Udp {
        return Ok(());
    }
    incoming.send(&handshake::reply(&hello, shared.contact.port), limit).await?;
    carrier(incoming, &hello, &peer, shared, activity).await
}

/// Serves the plain form: one answer per line.
async fn plain(
    mut incoming: IncomingBytes,
    peer: &str,
    shared: &SharedNameServer,
    activity: &LastMessage,
) -> io::Result<()> {
    loop {
        let Some(end) = incoming.bytes.iter().position(|b| *b == b'\n') else {
            if incoming.bytes.len() > LONGEST_LINE {
                return Err(io::Error::new(io::ErrorKind::InvalidData, "a line without end"));
            }
            if !incoming.more(shared.options.idle).await? {
                return Ok(());
            }
            continue;
        };
        activity.now();
        let line: Vec<u8> = incoming.bytes.drain(..=end).collect();
        let request = line.strip_prefix(REQUEST.as_bytes()).unwrap_or(&line);
        let answer = answer(&parse(request), peer, shared).await.text();
        incoming.send(&answer, shared.options.timeout).await?;
    }
}

/// Serves a port's carrier: data messages are requests, administrative ones are those of any port.
async fn carrier(
    mut incoming: IncomingBytes,
    hello: &handshake::Hello,
    peer: &str,
    shared: &SharedNameServer,
    activity: &LastMessage,
) -> io::Result<()> {
    let carrier = hello.carrier;
    let dialect = shared.options.dialect;
    let wrong = |e: &dyn std::fmt::Display| io::Error::new(io::ErrorKind::InvalidData, e.to_string());
    let mut scanner = line::Scanner::default();
    loop {
        let message = if carrier.is_text() {
            let found = scanner.parse(&incoming.bytes, LONGEST_LINE).map_err(|e| wrong(&e))?;
            found.map(|l| (l.command.verb, parse(&l.payload), l.end))
        } else {
            match frame::parse(&incoming.bytes, LONGEST_LINE).map_err(|e| wrong(&e))? {
                None => None,
                Some(f) => {
                    let payload = incoming.bytes.get(f.payload..f.end).unwrap_or_default();
                    // a payload that is not a bottle is dropped and acknowledged, as in the original
                    Some((f.command.verb, Bottle::decode(payload, dialect).unwrap_or_default(), f.end))
                }
            }
        };
        let Some((verb, payload, end)) = message else {
            if !incoming.more(shared.options.idle).await? {
                return Ok(());
            }
            continue;
        };
        activity.now();
        incoming.bytes.drain(..end);
        let mut reply = reply(&verb, &payload, hello, peer, shared).await;
        reply.extend_from_slice(carrier.ack());
        incoming.send(&reply, shared.options.timeout).await?;
        if verb == Verb::Quit {
            return Ok(());
        }
    }
}

/// Reply to one message, without its acknowledgment.
async fn reply(
    verb: &Verb,
    payload: &Bottle,
    hello: &handshake::Hello,
    peer: &str,
    shared: &SharedNameServer,
) -> Vec<u8> {
    let text = hello.carrier.is_text();
    let view = || admin::PortView {
        name: shared.contact.name.clone(),
        address: shared.contact.to_string(),
        is_input: true,
        is_rpc: true,
        inputs: vec![admin::Peer { name: hello.bare().into(), carrier: hello.carrier }],
        ..admin::PortView::default()
    };
    match verb {
        Verb::Data(wanted) => {
            let answer = answer(payload, peer, shared).await;
            match (wanted, text) {
                (false, _) => Vec::new(),
                (true, true) => answer.text(),
                (true, false) => answer.binary(shared.options.dialect),
            }
        }
        Verb::Admin => {
            let view = view();
            let reply = match admin::answer(&view, payload) {
                admin::AdminReply::Reply(reply) => reply,
                admin::AdminReply::Add { given, .. } => admin::added(&view.name, &given, admin::Added::NoOutputs),
                admin::AdminReply::Remove(name) => admin::removed(&view.name, &name, admin::Removed::None),
                admin::AdminReply::Set(..) => admin::ok(),
            };
            if text { [reply.to_text(), b"\r\n".to_vec()].concat() } else { reply.encode(shared.options.dialect) }
        }
        Verb::Describe if text => admin::describe(&view()).into_bytes(),
        Verb::Help if text => admin::KEYS.into(),
        Verb::Quit => Vec::new(),
        _ if text => admin::NOT_UNDERSTOOD.into(),
        _ => Vec::new(),
    }
}

/// Parses a line as a bottle; an invalid one is answered like an unknown command.
fn parse(line: &[u8]) -> Bottle {
    Bottle::parse(line, Dialect::V3).unwrap_or_default()
}

/// Applies a request to the table, and passes on the persistent connections that are due.
async fn answer(request: &Bottle, peer: &str, shared: &SharedNameServer) -> NameReply {
    let word = |v: &Value| v.as_text().map_or_else(|| v.to_string(), |t| t.into_owned());
    let mut words: Vec<String> = request.iter().map(word).collect();
    if words.first().is_some_and(|w| w == "NAME_SERVER") {
        words.remove(0);
    }
    let mut gone = None;
    let outcome = loop {
        let rival = {
            let mut table = shared.table();
            match rival(&table, &words, peer, shared) {
                Some(rival) if gone.as_ref() != Some(&rival) => rival,
                _ => break table.answer(&words, peer),
            }
        };
        if remote::holder(&shared.network, &rival).await == Holder::Port {
            tracing::warn!("name server: {rival} answers, and its name was not given to another port");
            return NameReply::end();
        }
        gone = Some(rival);
    };
    for link in outcome.links {
        if let Err(e) = shared.links.try_send(link) {
            tracing::warn!("name server: a persistent connection is left to the next announcement: {e}");
        }
    }
    outcome.answer
}

/// Port at another address that holds the name to be registered, if any. The original reassigns the name
/// without notice to its owner; here it is refused as long as the owner answers.
fn rival(table: &NameTable, words: &[String], peer: &str, shared: &SharedNameServer) -> Option<Contact> {
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let ["register", name, rest @ ..] = words.as_slice() else { return None };
    let before = table.query(name).filter(|before| before.name != shared.contact.name)?;
    let host = rest.get(1).copied().filter(|host| *host != "...").unwrap_or(peer);
    let same = before.host == host && rest.get(2).and_then(|number| number.parse().ok()) == Some(before.port);
    (!same).then(|| before.clone())
}
