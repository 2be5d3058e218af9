//! Finding the control port of a run: by its folder, or by its name on a YARP network.

use super::{CtlArgs, FILE, PORT};
use crate::config::ConfigError;
use mobee_yarp::{Carrier, Contact, Network, PortOptions, RpcClient};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How long an answer may take: a swap is built and checked meanwhile.
const PATIENCE: Duration = Duration::from_secs(60);

/// A connection to the run that the arguments mean.
pub(super) async fn connect(args: &CtlArgs) -> Result<RpcClient, ConfigError> {
    let (network, to, help) = match &args.port {
        Some(port) => {
            let network = Network::from_env()
                .map_err(|e| ConfigError::plain(e.to_string(), "give --run DIR instead, which needs no name server"))?;
            (network, Contact::parse(port), "see `mobee yarp list` for the ports there are".to_owned())
        }
        None => {
            let folder = args.run.clone().map_or_else(newest, Ok)?;
            let address = address(&folder)?;
            let host = address.ip().to_string();
            let help = format!("the run {} is not running any more; give another with --run", folder.display());
            (Network::at(address), Contact::new(PORT, "tcp", &host, address.port()), help)
        }
    };
    let network = network.with_timeout(Duration::from_secs(5));
    let client = RpcClient::connect_to(&network, "/mobee/ctl", to, Carrier::Tcp, PortOptions::default()).await;
    Ok(client.map_err(|e| ConfigError::plain(e.to_string(), help))?.with_timeout(PATIENCE))
}

/// What the run wrote into its folder.
fn address(folder: &Path) -> Result<SocketAddr, ConfigError> {
    let file = folder.join(FILE);
    let text = std::fs::read_to_string(&file).map_err(|e| {
        ConfigError::plain(
            format!("{}: {e}", file.display()),
            "a run can be controlled while it runs with clock = \"real\", and without --ctl off",
        )
    })?;
    text.trim().parse().map_err(|_| {
        ConfigError::plain(format!("{}: there is no address in it", file.display()), "give the folder of a run")
    })
}

/// The run in runs/ that wrote its address last.
fn newest() -> Result<PathBuf, ConfigError> {
    let folders = std::fs::read_dir("runs").into_iter().flatten().flatten().map(|e| e.path());
    let dated = |folder: PathBuf| Some((folder.join(FILE).metadata().ok()?.modified().ok()?, folder));
    let newest = folders.filter_map(dated).max();
    newest.map(|(_, folder)| folder).ok_or_else(|| {
        ConfigError::plain(
            "no run in runs/ can be controlled",
            "start one with `mobee run --clock real FILE`, or give its folder with --run",
        )
    })
}
