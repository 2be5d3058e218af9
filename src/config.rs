//! The configuration file: robots, world, controllers, agents and what happens, in one TOML file.
//!
//! ```text
//! text ──Source (values + places)──> Config (typed) ──compose──> Setup (everything built and checked)
//! ```
//! Nothing is started before all of it has been read, built and checked.

mod error;
mod source;

pub use error::ConfigError;
pub use source::Source;

use mobee_actors::clock::ClockKind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// A whole configuration.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Name of the run; its folder is called after it. Default: the file's name.
    #[serde(default)]
    pub name: String,
    /// The seed of everything random.
    #[serde(default = "one")]
    pub seed: u64,
    /// `virtual` (as fast as the machine allows) or `real`.
    #[serde(default)]
    pub clock: Clock,
    /// Ends the run after this many seconds on the run's own clock; absent: when the agents are done.
    #[serde(default)]
    pub for_s: Option<f64>,
    /// The world around the robots.
    #[serde(default)]
    pub world: World,
    /// The robots.
    pub robot: Vec<Robot>,
    /// What happens to the world while the robots move.
    #[serde(default)]
    pub script: Vec<Step>,
    /// The recording.
    #[serde(default)]
    pub record: Record,
    /// MoBeE's own YARP ports: the port filter, the world's RPC. Absent: none are opened.
    #[serde(default)]
    pub yarp: Option<mobee_drivers::YarpSettings>,
}

/// How time passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
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

/// One robot: its model, what drives it, what keeps it safe, and who plans for it.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Its name in this run, unique.
    pub name: String,
    /// Robot XML, relative to this file.
    pub model: PathBuf,
    /// Where its root frame stands in the world.
    #[serde(default)]
    pub base: Base,
    /// `kind` and settings of the driver; see `mobee kinds`.
    #[serde(default = "sim")]
    pub driver: Value,
    /// The controller.
    pub controller: Controller,
    /// `kind` and settings of the agent; see `mobee kinds`. Absent: nobody plans.
    #[serde(default)]
    pub agent: Option<Value>,
}

/// A pose in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Base {
    /// Position, metres.
    pub position_m: [f64; 3],
    /// Turn about the vertical, degrees.
    pub yaw_deg: f64,
}

/// History, Supervise and Reflex of one robot. Two settings are required; the others have defaults.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Controller {
    /// Control period, milliseconds.
    pub period_ms: f64,
    /// How many poses the history holds.
    pub history: usize,
    /// The reflex acts when anything comes nearer than this, millimetres.
    #[serde(default = "margin")]
    pub margin_mm: f64,
    /// A pose counts as reached within this, degrees per motor.
    #[serde(default = "tolerance")]
    pub tolerance_deg: f64,
}

/// Something that happens to the world.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// When.
    pub when: When,
    /// What.
    pub edit: EditStep,
}

/// When a step happens.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum When {
    /// At this many seconds of the run.
    AtS(f64),
    /// When this robot rests after this many outcomes.
    AfterOutcomes {
        /// The robot.
        robot: String,
        /// How many outcomes.
        count: u64,
    },
}

/// What happens to an object.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EditStep {
    /// The object's name.
    pub object: String,
    /// Its new class: `obstacle`, `target` or `ghost`.
    #[serde(default)]
    #[schemars(with = "Option<String>")]
    pub class: Option<mobee_model::ObjectClass>,
    /// Its new position, metres.
    #[serde(default)]
    pub position_m: Option<[f64; 3]>,
    /// Takes it out of the world.
    #[serde(default)]
    pub remove: bool,
}

/// The recording.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Record {
    /// Whether there is one.
    pub enabled: bool,
    /// Poses per second of the run's clock.
    pub poses_hz: f64,
}

impl Default for Record {
    fn default() -> Record {
        Record { enabled: true, poses_hz: 20.0 }
    }
}

/// What a run keeps of its configuration: the values, and the file that their paths are relative to.
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
fn margin() -> f64 {
    10.0
}
fn tolerance() -> f64 {
    0.1
}
fn sim() -> Value {
    serde_json::json!({ "kind": "sim" })
}

impl Config {
    /// Reads a file and applies overrides, later ones over earlier ones.
    ///
    /// # Errors
    /// The first complaint, with its place and remedy.
    pub fn load(path: &Path, overrides: &[String]) -> Result<(Config, Source), ConfigError> {
        let mut source = Source::read(path)?;
        for o in overrides {
            source.set(o)?;
        }
        let config = Config::from_source(&source)?;
        Ok((config, source))
    }

    /// Reads the resolved configuration that a run left in its folder.
    ///
    /// # Errors
    /// If it is not what a run writes.
    pub fn load_resolved(path: &Path) -> Result<(Config, Source), ConfigError> {
        let foreign = |what: String| {
            ConfigError::plain(format!("{}: {what}", path.display()), "give the folder of a run, as it was written")
        };
        let text = std::fs::read_to_string(path).map_err(|e| foreign(e.to_string()))?;
        let stored: Resolved = serde_json::from_str(&text).map_err(|e| foreign(e.to_string()))?;
        let source = Source::resolved(&stored.file, stored.config);
        Ok((Config::from_source(&source)?, source))
    }

    /// Understands parsed values.
    ///
    /// # Errors
    /// The first complaint, with its place and remedy.
    pub fn from_source(source: &Source) -> Result<Config, ConfigError> {
        let mut config: Config = serde_path_to_error::deserialize(&source.value).map_err(|e| {
            let message = e.inner().to_string();
            let help = did_you_mean(&message).unwrap_or_else(|| "see docs/configuration.md for every setting".into());
            source.error(&e.path().to_string(), message, help)
        })?;
        if config.name.is_empty() {
            config.name = source.path.file_stem().map_or("run".into(), |s| s.to_string_lossy().into_owned());
        }
        config.check(source)?;
        Ok(config)
    }

    /// What the types can't say.
    fn check(&self, source: &Source) -> Result<(), ConfigError> {
        let finite = |path: &str, x: f64, low: f64, high: f64, unit: &str| {
            if x >= low && x <= high {
                Ok(())
            } else {
                Err(source.error(path, format!("{x} {unit} is out of range"), format!("give {low} to {high} {unit}")))
            }
        };
        let yarp_robot = self.robot.iter().position(|r| r.driver["kind"] == "yarp");
        let real_only = yarp_robot.map(|i| format!("robot[{i}].driver")).or(self.yarp.as_ref().map(|_| "yarp".into()));
        if let Some(at) = real_only.filter(|_| self.clock == Clock::Virtual) {
            return Err(source.error(
                &at,
                "YARP runs by the wall clock, and this behavior's clock is virtual",
                "set clock = \"real\"",
            ));
        }
        if self.name.contains(['/', '\\']) || self.name.starts_with('.') {
            return Err(source.error(
                "name",
                "the name can't be part of a folder's name",
                "use letters, digits, - and _",
            ));
        }
        if self.robot.is_empty() {
            return Err(source.error(
                "robot",
                "there is no robot",
                "add a [[robot]] table with name, model and controller",
            ));
        }
        if let Some(secs) = self.for_s {
            finite("for_s", secs, 0.001, 1e7, "s")?;
        }
        finite("record.poses_hz", self.record.poses_hz, 0.1, 1000.0, "Hz")?;
        for (i, r) in self.robot.iter().enumerate() {
            let at = |key: &str| format!("robot[{i}].{key}");
            if self.robot.iter().take(i).any(|other| other.name == r.name) {
                return Err(source.error(
                    &at("name"),
                    format!("there are two robots `{}`", r.name),
                    "name one of them differently",
                ));
            }
            if r.name.is_empty() || !r.name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-') {
                return Err(source.error(&at("name"), "not a robot's name", "use letters, digits, - and _"));
            }
            finite(&at("controller.period_ms"), r.controller.period_ms, 1.0, 1000.0, "ms")?;
            finite(&at("controller.history"), r.controller.history as f64, 10.0, 1e7, "poses")?;
            finite(&at("controller.margin_mm"), r.controller.margin_mm, 0.0, 500.0, "mm")?;
            finite(&at("controller.tolerance_deg"), r.controller.tolerance_deg, 1e-3, 10.0, "deg")?;
            for (k, x) in r.base.position_m.iter().enumerate() {
                finite(&format!("robot[{i}].base.position_m[{k}]"), *x, -100.0, 100.0, "m")?;
            }
            finite(&at("base.yaw_deg"), r.base.yaw_deg, -360.0, 360.0, "deg")?;
        }
        for (i, s) in self.script.iter().enumerate() {
            match &s.when {
                When::AtS(t) => finite(&format!("script[{i}].when.at_s"), *t, 0.0, 1e7, "s")?,
                When::AfterOutcomes { robot, .. } if !self.robot.iter().any(|r| r.name == *robot) => {
                    let names: Vec<&str> = self.robot.iter().map(|r| r.name.as_str()).collect();
                    return Err(source.error(
                        &format!("script[{i}].when.after_outcomes.robot"),
                        format!("there is no robot `{robot}`"),
                        format!("the robots are: {}", names.join(", ")),
                    ));
                }
                When::AfterOutcomes { .. } => {}
            }
            if s.edit.class.is_none() && s.edit.position_m.is_none() && !s.edit.remove {
                return Err(source.error(
                    &format!("script[{i}].edit"),
                    "nothing happens here",
                    "give class, position_m or remove",
                ));
            }
        }
        Ok(())
    }

    /// The clock, in the actors' words.
    pub fn clock_kind(&self) -> ClockKind {
        if self.clock == Clock::Real { ClockKind::Real } else { ClockKind::Virtual }
    }

    /// A path of the configuration, seen from where the file stands.
    pub fn beside(source: &Source, path: &Path) -> PathBuf {
        source.path.parent().map_or_else(|| path.to_owned(), |dir| dir.join(path))
    }
}

/// The nearest of the names that serde says it expected, as a remedy.
pub fn did_you_mean(message: &str) -> Option<String> {
    let (wrong, rest) = message
        .strip_prefix("unknown field `")
        .or_else(|| message.strip_prefix("unknown variant `"))?
        .split_once('`')?;
    let names: Vec<&str> = rest.split('`').skip(1).step_by(2).collect();
    Some(nearest(wrong, &names).map_or_else(
        || format!("known here: {}", names.join(", ")),
        |n| format!("did you mean `{n}`? known here: {}", names.join(", ")),
    ))
}

/// The name that is nearest to `wrong` in spelling, if any is near.
pub fn nearest<'a>(wrong: &str, names: &[&'a str]) -> Option<&'a str> {
    names
        .iter()
        .map(|n| (if n.starts_with(wrong) || wrong.starts_with(n) { 1 } else { distance(wrong, n) }, *n))
        .filter(|(d, n)| *d <= 1 + n.len() / 3)
        .min_by_key(|(d, _)| *d)
        .map(|(_, n)| n)
}

/// Levenshtein distance.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = i;
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let next = (diagonal + usize::from(x != *y)).min(row[j] + 1).min(row[j + 1] + 1);
            diagonal = row[j + 1];
            row[j + 1] = next;
        }
    }
    row[b.len()]
}
