//! The handshake of `auth.conf` (spec section 18): both sides prove that they have the key before any other
//! message.
//!
//! The accepting side sends nonce 1 and its digest, the connecting side answers with nonce 2 and the digest
//! over both, the accepting side with nonce 3 and the digest over all three. This proves possession of the
//! key at the beginning of a connection; later messages are neither encrypted nor signed.

use hmac::{Hmac, Mac};
use sha2::Sha256;
use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};
use std::time::Duration;
use std::{fmt, io};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::time::timeout;

/// Time limit of the handshake.
const LIMIT: Duration = Duration::from_secs(2);
const NONCE: usize = 8;
const DIGEST: usize = 32;

/// The secret of `auth.conf`; its debug form does not show it.
#[derive(Clone, PartialEq, Eq)]
pub struct Key(Vec<u8>);

impl Key {
    /// A key from the text in the file.
    pub fn new(secret: impl Into<Vec<u8>>) -> Key {
        Key(secret.into())
    }

    /// HMAC-SHA256 over the nonces so far; never `None`, since HMAC accepts keys of any length.
    fn mac(&self, nonces: &[[u8; NONCE]]) -> Option<Hmac<Sha256>> {
        let mut mac = Hmac::<Sha256>::new_from_slice(&self.0).ok()?;
        nonces.iter().for_each(|n| mac.update(n));
        Some(mac)
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(...)")
    }
}

/// Our side of a connection that we accepted. On error the connection has to be closed.
///
/// # Errors
/// The other side closed, took more than 2 s, or does not have the key.
pub async fn accept<S: AsyncRead + AsyncWrite + Unpin>(stream: &mut S, key: &Key) -> io::Result<()> {
    limited(async {
        let first = nonce();
        send(stream, key, &[first]).await?;
        let second = receive(stream, key, &[first]).await?;
        send(stream, key, &[first, second, nonce()]).await
    })
    .await
}

/// Our side of a connection that we made. On error the connection has to be closed.
///
/// # Errors
/// The other side closed, took more than 2 s, or does not have the key.
pub async fn connect<S: AsyncRead + AsyncWrite + Unpin>(stream: &mut S, key: &Key) -> io::Result<()> {
    limited(async {
        let first = receive(stream, key, &[]).await?;
        let second = nonce();
        send(stream, key, &[first, second]).await?;
        receive(stream, key, &[first, second]).await.map(drop)
    })
    .await
}

async fn limited(work: impl Future<Output = io::Result<()>>) -> io::Result<()> {
    timeout(LIMIT, work).await.unwrap_or_else(|_| {
        let why = "no authentication within 2 s: has the other side an auth.conf with the same key?";
        Err(io::Error::new(io::ErrorKind::TimedOut, why))
    })
}

/// Sends the newest nonce and the digest over all of them.
async fn send<S: AsyncWrite + Unpin>(stream: &mut S, key: &Key, nonces: &[[u8; NONCE]]) -> io::Result<()> {
    let (Some(newest), Some(mac)) = (nonces.last(), key.mac(nonces)) else { return Err(refused()) };
    let mut message = newest.to_vec();
    message.extend_from_slice(&mac.finalize().into_bytes());
    stream.write_all(&message).await
}

/// Receives one nonce and checks the digest over `known` and it.
async fn receive<S: AsyncRead + Unpin>(stream: &mut S, key: &Key, known: &[[u8; NONCE]]) -> io::Result<[u8; NONCE]> {
    let mut theirs = [0; NONCE];
    let mut digest = [0; DIGEST];
    stream.read_exact(&mut theirs).await?;
    stream.read_exact(&mut digest).await?;
    let mut mac = key.mac(known).ok_or_else(refused)?;
    mac.update(&theirs);
    mac.verify_slice(&digest).map_err(|_| refused())?;
    Ok(theirs)
}

fn refused() -> io::Error {
    let why = "the other side does not know the key of our auth.conf: give both the same, or none";
    io::Error::new(io::ErrorKind::PermissionDenied, why)
}

/// Eight unpredictable bytes: the standard library seeds each hasher from the system's randomness.
fn nonce() -> [u8; NONCE] {
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u8(0);
    hasher.finish().to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn equal_keys_agree_and_the_stream_is_left_clean() {
        let (mut a, mut b) = tokio::io::duplex(256);
        let key = Key::new("secret");
        let (x, y) = tokio::join!(accept(&mut a, &key), connect(&mut b, &key));
        assert!(x.is_ok() && y.is_ok());
        a.write_all(b"on").await.unwrap();
        let mut rest = [0; 2];
        b.read_exact(&mut rest).await.unwrap();
        assert_eq!(&rest, b"on");
    }

    #[tokio::test]
    async fn another_key_is_refused_on_both_sides() {
        let (mut a, mut b) = tokio::io::duplex(256);
        let ours = async {
            let end = connect(&mut b, &Key::new("other")).await;
            drop(b);
            end
        };
        let key = Key::new("secret");
        let (x, y) = tokio::join!(accept(&mut a, &key), ours);
        assert!(x.is_err());
        assert_eq!(y.unwrap_err().kind(), io::ErrorKind::PermissionDenied);
    }

    #[tokio::test(start_paused = true)]
    async fn silence_ends_after_two_seconds() {
        let (mut a, _b) = tokio::io::duplex(256);
        assert_eq!(accept(&mut a, &Key::new("k")).await.unwrap_err().kind(), io::ErrorKind::TimedOut);
    }

    #[test]
    fn the_digest_is_hmac_sha256() {
        // RFC 4231, test case 2, whose data is split here as nonces are not: the key and digest decide
        let mut mac = Key::new("Jefe").mac(&[]).unwrap();
        mac.update(b"what do ya want for nothing?");
        let hex: String = mac.finalize().into_bytes().iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(hex, "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843");
    }
}
