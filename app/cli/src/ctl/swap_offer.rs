//! Builds and checks a new part from a configuration file before it is offered to the run.

use super::wire::SentConfig;
use crate::run::check_network_access;
use mobee_compose::config::{Config, Source, simulated};
use mobee_compose::{compose, margin_warning};
use mobee_contract::SwapPart;
use mobee_driver_yarp::YARP;
use mobee_model::Robot;
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{BesideOffer, Control, NewBeside, NewPart, PartOffer};
use mobee_runtime::wiring::{Maker, SwapRequest};
use serde_json::Value;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use tokio::sync::oneshot::Sender;

/// A new part, ready to be offered.
pub(crate) enum BuiltPart {
    Agent(SwapRequest),
    Part(PartOffer),
    Beside(BesideOffer),
}

impl BuiltPart {
    /// The control that offers the part to the robot or bridge of this name.
    pub(crate) fn control(self, name: String, reply: Sender<Result<(), String>>) -> Control {
        match self {
            BuiltPart::Agent(offer) => Control::SwapAgent { robot: name, offer, reply },
            BuiltPart::Part(offer) => Control::SwapPart { robot: name, offer, reply },
            BuiltPart::Beside(offer) => Control::SwapBeside { name, offer, reply },
        }
    }
}

/// The part of a robot that is requested from a file.
pub(crate) struct PartRequest<'a> {
    /// The kind of part.
    pub part: SwapPart,
    /// The robot's name.
    pub name: &'a str,
    /// The robot's model, whose motors the file's robot must have.
    pub model: &'a Arc<Robot>,
    /// True if a new agent starts without the state of the old one.
    pub fresh: bool,
    /// Shadow, probation and budget of the swap.
    pub terms: SwapPolicy,
}

/// The bridge that is requested from a file.
pub(crate) struct BridgeRequest<'a> {
    /// The bridge in the file.
    pub which: BridgeRef<'a>,
    /// The robots of the run, which it must fit.
    pub models: &'a [Arc<Robot>],
    /// Shadow, probation and budget of the swap.
    pub terms: SwapPolicy,
}

/// The detector that is requested from a file.
pub(crate) struct DetectorRequest<'a> {
    /// The camera in the run, as `<sensor>/<camera>`.
    pub camera: &'a str,
    /// True if it starts without the state of the old one.
    pub fresh: bool,
    /// Shadow, probation and budget of the swap.
    pub terms: SwapPolicy,
}

/// The locator that is requested from a file.
pub(crate) struct LocatorRequest<'a> {
    /// The sensor in the run.
    pub sensor: &'a str,
    /// The robots of the run; the file's robot must be one of them.
    pub models: &'a [Arc<Robot>],
    /// True if it starts without the state of the old one.
    pub fresh: bool,
    /// Shadow, probation and budget of the swap.
    pub terms: SwapPolicy,
}

/// A reference to a bridge of a file.
#[derive(Clone, Copy)]
pub(crate) enum BridgeRef<'a> {
    /// The bridge of this name, or the only one.
    Named(&'a str),
    /// The bridge at this index.
    At(usize),
}

/// Checks a whole configuration that was sent, and takes the requested part of it.
///
/// # Errors
/// All complaints about it, as they would be printed.
pub(super) fn sent(sent: SentConfig, wanted: &PartRequest<'_>) -> Result<BuiltPart, String> {
    let (config, source) = read(sent)?;
    take(config, &source, wanted)
}

/// Like [`sent`], for a bridge.
///
/// # Errors
/// All complaints about it, as they would be printed.
pub(super) fn sent_bridge(sent: SentConfig, wanted: &BridgeRequest<'_>) -> Result<BuiltPart, String> {
    let (config, source) = read(sent)?;
    take_bridge(config, &source, wanted)
}

/// Like [`sent`], for a detector.
///
/// # Errors
/// All complaints about it, as they would be printed.
pub(super) fn sent_detector(sent: SentConfig, wanted: &DetectorRequest<'_>) -> Result<BuiltPart, String> {
    let (config, source) = read(sent)?;
    take_detector(config, &source, wanted)
}

/// Like [`sent`], for a locator.
///
/// # Errors
/// All complaints about it, as they would be printed.
pub(super) fn sent_locator(sent: SentConfig, wanted: &LocatorRequest<'_>) -> Result<BuiltPart, String> {
    let (config, source) = read(sent)?;
    take_locator(config, &source, wanted)
}

fn read(sent: SentConfig) -> Result<(Config, Source), String> {
    let files = sent.files()?;
    let source = Source::sent(&sent.file, sent.config, files);
    let config = Config::from_source(&source).map_err(|e| format!("{:?}", miette::Report::new(e)))?;
    Ok((config, source))
}

/// Checks a whole configuration, and takes a bridge of it.
///
/// # Errors
/// All complaints about it, as they would be printed.
pub(crate) fn take_bridge(
    mut config: Config,
    source: &Source,
    wanted: &BridgeRequest<'_>,
) -> Result<BuiltPart, String> {
    let file = source.path.display();
    check_network_access(&config).map_err(|e| format!("{:?}", miette::Report::new(e)))?;
    // no board is touched
    config.robot.iter_mut().for_each(|robot| robot.driver = simulated());
    let kinds: Vec<Value> = config.bridges().map(|(_, table)| table["kind"].clone()).collect();
    let composition = compose(config, source).map_err(|report| format!("{report:?}"))?;
    let names = composition.bridge_names();
    let at = match wanted.which {
        BridgeRef::At(at) => Some(at),
        BridgeRef::Named(_) if names.len() == 1 => Some(0),
        BridgeRef::Named(name) => names.iter().position(|n| n == name),
    };
    let Some((bridge, kind)) = at.and_then(|at| composition.bridges.get(at).zip(kinds.get(at))) else {
        return Err(match (wanted.which, names.as_slice()) {
            (_, []) => format!("there is no bridge in {file}; add a table [yarp] or [[bridge]]"),
            (BridgeRef::Named(name), names) => {
                format!("there is no bridge {name} in {file}; there are: {}", names.join(", "))
            }
            (BridgeRef::At(_), _) => format!("there are fewer bridges in {file} than in the run"),
        });
    };
    bridge.check(wanted.models).map_err(|e| format!("it does not fit the robots of the run: {e}; {}", e.help))?;
    let what = format!("{} from {file}", kind.as_str().unwrap_or_default());
    Ok(BuiltPart::Beside(BesideOffer { part: NewBeside::Bridge(bridge.clone()), what, terms: wanted.terms }))
}

/// Checks a whole configuration, and takes the detector of one camera: the one of this name, or the only one.
///
/// # Errors
/// All complaints about it, as they would be printed.
pub(crate) fn take_detector(
    mut config: Config,
    source: &Source,
    wanted: &DetectorRequest<'_>,
) -> Result<BuiltPart, String> {
    let file = source.path.display();
    // no board is touched
    config.robot.iter_mut().for_each(|robot| robot.driver = simulated());
    let eyes: Vec<(String, Value)> =
        config.detectors().map(|(name, detector)| (name, detector["kind"].clone())).collect();
    let composition = compose(config, source).map_err(|report| format!("{report:?}"))?;
    let at = match eyes.as_slice() {
        [_] => Some(0),
        eyes => eyes.iter().position(|(name, _)| name == wanted.camera),
    };
    let makers = composition.sensors.into_iter().flat_map(|s| s.cameras.into_iter().map(|camera| camera.detector));
    let Some((maker, (_, kind))) = at.and_then(|at| makers.into_iter().nth(at).zip(eyes.get(at))) else {
        let names: Vec<&str> = eyes.iter().map(|(name, _)| name.as_str()).collect();
        return Err(match names.as_slice() {
            [] => format!("there is no sensor in {file}; add a table [[sensor]]"),
            names => format!("there is no camera {} in {file}; there are: {}", wanted.camera, names.join(", ")),
        });
    };
    let what = format!("{} from {file}", kind.as_str().unwrap_or_default());
    let part = NewBeside::Detector { maker, fresh: wanted.fresh };
    Ok(BuiltPart::Beside(BesideOffer { part, what, terms: wanted.terms }))
}

/// Checks a whole configuration, and takes the locator of one sensor: the one of this name, or the only one.
///
/// # Errors
/// All complaints about it, as they would be printed.
pub(crate) fn take_locator(
    mut config: Config,
    source: &Source,
    wanted: &LocatorRequest<'_>,
) -> Result<BuiltPart, String> {
    let file = source.path.display();
    // no board is touched
    config.robot.iter_mut().for_each(|robot| robot.driver = simulated());
    let sensors: Vec<(String, Value)> = config
        .sensor
        .iter()
        .map(|s| (s.name.clone(), s.locator.as_ref().map_or(Value::Null, |table| table["kind"].clone())))
        .collect();
    let composition = compose(config, source).map_err(|report| format!("{report:?}"))?;
    let at = match sensors.as_slice() {
        [_] => Some(0),
        sensors => sensors.iter().position(|(name, _)| name == wanted.sensor),
    };
    let Some((setup, (name, kind))) = at.and_then(|at| composition.sensors.into_iter().nth(at).zip(sensors.get(at)))
    else {
        let names: Vec<&str> = sensors.iter().map(|(name, _)| name.as_str()).collect();
        return Err(match names.as_slice() {
            [] => format!("there is no sensor in {file}; add a table [[sensor]]"),
            names => format!("there is no sensor {} in {file}; there are: {}", wanted.sensor, names.join(", ")),
        });
    };
    let locator = setup
        .locator
        .ok_or_else(|| format!("the sensor {name} of {file} has no locator; add a table [sensor.locator]"))?;
    let carrier = composition.scene.robots().iter().find(|robot| robot.name == locator.robot);
    if !carrier.is_some_and(|robot| wanted.models.iter().any(|model| motors(model) == motors(robot))) {
        return Err(format!(
            "no robot of the run has the motors of {} of {file}; give a file of this run",
            locator.robot
        ));
    }
    let what = format!("{} from {file}", kind.as_str().unwrap_or_default());
    let part = NewBeside::Locator { maker: locator.locator, fresh: wanted.fresh };
    Ok(BuiltPart::Beside(BesideOffer { part, what, terms: wanted.terms }))
}

/// The names of a robot's motors, in order.
fn motors(robot: &Robot) -> Vec<&str> {
    robot.motors.iter().map(|m| m.name.as_str()).collect()
}

/// Checks a whole configuration, and takes the requested part of it.
///
/// # Errors
/// All complaints about it, as they would be printed.
pub(crate) fn take(mut config: Config, source: &Source, wanted: &PartRequest<'_>) -> Result<BuiltPart, String> {
    let PartRequest { part, name, model, fresh, terms } = *wanted;
    let file = source.path.display();
    let mut index = config.robot.iter().position(|r| r.name == name);
    if index.is_none() && config.robot.len() == 1 {
        index = Some(0);
    }
    let Some(index) = index else {
        let names: Vec<&str> = config.robot.iter().map(|r| r.name.as_str()).collect();
        return Err(format!("there is no robot {name} in {file}; there are: {}", names.join(", ")));
    };
    for (i, robot) in config.robot.iter_mut().enumerate() {
        match &mut robot.driver {
            Value::Object(driver) if part == SwapPart::Driver && i == index => {
                if driver.get("kind").and_then(Value::as_str) == Some(YARP) {
                    driver.entry("name").or_insert_with(|| ports(&robot.name).into());
                }
            }
            // no other board is touched
            driver => *driver = simulated(),
        }
    }
    let robot = config.robot.get(index).cloned();
    let mut composition = compose(config, source).map_err(|report| format!("{report:?}"))?;
    let other = composition.scene.robots().get(index).cloned();
    let (Some(robot), Some(_)) = (robot, other.filter(|other| motors(other) == motors(model))) else {
        return Err(format!("the robot of {file} has other motors than {name}; give a file of this robot"));
    };
    let setup = composition.robots.swap_remove(index);
    let kind = |table: &Value| table.get("kind").and_then(Value::as_str).unwrap_or_default().to_owned();
    match part {
        SwapPart::Agent => {
            let what = format!("{} from {file}", robot.agent.as_ref().map(kind).unwrap_or_default());
            let maker = setup.agent.ok_or("the robot of this file has no agent; add a table [robot.agent]")?;
            Ok(BuiltPart::Agent(SwapRequest { maker: Maker(maker), what, fresh, terms }))
        }
        SwapPart::Controller => {
            let worse = margin_warning(&robot, model, setup.hardware.as_ref(), &setup.controller, None);
            if let Some(why) = worse {
                return Err(format!("this controller is not taken while the robot runs: {why}"));
            }
            let part = NewPart::Controller(Box::new(setup.controller));
            Ok(BuiltPart::Part(PartOffer { part, what: format!("the one from {file}"), terms }))
        }
        SwapPart::Driver => {
            let what = format!("{} from {file}", kind(&robot.driver));
            Ok(BuiltPart::Part(PartOffer { part: NewPart::Driver(setup.hardware), what, terms }))
        }
        SwapPart::Bridge | SwapPart::Detector | SwapPart::Locator => Err(format!("a {part} is no part of a robot")),
    }
}

/// The prefix of the names of a new driver's own ports; the old driver holds its own for a while.
fn ports(robot: &str) -> String {
    static SWAPS: AtomicU32 = AtomicU32::new(2);
    format!("/MoBeE/{robot}/driver/{}", SWAPS.fetch_add(1, Ordering::SeqCst))
}

#[cfg(test)]
mod tests {
    use super::super::config_payload;
    use super::*;
    use std::path::{Path, PathBuf};

    fn agent_of(file: SentConfig) -> Result<BuiltPart, String> {
        let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/icub.xml");
        let model = Arc::new(mobee_model::load_robot(robot).unwrap().value);
        let terms = SwapPolicy::default();
        sent(file, &PartRequest { part: SwapPart::Agent, name: "icub", model: &model, fresh: false, terms })
    }

    fn explore() -> SentConfig {
        config_payload::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/behaviors/explore.toml"))
            .unwrap()
    }

    #[test]
    fn what_was_sent_is_all_that_is_needed() {
        let mut file = explore();
        // where nothing of it can be found
        let moved = |path: PathBuf| Path::new("/nowhere").join(path.strip_prefix("/").unwrap());
        file.file = moved(file.file);
        file.texts = file.texts.into_iter().map(|(path, text)| (moved(path), text)).collect();
        assert!(agent_of(file).is_ok());
    }

    #[test]
    fn no_file_is_opened_for_others() {
        let dir = tempfile::tempdir().unwrap();
        let secret = dir.path().join("secret.xml");
        std::fs::write(&secret, "<ZRP KEY=\"4711\">").unwrap();
        for at in ["/robot/0/model", "/world/file"] {
            let mut file = explore();
            *file.config.pointer_mut(at).unwrap() = serde_json::json!(secret);
            let why = agent_of(file).err().unwrap();
            assert!(why.contains("send all files that it names") && !why.contains("4711"), "{why}");
        }
        let mut file = explore();
        file.config["include"] = serde_json::json!([secret]);
        assert!(agent_of(file).is_ok(), "includes were put in place by who sent them");
    }
}
