//! The commands that query the name server, or control ports from a third program.

use super::{Failure, because, info};
use mobee_yarp::remote::{self, Holder, RemoteError};
use mobee_yarp::{Bottle, Contact, Network};
use std::time::Duration;

/// Interval of checks for a port that does not exist yet.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// `list`: the registered ports.
pub(super) async fn list(network: &Network, prefix: &str) -> Result<(), Failure> {
    for contact in network.list(prefix).await.map_err(because)? {
        println!("{}", mobee_yarp::name::text::registration(&contact));
    }
    Ok(())
}

/// `name`: sends any request, and prints the answer unchanged.
pub(super) async fn request(network: &Network, words: &[String]) -> Result<(), Failure> {
    let words: Vec<&str> = words.iter().flat_map(|w| w.split_whitespace()).collect();
    let lines = network.ask(&words).await.map_err(because)?;
    if words.first() == Some(&"query") && lines.is_empty() {
        return Err(because(format!("{} not known.", words.get(1).unwrap_or(&""))));
    }
    lines.iter().for_each(|line| println!("{line}"));
    Ok(())
}

/// `where`: prints the name server's address after a query.
pub(super) async fn whereabouts(network: &Network) -> Result<(), Failure> {
    let (host, port) = network.server();
    println!("Looking for name server on {host}, port number {port}");
    let found = network.query(network.namespace()).await.map_err(because)?;
    let Some(Contact { name, host, port, .. }) = found else {
        let why = format!("a name server answers at {host}:{port}, but it is not that of {}", network.namespace());
        return Err(because(format!("{why}: set YARP_NAMESPACE, or another --server")));
    };
    println!("Name server {name} is available at ip {host} port {port}");
    Ok(())
}

/// `ping`: prints a port's information about itself.
pub(super) async fn ping(network: &Network, port: &str) -> Result<(), Failure> {
    for line in remote::ping(network, port).await.map_err(because)? {
        // the original reads the lines as bottles and prints those
        let printed = Bottle::parse(&line, network.dialect()).map_or(line, |bottle| bottle.to_string());
        println!("{printed}");
    }
    Ok(())
}

/// `exists`: reports the result by the exit code.
pub(super) async fn exists(network: &Network, port: &str, to: Option<&str>) -> Result<(), Failure> {
    let there = match to {
        None => remote::exists(network, port).await.map_err(because)?,
        Some(to) => match remote::connection(network, port, to).await {
            Ok(Some(c)) => {
                info(format_args!("Connection found between {} and {} using carrier {}", c.from, c.to, c.carrier));
                true
            }
            Ok(None) => {
                info(format_args!("No connection from {port} to {to} found"));
                false
            }
            Err(e) => return Err(because(e)),
        },
    };
    if there { Ok(()) } else { Err(None) }
}

/// `exists --wait`: returns once it exists. Continues without a name server, which may start, too.
pub(super) async fn wait(network: &Network, port: &str, to: Option<&str>) {
    loop {
        let there = match to {
            None => remote::exists(network, port).await.unwrap_or(false),
            Some(to) => matches!(remote::connection(network, port, to).await, Ok(Some(_))),
        };
        if there {
            return;
        }
        tokio::time::sleep(POLL_INTERVAL).await;
    }
}

/// `connect`: at once, or by the name server whenever both ports exist.
pub(super) async fn connect(
    network: &Network,
    from: &str,
    to: &str,
    carrier: Option<String>,
    persist: Option<&str>,
) -> Result<(), Failure> {
    let Some(mode) = persist else {
        let reply = remote::connect(network, from, to, carrier.as_deref()).await.map_err(because)?;
        println!("Success: {reply}");
        return Ok(());
    };
    let to = match carrier {
        Some(carrier) => Contact { carrier, ..Contact::parse(to) }.to_string(),
        None => to.to_string(),
    };
    let mut words = vec!["subscribe", from, &to];
    words.extend((!mode.is_empty()).then_some(mode));
    match network.ask(&words).await.map_err(because)?.first() {
        Some(answer) if answer == "[ok]" => Ok(()),
        _ => Err(because("the name server does not take this persistent connection")),
    }
}

/// `connect` without two ports: the persistent connections.
pub(super) async fn subscriptions(network: &Network, of: Option<&str>) -> Result<(), Failure> {
    if let Some(port) = of {
        ping(network, port).await?;
    }
    let lines = network.ask(&[&["subscribe"][..], &of.into_iter().collect::<Vec<_>>()].concat()).await;
    let lines = lines.map_err(because)?;
    let list = Bottle::parse(lines.join(" "), network.dialect()).unwrap_or_default();
    let connections = list.iter().skip(1).filter_map(|v| v.as_list());
    let mut none = true;
    for connection in connections {
        let text = |key: &str| connection.find(key).and_then(|v| v.first()?.as_text()).unwrap_or("?".into());
        let mode = match text("mode") {
            mode if mode == "?" => String::new(),
            mode => format!(" [{mode}]"),
        };
        println!("Persistent connection {} -> {}{mode}", text("src"), text("dest"));
        none = false;
    }
    if none {
        println!("No persistent connections.");
    }
    Ok(())
}

/// `disconnect`: at once, or by removing a persistent connection.
pub(super) async fn disconnect(network: &Network, from: &str, to: &str, persist: bool) -> Result<(), Failure> {
    if persist {
        return network.ask(&["unsubscribe", from, to]).await.map(drop).map_err(because);
    }
    match remote::disconnect(network, from, to).await {
        Ok(reply) => println!("Success: {reply}"),
        Err(e @ RemoteError::NoConnection(..)) => return Err(because(format!("Failure: {e}"))),
        Err(e) => return Err(because(e)),
    }
    Ok(())
}

/// `clean`: removes ports that accept no connection.
pub(super) async fn clean(network: &Network) -> Result<(), Failure> {
    println!("Requesting list of ports from name server... ");
    let ports = network.list("").await.map_err(because)?;
    println!("got {} port{}", ports.len(), if ports.len() == 1 { "" } else { "s" });
    for port in ports {
        let name = &port.name;
        if name == "fallback" || name == network.namespace() {
            println!("Ignoring {name}");
        } else if port.carrier == "mcast" {
            println!("Skipping mcast port {name}...");
        } else {
            println!("Testing {name} at {port}");
            match remote::holder(network, &port).await {
                Holder::Port => {}
                Holder::Silent => println!("* A program accepts connections there and does not answer: not removed"),
                Holder::Gone => {
                    println!("* No response, removing port {name}");
                    network.unregister(name).await.map_err(because)?;
                }
            }
        }
    }
    println!("Giving name server a chance to do garbage collection.");
    let reply = network.ask(&["gc"]).await.map_err(because)?;
    println!("Name server says: {}", reply.join(" "));
    Ok(())
}
