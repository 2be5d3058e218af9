//! Makes the persistent connections: the server acts as the third program of spec section 8.

use crate::name::PendingConnection;
use crate::{Network, remote};
use tokio::sync::mpsc;
use tokio::task::JoinSet;

/// Greatest number of connections waiting to be made; others are left to the next announcement.
pub(super) const MOST_WAITING: usize = 1024;
/// Greatest number made at the same time, so that a port which hangs does not delay the others.
const AT_ONCE: usize = 16;

/// Makes connections on request.
pub(super) async fn connect_all(network: Network, mut wanted: mpsc::Receiver<PendingConnection>) {
    let mut making = JoinSet::new();
    while let Some(link) = wanted.recv().await {
        while making.len() >= AT_ONCE {
            making.join_next().await;
        }
        while making.try_join_next().is_some() {}
        making.spawn(make(network.clone(), link));
    }
}

async fn make(network: Network, PendingConnection { src, dest }: PendingConnection) {
    let made = async {
        if remote::connection(&network, &src, &dest).await?.is_none() {
            remote::connect(&network, &src, &dest, None).await?;
        }
        Ok::<(), remote::RemoteError>(())
    };
    match made.await {
        Ok(()) => tracing::debug!("name server: persistent connection from {src} to {dest} is there"),
        Err(e) => tracing::warn!("name server: persistent connection from {src} to {dest}: {e}"),
    }
}
