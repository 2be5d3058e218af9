//! `mobee yarp`: the usual subcommands of the `yarp` program, without libYARP.
//!
//! Data goes to standard output as the original prints it; the original's log (`[INFO]`, `[ERROR]`) goes to standard
//! error, so that output can be piped. Exit codes are the original's, too: 0 done, 1 not done.

mod conf;
mod input;
mod names;
mod ports;
mod server;
mod streams;

use crate::signals::Interrupt;
use clap::{Args, Subcommand};
use mobee_yarp::config::Env;
use mobee_yarp::{Carrier, Network, NetworkConfigError, local_address};
use std::fmt::Display;
use std::net::IpAddr;
use std::process::ExitCode;
use std::time::Duration;

/// The arguments of `mobee yarp`.
#[derive(Args)]
pub struct YarpArgs {
    /// The name server, instead of the one in yarp.conf.
    #[arg(long, global = true, value_name = "HOST:PORT")]
    server: Option<String>,
    /// The address of this computer to listen on; loopback unless the name server is on another computer.
    #[arg(long, global = true, value_name = "ADDRESS")]
    ip: Option<IpAddr>,
    /// Time limit for any answer.
    #[arg(long, global = true, value_name = "SECONDS", default_value_t = 5.0)]
    timeout: f64,
    #[command(subcommand)]
    command: YarpCommand,
}

#[derive(Subcommand)]
enum YarpCommand {
    /// Run a name server until Ctrl-C (on loopback only, unless --public).
    Server(server::ServerArgs),
    /// List the registered ports.
    List {
        /// Only ports whose names begin with this.
        prefix: Option<String>,
    },
    /// Send a request to the name server, such as `query /port` or `help`.
    Name {
        /// The request.
        #[arg(required = true)]
        words: Vec<String>,
    },
    /// Report where the name server is running.
    Where,
    /// Look for a name server at the configured address and at the usual ones of this computer.
    Detect {
        /// Write its address into yarp.conf.
        #[arg(long)]
        write: bool,
    },
    /// Show the path of yarp.conf, or write the name server's address into it: `conf HOST NUMBER`.
    Conf(conf::ConfArgs),
    /// Show the namespace, or set another.
    Namespace {
        /// The new namespace, such as /root.
        name: Option<String>,
    },
    /// Print the version.
    Version,
    /// Request information from a port about itself.
    Ping {
        /// The port.
        port: String,
    },
    /// Check whether a port, or a connection between two, is alive: exit code 0, else 1.
    Exists {
        /// The port, or the sending port.
        port: String,
        /// The receiving port.
        to: Option<String>,
        /// Time to wait for it.
        #[arg(long, value_name = "SECONDS")]
        wait: Option<f64>,
    },
    /// Wait until a port, or a connection between two, is alive.
    Wait {
        /// The port, or the sending port.
        port: String,
        /// The receiving port.
        to: Option<String>,
    },
    /// Read from the network and print to standard output, until Ctrl-C.
    Read {
        /// The name of the port to open (`...`: any).
        port: String,
        /// A port to read from, and `envelope` to show stamps, and `trim [LENGTH]` to cut lines.
        words: Vec<String>,
        /// tcp, fast_tcp, text, text_ack or udp.
        #[arg(long, default_value = "tcp")]
        carrier: Carrier,
    },
    /// Write the lines of standard input to the network.
    Write {
        /// The name of the port to open (`...`: any).
        port: String,
        /// Ports to write to (also as udp://port), and `verbatim` to send lines as they are.
        words: Vec<String>,
        /// tcp, fast_tcp, text, text_ack or udp.
        #[arg(long, default_value = "tcp")]
        carrier: Carrier,
        /// Wait for a connection before sending each line.
        #[arg(long)]
        wait_connect: bool,
    },
    /// Send the lines of standard input as commands to a port, and print its replies.
    Rpc {
        /// The port.
        port: String,
        /// The name of our own port.
        #[arg(default_value = "anon_rpc")]
        name: String,
        /// tcp, fast_tcp, text or text_ack.
        #[arg(long, default_value = "tcp")]
        carrier: Carrier,
        /// Use the port's administrative interface (`[help]`).
        #[arg(long)]
        admin: bool,
    },
    /// Use a port's administrative interface, as `rpc --admin` does.
    Admin {
        /// The port.
        port: String,
        /// The name of our own port.
        #[arg(default_value = "anon_rpc")]
        name: String,
    },
    /// Drop or repeat messages, so that they leave at a constant rate.
    Sample(streams::SampleArgs),
    /// Whenever a message arrives, combine the newest messages of several ports into one.
    Merge(streams::MergeArgs),
    /// Connect two ports; without ports, list the persistent connections.
    Connect {
        /// The sending port.
        from: Option<String>,
        /// The receiving port (also as udp://port).
        to: Option<String>,
        /// The carrier, as a word.
        #[arg(conflicts_with = "option", value_parser = between_others)]
        word: Option<String>,
        /// tcp, fast_tcp, text, text_ack or udp; between other programs any that they support, also with modifiers.
        #[arg(id = "option", long = "carrier", value_name = "CARRIER", value_parser = between_others)]
        carrier: Option<String>,
        #[command(flatten)]
        persist: Persist,
    },
    /// Disconnect two ports.
    Disconnect {
        /// The sending port.
        from: String,
        /// The receiving port.
        to: String,
        /// Forget a persistent connection instead.
        #[arg(long)]
        persist: bool,
    },
    /// Remove ports from the name server that do not answer.
    Clean,
}

#[derive(Args)]
#[group(multiple = false)]
struct Persist {
    /// Let the name server connect them whenever both exist.
    #[arg(long)]
    persist: bool,
    /// The same, until the sending port closes.
    #[arg(long)]
    persist_from: bool,
    /// The same, until the receiving port closes.
    #[arg(long)]
    persist_to: bool,
}

impl Persist {
    /// The mode for the name server; `None` without persistence.
    fn mode(&self) -> Option<&'static str> {
        match self {
            Persist { persist: true, .. } => Some(""),
            Persist { persist_from: true, .. } => Some("from"),
            Persist { persist_to: true, .. } => Some("to"),
            _ => None,
        }
    }
}

/// Failure of a command: a sentence with the remedy, or nothing if the exit code is enough.
type Failure = Option<String>;

/// Turns any error into a sentence.
fn because(e: impl Display) -> Failure {
    Some(e.to_string())
}

/// A line of the log, as the original prints it.
fn info(line: impl Display) {
    eprintln!("[INFO] {line}");
}

/// Runs `mobee yarp ...`.
pub fn command(args: YarpArgs) -> ExitCode {
    let runtime = match tokio::runtime::Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(e) => return failed(because(format!("no asynchronous runtime: {e}"))),
    };
    let ended = runtime.block_on(dispatch(args));
    // a thread may still wait for standard input
    runtime.shutdown_background();
    ended.map_or_else(failed, |()| ExitCode::SUCCESS)
}

fn failed(why: Failure) -> ExitCode {
    if let Some(why) = why {
        eprintln!("[ERROR] {why}");
    }
    ExitCode::FAILURE
}

async fn dispatch(args: YarpArgs) -> Result<(), Failure> {
    if let YarpCommand::Server(server) = args.command {
        return server::serve(server, args.server, args.ip).await;
    }
    match args.command {
        YarpCommand::Conf(args) => return conf::conf(args),
        YarpCommand::Namespace { name } => return conf::namespace(name),
        YarpCommand::Version => {
            conf::version();
            return Ok(());
        }
        YarpCommand::Detect { write } => {
            let given = if args.server.is_some() { Some(network(&args).await?) } else { None };
            return conf::detect(given, write).await;
        }
        _ => {}
    }
    let network = network(&args).await?;
    match args.command {
        // handled above, without a network
        YarpCommand::Server(_) | YarpCommand::Conf(_) | YarpCommand::Namespace { .. } | YarpCommand::Version => Ok(()),
        YarpCommand::Detect { .. } => Ok(()),
        YarpCommand::Wait { port, to } => {
            let mut interrupt = Interrupt::new();
            tokio::select! {
                () = names::wait(&network, &port, to.as_deref()) => Ok(()),
                () = interrupt.wait() => Err(None),
            }
        }
        YarpCommand::Admin { port, name } => ports::rpc(&network, &port, &name, Carrier::Tcp, true).await,
        YarpCommand::Sample(args) => streams::sample(&network, args).await,
        YarpCommand::Merge(args) => streams::merge(&network, args).await,
        YarpCommand::List { prefix } => names::list(&network, prefix.as_deref().unwrap_or_default()).await,
        YarpCommand::Name { words } => names::request(&network, &words).await,
        YarpCommand::Where => names::whereabouts(&network).await,
        YarpCommand::Ping { port } => names::ping(&network, &port).await,
        YarpCommand::Exists { port, to, wait: None } => names::exists(&network, &port, to.as_deref()).await,
        YarpCommand::Exists { port, to, wait: Some(limit) } => {
            let waited = tokio::time::timeout(seconds(limit, "--wait")?, names::wait(&network, &port, to.as_deref()));
            waited.await.map_err(|_| None)
        }
        YarpCommand::Read { port, words, carrier } => ports::read(&network, &port, &words, carrier).await,
        YarpCommand::Write { port, words, carrier, wait_connect } => {
            ports::write(&network, &port, &words, carrier, wait_connect).await
        }
        YarpCommand::Rpc { port, name, carrier, admin } => ports::rpc(&network, &port, &name, carrier, admin).await,
        YarpCommand::Connect { from, to, word, carrier, persist } => match (from, to) {
            (Some(from), Some(to)) => names::connect(&network, &from, &to, carrier.or(word), persist.mode()).await,
            (from, _) => names::subscriptions(&network, from.as_deref()).await,
        },
        YarpCommand::Disconnect { from, to, persist } => names::disconnect(&network, &from, &to, persist).await,
        YarpCommand::Clean => names::clean(&network).await,
    }
}

/// The network of the arguments and the user's configuration.
async fn network(args: &YarpArgs) -> Result<Network, Failure> {
    let env = Env::real();
    let network = match &args.server {
        Some(address) => env.apply(network_at(address)?).map_err(because)?,
        None => Network::from_env().map_err(|e| match e {
            NetworkConfigError::Missing(_) => because(format!("{e}")),
            e => because(e),
        })?,
    };
    let (host, port) = network.server();
    let away = !(host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback()));
    let bind = match args.ip {
        Some(ip) => ip,
        // other programs must reach the ports that we open
        None if away && network.bind().is_loopback() => local_address(Some((host, port))).await,
        None => network.bind(),
    };
    Ok(network.with_bind(bind).with_timeout(seconds(args.timeout, "--timeout")?))
}

/// Carriers between two other programs.
const FOREIGN: &[&str] =
    &["mcast", "shmem", "unix_stream", "mjpeg", "h264", "mpi", "bcast", "human", "xmlrpc", "tcpros", "rossrv"];

/// Checks a carrier between two other programs: any of YARP's, also with modifiers (`tcp+recv.portmonitor+type.lua`).
fn between_others(text: &str) -> Result<String, String> {
    let base = text.split('+').next().unwrap_or_default();
    if !text.chars().all(|c| c.is_ascii_graphic()) {
        return Err("a carrier is a word".into());
    }
    match base.parse::<Carrier>() {
        Err(e) if !FOREIGN.contains(&base) => Err(format!("{e}; between other programs also {}", FOREIGN.join(", "))),
        _ => Ok(text.into()),
    }
}

fn seconds(number: f64, option: &str) -> Result<Duration, Failure> {
    let limit = Duration::try_from_secs_f64(number).ok().filter(|t| !t.is_zero());
    limit.ok_or_else(|| because(format!("{option} takes seconds above 0")))
}

fn network_at(address: &str) -> Result<Network, Failure> {
    address.parse().map_err(|e| because(format!("--server {e}")))
}
