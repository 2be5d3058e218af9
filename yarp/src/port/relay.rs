//! Ports that both receive and publish data, under one name.

use super::core::InputSink;
use super::inbox::{Inbox, Queue};
use super::listen::Handle;
use super::slot::{Delivery, Packet};
use super::{Message, Payload, PortError, PortOptions};
use crate::{Carrier, Contact, Network, remote};
use std::sync::Arc;

/// A port that passes on messages, changed or not, to the ports it is connected to.
pub struct Relay {
    handle: Handle,
    inbox: Arc<Inbox>,
}

impl Relay {
    /// Opens a port: listens, registers its name, announces it.
    ///
    /// # Errors
    /// A bad name, no socket, or no name server.
    pub async fn open(network: &Network, name: &str, queue: Queue, delivery: Delivery) -> Result<Relay, PortError> {
        let inbox = Arc::new(Inbox::new(queue));
        let sink = InputSink::Inbox(inbox.clone());
        let handle = Handle::open(network, name, sink, Some(delivery), PortOptions::default()).await?;
        Ok(Relay { handle, inbox })
    }

    /// Receives the next message; `None` when the port is closed. Cancel safe.
    pub async fn recv(&mut self) -> Option<Message> {
        self.inbox.take().await
    }

    /// Publishes a message. Never blocks: every connection has its own queue and task.
    pub fn write(&self, payload: impl Into<Payload>, envelope: Option<String>) {
        self.handle.core.publish(Arc::new(Packet::new(payload.into(), envelope)));
    }

    /// Requests the port `source` to send its data here (`[add]`, spec section 8).
    ///
    /// # Errors
    /// The other port is unknown or not reachable, or it refuses.
    pub async fn connect_from(&self, source: &str, carrier: Carrier) -> Result<(), PortError> {
        remote::connect(&self.handle.core.network, source, &self.handle.core.name, Some(carrier.name())).await?;
        Ok(())
    }

    /// Address of the port.
    pub fn contact(&self) -> &Contact {
        &self.handle.core.contact
    }

    /// Ends all connections and unregisters.
    pub async fn close(self) {
        self.handle.close().await;
    }
}
