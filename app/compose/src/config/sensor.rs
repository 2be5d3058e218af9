//! The tables `[[sensor]]`: cameras, detectors and locators.

use super::{Checks, Config, ConfigError, suggestion};
use mobee_contract::{DEFAULT_MAX_REGIONS, MAX_REGIONS};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// A sensor: cameras, a detector behind each of them, and a locator that estimates the positions of detected objects.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Sensor")]
pub struct SensorConfig {
    /// Its name in this run, unique among sensors and robots.
    pub name: String,
    /// The robot that carries the cameras; default: the only one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// Its cameras, each with its detector.
    pub eye: Vec<EyeConfig>,
    /// True: the run stores every frame that its detectors process in files of its folder, for cameras of the kind
    /// `recorded`, and for `mobee locator collect --images`.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keep_frames: bool,
    /// `kind` and settings of the locator; see `mobee kinds`. Absent: detections are recorded, but not located.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub locator: Option<Value>,
    /// The filter of positions for the model. Absent: the sensor does not change the model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gate: Option<WorldGateConfig>,
}

/// A camera and its detector.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Eye")]
pub struct EyeConfig {
    /// Its name, unique in its sensor.
    pub name: String,
    /// `kind` and settings of the camera; see `mobee kinds`.
    pub camera: Value,
    /// `kind` and settings of the detector; see `mobee kinds`.
    pub detector: Value,
    /// Maximum number of regions per object and image, 1 to 256: the detector's first ones are reported, further ones
    /// counted.
    #[serde(default = "max_regions", skip_serializing_if = "is_default_max_regions")]
    pub max_regions: usize,
}

fn max_regions() -> usize {
    DEFAULT_MAX_REGIONS
}
fn is_default_max_regions(n: &usize) -> bool {
    *n == DEFAULT_MAX_REGIONS
}

/// The world gate: the changes that a sensor may make to the model.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "WorldGate")]
pub struct WorldGateConfig {
    /// The objects that it tracks, by their names in the world. If its cameras are simulated, scripts and programs move
    /// these objects in the ground truth only, and the model is updated by this sensor.
    pub objects: Vec<String>,
    /// Minimum and maximum coordinates of an accepted position, in the world, meters.
    #[serde(default = "workspace")]
    pub workspace_m: [[f64; 3]; 2],
    /// Distance from its last position up to which an object's new position is accepted at once, mm.
    #[serde(default = "jump")]
    pub jump_mm: f64,
    /// Number of consecutive detections after which a position farther away is accepted.
    #[serde(default = "confirmations")]
    pub confirmations: u32,
    /// Maximum standard deviation of an accepted position, in its least certain direction, mm.
    #[serde(default = "uncertainty")]
    pub uncertainty_mm: f64,
    /// Distance from the model's position below which the model is not changed, mm.
    #[serde(default = "least_move")]
    pub least_move_mm: f64,
    /// Time without a detection after which an object is stale, s.
    #[serde(default = "stale")]
    pub stale_s: f64,
}

fn workspace() -> [[f64; 3]; 2] {
    [[-2.0, -2.0, -1.0], [2.0, 2.0, 3.0]]
}
fn jump() -> f64 {
    100.0
}
fn confirmations() -> u32 {
    3
}
fn uncertainty() -> f64 {
    40.0
}
fn least_move() -> f64 {
    5.0
}
fn stale() -> f64 {
    2.0
}

impl SensorConfig {
    /// The index of the robot that carries it.
    pub fn carrier(&self, config: &Config) -> Option<usize> {
        match &self.robot {
            Some(name) => config.robot.iter().position(|r| r.name == *name),
            None if config.robot.len() == 1 => Some(0),
            None => None,
        }
    }
}

impl Config {
    /// The index of the sensor of this name, or of the only one. Complaints name `file`.
    pub fn sensor_called(&self, name: Option<&str>, file: &Path) -> Result<usize, ConfigError> {
        let names: Vec<&str> = self.sensor.iter().map(|s| s.name.as_str()).collect();
        let file = file.display();
        match (name, names.as_slice()) {
            (_, []) => {
                let help = "add a table [[sensor]] with its eyes; configs/sensing/eyes-yarp.toml has one";
                Err(ConfigError::plain(format!("{file} has no sensor"), help))
            }
            (None, [_]) => Ok(0),
            (None, several) => {
                let help = format!("choose with --sensor; there are: {}", several.join(", "));
                Err(ConfigError::plain(format!("{file} has several sensors"), help))
            }
            (Some(name), all) => all.iter().position(|known| *known == name).ok_or_else(|| {
                let what = format!("there is no sensor `{name}` in {file}");
                ConfigError::plain(what, suggestion(name, "sensor", all))
            }),
        }
    }

    /// The cameras whose frames the run stores, as `<sensor>/<camera>`.
    pub fn stored_cameras(&self) -> Vec<String> {
        let keeping = self.sensor.iter().filter(|s| s.keep_frames);
        keeping.flat_map(|s| s.eye.iter().map(|eye| format!("{}/{}", s.name, eye.name))).collect()
    }

    /// The table of each camera's detector, and the camera's name in a run, as `<sensor>/<camera>`.
    pub fn detectors(&self) -> impl Iterator<Item = (String, &Value)> {
        self.sensor.iter().flat_map(|s| s.eye.iter().map(|eye| (format!("{}/{}", s.name, eye.name), &eye.detector)))
    }

    pub(super) fn check_sensors(&self, c: &mut Checks<'_>) {
        let robots: Vec<&str> = self.robot.iter().map(|r| r.name.as_str()).collect();
        for (i, s) in self.sensor.iter().enumerate() {
            let at = |key: &str| format!("sensor[{i}].{key}");
            c.name(&at("name"), &s.name, "sensor");
            if self.sensor.iter().take(i).any(|other| other.name == s.name) || robots.contains(&s.name.as_str()) {
                let what = format!("there is another sensor or robot `{}`", s.name);
                c.complain(&at("name"), what, "name one of them differently");
            }
            match &s.robot {
                Some(name) if !robots.contains(&name.as_str()) => {
                    c.complain(&at("robot"), format!("there is no robot `{name}`"), suggestion(name, "robot", &robots));
                }
                None if robots.len() > 1 => {
                    let help = format!("add robot = \"...\"; there are: {}", robots.join(", "));
                    c.complain(&at("name"), "the robot that carries it is not named", help);
                }
                _ => {}
            }
            if s.eye.is_empty() {
                let help = "add a [[sensor.eye]] table with name, camera and detector";
                c.complain(&at("eye"), "a sensor without a camera sees nothing", help);
            }
            for (k, eye) in s.eye.iter().enumerate() {
                c.name(&at(&format!("eye[{k}].name")), &eye.name, "camera");
                c.range(
                    &at(&format!("eye[{k}].max_regions")),
                    eye.max_regions as f64,
                    1.0,
                    MAX_REGIONS as f64,
                    "regions",
                );
                if eye.name == "locator" || s.eye.iter().take(k).any(|other| other.name == eye.name) {
                    let what = format!("there is another part of the sensor called `{}`", eye.name);
                    c.complain(&at(&format!("eye[{k}].name")), what, "name one of them differently");
                }
            }
            if let Some(gate) = &s.gate {
                if s.locator.is_none() {
                    let help = "add a table [sensor.locator], or take the gate away";
                    c.complain(&at("gate"), "without a locator there are no places to believe", help);
                }
                gate.check(&at("gate"), c);
                for (k, name) in gate.objects.iter().enumerate() {
                    let gates = self.sensor.iter().take(i).filter_map(|other| other.gate.as_ref());
                    let mut before = gates.flat_map(|g| &g.objects).chain(gate.objects.iter().take(k));
                    if before.any(|other| other == name) {
                        let what = format!("the object `{name}` is kept twice");
                        c.complain(&at(&format!("gate.objects[{k}]")), what, "let one sensor keep it, once");
                    }
                }
            }
        }
    }
}

impl WorldGateConfig {
    fn check(&self, at: &str, c: &mut Checks<'_>) {
        if self.objects.is_empty() {
            c.complain(
                &format!("{at}.objects"),
                "it keeps no object",
                "name those that the sensor sees, or take the gate away",
            );
        }
        let [low, high] = &self.workspace_m;
        c.position(&format!("{at}.workspace_m"), low);
        c.position(&format!("{at}.workspace_m"), high);
        // false for NaN
        if !low.iter().zip(high).all(|(a, b)| a < b) {
            let help = "give the least x, y, z, then the greatest";
            c.complain(&format!("{at}.workspace_m"), "there is no place in this workspace", help);
        }
        c.range_or(&format!("{at}.jump_mm"), self.jump_mm, (1.0, 10_000.0), "mm", Some(("meters", 1e3)));
        c.range(&format!("{at}.confirmations"), f64::from(self.confirmations), 1.0, 1000.0, "times");
        c.range_or(&format!("{at}.uncertainty_mm"), self.uncertainty_mm, (0.1, 10_000.0), "mm", Some(("meters", 1e3)));
        c.range(&format!("{at}.least_move_mm"), self.least_move_mm, 0.0, 1000.0, "mm");
        c.range(&format!("{at}.stale_s"), self.stale_s, 0.1, 1e6, "s");
    }
}
