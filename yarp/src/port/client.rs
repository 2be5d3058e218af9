//! Requests to other ports: to their owners, and administrative commands.

use super::dial::DialedConnection;
use super::keeper::Keeper;
use super::link::{Link, LinkError};
use super::slot::Packet;
use super::{Payload, PayloadError, PortError, PortOptions, output};
use crate::wire::{frame, line};
use crate::{Bottle, Carrier, Contact, Dialect, Network};
use std::time::Duration;
use tokio::time::timeout;

/// Reason why a request got no reply.
#[derive(Debug, thiserror::Error)]
pub enum CallError {
    /// No connection, and none could be made.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The connection broke; the outcome of the request is unknown.
    #[error("the connection to {to} broke before a reply: {why}")]
    Broken {
        /// The port.
        to: String,
        /// Description of the error.
        why: String,
    },
    /// No reply in time; the connection is closed, since a late reply would be mistaken for the next one.
    #[error("no reply from {to} within {after:?}")]
    Late {
        /// The port.
        to: String,
        /// Time waited.
        after: Duration,
    },
    /// The other side sent an acknowledgment without a reply.
    #[error("{0} acknowledged without a reply; it is no RPC port, or does not know the request")]
    NoReply(String),
    /// A reply or request that is not a bottle.
    #[error(transparent)]
    Payload(#[from] PayloadError),
}

/// Client of one RPC port, without a port of its own. One request at a time.
pub struct RpcClient {
    keeper: Keeper,
    limit: Duration,
}

impl RpcClient {
    /// Connects to a port by its name or URI, as `own_name`.
    ///
    /// # Errors
    /// The port is unknown or not reachable.
    pub async fn connect(
        network: &Network,
        own_name: &str,
        to: &str,
        carrier: Carrier,
    ) -> Result<RpcClient, PortError> {
        RpcClient::connect_to(network, own_name, Contact::parse(to), carrier, PortOptions::default()).await
    }

    /// Connects to a port, possibly by its address, with options.
    ///
    /// # Errors
    /// The port is unknown or not reachable, or the carrier has no replies.
    pub async fn connect_to(
        network: &Network,
        own_name: &str,
        to: Contact,
        carrier: Carrier,
        options: PortOptions,
    ) -> Result<RpcClient, PortError> {
        if carrier == Carrier::Udp {
            let why = "udp has no replies; use tcp".to_owned();
            return Err(PortError::Connect { to: to.to_string(), why });
        }
        let limit = network.timeout();
        Ok(RpcClient { keeper: Keeper::connect(network, own_name, to, carrier, options).await?, limit })
    }

    /// Creates a client that is not connected yet and reconnects after every loss, with pauses between
    /// attempts that grow up to 2 s. During a pause, calls fail at once. No request is sent twice.
    pub fn keep(network: &Network, own_name: &str, to: &str, carrier: Carrier) -> RpcClient {
        let mut keeper = Keeper::idle(network, own_name, Contact::parse(to), carrier, PortOptions::default());
        keeper.keep();
        RpcClient { keeper, limit: network.timeout() }
    }

    /// Falls back to the last address of the other side if the name server does not return one (it may be
    /// down, or have just been restarted). Another port may use that address by now: suitable only for
    /// harmless requests, such as a stop.
    #[must_use]
    pub fn remembering(mut self) -> RpcClient {
        self.keeper.remember();
        self
    }

    /// Sets the time limit of every reply; the default is the network's.
    pub fn with_timeout(self, limit: Duration) -> RpcClient {
        RpcClient { limit, ..self }
    }

    /// True if there is a connection, as far as can be determined without a call.
    pub fn is_connected(&self) -> bool {
        self.keeper.is_connected()
    }

    /// Waits until a lost connection may be retried; returns at once if connected.
    pub async fn pause(&mut self) {
        self.keeper.pause().await;
    }

    /// Sends a request and waits for the reply.
    ///
    /// # Errors
    /// See [`CallError`]; after a broken or late reply the connection is closed.
    pub async fn call(&mut self, request: &Bottle) -> Result<Bottle, CallError> {
        self.ask(b'd', request).await
    }

    /// Sends a request that needs no reply, and waits for its acknowledgment, if the carrier has one.
    ///
    /// # Errors
    /// See [`CallError`].
    pub async fn tell(&mut self, request: impl Into<Payload>) -> Result<(), CallError> {
        let packet = Packet::new(request.into(), None);
        let mut line = self.keeper.take().await?;
        let carrier = self.keeper.carrier;
        let dialect = self.keeper.network.dialect();
        let work = output::send(&mut line, carrier, b'D', &packet, dialect, &self.keeper.options);
        let ended = timeout(self.limit, work).await;
        self.judged(ended)?;
        self.keeper.put(line);
        Ok(())
    }

    /// Sends an administrative command (spec section 7) and waits for the reply.
    ///
    /// # Errors
    /// See [`CallError`].
    pub async fn admin(&mut self, command: &Bottle) -> Result<Bottle, CallError> {
        self.ask(b'a', command).await
    }

    /// Sends a request given as the bytes of a bottle, and returns the reply's bytes as received.
    ///
    /// # Errors
    /// See [`CallError`].
    pub async fn call_raw(&mut self, request: &[u8]) -> Result<Vec<u8>, CallError> {
        let dialect = self.keeper.network.dialect();
        if self.keeper.carrier.is_text() {
            let request = Bottle::decode(request, dialect).map_err(PayloadError::from)?;
            return Ok(self.call(&request).await?.encode(dialect));
        }
        Ok(self.exchange(b'd', request).await?.0)
    }

    /// Requests the port's description (`*`), a text for people. Text carriers only.
    ///
    /// # Errors
    /// See [`CallError`].
    pub async fn describe(&mut self) -> Result<String, CallError> {
        let mut line = self.keeper.take().await?;
        let work = async {
            let DialedConnection::Stream(link) = &mut line else { return Err(LinkError::Closed) };
            link.write(&[b"*\r\n"]).await?;
            let mut out = Vec::new();
            loop {
                match link.line().await?.as_slice() {
                    b"<ACK>" => return Ok(out),
                    line if out.len() < 1 << 20 => {
                        out.extend_from_slice(line);
                        out.push(b'\n');
                    }
                    _ => {}
                }
            }
        };
        let ended = timeout(self.limit, work).await;
        let out = self.judged(ended)?;
        self.keeper.put(line);
        Ok(String::from_utf8_lossy(&out).into_owned())
    }

    async fn ask(&mut self, key: u8, request: &Bottle) -> Result<Bottle, CallError> {
        let dialect = self.keeper.network.dialect();
        let text = self.keeper.carrier.is_text();
        let payload = if text { request.to_text() } else { request.encode(dialect) };
        let (bytes, reply) = self.exchange(key, &payload).await?;
        match reply {
            Some(reply) => Ok(reply),
            None => Ok(Bottle::parse(bytes, dialect).map_err(PayloadError::from)?),
        }
    }

    /// Sends a payload and returns the reply's bytes, with the bottle on binary carriers.
    async fn exchange(&mut self, key: u8, payload: &[u8]) -> Result<(Vec<u8>, Option<Bottle>), CallError> {
        let mut line = self.keeper.take().await?;
        let carrier = self.keeper.carrier;
        let dialect = self.keeper.network.dialect();
        let work = async {
            let DialedConnection::Stream(link) = &mut line else { return Err(LinkError::Closed) };
            if carrier.is_text() {
                link.write(&[&line::encode(key, None, payload)]).await?;
                let reply = link.line().await?;
                if reply == b"<ACK>" {
                    return Ok(None);
                }
                output::acknowledged(link, carrier, &self.keeper.options).await?;
                return Ok(Some((reply, None)));
            }
            link.write(&[&frame::encode(key, None, payload.len()), payload]).await?;
            let reply = reply(link, carrier, dialect).await?;
            if reply.is_some() {
                output::acknowledged(link, carrier, &self.keeper.options).await?;
            }
            Ok(reply)
        };
        let ended = timeout(self.limit, work).await;
        let reply = self.judged(ended)?;
        self.keeper.put(line);
        reply.ok_or_else(|| CallError::NoReply(self.keeper.to().to_string()))
    }

    fn judged<T>(&self, ended: Result<Result<T, LinkError>, tokio::time::error::Elapsed>) -> Result<T, CallError> {
        let to = || self.keeper.to().to_string();
        match ended {
            Ok(Ok(done)) => Ok(done),
            Ok(Err(error)) => Err(CallError::Broken { to: to(), why: error.to_string() }),
            Err(_) => Err(CallError::Late { to: to(), after: self.limit }),
        }
    }

    /// Ends the connection in order.
    pub async fn close(self) {
        self.keeper.close().await;
    }
}

/// Reads a reply, which has no length prefix: bottles are self-delimiting. `None` if an acknowledgment
/// arrived instead.
async fn reply(
    link: &mut Link,
    carrier: Carrier,
    dialect: Dialect,
) -> Result<Option<(Vec<u8>, Option<Bottle>)>, LinkError> {
    link.take(|bytes| {
        if carrier == Carrier::Tcp && bytes.starts_with(b"YA") {
            return Ok(frame::parse_ack(bytes)?.map(|used| (None, used)));
        }
        match Bottle::decode_prefix(bytes, dialect) {
            Ok(found) => Ok(found
                .map(|(bottle, used)| (Some((bytes.get(..used).unwrap_or_default().to_vec(), Some(bottle))), used))),
            Err(error) => Err(LinkError::Reply(error)),
        }
    })
    .await
}
