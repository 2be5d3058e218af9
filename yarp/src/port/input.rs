//! One connection from another port or program.

use super::core::{InputSink, PortCore};
use super::link::{Incoming, Link, LinkError};
use super::{Message, Payload};
use crate::guests::LastMessage;
use crate::wire::admin::{self, Peer, Removed};
use crate::wire::datagram::{Assembler, MAX_DATAGRAM};
use crate::wire::handshake::{self, HandshakeError, Hello};
use crate::wire::{Carrier, Verb, frame};
use crate::{Contact, auth};
use bytes::Bytes;
use std::net::SocketAddr;
use std::sync::Arc;
use tokio::net::{TcpStream, UdpSocket};
use tokio::time::timeout;

/// Serves a connection until it ends. Misbehavior of the other side ends only this connection.
pub(crate) async fn serve(core: Arc<PortCore>, stream: TcpStream, activity: Arc<LastMessage>) {
    let served = async {
        if let Err(error) = connection(&core, stream, &activity).await
            && !matches!(error, LinkError::Closed)
        {
            tracing::debug!(port = core.name, %error, "connection ended");
        }
    };
    tokio::select! {
        () = served => {}
        () = core.closed() => {}
    }
}

async fn connection(core: &Arc<PortCore>, stream: TcpStream, activity: &LastMessage) -> Result<(), LinkError> {
    stream.set_nodelay(true)?;
    let mut link = Link::new(stream, &core.options).within(&core.budget);
    if let Some(key) = core.network.auth() {
        auth::accept(link.stream_mut(), key).await?;
    }
    let limit = core.options.handshake;
    let hello = timeout(limit, link.take(handshake::parse)).await.map_err(|_| LinkError::Late(limit, "a handshake"))?;
    let hello = match hello {
        Err(LinkError::Handshake(HandshakeError::Unknown(_))) => return not_found(core, link).await,
        other => other?,
    };
    let peer = Peer { name: hello.bare().to_owned(), carrier: hello.carrier };
    if hello.carrier == Carrier::Udp {
        return datagrams(core, link, &hello, peer, activity).await;
    }
    let admitted = core.admit(peer);
    link.write(&[&handshake::reply(&hello, core.contact.port)]).await?;
    let conversation = async {
        loop {
            let incoming = link.message(hello.carrier, core.options.max_message, core.options.message).await?;
            activity.now();
            if respond(core, &mut link, &hello, admitted.id, incoming).await? {
                return Ok(());
            }
        }
    };
    tokio::select! {
        end = conversation => return end,
        () = admitted.end.notified() => {}
    }
    // Removed from this side: like the original, acknowledge what may be outstanding.
    link.write(&[hello.carrier.ack()]).await
}

/// Answers an invalid handshake with instructions. Reads the rest that is sent, since closing on unread bytes
/// would lose the text.
async fn not_found(core: &PortCore, mut link: Link) -> Result<(), LinkError> {
    link.write(&[handshake::NOT_FOUND.as_bytes()]).await?;
    link.shutdown().await;
    let _ = timeout(core.options.handshake / 10, link.until_closed()).await;
    Ok(())
}

/// Executes a message; returns `true` if the connection ends.
async fn respond(
    core: &Arc<PortCore>,
    link: &mut Link,
    hello: &Hello,
    id: u64,
    incoming: Incoming,
) -> Result<bool, LinkError> {
    let Incoming { command, payload } = incoming;
    let text = hello.carrier.is_text();
    let dialect = core.network.dialect();
    let payload = if text { Payload::Text(payload.into()) } else { Payload::Binary(payload) };
    let mut reply: Option<Payload> = None;
    let mut lines = String::new();
    let mut quits = false;
    match command.verb {
        Verb::Data(wants_reply) => {
            let from = hello.bare().to_owned();
            let message = Message { payload, envelope: command.envelope, from, connection: id, wants_reply };
            match &core.sink {
                InputSink::Inbox(inbox) => inbox.push(message).await,
                InputSink::Handler(handler) => reply = handler.call(message).await.filter(|_| wants_reply),
                InputSink::Nothing => {}
            }
        }
        // An unreadable command counts as an unknown one.
        Verb::Admin => reply = Some(core.admin(&payload.bottle(dialect).unwrap_or_default()).await.into()),
        Verb::Quit => quits = true,
        Verb::Describe => lines = admin::describe(&core.view()),
        Verb::Help => lines = admin::KEYS.to_owned(),
        Verb::Unknown => lines = admin::NOT_UNDERSTOOD.to_owned(),
        Verb::AddOutput(name) => {
            let how = core.try_add(&Contact::parse(&name)).await;
            lines = reply_text(&admin::added(&core.name, &name, how));
        }
        Verb::RemoveOutput(name) => {
            let how = if core.remove_output(&name).await { Removed::Output } else { Removed::None };
            lines = reply_text(&admin::removed(&core.name, &name, how));
        }
        Verb::RemoveInput(name) => {
            let how = if core.remove_input(&name) { Removed::Input } else { Removed::None };
            lines = reply_text(&admin::removed(&core.name, &name, how));
        }
    }
    let ack = hello.carrier.ack();
    match reply {
        Some(reply) if text => {
            let reply = reply.text(dialect).unwrap_or_else(|error| unreadable(core, &error).into());
            link.write(&[&reply, b"\r\n", ack]).await?;
        }
        Some(reply) => {
            let reply = reply.binary(dialect).unwrap_or_else(|error| {
                unreadable(core, &error);
                Bytes::new()
            });
            link.write(&[&reply, ack]).await?;
        }
        None if text => link.write(&[lines.as_bytes(), ack]).await?,
        None => link.write(&[ack]).await?,
    }
    Ok(quits)
}

/// Logs a handler's reply that can't be written on this carrier.
fn unreadable(core: &PortCore, error: &super::PayloadError) -> &'static [u8] {
    tracing::warn!(port = core.name, %error, "the reply has no form for this carrier");
    b""
}

/// Text of an administrative reply.
fn reply_text(reply: &crate::Bottle) -> String {
    reply.0.get(1).and_then(|value| value.as_text()).map(|text| text.into_owned()).unwrap_or_default()
}

/// Greatest size of a message in datagrams, bytes; much shorter ones are already lost often.
const LONGEST_BY_DATAGRAMS: usize = 8 << 20;

/// Receives from a sender of datagrams (spec section 18). It sends from the host of its TCP connection. The
/// specification requires the same port number, but 3.5 built without ACE uses any. The first valid datagram
/// from that host therefore determines the number, and other senders are ignored from then on.
async fn datagrams(
    core: &Arc<PortCore>,
    mut link: Link,
    hello: &Hello,
    peer: Peer,
    activity: &LastMessage,
) -> Result<(), LinkError> {
    let local = link.stream().local_addr()?;
    let remote = link.stream().peer_addr()?;
    let socket = UdpSocket::bind(SocketAddr::new(local.ip(), 0)).await?;
    let admitted = core.admit(peer);
    link.write(&[&handshake::reply(hello, socket.local_addr()?.port())]).await?;
    drop(link);
    let mut sender: Option<SocketAddr> = None;
    let mut assembler = Assembler::default();
    let mut buffer = vec![0; MAX_DATAGRAM + 1];
    let longest = core.options.max_message.min(LONGEST_BY_DATAGRAMS);
    loop {
        let received = tokio::select! {
            received = socket.recv_from(&mut buffer) => received,
            () = admitted.end.notified() => return Ok(()),
        };
        let (length, from) = received?;
        if from.ip() != remote.ip() || sender.is_some_and(|sender| sender != from) {
            continue;
        }
        let datagram = buffer.get(..length).unwrap_or_default();
        let Some(bytes) = assembler.take(datagram, longest) else { continue };
        let Ok(Some(found)) = frame::parse(&bytes, core.options.max_message) else { continue };
        sender = Some(from);
        activity.now();
        let Verb::Data(_) = found.command.verb else { continue };
        let payload = Payload::Binary(Bytes::from(bytes).split_off(found.payload));
        let from = hello.bare().to_owned();
        let envelope = found.command.envelope;
        let message = Message { payload, envelope, from, connection: admitted.id, wants_reply: false };
        match &core.sink {
            InputSink::Inbox(inbox) => inbox.offer(message),
            InputSink::Handler(handler) => drop(handler.call(message).await),
            InputSink::Nothing => {}
        }
    }
}
