//! The commands that show and change the user's YARP configuration: `conf`, `detect`, `namespace`, `version`.

use super::{Failure, because, info};
use mobee_yarp::config::Env;
use mobee_yarp::{Network, NetworkConfigError, local_address};
use std::io;
use std::path::Path;

/// The arguments of `conf`.
#[derive(clap::Args)]
pub(super) struct ConfArgs {
    /// The name server's host.
    #[arg(requires = "number")]
    host: Option<String>,
    /// Its port number.
    #[arg(value_parser = clap::value_parser!(u16).range(1..))]
    number: Option<u16>,
    /// The kind of name server; only one exists.
    #[arg(default_value = "yarp", value_parser = ["yarp"])]
    mode: String,
    /// Remove the address.
    #[arg(long, conflicts_with = "host")]
    clean: bool,
}

/// Writes a configuration file, and creates its folder if necessary.
pub(super) fn written(file: &Path, text: &str) -> Result<(), Failure> {
    let unwritten = |e: io::Error| because(format!("{} can't be written: {e}", file.display()));
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).map_err(unwritten)?;
    }
    std::fs::write(file, text).map_err(unwritten)
}

/// The line of an address file.
pub(super) fn address_line(host: &str, port: u16) -> String {
    format!("{host} {port} yarp\n")
}

/// `conf`: prints the path of the address file, or writes an address into it.
pub(super) fn conf(args: ConfArgs) -> Result<(), Failure> {
    let env = Env::real();
    let file = env.address_file(&env.namespace().map_err(because)?).map_err(because)?;
    if args.clean {
        return match std::fs::remove_file(&file) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => {
                Err(because(format!("{} can't be removed: {e}", file.display())))
            }
            _ => {
                info(format_args!("forgot the address in {}", file.display()));
                Ok(())
            }
        };
    }
    let (Some(host), Some(number)) = (args.host, args.number) else {
        println!("{}", file.display());
        return Ok(());
    };
    if host.is_empty() || host.contains(|c: char| c.is_whitespace() || c.is_control() || c == '"') {
        return Err(because(format!("`{}` is no host: a name or an address was expected", host.escape_debug())));
    }
    written(&file, &address_line(&host, number))?;
    info(format_args!("{} says {host} {number} now", file.display()));
    Ok(())
}

/// `namespace`: prints the namespace, or sets another one.
pub(super) fn namespace(wanted: Option<String>) -> Result<(), Failure> {
    let env = Env::real();
    if let Some(wanted) = wanted {
        if !wanted.starts_with('/') || wanted.contains(|c: char| c.is_whitespace() || c.is_control() || c == '"') {
            let wanted = wanted.escape_debug();
            return Err(because(format!(
                "`{wanted}` is no namespace: a word that begins with / was expected, such as /root"
            )));
        }
        let file = env.config_home().map_err(because)?.join("yarp_namespace.conf");
        written(&file, &format!("{wanted}\n"))?;
        info(format_args!("wrote it into {}; without that file the namespace is /root", file.display()));
    }
    println!("YARP namespace: {}", env.namespace().map_err(because)?);
    Ok(())
}

/// `version`: prints our version, and the protocol's.
pub(super) fn version() {
    println!("MoBeE {} speaks the protocol of YARP 2 and 3", env!("CARGO_PKG_VERSION"));
}

/// `detect`: looks for a name server at the configured address, and at the usual addresses of this computer.
pub(super) async fn detect(network: Option<Network>, write: bool) -> Result<(), Failure> {
    let env = Env::real();
    let namespace = env.namespace().map_err(because)?;
    let file = env.address_file(&namespace).map_err(because)?;
    let configured = match network {
        Some(given) => Some(given),
        None => match Network::from_env() {
            Ok(found) => Some(found),
            Err(NetworkConfigError::Missing(_)) => None,
            Err(e) => return Err(because(e)),
        },
    };
    let port = env.default_port().map_err(because)?;
    let usual = ["127.0.0.1".to_string(), local_address(None).await.to_string()];
    let mut places: Vec<(String, u16)> =
        configured.iter().map(Network::server).map(|(h, p)| (h.to_string(), p)).collect();
    places.extend(usual.into_iter().map(|host| (host, port)));
    places.dedup();
    for (host, port) in &places {
        info(format_args!("Checking for name server at ip {host} port {port}"));
        let network = env.apply(Network::of(host.as_str(), *port)).map_err(because)?;
        let Ok(Some(found)) = network.query(&namespace).await else { continue };
        println!("Name server {} is available at ip {} port {}", found.name, found.host, found.port);
        if write {
            written(&file, &address_line(host, *port))?;
            info(format_args!("wrote the address into {}", file.display()));
        } else if configured.as_ref().is_none_or(|known| known.server() != (host.as_str(), *port)) {
            info(format_args!("{} does not say so: `mobee yarp detect --write` changes it", file.display()));
        }
        return Ok(());
    }
    Err(because(
        "no name server answers: start one with `mobee yarp server`, or give its address with --server HOST:PORT",
    ))
}
