//! `mobee ctl`: inspect a running `mobee run`, swap its parts, pause it, stop it.
//!
//! ```text
//! mobee ctl ──RUN/ctl.sock (JSON lines)──> a service of the run ──Control──> the system
//! ```
//! The run's own user and root may request anything, other users nothing. `mobee ctl` reads the files; the run opens
//! none on request.

mod client;
mod config_payload;
mod connection;
mod handler;
mod listener;
mod operate;
mod restart;
mod service;
mod show;
pub(crate) mod swap_offer;
mod wire;

pub(crate) use handler::BesideNames;
pub use service::CtlService;
pub(crate) use service::{CtlPort, StopConnections};

use clap::{Args, Subcommand};
use miette::Report;
use mobee_compose::config::{Config, ConfigError, Source};
use mobee_sensing::locators::file::LocatorKind;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tokio::runtime::Runtime;

/// The arguments of `mobee ctl`.
#[derive(Args)]
pub struct CtlArgs {
    /// The run's folder; default: the newest one in runs/ that can be controlled.
    #[arg(long, global = true, value_name = "DIR")]
    run: Option<PathBuf>,
    /// Instead of the folder, the address of a run on another computer that was started with --ctl ADDRESS:PORT; needs --key.
    #[arg(long, global = true, value_name = "HOST:PORT", conflicts_with = "run", requires = "key")]
    at: Option<String>,
    /// A copy of the file ctl.tcp from that run's folder.
    #[arg(long, global = true, value_name = "FILE", requires = "at")]
    key: Option<PathBuf>,
    #[command(subcommand)]
    command: CtlCommand,
}

#[derive(Subcommand)]
enum CtlCommand {
    /// Show each robot's state in one line, then the tree of actors with restarts, queues, rates and drops.
    Status,
    /// Show the same live, once a second, until Ctrl-C; on a terminal, in place.
    Top {
        /// End after this many updates.
        #[arg(long, value_name = "N")]
        times: Option<u64>,
    },
    /// Replace a part of a running robot, a bridge, a detector or a locator with the one from another configuration file.
    Swap(SwapArgs),
    /// Pause the robots' own agents (motions under way end first).
    Pause(OfRobot),
    /// Resume paused agents.
    Resume(OfRobot),
    /// Stop robots now and hold them, until `release`: the motion under way ends with an outcome, a retreat stops where it is, the run goes on.
    Halt(OfRobot),
    /// Let halted robots act again.
    Release(OfRobot),
    /// Retry a failed retreat.
    Recover(OfRobot),
    /// Show the positions of motors (degrees, or millimeters) and markers of robots.
    Pose(OfRobot),
    /// Move motors of a robot whose agent is paused, in a transaction under the reflex, and wait for the outcome. Exit code 0: reached.
    Go {
        /// Motors and positions in degrees, or millimeters for prismatic joints: r_elbow=60.
        #[arg(required = true, value_name = "MOTOR=DEG")]
        motors: Vec<String>,
        /// The robot; required if there are several.
        #[arg(long)]
        robot: Option<String>,
        /// Share of each motor's maximum speed.
        #[arg(long, value_name = "SHARE", default_value_t = 0.2)]
        speed: f64,
    },
    /// Restart a sensor or a bridge: one that runs, or one that has used up its restarts.
    Restart {
        /// The sensor or bridge, as `mobee ctl status` names it; required if there are several.
        name: Option<String>,
    },
    /// Move a robot whose agent is paused home, straight, in a transaction under the reflex, and wait for the outcome.
    Home {
        #[command(flatten)]
        of: OfRobot,
        /// Share of each motor's maximum speed.
        #[arg(long, value_name = "SHARE", default_value_t = 0.2)]
        speed: f64,
    },
    /// Show the newest events as sentences.
    Log {
        /// Follow the events until Ctrl-C or the end of the run.
        #[arg(short, long)]
        follow: bool,
        /// Number of events.
        #[arg(short = 'n', long = "lines", value_name = "N", default_value_t = 20)]
        lines: u32,
    },
    /// Shut down in order: motions stop, and every commit gets its outcome. Returns when the run is over.
    Stop {
        /// Without waiting for rest.
        #[arg(long)]
        now: bool,
    },
    /// Send a request to the world, such as `mk ssph 0.05 0.3 0 0.5`, `ls`, `rm ssph 1`, `help`.
    World {
        /// The request.
        #[arg(required = true, trailing_var_arg = true, allow_hyphen_values = true)]
        words: Vec<String>,
    },
    /// Turn the recording `on` or `off` (the journal is always written), or `connect` a Rerun viewer that follows the
    /// run.
    Record {
        /// `on`, `off` or `connect`.
        what: String,
        /// Address of the viewer, as seen from the run; default: 127.0.0.1:9876.
        #[arg(value_name = "ADDRESS:PORT")]
        address: Option<String>,
    },
}

/// The robot that a request is for.
#[derive(Args)]
struct OfRobot {
    /// Only this robot.
    #[arg(value_name = "ROBOT")]
    robot: Option<String>,
    /// The same as an option.
    #[arg(long = "robot", value_name = "ROBOT", conflicts_with = "robot")]
    named: Option<String>,
}

impl OfRobot {
    fn name(self) -> Option<String> {
        self.robot.or(self.named)
    }
}

#[derive(Args)]
struct SwapArgs {
    /// The part to swap: `agent`, `controller`, `driver`, `bridge`, `detector` or `locator`.
    part: String,
    /// The configuration file that contains the new part. It may `include` the running one.
    file: PathBuf,
    /// The robot; required if there are several.
    #[arg(long)]
    robot: Option<String>,
    /// The bridge, as `mobee ctl status` names it; required if there are several.
    #[arg(long)]
    bridge: Option<String>,
    /// The sensor whose detectors or locator are swapped, or for a detector one camera of it as SENSOR/CAMERA; required if there are several sensors.
    #[arg(long)]
    sensor: Option<String>,
    /// Seconds for which a new agent or detector only observes; the journal records its intents or its detections.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    shadow: f64,
    /// Seconds after the takeover during which the old part returns if the new one fails.
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    probation: f64,
    /// Time limit for an answer of the new part during its probation, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0)]
    budget: f64,
    /// Start without the state of the old agent, detector or locator: for an agent of another kind.
    #[arg(long)]
    fresh: bool,
    /// Return once the part is built and checked, without waiting for the end of its probation.
    #[arg(long)]
    no_wait: bool,
}

/// Runs `mobee ctl ...`.
///
/// # Errors
/// If the run can't be found or reached, or refuses the request, with its reason.
pub fn command(args: CtlArgs) -> Result<ExitCode, Report> {
    runtime()?.block_on(client::run(args))
}

fn runtime() -> Result<Runtime, Report> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.map_err(|e| Report::msg(format!("no asynchronous runtime: {e}")))
}

/// Swaps a trained locator into a sensor of a running run, and waits until the swap has settled. Other settings of a
/// trained locator's table stay.
///
/// # Arguments
/// * `run`: the run's folder.
/// * `sensor`: the sensor's name; `None` for the only one.
/// * `learned`: the locator's kind and file.
/// * `probation`: time during which the old one may return, seconds.
///
/// # Errors
/// If the run can't be reached, has no such sensor, or retains its locator, with the reason.
pub(crate) fn put_locator(
    run: &Path,
    sensor: Option<&str>,
    (kind, file): (LocatorKind, &Path),
    probation: f64,
) -> Result<(), Report> {
    let (config, source) = Config::load_resolved(&run.join("config.json"))?;
    let index = config.sensor_called(sensor, run)?;
    let name = config.sensor.get(index).map(|s| s.name.clone()).unwrap_or_default();
    let mut value = source.value.clone();
    let locator = value.get_mut("sensor").and_then(|s| s.get_mut(index)).and_then(|s| s.get_mut("locator"));
    let Some(Value::Object(locator)) = locator else {
        let what = format!("the sensor {name} of {} has no locator that another could take over from", run.display());
        let help = "start the run with a table [sensor.locator], as configs/behaviors/collect.toml has it";
        return Err(ConfigError::plain(what, help).into());
    };
    if !LocatorKind::ALL.iter().any(|k| locator.get("kind").is_some_and(|kind| kind == k.name())) {
        locator.clear();
    }
    let file = file.canonicalize().unwrap_or_else(|_| file.to_owned());
    locator.insert("kind".into(), kind.name().into());
    locator.insert("file".into(), file.to_string_lossy().into());
    let offer = config_payload::of(source.path.clone(), &Source::resolved(&source.path, value))?;
    Ok(runtime()?.block_on(client::put_locator(run, &name, offer, probation))?)
}
