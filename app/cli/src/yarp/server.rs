//! `mobee yarp server`: the embedded name server as a program.

use super::conf::{address_line, written};
use super::{Failure, because, info, network_at};
use crate::signals::Interrupt;
use mobee_yarp::config::Env;
use mobee_yarp::{NameServer, Network, NetworkConfigError, ServerOptions};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::Path;

/// The arguments of the name server.
#[derive(clap::Args)]
pub(super) struct ServerArgs {
    /// The port number; 10000 unless YARP_PORT_RANGE is set, 0 for any.
    #[arg(long, value_name = "NUMBER")]
    socket: Option<u16>,
    /// Serve at the address in yarp.conf.
    #[arg(long, conflicts_with_all = ["write", "socket"])]
    read: bool,
    /// Write the address into yarp.conf, replacing its contents.
    #[arg(long)]
    write: bool,
    /// Allow addresses other than loopback. Anyone who can reach a name server can take over every port.
    #[arg(long)]
    public: bool,
}

/// Serves until Ctrl-C.
pub(super) async fn serve(args: ServerArgs, server: Option<String>, ip: Option<IpAddr>) -> Result<(), Failure> {
    let env = Env::real();
    let namespace = env.namespace().map_err(because)?;
    let file = env.address_file(&namespace).map_err(because)?;
    let configured = match Network::from_env() {
        Ok(network) => Some(network.server()).map(|(host, port)| (host.to_string(), port)),
        Err(NetworkConfigError::Missing(_)) => None,
        Err(_) if args.write || server.is_some() => None,
        Err(e) => return Err(because(e)),
    };
    let (host, port) = match (&server, &configured) {
        (Some(address), _) => {
            let given = network_at(address)?;
            let (host, port) = given.server();
            (host.to_string(), port)
        }
        (None, Some(found)) if args.read => found.clone(),
        (None, None) if args.read => return Err(because(NetworkConfigError::Missing(file))),
        _ => {
            let port = args.socket.map_or_else(|| env.default_port().map_err(because), Ok)?;
            (ip.unwrap_or(IpAddr::V4(Ipv4Addr::LOCALHOST)).to_string(), port)
        }
    };
    let known = host == "localhost";
    let address = if known { Ok(IpAddr::V4(Ipv4Addr::LOCALHOST)) } else { host.parse() };
    let address = address.map_err(|_| because(format!("{host} is no address: give --ip one of this computer's")))?;
    let mut interrupt = Interrupt::new();
    let options = ServerOptions {
        namespace,
        public: args.public,
        auth: env.auth().map_err(because)?,
        ..ServerOptions::default()
    };
    let bound = NameServer::bind(SocketAddr::new(address, port), options).await;
    let server_there = bound.map_err(|e| because(format!("no name server at {address}:{port}: {e}")))?;
    let contact = server_there.contact().clone();
    // --server leaves the file alone
    if server.is_none() {
        record(&file, configured, (&contact.host, contact.port), args.write)?;
    }
    println!("Name server {} is available at ip {} port {}", contact.name, contact.host, contact.port);
    interrupt.wait().await;
    let counts = server_there.counts();
    info(format_args!("{} registrations, {} of them of names that another had", counts.registered, counts.replaced));
    server_there.close().await;
    Ok(())
}

/// Records the server's address in the address file: writes it if it is missing or requested, else compares it.
fn record(file: &Path, there: Option<(String, u16)>, (host, port): (&str, u16), write: bool) -> Result<(), Failure> {
    match there {
        Some((h, p)) if (h.as_str(), p) == (host, port) => return Ok(()),
        Some((h, p)) if !write => {
            let file = file.display();
            return Err(because(format!(
                "{file} says {h} {p}, but this server would be at {host} {port}: \
                 --read serves there, --write changes the file, --server HOST:PORT leaves it alone"
            )));
        }
        _ => {}
    }
    written(file, &address_line(host, port))?;
    info(format_args!("wrote the address into {}", file.display()));
    Ok(())
}
