//! Connecting to other ports: lookup and handshake.

use super::link::Link;
use super::{PortError, PortOptions};
use crate::wire::{Carrier, handshake};
use crate::{Contact, Network};
use std::net::SocketAddr;
use tokio::net::UdpSocket;
use tokio::time::timeout;

/// A connection after its handshake.
pub(crate) enum DialedConnection {
    Stream(Link),
    /// The socket is connected to the reader's. The contact is that of the reader's TCP listener.
    Datagrams(UdpSocket, Contact),
}

/// Completes a contact that has only a name.
pub(crate) async fn find(network: &Network, contact: &Contact) -> Result<Contact, PortError> {
    if contact.port != 0 && !contact.host.is_empty() {
        return Ok(contact.clone());
    }
    network.query(&contact.name).await?.ok_or_else(|| PortError::Unknown(contact.name.clone()))
}

/// Connects to a port and identifies itself.
pub(crate) async fn dial(
    network: &Network,
    options: &PortOptions,
    to: &Contact,
    carrier: Carrier,
    own_name: &str,
) -> Result<DialedConnection, PortError> {
    let failed = |why: String| PortError::Connect { to: label(to), why };
    let stream = network.connect_tcp(&to.host, to.port).await.map_err(|e| failed(e.to_string()))?;
    let addresses = stream.local_addr().and_then(|local| Ok((local, stream.peer_addr()?)));
    let mut link = Link::new(stream, options);
    link.write(&[&handshake::encode(carrier, own_name)]).await.map_err(|e| failed(e.to_string()))?;
    let reply = link.take(|bytes| handshake::parse_reply(carrier, bytes));
    let number = timeout(options.handshake, reply)
        .await
        .map_err(|_| failed(format!("no answer to the handshake within {:?}", options.handshake)))?
        .map_err(|e| failed(e.to_string()))?;
    if carrier != Carrier::Udp {
        return Ok(DialedConnection::Stream(link));
    }
    // The reader may expect datagrams from the number that the TCP connection had (spec section 18). But 3.5
    // built without ACE, on the same computer, uses that number for its own socket, and accepts datagrams
    // from any number.
    drop(link);
    let socket = async {
        let (local, peer) = addresses?;
        let socket = match UdpSocket::bind(local).await {
            Ok(socket) => socket,
            Err(_) => UdpSocket::bind(SocketAddr::new(local.ip(), 0)).await?,
        };
        let number = u16::try_from(number).map_err(std::io::Error::other)?;
        socket.connect(SocketAddr::new(peer.ip(), number)).await?;
        Ok::<_, std::io::Error>(socket)
    };
    let socket = socket.await.map_err(|e| failed(format!("no datagram socket: {e}")))?;
    Ok(DialedConnection::Datagrams(socket, to.clone()))
}

/// Name of a contact if it has one, otherwise its address.
fn label(to: &Contact) -> String {
    if to.name.is_empty() { to.to_string() } else { format!("{} at {}:{}", to.name, to.host, to.port) }
}
