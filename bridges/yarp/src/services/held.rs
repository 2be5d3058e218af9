//! Ownership of our port names: before they are opened, and while they are served.

use mobee_yarp::remote::{Holder, holder};
use mobee_yarp::{Contact, Network, PortError};
use std::collections::BTreeMap;
use std::time::Duration;

/// Period of queries to the name server.
const CHECK_PERIOD: Duration = Duration::from_secs(2);

/// Reason why a run can't have a port name, with the remedy.
pub(super) fn refusal(error: &PortError) -> String {
    match error {
        PortError::Taken(_) | PortError::Silent(_) => {
            format!("{error}: set another `prefix` in [yarp], or stop the other run (`mobee ctl stop`)")
        }
        _ => error.to_string(),
    }
}

/// Waits until the name server assigns one of our names to another port that answers to it, which the
/// original does for any program that requests it. Returns the message. A name server that does not answer is
/// ignored.
pub(super) async fn lost(network: &Network, names: &[String]) -> String {
    let names: Vec<String> = names.iter().map(|name| network.full_name(name)).collect();
    let listed = async || {
        let all = network.list("").await.ok()?;
        let ours = all.into_iter().filter(|contact| names.contains(&contact.name));
        Some(ours.map(|contact| (contact.name.clone(), contact)).collect::<BTreeMap<String, Contact>>())
    };
    let mut known: BTreeMap<String, Contact> = BTreeMap::new();
    loop {
        for (name, contact) in listed().await.unwrap_or_default() {
            let before = known.entry(name).or_insert_with(|| contact.clone());
            let moved = (&before.host, before.port) != (&contact.host, contact.port);
            if moved && holder(network, &contact).await == Holder::Port {
                return refusal(&PortError::Taken(contact));
            }
        }
        tokio::time::sleep(CHECK_PERIOD).await;
    }
}
