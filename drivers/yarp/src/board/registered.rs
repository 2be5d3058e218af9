//! Ports that stay known when their name server is restarted (spec section 17).

use super::server::roll_call;
use crate::{Contact, Network};

/// What the name server says of one of our names.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Roll {
    /// It is ours.
    Ours,
    /// The server had forgotten it; it is registered again.
    Anew,
    /// Another program has it.
    Taken(Contact),
    /// The server does not answer.
    Unknown,
}

/// Looks whether the name server knows a port of ours, and registers it again if it has forgotten.
pub(super) async fn call(network: &Network, ours: &Contact) -> Roll {
    match network.query(&ours.name).await {
        Ok(Some(found)) if found.host == ours.host && found.port == ours.port => Roll::Ours,
        Ok(Some(found)) => Roll::Taken(found),
        Ok(None) => {
            if network.register(&ours.name, &ours.host, ours.port).await.is_err() {
                return Roll::Unknown;
            }
            let _ = network.announce(&ours.name).await;
            Roll::Anew
        }
        Err(_) => Roll::Unknown,
    }
}

/// Keeps these ports registered, for ever.
pub(super) async fn keep_registered(network: Network, ports: Vec<Contact>) {
    let mut ticks = roll_call();
    // the first tick comes at once, when all are registered
    ticks.tick().await;
    let mut taken = vec![false; ports.len()];
    loop {
        ticks.tick().await;
        for (port, warned) in ports.iter().zip(&mut taken) {
            match call(&network, port).await {
                Roll::Taken(by) if !*warned => {
                    *warned = true;
                    tracing::warn!(name = port.name, by = %by, "another program has taken the name of this port");
                }
                Roll::Anew => tracing::info!(name = port.name, "registered again"),
                _ => {}
            }
        }
    }
}
