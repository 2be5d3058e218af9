//! Finds the YARP network, or starts one.

use super::YarpSettings;
use mobee_yarp::config::{self, Env};
use mobee_yarp::{Dialect, NameServer, Network};
use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

/// Time limit of an answer of the name server.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);

/// Opens the network of the settings and of YARP's own configuration, with a name server of our own if it
/// needed one.
///
/// # Errors
/// A message with the remedy.
pub(super) async fn open(settings: &YarpSettings) -> Result<(Network, Option<NameServer>), String> {
    let network = find(settings)?;
    let probe = network.clone().with_timeout(ANSWER_TIMEOUT);
    let Err(error) = probe.query(network.namespace()).await else { return Ok((network, None)) };
    let (host, port) = network.server();
    if !settings.start_name_server {
        return Err(format!(
            "the name server at {host}:{port} does not answer ({error}); start one (`mobee yarp server`), or set \
             start_name_server = true"
        ));
    }
    let server = NameServer::instead(&network, settings.allow_open_network).await.map_err(|e| {
        format!("no name server answers at {host}:{port}, and none can be started there: {e}; set name_server")
    })?;
    tracing::info!(address = %server.address(), "started a YARP name server");
    Ok((network, Some(server)))
}

pub(super) fn find(settings: &YarpSettings) -> Result<Network, String> {
    let env = Env::real();
    let network = match settings.name_server {
        Some(address) => env.apply(Network::at(address)),
        None => config::network_or_default(&env),
    };
    let network = network.map_err(|e| e.to_string())?;
    let dialect = if settings.dialect == 4 { Dialect::V4 } else { Dialect::V3 };
    let network = network.with_dialect(dialect);
    if settings.allow_open_network {
        return Ok(network.with_bind(IpAddr::V4(Ipv4Addr::UNSPECIFIED)));
    }
    let (host, port) = network.server();
    if host != "localhost" && !host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback()) {
        return Err(format!(
            "YARP's configuration names the name server {host}:{port} on another computer, and only this one may be \
             used; set allow_open_network = true if that network is yours alone, or name_server = \"127.0.0.1:10000\""
        ));
    }
    Ok(network.with_bind(IpAddr::V4(Ipv4Addr::LOCALHOST)))
}
