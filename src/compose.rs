//! From a configuration to a system that is ready to run: every file read, every part built, every name checked.

use crate::config::{Config, ConfigError, EditStep, Source, When, nearest};
use mobee_actors::controller::Controller;
use mobee_actors::system::{AgentMaker, RobotSetup, ScriptStep};
use mobee_contract::{Context, Hardware, KindError, Service, agent_kinds, driver_kinds};
use mobee_drivers::YarpServices;
use mobee_model::{Edit, Object, Robot, Scene, load_robot, load_world};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Everything built and checked, nothing started.
pub struct Composition {
    /// The configuration it was built from.
    pub config: Config,
    /// The file it stood in.
    pub file: PathBuf,
    /// Robots and objects.
    pub scene: Scene,
    /// The robots with their hardware, controllers and agents.
    pub robots: Vec<RobotSetup>,
    /// What happens to the world.
    pub script: Vec<ScriptStep>,
    /// What runs beside the safety chain.
    pub services: Vec<Box<dyn Service>>,
    /// What deserves attention but does not forbid to run.
    pub warnings: Vec<String>,
}

/// Builds everything that a configuration names.
///
/// # Errors
/// The first complaint, with its place and remedy.
pub fn compose(config: Config, source: &Source) -> Result<Composition, miette::Report> {
    let mut warnings = Vec::new();
    let mut models: Vec<(Arc<Robot>, Isometry3<f64>)> = Vec::new();
    for (i, r) in config.robot.iter().enumerate() {
        let path = Config::beside(source, &r.model);
        must_exist(source, &format!("robot[{i}].model"), &path, "robot file; `configs/robots/` has some")?;
        let loaded = load_robot(&path)?;
        warnings.extend(loaded.warnings.iter().map(ToString::to_string));
        let [x, y, z] = r.base.position_m;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), r.base.yaw_deg.to_radians());
        let mut robot = loaded.value;
        robot.name = r.name.clone();
        models.push((Arc::new(robot), Isometry3::from_parts(Translation3::new(x, y, z), turn)));
    }
    let objects = world(&config, source, &mut warnings)?;
    let scene = Scene::new(models.clone(), objects)
        .map_err(|e| source.error("world", e.to_string(), "mend the world's or the robots' files"))?;

    let mut robots = Vec::new();
    for (i, r) in config.robot.iter().enumerate() {
        let robot = models[i].0.clone();
        let context = |role: &str| Context {
            robot: robot.clone(),
            seed: derive_seed(config.seed, &format!("{}/{role}", r.name)),
        };
        let hardware = driver(source, &format!("robot[{i}].driver"), &r.driver, &context("driver"))?;
        let agent = match &r.agent {
            Some(value) => Some(agent(source, &format!("robot[{i}].agent"), value, context("agent"))?),
            None => None,
        };
        let at = format!("robot[{i}].controller");
        let controller = r.controller.settings().map_err(|e| place(source, &at, &e))?;
        let foreign = config.yarp.as_ref().filter(|y| y.filter).map(|y| y.speed);
        warnings.extend(margin_warning(r, &robot, hardware.as_ref(), &controller, foreign));
        robots.push(RobotSetup { name: r.name.clone(), hardware, controller, agent });
    }
    home_is_free(&config, source, &scene)?;
    let script = script(&config, source, &scene)?;
    let services = services(&config, source)?;
    Ok(Composition { config, file: source.path.clone(), scene, robots, script, services, warnings })
}

fn must_exist(source: &Source, at: &str, path: &Path, what: &str) -> Result<(), ConfigError> {
    if path.is_file() {
        return Ok(());
    }
    Err(source.error(
        at,
        format!("there is no file {}", path.display()),
        format!("give the path of a {what}, relative to this file"),
    ))
}

fn world(config: &Config, source: &Source, warnings: &mut Vec<String>) -> Result<Vec<Object>, miette::Report> {
    let Some(file) = &config.world.file else { return Ok(Vec::new()) };
    let path = Config::beside(source, file);
    must_exist(source, "world.file", &path, "world file; `configs/worlds/` has some")?;
    let loaded = load_world(&path)?;
    warnings.extend(loaded.warnings.iter().map(ToString::to_string));
    Ok(loaded.value)
}

/// A kind's name and its settings without it.
fn kind(source: &Source, at: &str, value: &Value, known: &[&'static str]) -> Result<(String, Value), ConfigError> {
    let Value::Object(map) = value else {
        return Err(source.error(at, "this is no table", "write a table with `kind` and its settings"));
    };
    let Some(name) = map.get("kind").and_then(Value::as_str) else {
        return Err(source.error(
            at,
            "there is no `kind` here",
            format!("add kind = \"...\"; known: {}", known.join(", ")),
        ));
    };
    if !known.contains(&name) {
        let near = nearest(name, known).map_or(String::new(), |n| format!("did you mean `{n}`? "));
        return Err(source.error(
            &format!("{at}.kind"),
            format!("there is no kind `{name}`"),
            format!("{near}known: {}", known.join(", ")),
        ));
    }
    let mut settings = map.clone();
    settings.remove("kind");
    Ok((name.to_owned(), Value::Object(settings)))
}

fn place(source: &Source, at: &str, e: &KindError) -> ConfigError {
    let path = if e.path.is_empty() { at.to_owned() } else { format!("{at}.{}", e.path) };
    let help = crate::config::did_you_mean(&e.what).unwrap_or_else(|| e.help.clone());
    source.error(&path, e.what.clone(), help)
}

/// The kind of a driver and its settings.
pub(crate) fn driver_of(source: &Source, at: &str, value: &Value) -> Result<(String, Value), ConfigError> {
    let names: Vec<&'static str> = driver_kinds().iter().map(|k| k.name).collect();
    kind(source, at, value, &names)
}

fn driver(source: &Source, at: &str, value: &Value, context: &Context) -> Result<Arc<dyn Hardware>, ConfigError> {
    let kinds = driver_kinds();
    let names: Vec<&'static str> = kinds.iter().map(|k| k.name).collect();
    let (name, mut settings) = kind(source, at, value, &names)?;
    if let Some(Value::String(file)) = settings.get_mut("file") {
        // kinds know no configuration file that their paths could be relative to
        *file = Config::beside(source, Path::new(file)).to_string_lossy().into_owned();
    }
    let found = kinds.iter().find(|k| k.name == name).expect("the name was looked up in these kinds");
    (found.build)(&settings, context).map_err(|e| place(source, at, &e))
}

fn services(config: &Config, source: &Source) -> Result<Vec<Box<dyn Service>>, ConfigError> {
    let Some(mut yarp) = config.yarp.clone() else { return Ok(Vec::new()) };
    yarp.save_folder = yarp.save_folder.map(|folder| Config::beside(source, &folder));
    let ports = YarpServices::new(yarp).map_err(|e| place(source, "yarp", &e))?;
    Ok(vec![Box::new(ports)])
}

fn agent(source: &Source, at: &str, value: &Value, context: Context) -> Result<AgentMaker, ConfigError> {
    let kinds = agent_kinds();
    let names: Vec<&'static str> = kinds.iter().map(|k| k.name).collect();
    let (name, settings) = kind(source, at, value, &names)?;
    let build = kinds.iter().find(|k| k.name == name).expect("the name was looked up in these kinds").build;
    build(&settings, &context).map_err(|e| place(source, at, &e))?;
    Ok(Arc::new(move || build(&settings, &context).map_err(|e| e.to_string())))
}

/// A motion that starts in contact could never be committed: said before anything moves.
fn home_is_free(config: &Config, source: &Source, scene: &Scene) -> Result<(), ConfigError> {
    let home = scene.home();
    for (i, r) in config.robot.iter().enumerate() {
        let margin = r.controller.margin_mm * 1e-3;
        if let Some(c) = scene.clearance(&home, margin) {
            let (a, b) = (scene.shape_name(c.pair.0), scene.shape_name(c.pair.1));
            return Err(source.error(
                &format!("robot[{i}].model"),
                format!(
                    "at home, {a} is {:.1} mm from {b}, nearer than the margin of {} mm",
                    c.distance * 1e3,
                    r.controller.margin_mm
                ),
                "move the object or the robot's base, or choose a smaller margin",
            ));
        }
    }
    Ok(())
}

fn script(config: &Config, source: &Source, scene: &Scene) -> Result<Vec<ScriptStep>, ConfigError> {
    let names: Vec<&str> = scene.objects().map(|(_, o)| o.name.as_str()).collect();
    let mut steps = Vec::new();
    for (i, s) in config.script.iter().enumerate() {
        let EditStep { object, class, position_m, remove } = &s.edit;
        let Some((_, found)) = scene.object(object) else {
            let near = nearest(object, &names).map_or(String::new(), |n| format!("did you mean `{n}`? "));
            return Err(source.error(
                &format!("script[{i}].edit.object"),
                format!("there is no object `{object}` in the world"),
                format!("{near}the objects are: {}", names.join(", ")),
            ));
        };
        let mut edits = Vec::new();
        if let Some([x, y, z]) = position_m {
            let pose = Isometry3::from_parts(Translation3::new(*x, *y, *z), found.pose.rotation);
            edits.push(Edit::Move { name: object.clone(), pose });
        }
        if let Some(class) = class {
            edits.push(Edit::Class { name: object.clone(), class: *class });
        }
        if *remove {
            edits.push(Edit::Remove { name: object.clone() });
        }
        let when = match &s.when {
            When::AtS(t) => mobee_actors::system::When::At(mobee_contract::Time::from_secs(*t)),
            When::AfterOutcomes { robot, count } => {
                mobee_actors::system::When::AfterOutcomes { robot: robot.clone(), n: *count }
            }
        };
        steps.extend(edits.into_iter().map(|edit| ScriptStep { when: when.clone(), edit }));
    }
    Ok(steps)
}

/// Whether the robot can stop within its margin at the speed its agent uses, or foreign programs may.
pub(crate) fn margin_warning(
    r: &crate::config::Robot,
    robot: &Robot,
    hardware: &dyn Hardware,
    controller: &Controller,
    foreign: Option<f64>,
) -> Option<String> {
    // a real robot is not connected to before the run
    if r.driver.get("kind").and_then(Value::as_str) == Some("yarp") {
        return None;
    }
    let own = r.agent.as_ref().map(|a| a.get("speed").and_then(Value::as_f64).unwrap_or(0.1));
    let speed = own.into_iter().chain(foreign).reduce(f64::max)?;
    let board = hardware.connect().ok()?.board().clone();
    let period = std::time::Duration::from_secs_f64(controller.period_s);
    let warning = mobee_drivers::stopping_path(robot, &board, period, speed).warning(controller.margin_m, robot)?;
    Some(format!("{}: {warning}", r.name))
}

/// A seed for one part of the run, from the run's seed and the part's name (FNV-1a, then a final mix).
pub(crate) fn derive_seed(seed: u64, part: &str) -> u64 {
    let mut h =
        part.bytes().fold(0xcbf2_9ce4_8422_2325_u64 ^ seed, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h ^ (h >> 31)
}
