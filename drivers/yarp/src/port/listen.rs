//! The life of a port: it listens, registers, accepts, and ends in order.

use super::core::{Core, Sink};
use super::slot::Delivery;
use super::{PortError, PortOptions, input};
use crate::Network;
use crate::wire::names;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::{sleep, timeout};

/// An open port. Dropping it closes it in the background.
pub(crate) struct Handle {
    pub core: Arc<Core>,
    listener: Option<JoinHandle<()>>,
}

impl Handle {
    pub async fn open(
        network: &Network,
        name: &str,
        sink: Sink,
        delivery: Option<Delivery>,
        options: PortOptions,
    ) -> Result<Handle, PortError> {
        let name = network.full_name(name);
        if !names::is_rooted(&name) && name != "..." {
            return Err(PortError::BadName(name));
        }
        let address = (network.bind(), options.number);
        let listen =
            |source| PortError::Listen { name: name.clone(), address: format!("{}:{}", address.0, address.1), source };
        let listener = TcpListener::bind(address).await.map_err(listen)?;
        let number = listener.local_addr().map_err(listen)?.port();
        let contact = network.register(&name, &network.host(), number).await?;
        let core = Arc::new(Core::new(network, contact, sink, delivery, options));
        let listener = Some(tokio::spawn(listen_loop(core.clone(), listener)));
        let handle = Handle { core, listener };
        // Persistent connections are a courtesy of the name server; without them the port is open all the same.
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

impl Drop for Handle {
    fn drop(&mut self) {
        self.core.begin_closing();
    }
}

async fn listen_loop(core: Arc<Core>, listener: TcpListener) {
    let mut inputs = JoinSet::new();
    let renewal = tokio::spawn(renew(core.clone()));
    let closed = core.closed();
    tokio::pin!(closed);
    loop {
        tokio::select! {
            () = &mut closed => break,
            Some(_) = inputs.join_next() => {}
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) if inputs.len() < core.options.connections => {
                    inputs.spawn(input::serve(core.clone(), stream));
                }
                Ok((_, peer)) => tracing::debug!(port = core.name, %peer, "connection limit reached"),
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
    // Inputs end by themselves when they see the port closing.
    let _ = timeout(core.options.write, async { while inputs.join_next().await.is_some() {} }).await;
    inputs.shutdown().await;
    if let Sink::Inbox(inbox) = &core.sink {
        inbox.close();
    }
    // Who has taken the name in the meantime keeps it.
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

/// Calls the roll from time to time, so that the port stays known.
async fn renew(core: Arc<Core>) {
    loop {
        sleep(core.options.renew).await;
        core.roll_call().await;
    }
}
