//! Parts of a sensor in processes of their own, over YARP: `mobee detector run` and `mobee locator run`.
//!
//! ```text
//! image port ──> detector run ──regions──> locator run ──set OBJECT x y z──> the world of a `mobee run`
//!                     └──mask──> any viewer     └──<── states of the robot's boards
//! ```
//! Both use the configuration of a run, and one table `[[sensor]]` of it.

mod body;
pub(crate) mod detector_process;
pub(crate) mod locator_process;

use miette::Report;
use mobee_compose::config::{Config, ConfigError, Source};
use mobee_compose::{Composition, compose};
use mobee_runtime::system::SensorSetup;
use mobee_yarp::Network;
use mobee_yarp::config::{self, Env};
use std::collections::BTreeSet;
use std::net::IpAddr;
use std::path::PathBuf;
use std::time::Duration;

/// Pause before a retry.
const RETRY_DELAY: Duration = Duration::from_millis(500);

/// Arguments of both commands.
#[derive(clap::Args, Clone, Debug)]
pub struct RemoteSensorArgs {
    /// The configuration file with a table [[sensor]], such as configs/sensing/eyes-yarp.toml
    file: PathBuf,
    /// The sensor, if there are several.
    #[arg(long, value_name = "NAME")]
    sensor: Option<String>,
    /// Prefix of the names of our ports.
    #[arg(long, value_name = "PREFIX", default_value = "/MoBeE", value_parser = port_name)]
    prefix: String,
    /// The name server, HOST:PORT; default: from YARP's own configuration.
    #[arg(long, value_name = "HOST:PORT")]
    server: Option<Network>,
    /// The address of this machine on which our ports listen.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    listen: IpAddr,
    /// Override a setting: --set sensor.eyes.gate.stale_s=5
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

fn port_name(text: &str) -> Result<String, String> {
    let is_name = text.starts_with('/') && !text.ends_with('/') && !text.contains(char::is_whitespace);
    if is_name { Ok(text.into()) } else { Err("give a name that begins with /, such as /MoBeE".into()) }
}

/// A sensor of a configuration, with its composition and network.
struct RemoteSensor {
    config: Config,
    source: Source,
    /// Its index in the configuration.
    index: usize,
    composition: Composition,
    network: Network,
    /// Prefix of the names of its ports: the option's and the sensor's name.
    ports: String,
}

impl RemoteSensor {
    /// Reads the file, and builds its parts; opens and queries nothing.
    ///
    /// # Errors
    /// Every complaint about the configuration, with its place and remedy.
    fn load(args: &RemoteSensorArgs) -> Result<RemoteSensor, Report> {
        let (mut config, source) = Config::load(&args.file, &args.set)?;
        let index = config.sensor_called(args.sensor.as_deref(), &args.file)?;
        // these belong to the run
        (config.yarp, config.script) = (None, Vec::new());
        config.bridge.clear();
        config.robot.iter_mut().for_each(|robot| robot.agent = None);
        let composition = compose(config.clone(), &source)?;
        let network = match &args.server {
            Some(network) => network.clone(),
            None => config::network_or_default(&Env::real())
                .map_err(|e| ConfigError::plain(e.to_string(), "mend yarp.conf, or give --server HOST:PORT"))?,
        };
        let network = network.with_bind(args.listen);
        let name = config.sensor.get(index).map(|s| s.name.clone()).unwrap_or_default();
        let ports = format!("{}/{name}", args.prefix);
        Ok(RemoteSensor { config, source, index, composition, network, ports })
    }

    /// Takes the built sensor.
    fn sensor(&mut self) -> Result<SensorSetup, Report> {
        let at = self.index;
        if at < self.composition.sensors.len() {
            return Ok(self.composition.sensors.swap_remove(at));
        }
        Err(Report::msg("the sensor could not be built"))
    }

    /// Checks that the name server answers.
    ///
    /// # Errors
    /// If it does not, with the remedy.
    async fn reach(&self) -> Result<(), ConfigError> {
        let answer = self.network.query(self.network.namespace()).await;
        answer.map(drop).map_err(|e| {
            let (host, port) = self.network.server();
            let help = "start one (`mobee yarp server`), or give --server HOST:PORT";
            ConfigError::plain(format!("the name server at {host}:{port} does not answer: {e}"), help)
        })
    }
}

/// Warnings on standard error; each is printed once.
#[derive(Default)]
struct WarnOnce(BTreeSet<String>);

impl WarnOnce {
    fn warn(&mut self, text: impl Into<String>) {
        let text = text.into();
        // bounded, in case that warnings contain changing numbers
        if self.0.len() < 100 && self.0.insert(text.clone()) {
            eprintln!("warning: {}", mobee_model::printable(&text));
        }
    }
}
