//! The configuration file: robots, world, controllers, agents and script, in one TOML file.
//!
//! ```text
//! text ──Source (values + places)──> Config (typed) ──compose──> Setup (everything built and checked)
//! ```
//! Everything is read, built and checked before anything is started.

mod check;
mod complaints;
mod controller;
#[cfg(feature = "miette")]
mod diagnostic;
mod difference;
mod error;
mod files;
mod include;
mod layer;
mod rest;
mod sensor;
mod shape;
pub mod show;
mod source;
mod spelling;

pub use complaints::{Complaint, Complaints};
pub use controller::{Controller, schema as controller_schema};
pub use difference::{Difference, differences};
pub use error::ConfigError;
pub use files::{KindTable, PathSetting, maps, paths};
pub use mobee_contract::{nearest, suggestion};
pub use rest::{RestConfig, RestTable};
pub use sensor::{EyeConfig, SensorConfig, WorldGateConfig};
pub use shape::{Misfit, misfits};
pub use source::Source;
pub use spelling::did_you_mean;

use check::Checks;
use mobee_bridge_yarp::{YarpServices, YarpSettings};
use mobee_model::file::{MIB, read_text};
use mobee_runtime::clock::ClockKind;
use mobee_sim::SIM;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// Maximum size of the resolved configuration in a run's folder, bytes.
const MAX_RESOLVED_BYTES: u64 = 16 * MIB;

/// A whole configuration.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Files whose settings this file overrides; paths are relative to this file.
    #[serde(default, skip_serializing)]
    pub include: Vec<PathBuf>,
    /// Name of the run and of its folder. Default: the file's name.
    #[serde(default)]
    pub name: String,
    /// The seed of all randomness.
    #[serde(default = "one")]
    pub seed: u64,
    /// `virtual` (as fast as the machine allows) or `real`.
    #[serde(default)]
    pub clock: ClockMode,
    /// Ends the run after this many seconds on the run's clock; default: when the agents are done.
    #[serde(default)]
    pub for_s: Option<f64>,
    /// The world around the robots.
    #[serde(default)]
    pub world: World,
    /// The robots.
    pub robot: Vec<RobotConfig>,
    /// Sensors: cameras, detectors and locators.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sensor: Vec<SensorConfig>,
    /// Changes to the world while the robots move.
    #[serde(default)]
    pub script: Vec<StepConfig>,
    /// The recording.
    #[serde(default)]
    pub record: Record,
    /// MoBeE's own YARP ports: the port filter, the world RPC. Absent: none are opened.
    #[serde(default)]
    pub yarp: Option<YarpSettings>,
    /// Bridges to external programs: `kind` and settings of each; see `mobee kinds`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bridge: Vec<Value>,
    /// Requirements of `mobee torture` for this behavior beside the invariants.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub torture: Option<Torture>,
}

/// The result that a `mobee torture` battery must reach.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Torture {
    /// Maximum share of commits that may end as faulted, percent, over fifty or more seeds of the usual faults. Escapes, which have
    /// no retreat, and commits cut off by the end of a run don't count.
    pub faulted_percent: f64,
}

/// The run's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ClockMode {
    /// As fast as the machine allows, and equal for equal seeds.
    #[default]
    Virtual,
    /// By the wall clock.
    Real,
}

/// The world's file.
#[derive(Clone, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct World {
    /// World XML, relative to this file.
    #[serde(default)]
    pub file: Option<PathBuf>,
}

/// One robot: its model, driver, controller and agent.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Robot")]
pub struct RobotConfig {
    /// Its name in this run, unique.
    pub name: String,
    /// Robot XML, relative to this file.
    pub model: PathBuf,
    /// Pose of its root frame in the world.
    #[serde(default)]
    pub base: Base,
    /// `kind` and settings of the driver; see `mobee kinds`.
    #[serde(default = "default_driver")]
    pub driver: Value,
    /// The controller: `kind` (default: `rollback`), what all kinds have, and the kind's settings; see `mobee kinds`.
    pub controller: Controller,
    /// `kind` and settings of the agent; see `mobee kinds`. Absent: no agent.
    #[serde(default)]
    pub agent: Option<Value>,
    /// Rest pose, to which the robot moves at the end of the run, over edges that are certified free, under the reflex:
    /// `home` (from the robot's file), the name of a pose of its agent, or a table with `pose` or `q_deg`, and `speed`
    /// and `within_s`. Absent: the robot stops where it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<RestConfig>,
}

/// A pose in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Base {
    /// Position, meters.
    pub position_m: [f64; 3],
    /// Rotation about the vertical, degrees.
    pub yaw_deg: f64,
}

/// A change to the world.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StepConfig {
    /// The trigger.
    pub when: StepTrigger,
    /// The change.
    pub edit: EditStep,
}

/// The trigger of a step.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum StepTrigger {
    /// At this many seconds of the run.
    AtS(f64),
    /// At this robot's rest after this many outcomes.
    AfterOutcomes {
        /// The robot.
        robot: String,
        /// Number of outcomes.
        count: u64,
    },
}

/// A change to an object.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EditStep {
    /// The object's name.
    pub object: String,
    /// Its new class: `obstacle`, `target` or `ghost`; the original's words `obs`, `tgt` and `gho` mean the same.
    #[serde(default)]
    #[schemars(with = "Option<String>", extend("enum" = ["obstacle", "target", "ghost", "obs", "tgt", "gho", null]))]
    pub class: Option<mobee_model::ObjectClass>,
    /// Its new position, meters.
    #[serde(default)]
    pub position_m: Option<[f64; 3]>,
    /// Removes it from the world.
    #[serde(default)]
    pub remove: bool,
}

/// The recording.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Record {
    /// True: make a recording.
    pub enabled: bool,
    /// Poses per second of the run's clock.
    pub poses_hz: f64,
    /// Address of a Rerun viewer that follows the run, such as `127.0.0.1:9876`; for runs with a real clock.
    pub live: Option<SocketAddr>,
}

impl Default for Record {
    fn default() -> Record {
        Record { enabled: true, poses_hz: 20.0, live: None }
    }
}

/// The configuration as a run stores it: the values, and the file that their paths are relative to.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Resolved {
    /// The configuration file.
    pub file: PathBuf,
    /// All values.
    pub config: Value,
}

fn one() -> u64 {
    1
}
fn default_driver() -> Value {
    serde_json::json!({ "kind": SIM })
}

/// The driver that replaces a robot's own: kinematic joints.
pub fn simulated() -> Value {
    serde_json::json!({ "kind": SIM, "profile": "ideal" })
}

impl RobotConfig {
    /// The kind of its driver; empty if the file does not name it correctly.
    pub fn driver_kind(&self) -> &str {
        self.driver.get("kind").and_then(Value::as_str).unwrap_or_default()
    }

    /// Replaces its driver with a simulated one, unless it is simulated already; the board stays untouched.
    pub fn simulate(&mut self) {
        if self.driver_kind() != SIM {
            self.driver = simulated();
        }
    }
}

impl Config {
    /// Reads a file with its layers: included files, the environment, and overrides. Later layers take precedence.
    ///
    /// # Errors
    /// Every complaint, with its place and remedy.
    pub fn load(path: &Path, overrides: &[String]) -> Result<(Config, Source), Complaints> {
        let source = Source::load(path, overrides)?;
        Ok((Config::from_source(&source)?, source))
    }

    /// Reads the resolved configuration in a run's folder.
    ///
    /// # Errors
    /// If a run did not write it.
    pub fn load_resolved(path: &Path) -> Result<(Config, Source), Complaints> {
        let foreign = |what: String| {
            ConfigError::plain(format!("{}: {what}", path.display()), "give the folder of a run, as it was written")
        };
        let text = read_text(path, MAX_RESOLVED_BYTES).map_err(|e| foreign(e.to_string()))?;
        let stored: Resolved = serde_json::from_str(&text).map_err(|e| foreign(e.to_string()))?;
        let source = Source::resolved(&stored.file, stored.config);
        Ok((Config::from_source(&source)?, source))
    }

    /// Converts parsed values into a configuration.
    ///
    /// # Errors
    /// Every complaint, with its place and remedy.
    pub fn from_source(source: &Source) -> Result<Config, Complaints> {
        let (config, wrong) = Config::partly(source)?;
        wrong.none_or(config)
    }

    /// Converts as many values as possible, so that much can be checked at once: returns a configuration without the
    /// tables of the wrong shape, and the complaints so far.
    ///
    /// # Errors
    /// The complaints, if too little is left.
    pub fn partly(source: &Source) -> Result<(Config, Complaints), Complaints> {
        let mut wrong = Complaints::default();
        let mut value = source.value.clone();
        for m in shape::misfits(crate::schema::whole(), &source.value) {
            remove_misfit(&mut value, &m);
            if wrong.is_full() {
                continue;
            }
            wrong.push(source.complain(&m.steps, m.at_key, m.what, m.help));
        }
        let mut config: Config = match serde_path_to_error::deserialize(&value) {
            Ok(config) => config,
            Err(_) if !wrong.is_empty() => return Err(wrong),
            Err(e) => {
                let message = e.inner().to_string();
                let address =
                    message.contains("socket address").then(|| "give ADDRESS:PORT, such as 127.0.0.1:10000".to_owned());
                let help = did_you_mean(&message).or(address);
                let help = help.unwrap_or_else(|| "see docs/configuration.md for every setting".into());
                return Err(source.error(&e.path().to_string(), message, help).into());
            }
        };
        config.resolve(source);
        wrong.append(config.check(source));
        Ok((config, wrong))
    }

    /// Names the run, and makes paths that stand in included files relative to the main file.
    fn resolve(&mut self, source: &Source) {
        if self.name.is_empty() {
            self.name = source.path.file_stem().map_or("run".into(), |s| s.to_string_lossy().into_owned());
        }
        let relocate = |at: &str, path: &mut PathBuf| *path = source.relocated(at, path);
        if let Some(file) = &mut self.world.file {
            relocate("world.file", file);
        }
        for (i, r) in self.robot.iter_mut().enumerate() {
            relocate(&format!("robot[{i}].model"), &mut r.model);
        }
        if let Some(folder) = self.yarp.as_mut().and_then(|y| y.save_folder.as_mut()) {
            relocate("yarp.save_folder", folder);
        }
        self.relocate_kinds(source);
    }

    /// The clock as the actors' type.
    pub fn clock_kind(&self) -> ClockKind {
        if self.clock == ClockMode::Real { ClockKind::Real } else { ClockKind::Virtual }
    }

    /// The tables of all bridges, each with its place. The table `[yarp]` is a bridge of that kind.
    pub fn bridges(&self) -> impl Iterator<Item = (String, Value)> {
        let yarp = self.yarp.iter().filter_map(|yarp| {
            let mut table = serde_json::to_value(yarp).ok()?;
            table["kind"] = YarpServices::KIND.into();
            Some(("yarp".to_owned(), table))
        });
        yarp.chain(self.bridge.iter().enumerate().map(|(i, table)| (format!("bridge[{i}]"), table.clone())))
    }

    /// The settings of all YARP ports, each with the place of its table.
    pub fn yarp_ports(&self) -> impl Iterator<Item = (String, YarpSettings)> {
        self.bridges().filter_map(|(at, mut table)| {
            let kind = table.as_object_mut()?.remove("kind")?;
            if kind == YarpServices::KIND { Some((at, mobee_contract::settings(&table).ok()?)) } else { None }
        })
    }

    /// A path of the configuration, resolved against the file's folder.
    pub fn beside(source: &Source, path: &Path) -> PathBuf {
        source.path.parent().map_or_else(|| path.to_owned(), |dir| dir.join(path))
    }
}

/// Removes a table of the wrong shape, and the tables that could not be checked without it.
fn remove_misfit(value: &mut Value, m: &shape::Misfit) {
    let step = |i: usize| m.steps.get(i).map(String::as_str).unwrap_or_default();
    let out = |at: &mut Value, key: &str| drop(at.as_object_mut().map(|map| map.remove(key)));
    let robot = step(1).parse::<usize>().ok().filter(|_| step(0) == "robot");
    match (robot, step(2)) {
        (Some(i), "controller") if step(3) == "kind" => {
            if let Some(all) = value["robot"][i]["controller"].as_object_mut() {
                all.retain(|key, _| controller::SHARED.contains(&key.as_str()));
            }
        }
        (Some(i), "controller") if m.steps.len() > 3 && !controller::SHARED.contains(&step(3)) => {
            out(&mut value["robot"][i]["controller"], step(3));
        }
        (Some(i), key @ ("agent" | "driver" | "rest")) => out(&mut value["robot"][i], key),
        (Some(i), key) if m.at_key && m.steps.len() == 3 => out(&mut value["robot"][i], key),
        (Some(i), key) if m.at_key && m.steps.len() == 4 => out(&mut value["robot"][i][key], step(3)),
        (Some(_), _) => {}
        (None, _) => out(value, step(0)),
    }
    out(value, "script");
}
