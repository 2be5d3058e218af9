//! Ports on tokio: a listener per port, a task per connection, all resources bounded (spec sections 4 to 8,
//! 17, 18).
//!
//! ```text
//!   others --> listener --> input task ---> inbox (Reader) | handler (RpcServer)
//!                  \-- admin [add] ---> output task <--- Writer::write
//! ```
//! An [`InputPort`] receives data, an [`OutputPort`] publishes it, an [`RpcServer`] answers requests; all
//! three answer administrative commands; a [`Relay`] both receives and publishes. An [`RpcClient`] and a
//! [`Sender`] are connected to one given port and have no port of their own.

mod client;
mod core;
mod dial;
mod inbox;
mod input;
mod keeper;
mod link;
mod listen;
mod message;
mod output;
mod reader;
mod relay;
mod rpc;
mod sender;
mod slot;
mod source;
mod writer;

pub(crate) use self::core::PortCore;
pub use client::{CallError, RpcClient};
pub use inbox::Queue;
pub use listen::check_free;
pub use message::{Message, Payload, PayloadError};
pub use reader::InputPort;
pub use relay::Relay;
pub use rpc::{Handler, RpcServer};
pub use sender::{SendError, Sender};
pub use slot::Delivery;
pub use source::StreamSource;
pub use writer::OutputPort;

use crate::{NameError, remote::RemoteError};
use std::{io, time::Duration};

/// Options of a port; the defaults suit a robot on a local network.
#[derive(Clone, Debug)]
pub struct PortOptions {
    /// Port number to listen on; 0 lets the system choose.
    pub number: u16,
    /// Greatest number of connections; a further one replaces the one that has been silent for longest.
    pub connections: usize,
    /// Time limit for a connection to identify itself (the original waits without end).
    pub handshake: Duration,
    /// Time limit of a message from its first byte to its last.
    pub message: Duration,
    /// Time for which a write may be blocked before the connection is closed.
    pub write: Duration,
    /// Time for which an output waits for an acknowledgment.
    pub ack: Duration,
    /// Greatest size of a message, bytes.
    pub max_message: usize,
    /// Memory for unfinished messages on all connections together, bytes. Messages up to 1 MiB don't count; a
    /// connection that needs more than is left is closed.
    pub max_buffered: usize,
    /// Period at which a port looks up its own name at the name server, to register again after a restart
    /// (spec section 17).
    pub renew: Duration,
    /// Greatest number of user properties that others may set on the port.
    pub properties: usize,
}

impl Default for PortOptions {
    fn default() -> Self {
        PortOptions {
            number: 0,
            connections: 256,
            handshake: Duration::from_secs(5),
            message: Duration::from_secs(30),
            write: Duration::from_secs(5),
            ack: Duration::from_secs(5),
            max_message: 64 << 20,
            max_buffered: 256 << 20,
            renew: Duration::from_secs(2),
            properties: 256,
        }
    }
}

/// Reason why a port could not be opened or connected.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The name is not a port name.
    #[error("\"{0}\" is no port name: it must begin with / and hold no blanks")]
    BadName(String),
    /// Another port has the name and answers.
    #[error("another program holds the port name {} (at {}:{}); end it, or choose another name", .0.name, .0.host, .0.port)]
    Taken(crate::Contact),
    /// A program listens where the name is registered, and does not answer.
    #[error(
        "the port name {name} belongs to a program at {host}:{port} that does not answer: it may be suspended; end it, or \
         choose another name (`mobee yarp name unregister {name}` if that program is not the port's)",
        name = .0.name, host = .0.host, port = .0.port
    )]
    Silent(crate::Contact),
    /// No socket could be opened.
    #[error("can't listen for port {name} on {address}: {source}")]
    Listen {
        /// Name of the port.
        name: String,
        /// Address to listen on.
        address: String,
        /// Error of the system.
        source: io::Error,
    },
    /// The request to the name server failed or was refused.
    #[error(transparent)]
    Name(#[from] NameError),
    /// The other side is not registered with the name server.
    #[error("no port {0} is known to the name server; is it running, and is its name spelled so?")]
    Unknown(String),
    /// The other side can't be reached or does not speak the protocol.
    #[error("can't connect to {to}: {why}")]
    Connect {
        /// The other side.
        to: String,
        /// Description of the error.
        why: String,
    },
    /// The other side did not execute a request.
    #[error(transparent)]
    Remote(#[from] RemoteError),
}

/// Locks a mutex whose data is consistent after a panic of a holder: every change under these locks is one
/// step.
fn lock<T>(mutex: &std::sync::Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}
