//! A YARP network: its name server, its dialect, and the behavior of our ports in it.

use crate::auth::{self, Key};
use crate::config::{self, NetworkConfigError};
use crate::{Dialect, NameError};
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::str::FromStr;
use std::time::Duration;
use tokio::net::{TcpStream, UdpSocket};
use tokio::time::timeout;

/// Time limit of an answer, where the original waits without end.
pub const TIMEOUT: Duration = Duration::from_secs(5);

/// Handle of a YARP network; cheap to clone, holds no connection.
#[derive(Clone, Debug)]
pub struct Network {
    host: String,
    port: u16,
    dialect: Dialect,
    timeout: Duration,
    bind: IpAddr,
    advertise: Option<String>,
    prefix: String,
    namespace: String,
    auth: Option<Key>,
}

/// A text that is not the address of a name server.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not an address: give HOST:PORT, such as 127.0.0.1:10000")]
pub struct NoAddress(String);

/// Network whose name server is at `HOST:PORT`; reads no file and no environment variable.
impl FromStr for Network {
    type Err = NoAddress;

    fn from_str(text: &str) -> Result<Network, NoAddress> {
        let parts = text.rsplit_once(':').and_then(|(host, port)| Some((host, port.parse().ok()?)));
        let (host, port) = parts.filter(|(host, _)| !host.is_empty()).ok_or_else(|| NoAddress(text.into()))?;
        Ok(Network::of(host, port))
    }
}

impl Network {
    /// Network whose name server is at this address; reads no file and no environment variable.
    pub fn at(server: SocketAddr) -> Network {
        Network::of(server.ip().to_string(), server.port())
    }

    /// Network whose name server is at this host (a name or an address) and number.
    pub fn of(host: impl Into<String>, port: u16) -> Network {
        Network {
            host: host.into(),
            port,
            dialect: Dialect::default(),
            timeout: TIMEOUT,
            bind: IpAddr::V4(Ipv4Addr::LOCALHOST),
            advertise: None,
            prefix: String::new(),
            namespace: "/root".into(),
            auth: None,
        }
    }

    /// Network of the user's YARP configuration (spec section 2): `yarp.conf`, namespaces and `YARP_...`.
    ///
    /// # Errors
    /// No file, or one with an error; the message names it and the remedy.
    pub fn from_env() -> Result<Network, NetworkConfigError> {
        config::network(&config::Env::real())
    }

    /// Sets the dialect; it can't be detected on the wire (spec section 1).
    pub fn with_dialect(self, dialect: Dialect) -> Network {
        Network { dialect, ..self }
    }

    /// Sets the time limit for connecting and for every answer.
    pub fn with_timeout(self, timeout: Duration) -> Network {
        Network { timeout, ..self }
    }

    /// Sets the address that ports listen on; the default is loopback only, `0.0.0.0` opens them to the
    /// network (YARP has no encryption).
    pub fn with_bind(self, bind: IpAddr) -> Network {
        Network { bind, ..self }
    }

    /// Registers ports under this host instead of the one they listen on.
    pub fn with_host(self, host: impl Into<String>) -> Network {
        Network { advertise: Some(host.into()), ..self }
    }

    /// Sets a prefix of every name that is opened (`YARP_PORT_PREFIX`).
    pub fn with_prefix(self, prefix: impl Into<String>) -> Network {
        Network { prefix: prefix.into(), ..self }
    }

    /// Sets the namespace, which is the name server's own port name.
    pub fn with_namespace(self, namespace: impl Into<String>) -> Network {
        Network { namespace: namespace.into(), ..self }
    }

    /// Requires the handshake of `auth.conf` on every TCP connection (spec section 18).
    pub fn with_auth(self, auth: Option<Key>) -> Network {
        Network { auth, ..self }
    }

    /// Host and port number of the name server.
    pub fn server(&self) -> (&str, u16) {
        (&self.host, self.port)
    }

    /// Dialect of the network.
    pub fn dialect(&self) -> Dialect {
        self.dialect
    }

    /// Time limit for connecting and for every answer.
    pub fn timeout(&self) -> Duration {
        self.timeout
    }

    /// Address that ports listen on.
    pub fn bind(&self) -> IpAddr {
        self.bind
    }

    /// Host that ports register: `...` (the address that the server sees, spec section 3.1) if they listen on
    /// all addresses.
    pub fn host(&self) -> String {
        match &self.advertise {
            Some(host) => host.clone(),
            None if self.bind.is_unspecified() => "...".into(),
            None => self.bind.to_string(),
        }
    }

    /// Namespace, `/root` unless configured.
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// Key of `auth.conf`, if there is one.
    pub fn auth(&self) -> Option<&Key> {
        self.auth.as_ref()
    }

    /// Name under which a port named `name` is opened: with the prefix, if it is rooted.
    pub fn full_name(&self, name: &str) -> String {
        if name.starts_with('/') { format!("{}{name}", self.prefix) } else { name.into() }
    }

    /// Connects to a port, within the time limit, and authenticates if this network requires it. Every
    /// outgoing TCP connection begins here.
    ///
    /// # Errors
    /// Refused, unreachable, time limit exceeded, or the other side has another key.
    pub async fn connect_tcp(&self, host: &str, port: u16) -> io::Result<TcpStream> {
        let late = || io::Error::new(io::ErrorKind::TimedOut, format!("no connection within {:?}", self.timeout));
        let mut stream = timeout(self.timeout, TcpStream::connect((host, port))).await.map_err(|_| late())??;
        stream.set_nodelay(true)?;
        if let Some(key) = &self.auth {
            auth::connect(&mut stream, key).await?;
        }
        Ok(stream)
    }

    pub(crate) fn name_error(&self, why: impl ToString) -> NameError {
        NameError::Unreachable { server: format!("{}:{}", self.host, self.port), why: why.to_string() }
    }
}

/// Loopback address of this computer.
pub(crate) const LOOPBACK: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

/// Address of this computer toward another one (or toward the world); loopback if it has none. Sends nothing.
pub async fn local_address(toward: Option<(&str, u16)>) -> IpAddr {
    let toward = toward.unwrap_or(("192.0.2.1", 9));
    let look = async {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).await?;
        socket.connect(toward).await?;
        socket.local_addr()
    };
    look.await.map_or(LOOPBACK, |a: SocketAddr| a.ip())
}
