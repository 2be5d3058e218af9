//! One-way output to a given port.

use super::keeper::Keeper;
use super::slot::Packet;
use super::{Payload, PortError, PortOptions, output};
use crate::{Carrier, Contact, Network};

/// Reason why a message was not sent.
#[derive(Debug, thiserror::Error)]
pub enum SendError {
    /// No connection, and none could be made.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The connection broke.
    #[error("the connection to {to} broke: {why}")]
    Broken {
        /// The port.
        to: String,
        /// Description of the error.
        why: String,
    },
    /// The payload has no form for the carrier.
    #[error("the message can't be written for the carrier {0}: it is no bottle")]
    Form(Carrier),
}

/// One-way output to a given port, without a port of its own.
pub struct Sender {
    keeper: Keeper,
}

impl Sender {
    /// Connects to a port by its name or URI, as `own_name`.
    ///
    /// # Errors
    /// The port is unknown or not reachable.
    pub async fn connect(network: &Network, own_name: &str, to: &str, carrier: Carrier) -> Result<Sender, PortError> {
        Sender::connect_with(network, own_name, to, carrier, PortOptions::default()).await
    }

    /// Connects with options.
    ///
    /// # Errors
    /// The port is unknown or not reachable.
    pub async fn connect_with(
        network: &Network,
        own_name: &str,
        to: &str,
        carrier: Carrier,
        options: PortOptions,
    ) -> Result<Sender, PortError> {
        let keeper = Keeper::connect(network, own_name, Contact::parse(to), carrier, options).await?;
        Ok(Sender { keeper })
    }

    /// Creates a sender that is not connected yet and reconnects after every loss, with pauses between
    /// attempts that grow up to 2 s. During a pause, [`send`](Sender::send) fails at once.
    pub fn keep(network: &Network, own_name: &str, to: &str, carrier: Carrier) -> Sender {
        let mut keeper = Keeper::idle(network, own_name, Contact::parse(to), carrier, PortOptions::default());
        keeper.keep();
        Sender { keeper }
    }

    /// Sends a message and waits for its acknowledgment, if the carrier has one.
    ///
    /// # Errors
    /// No connection, a connection that broke, or a payload without a form for the carrier.
    pub async fn send(&mut self, payload: impl Into<Payload>, envelope: Option<String>) -> Result<(), SendError> {
        let packet = Packet::new(payload.into(), envelope);
        let mut line = self.keeper.take().await?;
        let carrier = self.keeper.carrier;
        let dialect = self.keeper.network.dialect();
        match output::send(&mut line, carrier, b'D', &packet, dialect, &self.keeper.options).await {
            Ok(formed) => {
                self.keeper.put(line);
                if formed { Ok(()) } else { Err(SendError::Form(carrier)) }
            }
            Err(error) => Err(SendError::Broken { to: self.keeper.to().to_string(), why: error.to_string() }),
        }
    }

    /// Waits until a lost connection may be retried; returns at once if connected.
    pub async fn pause(&mut self) {
        self.keeper.pause().await;
    }

    /// True if there is a connection, as far as can be determined without sending.
    pub fn is_connected(&self) -> bool {
        self.keeper.is_connected()
    }

    /// Ends the connection in order.
    pub async fn close(self) {
        self.keeper.close().await;
    }
}
