//! Finding the control port of a run: by its folder, or by an address and the key.

use super::CtlArgs;
use super::listener::{ADDRESS, SOCKET, connect_address, connect_socket};
use super::wire::{self, CtlStream, Reply, Request};
use mobee_compose::config::ConfigError;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::io::BufReader;
use tokio::time::error::Elapsed;
use tokio::time::timeout;

/// Time limit for a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Time limit for a reply; a swap is built and checked within it.
const REPLY_TIMEOUT: Duration = Duration::from_secs(60);

/// A connection to a run.
pub(super) struct Client(BufReader<Box<dyn CtlStream>>);

impl Client {
    /// Sends a request and waits for the reply.
    ///
    /// # Errors
    /// If there is no reply in time, or the run has ended.
    pub(super) async fn call(&mut self, request: &Request) -> Result<Reply, ConfigError> {
        let exchange = async {
            // a run that has ended has sent its farewell before it closed the connection
            let written = wire::write(self.0.get_mut(), request).await;
            match wire::read(&mut self.0).await {
                Ok(Some(reply)) => Ok(reply),
                answer => {
                    written?;
                    answer?.ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
                }
            }
        };
        let late = |_| Err(io::Error::new(io::ErrorKind::TimedOut, "the run does not answer"));
        timeout(REPLY_TIMEOUT, exchange).await.unwrap_or_else(late).map_err(|e| {
            ConfigError::plain(format!("no answer: {e}"), "check whether the run is still active, and ask again")
        })
    }
}

impl Client {
    /// Waits until the run closes the connection because it is over; false if that takes longer than `within`.
    pub(super) async fn closed(&mut self, within: Duration) -> bool {
        let closed = async { while matches!(wire::read::<Reply>(&mut self.0).await, Ok(Some(_))) {} };
        timeout(within, closed).await.is_ok()
    }
}

/// Connects to the run that the arguments name.
pub(super) async fn connect(args: &CtlArgs) -> Result<Client, ConfigError> {
    let (what, line) = match (&args.at, &args.key) {
        (Some(at), Some(file)) => {
            let (_, key) = address(file)?;
            (at.clone(), timeout(CONNECT_TIMEOUT, connect_address(at, &key)).await)
        }
        _ => return connect_in(&args.run.clone().map_or_else(newest, Ok)?).await,
    };
    connected(what, line)
}

/// Connects to the run in this folder.
pub(super) async fn connect_in(folder: &Path) -> Result<Client, ConfigError> {
    let line = if folder.join(SOCKET).exists() {
        timeout(CONNECT_TIMEOUT, connect_socket(folder)).await
    } else {
        let (at, key) = address(&folder.join(ADDRESS))?;
        timeout(CONNECT_TIMEOUT, connect_address(&at, &key)).await
    };
    connected(format!("the run {}", folder.display()), line)
}

fn connected(what: String, line: Result<io::Result<Box<dyn CtlStream>>, Elapsed>) -> Result<Client, ConfigError> {
    let late = |_| Err(io::Error::new(io::ErrorKind::TimedOut, "no connection"));
    let line = line.unwrap_or_else(late).map_err(|e| {
        let help = match e.kind() {
            io::ErrorKind::PermissionDenied => "a run is controlled by its own user, or root, with its own key",
            _ => "it is no longer running; give another with --run",
        };
        ConfigError::plain(format!("{what} can't be reached: {e}"), help)
    })?;
    Ok(Client(BufReader::new(line)))
}

/// Maximum size of an address file, bytes.
const MAX_ADDRESS_BYTES: u64 = 4096;

/// The address and the key that a run wrote into its folder.
fn address(file: &Path) -> Result<(String, String), ConfigError> {
    let text = mobee_model::file::read_text(file, MAX_ADDRESS_BYTES).map_err(|e| {
        let help = match e.kind() {
            io::ErrorKind::PermissionDenied => "a run is controlled by its own user, or root",
            _ => "a run can be controlled while it runs with clock = \"real\", and without --ctl off",
        };
        ConfigError::plain(format!("{}: {e}", file.display()), help)
    })?;
    let known = text.trim().split_once(' ').and_then(|(at, key)| Some((at.parse::<SocketAddr>().ok()?, key)));
    let (mut at, key) = known.ok_or_else(|| {
        let what = format!("{}: there is no address and key in it", file.display());
        ConfigError::plain(what, "give the folder of a run")
    })?;
    // a listener at all addresses is reached at this computer's loopback address
    if at.ip().is_unspecified() {
        at.set_ip(if at.is_ipv4() { IpAddr::V4(Ipv4Addr::LOCALHOST) } else { IpAddr::V6(Ipv6Addr::LOCALHOST) });
    }
    Ok((at.to_string(), key.to_owned()))
}

/// The run in runs/ that was the last to open its control port.
fn newest() -> Result<PathBuf, ConfigError> {
    let folders = std::fs::read_dir("runs").into_iter().flatten().flatten().map(|e| e.path());
    let opened = |folder: &Path| {
        let files = [SOCKET, ADDRESS].map(|file| folder.join(file).metadata().ok()?.modified().ok());
        files.into_iter().flatten().max()
    };
    let newest = folders.filter_map(|folder| Some((opened(&folder)?, folder))).max();
    newest.map(|(_, folder)| folder).ok_or_else(|| {
        ConfigError::plain(
            "no run in runs/ can be controlled",
            "start one with `mobee run --clock real FILE`, or give its folder with --run",
        )
    })
}
