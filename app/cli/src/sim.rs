//! `mobee sim`: serves simulated robots as YARP devices, for other programs and for our own driver in another process.

mod cameras;

use crate::signals::Interrupt;
use miette::Report;
use mobee_compose::config::{Config, ConfigError, RobotConfig, Source};
use mobee_compose::{compose, derive_seed, driver_of};
use mobee_contract::Context;
use mobee_driver_yarp::{SimBoard, SimClock};
use mobee_sim::{SIM, SimSettings};
use mobee_yarp::board::BoardServer;
use mobee_yarp::config::{self, Env};
use mobee_yarp::{NameServer, Network};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The arguments of `mobee sim`.
#[derive(clap::Args)]
pub struct SimArgs {
    /// A configuration file whose robots have drivers of kind `sim`, such as configs/behaviors/explore.toml; the images
    /// of its simulated cameras, with objects moved by its script, are at PREFIX/cam/EYE
    file: PathBuf,
    /// Prefix of the port names (one robot only); default: `/NAMESim` for a robot called NAME.
    #[arg(long)]
    prefix: Option<String>,
    /// Ratio of simulated to real time.
    #[arg(long, default_value_t = 1.0)]
    speed: f64,
    /// The name server, HOST:PORT; default: from YARP's own configuration. If this machine has none, one is started.
    #[arg(long, value_name = "HOST:PORT")]
    server: Option<Network>,
    /// Override a setting: --set robot.icub.driver.latency_ms=5
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Serves the robots of a file, and the images of their simulated cameras, until Ctrl-C.
///
/// # Errors
/// Complaints about the configuration or the network, before any port is opened.
pub fn command(args: &SimArgs) -> Result<(), Report> {
    if !(args.speed > 0.0 && args.speed <= 1000.0) {
        return Err(
            ConfigError::plain(format!("{} is not a speed", args.speed), "give a number above 0, up to 1000").into()
        );
    }
    let simulated = ServedRobots::load(args)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|e| ConfigError::plain(format!("no runtime: {e}"), "free some resources"))?;
    runtime.block_on(serve(args, simulated))
}

/// The served devices.
struct ServedRobots {
    /// Devices by the first part of their port names.
    boards: Vec<(String, Arc<SimBoard>)>,
    cameras: Vec<cameras::ServedCamera>,
    clock: SimClock,
}

impl ServedRobots {
    fn load(args: &SimArgs) -> Result<ServedRobots, Report> {
        let (config, source) = Config::load(&args.file, &args.set)?;
        if args.prefix.is_some() && config.robot.len() > 1 {
            let help = "leave --prefix out; every robot then has its own";
            return Err(ConfigError::plain("one prefix for several robots", help).into());
        }
        let prefix = |robot: &str| args.prefix.clone().unwrap_or_else(|| format!("/{robot}Sim"));
        let clock = SimClock::start(args.speed, wall());
        let mut all = Vec::new();
        let mut by_robot = Vec::new();
        let mut arms = false;
        for (i, robot) in config.robot.iter().enumerate() {
            let prefix = prefix(&robot.name);
            let model = Config::beside(&source, &robot.model);
            let model = mobee_model::load_robot(&model)?.value;
            let seed = derive_seed(config.seed, &format!("{}/driver", robot.name));
            let at = format!("robot[{i}].driver");
            let settings = settings(robot, &at, &source)?;
            arms |= settings.arm().is_some();
            let context = Context { robot: Arc::new(model), seed };
            let boards = SimBoard::all(&settings, &context, clock)
                .map_err(|e| source.error(&format!("{at}.{}", e.path), e.what.clone(), e.help.clone()))?;
            let boards: cameras::RobotBoards = boards.into_iter().map(Arc::new).collect();
            all.extend(boards.iter().map(|b| (format!("{prefix}/{}", b.part()), b.clone())));
            by_robot.push(boards);
        }
        if arms {
            place(&by_robot, &config, &source)?;
        }
        let cameras = cameras::cameras(&config, &source, prefix, &by_robot, clock)?;
        Ok(ServedRobots { boards: all, cameras, clock })
    }
}

/// Gives the arms gravity and objects to touch.
fn place(robots: &[cameras::RobotBoards], config: &Config, source: &Source) -> Result<(), Report> {
    let scene = compose(cameras::bare(config), source)?.scene;
    for (i, boards) in robots.iter().enumerate() {
        // all boards of an arm share it, and kinematic joints touch nothing
        if let Some(board) = boards.first() {
            let at = format!("robot[{i}].driver");
            board.place(&scene, i).map_err(|e| source.error(&format!("{at}.{}", e.path), e.what, e.help))?;
        }
    }
    Ok(())
}

fn settings(robot: &RobotConfig, at: &str, source: &Source) -> Result<SimSettings, ConfigError> {
    let (kind, settings) = driver_of(source, at, &robot.driver)?;
    if kind != SIM {
        let what = format!("robot {} has a driver of kind `{kind}`: there is nothing to simulate", robot.name);
        return Err(source.error(&format!("{at}.kind"), what, "give a file whose robots have drivers of kind `sim`"));
    }
    mobee_contract::settings(&settings).map_err(|e| source.error(&format!("{at}.{}", e.path), e.what, e.help))
}

async fn serve(args: &SimArgs, simulated: ServedRobots) -> Result<(), Report> {
    let ServedRobots { boards, cameras, clock } = simulated;
    let (network, server) = network(args.server.clone()).await?;
    let mut open = Vec::new();
    for (prefix, board) in boards {
        let period = board.publishes();
        let opened = BoardServer::open(&network, &prefix, board, period).await;
        open.push(opened.map_err(|e| ConfigError::plain(e.to_string(), "end the program that holds it, or wait"))?);
        println!("{prefix}");
    }
    let mut cameras = cameras::serve(&network, cameras, clock, args.speed).await?;
    let (host, port) = network.server();
    let whose = if server.is_some() { "our own" } else { "the" };
    let eyes = if cameras.is_empty() { String::new() } else { format!(" and {} cameras", cameras.len()) };
    println!("{} boards{eyes} at {whose} name server {host}:{port}; Ctrl-C ends", open.len());
    Interrupt::new().wait().await;
    // their ports unregister as they are dropped
    cameras.shutdown().await;
    for board in open {
        board.close().await;
    }
    if let Some(server) = server {
        server.close().await;
    }
    Ok(())
}

/// The network to serve on, with a name server of our own if none answers on this machine.
async fn network(server: Option<Network>) -> Result<(Network, Option<NameServer>), Report> {
    let network = match server {
        Some(network) => network,
        None => config::network_or_default(&Env::real())
            .map_err(|e| ConfigError::plain(e.to_string(), "fix yarp.conf, or give --server HOST:PORT"))?,
    };
    if network.query(network.namespace()).await.is_ok() {
        return Ok((network, None));
    }
    let own = NameServer::instead(&network, false).await.map_err(|e| {
        let (host, port) = network.server();
        let what = format!("no name server answers at {host}:{port}, and none can be started there: {e}");
        ConfigError::plain(what, "start it, or give --server HOST:PORT")
    })?;
    Ok((network, Some(own)))
}

/// Seconds since 1970.
#[expect(clippy::disallowed_methods, reason = "stamps of YARP tell the time of day")]
fn wall() -> f64 {
    std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

/// The ports of a file: a check that it can be served, for tests.
///
/// # Errors
/// As for [`command`].
pub fn ports(file: &Path) -> Result<Vec<String>, Report> {
    let args = SimArgs { file: file.to_owned(), prefix: None, speed: 1.0, server: None, set: Vec::new() };
    Ok(ServedRobots::load(&args)?.boards.into_iter().map(|(prefix, _)| prefix).collect())
}
