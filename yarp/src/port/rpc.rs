//! Ports that answer requests.

use super::core::InputSink;
use super::listen::Handle;
use super::{Message, Payload, PortError, PortOptions};
use crate::{Contact, Network};
use std::pin::Pin;
use std::sync::Arc;

/// Handler of the requests to an [`RpcServer`]. Requests of one connection are sequential; those of different
/// connections are concurrent.
pub trait Handler: Send + Sync + 'static {
    /// Answers a request. `None` acknowledges without a reply, which an RPC client treats as an error: always
    /// answer. Data whose sender wants no reply is passed here too. The future is dropped when the port
    /// closes or the connection is removed, and runs to its end if the other side merely disconnects.
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>>;

    /// A connection ended.
    fn gone(&self, _connection: u64) {}
}

/// A port that answers requests.
pub struct RpcServer {
    handle: Handle,
}

impl RpcServer {
    /// Opens a port: listens, registers its name, announces it.
    ///
    /// # Errors
    /// A bad name, no socket, or no name server.
    pub async fn open(network: &Network, name: &str, handler: Arc<dyn Handler>) -> Result<RpcServer, PortError> {
        RpcServer::open_with(network, name, handler, PortOptions::default()).await
    }

    /// Opens a port with options.
    ///
    /// # Errors
    /// A bad name, no socket, or no name server.
    pub async fn open_with(
        network: &Network,
        name: &str,
        handler: Arc<dyn Handler>,
        options: PortOptions,
    ) -> Result<RpcServer, PortError> {
        Ok(RpcServer { handle: Handle::open(network, name, InputSink::Handler(handler), None, options).await? })
    }

    /// Name of the port, as registered.
    pub fn name(&self) -> &str {
        &self.handle.core.name
    }

    /// Address of the port.
    pub fn contact(&self) -> &Contact {
        &self.handle.core.contact
    }

    /// Names of the connected ports.
    pub fn peers(&self) -> Vec<String> {
        self.handle.core.view().inputs.into_iter().map(|peer| peer.name).collect()
    }

    /// Ends all connections and unregisters.
    pub async fn close(self) {
        self.handle.close().await;
    }
}
