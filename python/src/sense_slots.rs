//! Which detectors and locators of a configuration are Python code: by the names of its cameras and sensors. No Python here.

use crate::failure::Failure;
use crate::relay::RelayLine;
use crate::sense_relay::{RelaySense, SenseName};
use mobee::compose::Composition;
use mobee::config::{ConfigError, Source};
use mobee::kinds::PYTHON;
use mobee_contract::{Detector, Locator};
use mobee_model::suggestion;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Names of the classes of detectors and locators in Python, by the keys under which they were passed.
#[derive(Clone, Debug, Default)]
pub(crate) struct SenseClasses {
    /// The key is a camera (`<sensor>/<camera>`), or a sensor for all its cameras.
    pub detectors: BTreeMap<String, String>,
    /// The key is a sensor.
    pub locators: BTreeMap<String, String>,
}

impl SenseClasses {
    /// Sets the kinds of a configuration's detectors and locators.
    ///
    /// # Errors
    /// A key that names nothing.
    pub fn assign(&self, source: &mut Source) -> Result<(), Failure> {
        let cameras = cameras_of(source);
        for (sensor, camera) in &cameras {
            if let Some((_, class)) = self.detector_of(sensor, &format!("{sensor}/{camera}")) {
                set(source, &format!("sensor.{sensor}.eye.{camera}.detector"), class)?;
            }
        }
        let sensors: BTreeSet<&str> = cameras.iter().map(|(sensor, _)| sensor.as_str()).collect();
        for (sensor, class) in self.locators.iter().filter(|(sensor, _)| sensors.contains(sensor.as_str())) {
            set(source, &format!("sensor.{sensor}.locator"), class)?;
        }
        self.check_keys(cameras.iter().map(|(sensor, camera)| (sensor.as_str(), camera.as_str())))
    }

    /// Puts relays in the place of detectors and locators.
    ///
    /// # Errors
    /// A key that names nothing; a detector or locator that is Python code and was not passed.
    pub fn install<E: Send + 'static>(
        &self,
        composition: &mut Composition,
        line: impl Fn() -> RelayLine<E>,
    ) -> Result<(), Failure> {
        let sensors = &mut composition.sensors;
        let cameras = sensors.iter().flat_map(|s| s.cameras.iter().map(|c| (s.name.as_str(), c.name.as_str())));
        self.check_keys(cameras)?;
        let robots: Vec<String> = composition.robots.iter().map(|robot| robot.name.clone()).collect();
        for (sensor, config) in sensors.iter_mut().zip(&composition.config.sensor) {
            for (camera, config) in sensor.cameras.iter_mut().zip(&config.eye) {
                let part = format!("{}/{}", sensor.name, camera.name);
                let given = self.detector_of(&sensor.name, &part).map(|(key, _)| key.clone());
                if let Some(name) = passed("detector", given, part, &config.detector)? {
                    let line = line();
                    camera.detector =
                        Arc::new(move || Ok(Box::new(RelaySense::new(&line, &name, 0)) as Box<dyn Detector>));
                }
            }
            let Some((locator, config)) = sensor.locator.as_mut().zip(config.locator.as_ref()) else { continue };
            let given = self.locators.get_key_value(&sensor.name).map(|(key, _)| key.clone());
            if let Some(name) = passed("locator", given, sensor.name.clone(), config)? {
                let line = line();
                let robot = robots.iter().position(|robot| *robot == locator.robot).unwrap_or_default();
                locator.locator =
                    Arc::new(move || Ok(Box::new(RelaySense::new(&line, &name, robot)) as Box<dyn Locator>));
            }
        }
        Ok(())
    }

    /// The detector of a camera: its own, or that of its sensor.
    fn detector_of(&self, sensor: &str, camera: &str) -> Option<(&String, &String)> {
        self.detectors.get_key_value(camera).or_else(|| self.detectors.get_key_value(sensor))
    }

    fn check_keys<'a>(&self, cameras: impl Iterator<Item = (&'a str, &'a str)>) -> Result<(), Failure> {
        let (mut known, mut sensors) = (BTreeSet::new(), BTreeSet::new());
        for (sensor, camera) in cameras {
            known.extend([sensor.to_owned(), format!("{sensor}/{camera}")]);
            sensors.insert(sensor.to_owned());
        }
        unknown("detectors", self.detectors.keys(), "camera", &known)?;
        unknown("locators", self.locators.keys(), "sensor", &sensors)
    }
}

fn unknown<'a>(
    argument: &'static str,
    mut keys: impl Iterator<Item = &'a String>,
    kind: &str,
    known: &BTreeSet<String>,
) -> Result<(), Failure> {
    let Some(stray) = keys.find(|key| !known.contains(*key)) else { return Ok(()) };
    let known: Vec<&str> = known.iter().map(String::as_str).collect();
    let message = format!("this file has no {kind} {stray:?}");
    Err(Failure::new("unknown", message, suggestion(stray, kind, &known)).at(argument))
}

/// The name of a part that was passed; `None` if it is not Python code.
fn passed(
    role: &str,
    key: Option<String>,
    part: String,
    config: &serde_json::Value,
) -> Result<Option<SenseName>, Failure> {
    let kind = config.get("kind").and_then(serde_json::Value::as_str);
    match (key, kind == Some(PYTHON)) {
        (Some(key), true) => Ok(Some(SenseName { key, part: part.into() })),
        (None, false) => Ok(None),
        (None, true) => {
            let message = format!("the {role} of {part} is Python code, and none was passed");
            Err(Failure::new("kind", message, format!("pass it: {role}s={{\"{part}\": ...}}")).at(format!("{role}s")))
        }
        (Some(_), false) => {
            let message = format!("the {role} of {part} was not Python code in this run");
            Err(Failure::new("kind", message, "leave it out").at(format!("{role}s")))
        }
    }
}

fn set(source: &mut Source, key: &str, class: &str) -> Result<(), ConfigError> {
    let class = serde_json::Value::String(class.to_owned());
    source.set(&format!("{key}={{ kind = \"{PYTHON}\", class = {class} }}"))
}

/// The names of the cameras, each with its sensor, as far as the configuration has any.
fn cameras_of(source: &Source) -> Vec<(String, String)> {
    let list = |value: &serde_json::Value, key: &str| -> Vec<serde_json::Value> {
        value.get(key).and_then(serde_json::Value::as_array).cloned().unwrap_or_default()
    };
    let name = |value: &serde_json::Value| value.get("name")?.as_str().map(str::to_owned);
    let cameras = |sensor: serde_json::Value| {
        let eyes = list(&sensor, "eye");
        let of = name(&sensor);
        eyes.into_iter().filter_map(move |eye| Some((of.clone()?, name(&eye)?)))
    };
    list(&source.value, "sensor").into_iter().flat_map(cameras).collect()
}
