//! What tests of ports share.

use mobee_yarp::{NameServer, Network, ServerOptions};

/// Starts a name server of one test's own, and gives the network it serves.
pub async fn names() -> (NameServer, Network) {
    let server = NameServer::bind(([127, 0, 0, 1], 0).into(), ServerOptions::default()).await.unwrap();
    let network = server.network();
    (server, network)
}
