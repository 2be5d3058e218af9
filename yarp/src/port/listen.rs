//! Life cycle of a port: it listens, registers, accepts, and ends in order.

use super::core::{InputSink, PortCore};
use super::slot::Delivery;
use super::{PortError, PortOptions, input};
use crate::Network;
use crate::guests::Guests;
use crate::remote::{self, Holder};
use crate::wire::names;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};

/// Time that another port with the name may take to close, as a number of checks and their interval.
const CLOSES: (u32, Duration) = (5, Duration::from_millis(100));

/// An open port. Dropping it closes it in the background.
pub(crate) struct Handle {
    pub core: Arc<PortCore>,
    listener: Option<JoinHandle<()>>,
}

impl Handle {
    pub async fn open(
        network: &Network,
        name: &str,
        sink: InputSink,
        delivery: Option<Delivery>,
        options: PortOptions,
    ) -> Result<Handle, PortError> {
        let name = network.full_name(name);
        if !names::is_rooted(&name) && name != "..." {
            return Err(PortError::BadName(name));
        }
        check_free(network, &name).await?;
        let address = (network.bind(), options.number);
        let listen =
            |source| PortError::Listen { name: name.clone(), address: format!("{}:{}", address.0, address.1), source };
        let listener = TcpListener::bind(address).await.map_err(listen)?;
        let number = listener.local_addr().map_err(listen)?.port();
        let contact = match network.register(&name, &network.host(), number).await {
            Ok(contact) => contact,
            Err(error) => {
                // our name server refuses a name that another port has registered since the check
                check_free(network, &name).await?;
                return Err(error.into());
            }
        };
        let core = Arc::new(PortCore::new(network, contact, sink, delivery, options));
        let listener = Some(tokio::spawn(listen_loop(core.clone(), listener)));
        let handle = Handle { core, listener };
        // Persistent connections are optional; without them the port is open nevertheless.
        if let Err(error) = network.announce(&handle.core.name).await {
            tracing::debug!(port = handle.core.name, %error, "not announced");
        }
        Ok(handle)
    }

    /// Ends connections in order and unregisters.
    pub async fn close(mut self) {
        self.core.begin_closing();
        if let Some(listener) = self.listener.take() {
            let _ = listener.await;
        }
    }
}

/// Checks that no other port has this name, because the original's name server gives any name to the last
/// port that requests it. A port that is closing gets some time.
///
/// # Errors
/// Another port has the name; or the name server can't be queried.
pub async fn check_free(network: &Network, name: &str) -> Result<(), PortError> {
    for look in 1.. {
        let Some(other) = network.query(name).await? else { break };
        match remote::holder(network, &other).await {
            Holder::Gone => break,
            Holder::Silent => return Err(PortError::Silent(other)),
            Holder::Port if look == CLOSES.0 => return Err(PortError::Taken(other)),
            Holder::Port => sleep(CLOSES.1).await,
        }
    }
    Ok(())
}

impl Drop for Handle {
    fn drop(&mut self) {
        self.core.begin_closing();
    }
}

async fn listen_loop(core: Arc<PortCore>, listener: TcpListener) {
    let mut inputs = Guests::new(core.options.connections);
    let renewal = tokio::spawn(renew(core.clone()));
    let closed = core.closed();
    tokio::pin!(closed);
    loop {
        tokio::select! {
            () = &mut closed => break,
            Some(()) = inputs.ended() => {}
            accepted = listener.accept() => match accepted {
                Ok((stream, peer)) => {
                    if !inputs.admit(|heard| input::serve(core.clone(), stream, heard)) {
                        tracing::debug!(port = core.name, %peer, "connection limit reached");
                    }
                }
                Err(error) => {
                    tracing::debug!(port = core.name, %error, "can't accept");
                    sleep(Duration::from_millis(50)).await;
                }
            }
        }
    }
    drop(listener);
    renewal.abort();
    core.end_outputs().await;
    // Inputs end by themselves when they detect that the port closes.
    let _ = timeout(core.options.write, async { while inputs.ended().await.is_some() {} }).await;
    inputs.shutdown().await;
    if let InputSink::Inbox(inbox) = &core.sink {
        inbox.close();
    }
    // a port that has taken the name since then keeps it
    let unregistered = match core.network.query(&core.name).await {
        Ok(Some(found)) if (&found.host, found.port) == (&core.contact.host, core.contact.port) => {
            core.network.unregister(&core.name).await
        }
        Ok(_) => Ok(()),
        Err(error) => Err(error),
    };
    if let Err(error) = unregistered {
        tracing::debug!(port = core.name, %error, "not unregistered");
    }
}

/// Renews the registration periodically.
async fn renew(core: Arc<PortCore>) {
    loop {
        sleep(core.options.renew).await;
        core.roll_call().await;
    }
}
