//! Requests of third programs to ports: to connect, to disconnect, to describe themselves (spec section 8).

use crate::{Bottle, Contact, Dialect, NameError, Network, TextError, Value, Vocab};
use std::io;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;
use tokio::time::timeout;

/// Greatest size of a port's answer, bytes.
const MAX_ANSWER_BYTES: u64 = 1 << 20;

/// Reason why a port did not execute the request of a third program.
#[derive(Debug, thiserror::Error)]
pub enum RemoteError {
    /// The request to the name server failed.
    #[error(transparent)]
    Name(#[from] NameError),
    /// The sending port is not registered.
    #[error("could not find source port {0}: is it running, and is its name spelled right? (`mobee yarp list`)")]
    NoSource(String),
    /// The receiving port is not registered.
    #[error("could not find destination port {0}: is it running, and is its name spelled right? (`mobee yarp list`)")]
    NoDestination(String),
    /// The port is not registered.
    #[error("could not find port {0}: is it running, and is its name spelled right? (`mobee yarp list`)")]
    NoPort(String),
    /// Registered, but it does not answer.
    #[error(
        "{name} is registered at {host}:{port} but does not answer ({why}): if it is dead, `mobee yarp clean` forgets it"
    )]
    Silent {
        /// Name of the port.
        name: String,
        /// Its registered host.
        host: String,
        /// Its registered number.
        port: u16,
        /// The system's reason.
        why: String,
    },
    /// There is no such connection.
    #[error("no such connection from {0} to {1}")]
    NoConnection(String, String),
    /// The port refused.
    #[error("{0} refused: {1}")]
    Refused(String, String),
}

/// A connection as reported by its sending port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Connection {
    /// The sending port.
    pub from: String,
    /// The receiving port.
    pub to: String,
    /// Carrier of the connection.
    pub carrier: String,
}

/// Requests `src` to connect to `dest`, either of which may contain a carrier (`udp://reader`). Returns the
/// port's message.
///
/// # Errors
/// A port is unknown or does not answer, or the source refuses.
pub async fn connect(network: &Network, src: &str, dest: &str, carrier: Option<&str>) -> Result<String, RemoteError> {
    let (src, dest) = (Contact::parse(src), Contact::parse(dest));
    let source = find(network, &src).await?.ok_or_else(|| RemoteError::NoSource(src.name.clone()))?;
    find(network, &dest).await?.ok_or_else(|| RemoteError::NoDestination(dest.name.clone()))?;
    let chosen = [carrier.unwrap_or_default(), &dest.carrier, &src.carrier].into_iter().find(|c| !c.is_empty());
    let target = Contact { carrier: chosen.unwrap_or("tcp").into(), ..dest };
    let request = command("add").with(target.to_string());
    accepted(&source.name, &admin(network, &source, &request).await?)
}

/// Requests `src` to drop its connection to `dest`. Returns the port's message.
///
/// # Errors
/// There is no such connection, or the source is unknown or does not answer.
pub async fn disconnect(network: &Network, src: &str, dest: &str) -> Result<String, RemoteError> {
    let (src, dest) = (Contact::parse(src), Contact::parse(dest));
    let source = find(network, &src).await?.ok_or_else(|| RemoteError::NoSource(src.name.clone()))?;
    if listed(network, &source, &dest.name).await?.is_none() {
        return Err(RemoteError::NoConnection(src.name, dest.name));
    }
    accepted(&source.name, &admin(network, &source, &command("del").with(dest.name)).await?)
}

/// The connection from `src` to `dest`, if there is one.
///
/// # Errors
/// The source is unknown or does not answer.
pub async fn connection(network: &Network, src: &str, dest: &str) -> Result<Option<Connection>, RemoteError> {
    let (src, dest) = (Contact::parse(src), Contact::parse(dest));
    let source = find(network, &src).await?.ok_or_else(|| RemoteError::NoSource(src.name.clone()))?;
    listed(network, &source, &dest.name).await
}

/// True if a port is registered and answers to its name.
///
/// # Errors
/// The request to the name server failed.
pub async fn exists(network: &Network, name: &str) -> Result<bool, RemoteError> {
    let Some(contact) = find(network, &Contact::parse(name)).await? else { return Ok(false) };
    if contact.name.is_empty() {
        return Ok(admin(network, &contact, &command("ver")).await.is_ok());
    }
    Ok(holder(network, &contact).await == Holder::Port)
}

/// Program that listens at the registered address of a port name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holder {
    /// No program, or another one: the port has died, and its number may have been reassigned.
    Gone,
    /// The port of that name.
    Port,
    /// A program that accepts connections and does not answer: it may be the suspended owner of the port.
    Silent,
}

/// Determines whether the port of this name still listens at its registered address. A name server also lists
/// ports that died without unregistering, and the system reassigns their numbers: only the port's own name
/// counts.
pub async fn holder(network: &Network, contact: &Contact) -> Holder {
    let Ok(stream) = network.connect_tcp(&contact.host, contact.port).await else { return Holder::Gone };
    match timeout(network.timeout(), exchange(stream, "<ping>", b"*\r\n")).await {
        Err(_) => Holder::Silent,
        Ok(Ok(lines)) if lines.iter().any(|line| is_of(line, &contact.name)) => Holder::Port,
        Ok(_) => Holder::Gone,
    }
}

/// True if a line of a port's description contains this name: `This is /NAME at tcp://...`.
fn is_of(line: &str, name: &str) -> bool {
    line.strip_prefix("This is ").and_then(|rest| rest.strip_prefix(name)).is_some_and(|rest| rest.starts_with(" at "))
}

/// Description of a port and its connections, in lines.
///
/// # Errors
/// The port is unknown or does not answer.
pub async fn ping(network: &Network, name: &str) -> Result<Vec<String>, RemoteError> {
    let contact = found(network, name).await?;
    talk(network, &contact, "<ping>", b"*\r\n").await
}

/// Sends any administrative command of spec section 7 to a port.
///
/// # Errors
/// The port is unknown or does not answer.
pub async fn ask(network: &Network, name: &str, request: &Bottle) -> Result<Bottle, RemoteError> {
    admin(network, &found(network, name).await?, request).await
}

async fn found(network: &Network, name: &str) -> Result<Contact, RemoteError> {
    let contact = Contact::parse(name);
    find(network, &contact).await?.ok_or(RemoteError::NoPort(contact.name))
}

/// Completes a contact by the name server, unless it has an address.
async fn find(network: &Network, contact: &Contact) -> Result<Option<Contact>, NameError> {
    if !contact.host.is_empty() {
        return Ok(Some(contact.clone()));
    }
    network.query(&contact.name).await
}

async fn listed(network: &Network, source: &Contact, dest: &str) -> Result<Option<Connection>, RemoteError> {
    let answer = admin(network, source, &command("list").with(Vocab::new("out")).with(dest)).await?;
    let text = |key: &str| answer.find(key).and_then(|v| v.first()).and_then(Value::as_text).map(|t| t.into_owned());
    Ok(text("carrier").map(|carrier| Connection { from: source.name.clone(), to: dest.into(), carrier }))
}

async fn admin(network: &Network, contact: &Contact, request: &Bottle) -> Result<Bottle, RemoteError> {
    let message = [b"a\r\n".as_slice(), &request.to_text(), b"\r\n"].concat();
    let lines = talk(network, contact, "admin", &message).await?;
    Bottle::parse(lines.join("\n"), Dialect::V3).map_err(|e: TextError| silent(contact, e))
}

/// Sends one message to a port over `text_ack`. Returns the lines of its answer.
async fn talk(network: &Network, contact: &Contact, me: &str, message: &[u8]) -> Result<Vec<String>, RemoteError> {
    let stream = network.connect_tcp(&contact.host, contact.port).await.map_err(|e| silent(contact, e))?;
    let late = |_| silent(contact, format!("nothing within {:?}", network.timeout()));
    timeout(network.timeout(), exchange(stream, me, message)).await.map_err(late)?.map_err(|e| silent(contact, e))
}

async fn exchange(mut stream: TcpStream, me: &str, message: &[u8]) -> io::Result<Vec<String>> {
    let (read, mut write) = stream.split();
    let mut lines = BufReader::new(read.take(MAX_ANSWER_BYTES)).split(b'\n');
    let mut next = async || match lines.next_segment().await? {
        Some(line) => Ok(String::from_utf8_lossy(line.strip_suffix(b"\r").unwrap_or(&line)).into_owned()),
        None => Err(io::Error::new(io::ErrorKind::UnexpectedEof, "it closed the connection")),
    };
    write.write_all(format!("CONNACK {me}\r\n").as_bytes()).await?;
    let welcome = next().await?;
    if !welcome.starts_with("Welcome ") {
        return Err(io::Error::new(io::ErrorKind::InvalidData, format!("it said \"{welcome}\"")));
    }
    write.write_all(message).await?;
    let mut answer = Vec::new();
    loop {
        let line = next().await?;
        if line == "<ACK>" {
            return Ok(answer);
        }
        answer.push(line);
    }
}

fn silent(contact: &Contact, why: impl ToString) -> RemoteError {
    let Contact { name, host, port, .. } = contact.clone();
    RemoteError::Silent { name, host, port, why: why.to_string() }
}

fn command(letters: &str) -> Bottle {
    Bottle::of([Vocab::new(letters)])
}

/// The text of an answer `0 "text"`; other numbers are refusals.
fn accepted(name: &str, answer: &Bottle) -> Result<String, RemoteError> {
    let text = answer.get(1).and_then(Value::as_text).map(|t| t.trim_end().to_string()).unwrap_or_default();
    match answer.get(0).and_then(Value::as_i64) {
        Some(0) => Ok(text),
        _ if text.is_empty() => Err(RemoteError::Refused(name.into(), answer.to_string())),
        _ => Err(RemoteError::Refused(name.into(), text)),
    }
}
