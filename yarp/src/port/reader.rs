//! Ports that receive data.

use super::core::{InputSink, PortCore};
use super::inbox::{Inbox, Queue};
use super::listen::Handle;
use super::{Message, PortError, PortOptions};
use crate::{Carrier, Contact, Network, remote};
use std::sync::Arc;

/// A port that receives data from any port that connects to it.
pub struct InputPort {
    handle: Handle,
    inbox: Arc<Inbox>,
}

impl InputPort {
    /// Opens a port: listens, registers its name, announces it.
    ///
    /// # Errors
    /// A bad name, no socket, or no name server.
    pub async fn open(network: &Network, name: &str, queue: Queue) -> Result<InputPort, PortError> {
        InputPort::open_with(network, name, queue, PortOptions::default()).await
    }

    /// Opens a port with options.
    ///
    /// # Errors
    /// A bad name, no socket, or no name server.
    pub async fn open_with(
        network: &Network,
        name: &str,
        queue: Queue,
        options: PortOptions,
    ) -> Result<InputPort, PortError> {
        let inbox = Arc::new(Inbox::new(queue));
        let handle = Handle::open(network, name, InputSink::Inbox(inbox.clone()), None, options).await?;
        Ok(InputPort { handle, inbox })
    }

    /// Receives the next message; `None` when the port is closed. Cancel safe.
    pub async fn recv(&mut self) -> Option<Message> {
        self.inbox.take().await
    }

    /// Next message if there is one now.
    pub fn try_recv(&mut self) -> Option<Message> {
        self.inbox.try_take().flatten()
    }

    /// Requests the port `source` to send its data here (`[add]`, spec section 8).
    ///
    /// # Errors
    /// The other port is unknown or not reachable, or it refuses.
    pub async fn connect_from(&mut self, source: &str, carrier: Carrier) -> Result<(), PortError> {
        remote::connect(&self.handle.core.network, source, self.name(), Some(carrier.name())).await?;
        Ok(())
    }

    /// Name of the port, as registered.
    pub fn name(&self) -> &str {
        &self.handle.core.name
    }

    /// Address of the port.
    pub fn contact(&self) -> &Contact {
        &self.handle.core.contact
    }

    /// The port itself, which lives as long as this reader is open.
    pub(crate) fn core(&self) -> &Arc<PortCore> {
        &self.handle.core
    }

    /// Names of the ports connected to this one.
    pub fn peers(&self) -> Vec<String> {
        self.handle.core.view().inputs.into_iter().map(|peer| peer.name).collect()
    }

    /// Number of messages dropped because newer ones arrived before they were read.
    pub fn dropped(&self) -> u64 {
        self.inbox.dropped()
    }

    /// Ends all connections and unregisters.
    pub async fn close(self) {
        self.handle.close().await;
    }
}
