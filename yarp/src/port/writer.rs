//! Ports that publish data.

use super::core::InputSink;
use super::listen::Handle;
use super::slot::{Delivery, Packet};
use super::{Payload, PortError, PortOptions};
use crate::{Carrier, Contact, Network};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// A port that publishes data to the ports it is connected to. It also listens, since others request
/// connections from it.
pub struct OutputPort {
    handle: Handle,
}

impl OutputPort {
    /// Opens a port: listens, registers its name, announces it.
    ///
    /// # Errors
    /// A bad name, no socket, or no name server.
    pub async fn open(network: &Network, name: &str, delivery: Delivery) -> Result<OutputPort, PortError> {
        OutputPort::open_with(network, name, delivery, PortOptions::default()).await
    }

    /// Opens a port with options.
    ///
    /// # Errors
    /// A bad name, no socket, or no name server.
    pub async fn open_with(
        network: &Network,
        name: &str,
        delivery: Delivery,
        options: PortOptions,
    ) -> Result<OutputPort, PortError> {
        Ok(OutputPort { handle: Handle::open(network, name, InputSink::Nothing, Some(delivery), options).await? })
    }

    /// Publishes a message. Never blocks: every connection has its own queue and task.
    pub fn write(&self, payload: impl Into<Payload>, envelope: Option<String>) {
        self.handle.core.publish(Arc::new(Packet::new(payload.into(), envelope)));
    }

    /// Waits until every connection has sent all earlier messages and received their acknowledgments.
    pub async fn drained(&self) {
        self.handle.core.drained().await;
    }

    /// Connects to a port by its name or URI.
    ///
    /// # Errors
    /// The port is unknown or not reachable.
    pub async fn connect(&self, to: &str, carrier: Carrier) -> Result<(), PortError> {
        let contact = Contact { carrier: carrier.name().into(), ..Contact::parse(to) };
        self.handle.core.add(&contact).await
    }

    /// Ends the connection to a port; `false` if there is none.
    pub async fn disconnect(&self, to: &str) -> bool {
        self.handle.core.remove_output(to).await
    }

    /// Name of the port, as registered.
    pub fn name(&self) -> &str {
        &self.handle.core.name
    }

    /// Address of the port.
    pub fn contact(&self) -> &Contact {
        &self.handle.core.contact
    }

    /// Names of the ports that this one is connected to.
    pub fn peers(&self) -> Vec<String> {
        self.handle.core.view().outputs.into_iter().map(|peer| peer.name).collect()
    }

    /// Number of messages dropped for single connections, because newer ones came first, or because they
    /// can't be encoded for the connection's carrier.
    pub fn dropped(&self) -> u64 {
        self.handle.core.dropped.load(Ordering::Relaxed)
    }

    /// Ends all connections in order and unregisters.
    pub async fn close(self) {
        self.handle.close().await;
    }
}
