//! Embedded name server: the table behind a socket (spec section 3).

mod persist;
mod session;

use super::table::{NameCounts, NameTable};
use crate::auth::Key;
use crate::guests::{Guests, LastMessage};
use crate::{Contact, Dialect, Network, TIMEOUT, network};
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream, lookup_host};
use tokio::sync::{mpsc, watch};
use tokio::task::{JoinHandle, JoinSet};

/// Options of a name server; the defaults are the original's, on loopback only.
#[derive(Clone, Debug)]
pub struct ServerOptions {
    /// Port name of the server.
    pub namespace: String,
    /// True if it may listen on other addresses than loopback. Any program that can reach it can take over
    /// any port's name.
    pub public: bool,
    /// Host that it registers itself under, if not the one it listens on.
    pub host: Option<String>,
    /// Greatest number of registered ports.
    pub max_ports: usize,
    /// Greatest number of connections; a further one replaces the one that has been silent for longest.
    pub max_connections: usize,
    /// Time limit of a handshake, and of every step of making a persistent connection.
    pub timeout: Duration,
    /// Time after which a silent connection is closed.
    pub idle: Duration,
    /// Dialect of bottles on binary carriers; relevant only for floats, which name servers don't use.
    pub dialect: Dialect,
    /// Key of the handshake of `auth.conf`, used on every connection.
    pub auth: Option<Key>,
}

impl Default for ServerOptions {
    fn default() -> ServerOptions {
        ServerOptions {
            namespace: "/root".into(),
            public: false,
            host: None,
            max_ports: 4096,
            max_connections: 512,
            timeout: TIMEOUT,
            idle: Duration::from_secs(300),
            dialect: Dialect::default(),
            auth: None,
        }
    }
}

/// A name server that runs until it is closed or dropped.
#[derive(Debug)]
pub struct NameServer {
    shared: Arc<SharedNameServer>,
    address: SocketAddr,
    stop: watch::Sender<bool>,
    task: JoinHandle<()>,
}

/// State shared by all connections.
#[derive(Debug)]
struct SharedNameServer {
    table: Mutex<NameTable>,
    contact: Contact,
    options: ServerOptions,
    links: mpsc::Sender<super::PendingConnection>,
    /// Network of the server, to check whether the owner of a name still exists.
    network: Network,
}

impl SharedNameServer {
    /// Locks the table. A poisoned lock is used anyway, because no panic can leave the table
    /// inconsistent.
    fn table(&self) -> MutexGuard<'_, NameTable> {
        self.table.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

impl NameServer {
    /// Listens on this address (number 0: any free one) and serves in the background of the current runtime.
    ///
    /// # Errors
    /// The address can't be used, or is not loopback and [`ServerOptions::public`] is not set.
    pub async fn bind(address: SocketAddr, options: ServerOptions) -> io::Result<NameServer> {
        if !address.ip().is_loopback() && !options.public {
            let why = format!(
                "a name server on {} could be reached from other computers, and YARP has no encryption: \
                 say so on purpose (`public`), or use 127.0.0.1",
                address.ip()
            );
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, why));
        }
        let listener = TcpListener::bind(address).await?;
        let address = listener.local_addr()?;
        let host = match &options.host {
            Some(host) => host.clone(),
            None if address.ip().is_unspecified() => network::local_address(None).await.to_string(),
            None => address.ip().to_string(),
        };
        let contact = Contact::new(&options.namespace, "tcp", &host, address.port());
        let near =
            if address.ip().is_unspecified() { SocketAddr::new(network::LOOPBACK, address.port()) } else { address };
        let network = Network::at(near).with_timeout(options.timeout).with_auth(options.auth.clone());
        let (links, wanted) = mpsc::channel(persist::MOST_WAITING);
        let table = Mutex::new(NameTable::new(contact.clone(), options.max_ports));
        let shared = Arc::new(SharedNameServer { table, contact, options, links, network: network.clone() });
        let (stop, stopped) = watch::channel(false);
        let task = tokio::spawn(serve(listener, shared.clone(), network, wanted, stopped));
        Ok(NameServer { shared, address, stop, task })
    }

    /// Starts our own name server for a network whose name server does not answer, at its address.
    ///
    /// # Errors
    /// As [`NameServer::bind`]; or the network's host has no address.
    pub async fn instead(network: &Network, public: bool) -> io::Result<NameServer> {
        let (host, port) = network.server();
        let address = lookup_host((host, port)).await?.next();
        let address = address.ok_or_else(|| io::Error::other(format!("{host} has no address")))?;
        let options = ServerOptions {
            namespace: network.namespace().to_owned(),
            public,
            dialect: network.dialect(),
            auth: network.auth().cloned(),
            ..ServerOptions::default()
        };
        NameServer::bind(address, options).await
    }

    /// Address that it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Its contact in its own table.
    pub fn contact(&self) -> &Contact {
        &self.shared.contact
    }

    /// Network of this server, as seen from this computer.
    pub fn network(&self) -> Network {
        let ip = if self.address.ip().is_unspecified() { network::LOOPBACK } else { self.address.ip() };
        let options = &self.shared.options;
        Network::at(SocketAddr::new(ip, self.address.port()))
            .with_auth(options.auth.clone())
            .with_namespace(options.namespace.clone())
            .with_dialect(options.dialect)
    }

    /// All registrations, in the order of their names.
    pub fn ports(&self) -> Vec<Contact> {
        self.shared.table().ports().cloned().collect()
    }

    /// Counters since the start.
    pub fn counts(&self) -> NameCounts {
        self.shared.table().counts()
    }

    /// Ends all connections and frees the address.
    pub async fn close(mut self) {
        self.stop.send_replace(true);
        let _ = (&mut self.task).await;
    }
}

impl Drop for NameServer {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Accepts connections until `stopped` changes; returning ends them all.
async fn serve(
    listener: TcpListener,
    shared: Arc<SharedNameServer>,
    network: Network,
    wanted: mpsc::Receiver<super::PendingConnection>,
    mut stopped: watch::Receiver<bool>,
) {
    let mut sessions = Guests::new(shared.options.max_connections);
    let mut persistent = JoinSet::new();
    persistent.spawn(persist::connect_all(network, wanted));
    loop {
        tokio::select! {
            _ = stopped.changed() => return,
            Some(()) = sessions.ended() => {}
            accepted = listener.accept() => match accepted {
                Ok((stream, peer)) => {
                    if !sessions.admit(|activity| session(stream, peer, shared.clone(), activity)) {
                        tracing::warn!("name server: too many connections, so {peer} was closed at once");
                    }
                }
                // out of file descriptors, or the peer disconnected at once: retries
                Err(e) => {
                    tracing::warn!("name server: {e}");
                    tokio::time::sleep(Duration::from_millis(10)).await;
                }
            },
        }
    }
}

async fn session(stream: TcpStream, peer: SocketAddr, shared: Arc<SharedNameServer>, activity: Arc<LastMessage>) {
    if let Err(e) = session::run(stream, peer, &shared, &activity).await {
        tracing::debug!("name server: connection of {peer}: {e}");
    }
}
