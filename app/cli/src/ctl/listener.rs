//! Listener and access control of the control port.
//!
//! ```text
//! RUN/ctl.sock   a Unix socket in a folder that only its user can enter; the system reports the user at the other end
//! RUN/ctl.tcp    with --ctl ADDRESS:PORT: the address, and a key that both sides prove to have before any request
//! ```

use super::wire::CtlStream;
use mobee_contract::{Before, create_private};
use mobee_yarp::auth::{self, Key};
use std::fs::{File, Permissions};
use std::io::{self, Write};
use std::net::SocketAddr;
use std::os::fd::AsRawFd;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use tokio::net::{TcpListener, TcpStream, UnixListener, UnixStream};

/// The socket in a run's folder.
pub(super) const SOCKET: &str = "ctl.sock";
/// The file in a run's folder with the address and the key of a port that `--ctl` opened.
pub(super) const ADDRESS: &str = "ctl.tcp";
/// Maximum length of a socket's path that operating systems accept, bytes.
const MAX_SOCKET_PATH_BYTES: usize = 100;
/// Length of a key, bytes.
const KEY_BYTES: usize = 32;

/// The listener of the control port.
pub(super) enum CtlListener {
    Unix(UnixListener),
    Tcp(TcpListener, Key),
}

/// A connection that is not yet authenticated.
pub(super) enum CtlPeer {
    Unix(UnixStream),
    Tcp(TcpStream, Key),
}

impl CtlListener {
    /// Opens the listener for the run in this folder, at an address or else as a socket in the folder; an address is
    /// written into the folder.
    ///
    /// # Errors
    /// A sentence with the remedy.
    pub(super) async fn open(folder: &Path, at: Option<SocketAddr>) -> Result<CtlListener, String> {
        CtlListener::remove_files(folder);
        let Some(at) = at else {
            let wrong = |e: io::Error| format!("no control port at {}: {e}", folder.join(SOCKET).display());
            let (path, _open) = socket_path(folder).map_err(wrong)?;
            let listener = UnixListener::bind(&path).map_err(wrong)?;
            std::fs::set_permissions(&path, Permissions::from_mode(0o600)).map_err(wrong)?;
            return Ok(CtlListener::Unix(listener));
        };
        let listener = TcpListener::bind(at).await.map_err(|e| format!("{e}; give another address with --ctl"))?;
        let at = listener.local_addr().map_err(|e| e.to_string())?;
        let mut key = [0; KEY_BYTES];
        getrandom::fill(&mut key).map_err(|e| format!("no key for the control port: {e}"))?;
        let key: String = key.iter().map(|b| format!("{b:02x}")).collect();
        let file = folder.join(ADDRESS);
        let written = create_private(&file, Before::Empty).and_then(|mut f| writeln!(f, "{at} {key}"));
        written.map_err(|e| format!("can't write {}: {e}", file.display()))?;
        Ok(CtlListener::Tcp(listener, Key::new(key)))
    }

    /// Removes the socket and the address file, so that clients no longer find them.
    pub(super) fn remove_files(folder: &Path) {
        for file in [SOCKET, ADDRESS] {
            let _ = std::fs::remove_file(folder.join(file));
        }
    }

    /// Waits for the next connection.
    ///
    /// # Errors
    /// If the system can't accept a connection.
    pub(super) async fn accept(&self) -> io::Result<CtlPeer> {
        Ok(match self {
            CtlListener::Unix(listener) => CtlPeer::Unix(listener.accept().await?.0),
            CtlListener::Tcp(listener, key) => CtlPeer::Tcp(listener.accept().await?.0, key.clone()),
        })
    }
}

impl CtlPeer {
    /// Accepts the run's own user, root, or a client that has the key.
    ///
    /// # Errors
    /// If the client is none of these; it gets no reply.
    pub(super) async fn admit(self) -> io::Result<Box<dyn CtlStream>> {
        match self {
            CtlPeer::Unix(line) => {
                let user = line.peer_cred()?.uid();
                if user != own_user()? && user != 0 {
                    return Err(io::ErrorKind::PermissionDenied.into());
                }
                Ok(Box::new(line))
            }
            CtlPeer::Tcp(mut line, key) => {
                auth::accept(&mut line, &key).await?;
                Ok(Box::new(line))
            }
        }
    }
}

/// Connects to the socket of a run in this folder, and checks that the run belongs to this user: anybody can create a
/// folder with a socket in a place where runs are searched.
///
/// # Errors
/// If nothing listens there, or the run belongs to another user.
pub(super) async fn connect_socket(folder: &Path) -> io::Result<Box<dyn CtlStream>> {
    let (path, _open) = socket_path(folder)?;
    let line = UnixStream::connect(path).await?;
    let user = line.peer_cred()?.uid();
    let own_user = own_user()?;
    if user != own_user && own_user != 0 {
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, "this is the run of another user"));
    }
    Ok(Box::new(line))
}

/// Connects to an address with the key in the text of a run's [`ADDRESS`] file.
///
/// # Errors
/// If nothing listens there, or the key is another one.
pub(super) async fn connect_address(address: &str, key: &str) -> io::Result<Box<dyn CtlStream>> {
    let mut line = TcpStream::connect(address).await?;
    auth::connect(&mut line, &Key::new(key)).await?;
    Ok(Box::new(line))
}

/// The user id of this process.
fn own_user() -> io::Result<u32> {
    UnixStream::pair()?.0.peer_cred().map(|c| c.uid())
}

/// The path of a folder's socket, short enough for the system. It is valid while the returned file is open.
fn socket_path(folder: &Path) -> io::Result<(PathBuf, Option<File>)> {
    let path = folder.join(SOCKET);
    if path.as_os_str().len() <= MAX_SOCKET_PATH_BYTES {
        return Ok((path, None));
    }
    // Linux has a short path for an open folder
    let open = File::open(folder)?;
    let path = PathBuf::from(format!("/proc/self/fd/{}", open.as_raw_fd()));
    if !path.exists() {
        let what = format!("the folder's path is longer than {MAX_SOCKET_PATH_BYTES} bytes; give a shorter --out");
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    Ok((path.join(SOCKET), Some(open)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};

    #[tokio::test]
    async fn a_socket_in_a_deep_folder_is_reached() {
        let dir = tempfile::tempdir().unwrap();
        let deep = dir.path().join("d".repeat(120)).join("e".repeat(120));
        std::fs::create_dir_all(&deep).unwrap();
        for folder in [dir.path(), &deep] {
            let door = CtlListener::open(folder, None).await.unwrap();
            let mode = folder.join(SOCKET).metadata().unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600);
            let (client, guest) = tokio::join!(connect_socket(folder), async { door.accept().await?.admit().await });
            client.unwrap().write_all(b"x").await.unwrap();
            assert_eq!(guest.unwrap().read_u8().await.unwrap(), b'x');
            CtlListener::remove_files(folder);
            assert!(connect_socket(folder).await.is_err());
        }
    }

    #[tokio::test]
    async fn an_address_is_of_no_use_without_the_key() {
        let dir = tempfile::tempdir().unwrap();
        let door = CtlListener::open(dir.path(), Some(SocketAddr::from(([127, 0, 0, 1], 0)))).await.unwrap();
        let text = std::fs::read_to_string(dir.path().join(ADDRESS)).unwrap();
        let (at, key) = text.trim().split_once(' ').unwrap();
        for (key, comes_in) in [(key, true), ("", false), ("00", false)] {
            let (client, guest) = tokio::join!(connect_address(at, key), async { door.accept().await?.admit().await });
            assert_eq!((client.is_ok(), guest.is_ok()), (comes_in, comes_in));
        }
    }
}
