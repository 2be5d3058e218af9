//! Builds a configuration into a system that is ready to run: reads every file, builds every part, checks every name.

mod checks;
mod rest;
mod script;
mod sensors;

pub use sensors::camera as sensor_camera;

use crate::config::{ClockMode, Complaints, Config, ConfigError, PathSetting, Source, paths, suggestion};
use mobee_contract::{Agent, Axis, Bridge, Context, Hardware, Kind, KindError, Requirements, Role, Service, kinds};
use mobee_controller::look_ahead::{FastClearance, stop_error};
use mobee_controller::{ControllerSettings, RELEASE};
use mobee_model::{Object, Robot, Scene, load_robot, load_world, parse_robot, parse_world};
use mobee_planning::hand_goal::{self, HandGoals, ResolvedGoal};
use mobee_runtime::system::{AgentMaker, RobotSetup, ScriptStep, SensorSetup, TruthCell, named_apart};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tempfile::NamedTempFile;

/// A system that is built and checked, but not started.
pub struct Composition {
    /// The configuration it was built from.
    pub config: Config,
    /// The configuration file.
    pub file: PathBuf,
    /// Robots and objects.
    pub scene: Scene,
    /// The robots with their hardware, controllers and agents.
    pub robots: Vec<RobotSetup>,
    /// The sensors.
    pub sensors: Vec<SensorSetup>,
    /// The world that simulated cameras see.
    pub truth: Arc<TruthCell>,
    /// Scheduled edits of the world.
    pub script: Vec<ScriptStep>,
    /// Bridges through which external programs move robots.
    pub bridges: Vec<Arc<dyn Bridge>>,
    /// Services beside the safety chain.
    pub services: Vec<Arc<dyn Service>>,
    /// Warnings, which do not prevent a run.
    pub warnings: Vec<String>,
    /// Configurations found for poses that are given by the hand, each with its robot.
    pub resolved_goals: Vec<(String, ResolvedGoal)>,
}

/// Reads a file with its layers, and builds every part of it.
///
/// # Errors
/// Every complaint, with its place and remedy.
pub fn read(path: &Path, overrides: &[String]) -> Result<Composition, Complaints> {
    from_source(&Source::load(path, overrides)?)
}

/// Like [`read`], for values that were read already.
///
/// # Errors
/// Every complaint, with its place and remedy.
pub fn from_source(source: &Source) -> Result<Composition, Complaints> {
    let (config, wrong) = Config::partly(source)?;
    build(config, source, wrong, Begin::New)
}

/// Builds every part of a configuration.
///
/// # Errors
/// Every complaint, with its place and remedy.
pub fn compose(config: Config, source: &Source) -> Result<Composition, Complaints> {
    build(config, source, Complaints::default(), Begin::New)
}

/// Like [`compose`], for a run that is resumed: its robots stay where they are, possibly in contact.
///
/// # Errors
/// As for [`compose`].
pub fn compose_again(config: Config, source: &Source) -> Result<Composition, Complaints> {
    build(config, source, Complaints::default(), Begin::Resumed)
}

/// Start of a run: new, with the robots at chosen configurations, or resumed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Begin {
    New,
    Resumed,
}

/// One robot with the parts built for it, before it moves.
struct BuiltRobot {
    model: Arc<Robot>,
    hardware: Option<Arc<dyn Hardware>>,
    agent: Option<(AgentMaker, Requirements)>,
    rest: Option<rest::Rest>,
}

fn build(config: Config, source: &Source, mut wrong: Complaints, begin: Begin) -> Result<Composition, Complaints> {
    let mut warnings = Vec::new();
    let mut built: Vec<Option<BuiltRobot>> = Vec::new();
    for (i, r) in config.robot.iter().enumerate() {
        let at = |key: &str| format!("robot[{i}].{key}");
        let model = wrong.keep(model(r, &at("model"), source, &mut warnings));
        built.push(model.map(|model| {
            let seed = derive_seed(config.seed, &format!("{}/driver", r.name));
            let context = Context { robot: model.clone(), seed };
            let hardware = wrong.keep(driver(source, &at("driver"), &r.driver, &context));
            if config.clock == ClockMode::Virtual && hardware.as_ref().is_some_and(|h| !h.runs_in_virtual_time()) {
                wrong.push(needs_real_clock(source, &at("driver"), "driver"));
            }
            BuiltRobot { hardware, agent: None, rest: None, model }
        }));
    }
    let objects = wrong.keep(world(&config, source, &mut warnings));
    let scene = objects.and_then(|objects| scene(&config, &built, objects));
    let resolved_goals = agents(&config, source, &mut built, scene.as_ref().and_then(|s| s.as_ref().ok()), &mut wrong);
    rest::all(&config, source, &mut built, &resolved_goals, &mut wrong);
    let bridges = bridges(&config, source, &mut wrong);
    let whole: Option<Vec<BuiltRobot>> = built.into_iter().collect();
    let (Some(built), Some(scene)) = (whole, scene) else { return Err(wrong.of_something()) };
    let scene = match scene {
        Ok(scene) => scene,
        // an error of the robots, such as a duplicate name, was reported before
        Err(_) if !wrong.is_empty() => return Err(wrong),
        Err(e) => {
            return Err(source.error("world.file", e.to_string(), "mend the world's or the robots' files").into());
        }
    };
    checks::all(&config, source, &scene, &built, begin, &mut wrong, &mut warnings);
    for (at, bridge) in &bridges {
        wrong.keep(bridge.check(scene.robots()).map_err(|e| placed(source, at, e)));
    }
    let truth = Arc::new(TruthCell::default());
    let sensors = sensors::all(&config, source, &scene, &truth, &mut wrong);
    let script = script::steps(&config, source, &scene, &mut wrong);

    let mut robots = Vec::new();
    if wrong.is_empty() {
        for (i, (BuiltRobot { model, hardware, agent, rest }, r)) in built.into_iter().zip(&config.robot).enumerate() {
            let Some(hardware) = hardware else { continue };
            wrong.keep(hardware.place(&scene, i).map_err(|e| placed(source, &format!("robot[{i}].driver"), e)));
            let at = format!("robot[{i}].controller");
            let settings = r.controller.settings().map_err(|e| placed(source, &at, e));
            let Some(controller) = wrong.keep(settings) else { continue };
            if !controller.drive.has_reflex() {
                let what = "its controller has no reflex; contacts are recorded and stop nothing";
                warnings.push(format!("{}: {what}", r.name));
                if r.controller.reserve_mm.is_some_and(|mm| mm > 0.0) {
                    warnings.push(format!("{}: `reserve_mm` is not used without a reflex; remove it", r.name));
                }
            }
            let foreign = bridges.iter().filter_map(|(_, b)| b.speed()).reduce(f64::max);
            warnings.extend(margin_warning(r, &model, hardware.as_ref(), &controller, foreign));
            robots.push(RobotSetup {
                name: r.name.clone(),
                hardware,
                controller,
                agent: agent.map(|(maker, _)| maker),
                rest: rest.map(|(rest, _)| rest),
            });
        }
    }
    let bridges = bridges.into_iter().map(|(_, bridge)| bridge).collect();
    let services = Vec::new();
    let file = source.path.clone();
    wrong.none_or(Composition {
        config,
        file,
        scene,
        robots,
        sensors,
        truth,
        script,
        bridges,
        services,
        warnings,
        resolved_goals,
    })
}

/// The scene of all robots; `None` if one of them could not be read.
fn scene(
    config: &Config,
    built: &[Option<BuiltRobot>],
    objects: Vec<Object>,
) -> Option<Result<Scene, mobee_model::SceneError>> {
    let base = |r: &crate::config::RobotConfig| {
        let [x, y, z] = r.base.position_m;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), r.base.yaw_deg.to_radians());
        Isometry3::from_parts(Translation3::new(x, y, z), turn)
    };
    let robot = |(b, r): (&Option<BuiltRobot>, &crate::config::RobotConfig)| Some((b.as_ref()?.model.clone(), base(r)));
    let models: Option<Vec<_>> = built.iter().zip(&config.robot).map(robot).collect();
    models.map(|models| Scene::new(models, objects))
}

/// Builds all agents; returns the configurations of poses that are given by the hand. These need the scene: without
/// one, which is reported elsewhere, agents with such poses are skipped.
fn agents(
    config: &Config,
    source: &Source,
    built: &mut [Option<BuiltRobot>],
    scene: Option<&Scene>,
    wrong: &mut Complaints,
) -> Vec<(String, ResolvedGoal)> {
    let mut all_found = Vec::new();
    for (i, (r, b)) in config.robot.iter().zip(built).enumerate() {
        let (Some(value), Some(b)) = (&r.agent, b) else { continue };
        // a margin out of bounds is reported elsewhere
        let margin_mm = Some(r.controller.margin_mm).filter(|mm| (0.0..=500.0).contains(mm));
        let seed = derive_seed(config.seed, &format!("{}/agent", r.name));
        let goals =
            scene.zip(margin_mm).map(|(scene, mm)| HandGoals { scene, robot: i, clearance: mm * 1e-3 + RELEASE, seed });
        if goals.is_none() && hand_goal::is_given(value) {
            continue;
        }
        let context = Context { robot: b.model.clone(), seed };
        let agent = agent(source, &format!("robot[{i}].agent"), value, context, goals);
        let Some((maker, means, found)) = wrong.keep(agent) else { continue };
        b.agent = Some((maker, means));
        all_found.extend(found.into_iter().map(|pose| (r.name.clone(), pose)));
    }
    all_found
}

impl Composition {
    /// The names of its bridges in a run, in their order.
    pub fn bridge_names(&self) -> Vec<String> {
        named_apart(self.bridges.iter().map(|bridge| bridge.name()))
    }

    /// The names of its cameras in a run, each as `<sensor>/<camera>`.
    pub fn camera_names(&self) -> Vec<String> {
        let of = |s: &SensorSetup| s.cameras.iter().map(|c| format!("{}/{}", s.name, c.name)).collect::<Vec<_>>();
        self.sensors.iter().flat_map(of).collect()
    }
}

fn must_exist(source: &Source, at: &str, path: &Path, what: &str) -> Result<(), ConfigError> {
    if path.is_file() {
        return Ok(());
    }
    let beside = path.parent().into_iter().filter_map(|dir| std::fs::read_dir(dir).ok()).flatten().flatten();
    let mut names: Vec<String> = beside.filter_map(|e| e.file_name().into_string().ok()).take(1000).collect();
    names.sort();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let wanted = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    let near = mobee_contract::nearest(wanted, &names).filter(|n| *n != wanted);
    let near = near.map_or(String::new(), |n| format!("did you mean `{n}`, in the same folder? "));
    let written = mobee_model::file::path_remedy(path).map_or(String::new(), |help| format!("{help}; "));
    let (problem, remedy) = match path.metadata() {
        Ok(about) if about.is_dir() => {
            (format!("{} is a folder", path.display()), "give the path of a file in it".into())
        }
        Ok(_) => (format!("{} is a device or a pipe", path.display()), format!("give the path of a {what}")),
        Err(_) => (
            format!("there is no file {}", path.display()),
            format!("{near}{written}give the path of a {what}, relative to this file"),
        ),
    };
    Err(source.error(at, problem, remedy))
}

fn model(
    r: &crate::config::RobotConfig,
    at: &str,
    source: &Source,
    warnings: &mut Vec<String>,
) -> Result<Arc<Robot>, Complaints> {
    let path = Config::beside(source, &r.model);
    let sent = source.text_sent(at, &path).transpose()?;
    if sent.is_none() {
        must_exist(source, at, &path, "robot file; `configs/robots/` has some")?;
    }
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("urdf")) {
        let help = format!("convert it: mobee model convert {} robot.xml", path.display());
        return Err(source.error(at, "this is a URDF file, and robots are read from ZRP XML", help).into());
    }
    let loaded = match sent {
        Some(text) => parse_robot(&path.display().to_string(), text)?,
        None => load_robot(&path)?,
    };
    warnings.extend(loaded.warnings.iter().map(ToString::to_string));
    let mut robot = loaded.value;
    robot.name = r.name.clone();
    Ok(Arc::new(robot))
}

fn world(config: &Config, source: &Source, warnings: &mut Vec<String>) -> Result<Vec<Object>, Complaints> {
    let Some(file) = &config.world.file else { return Ok(Vec::new()) };
    let path = Config::beside(source, file);
    let loaded = match source.text_sent("world.file", &path).transpose()? {
        Some(text) => parse_world(&path.display().to_string(), text)?,
        None => {
            must_exist(source, "world.file", &path, "world file; `configs/worlds/` has some")?;
            load_world(&path)?
        }
    };
    warnings.extend(loaded.warnings.iter().map(ToString::to_string));
    Ok(loaded.value)
}

/// A kind of a role as a table names it, and its settings without the name.
fn kind<R: Role + ?Sized>(source: &Source, at: &str, value: &Value) -> Result<(&'static Kind<R>, Value), ConfigError> {
    let kinds = kinds::<R>();
    let known: Vec<&str> = kinds.iter().map(|k| k.name).collect();
    let Value::Object(map) = value else {
        return Err(source.error(at, "this is not a table", "write a table with `kind` and its settings"));
    };
    let Some(name) = map.get("kind").and_then(Value::as_str) else {
        let help = format!("add kind = \"...\"; known: {}", known.join(", "));
        return Err(source.error(at, "there is no `kind` here", help));
    };
    let Some(found) = kinds.iter().copied().find(|k| k.name == name) else {
        let what = format!("there is no kind `{name}`");
        return Err(source.error(&format!("{at}.kind"), what, suggestion(name, "kind", &known)));
    };
    let mut settings = map.clone();
    settings.remove("kind");
    Ok((found, Value::Object(settings)))
}

/// Converts the complaints about a kind's table at `at`.
fn placed(source: &Source, at: &str, e: KindError) -> Complaints {
    let mut wrong = Complaints::default();
    for e in e.all() {
        let path = if e.path.is_empty() { at.to_owned() } else { format!("{at}.{}", e.path) };
        let help = crate::config::did_you_mean(&e.what).unwrap_or(e.help);
        wrong.push(source.error(&path, e.what, help));
    }
    wrong
}

/// The kind of a driver and its settings.
pub fn driver_of(source: &Source, at: &str, value: &Value) -> Result<(&'static str, Value), ConfigError> {
    kind::<dyn Hardware>(source, at, value).map(|(kind, settings)| (kind.name, settings))
}

fn driver(source: &Source, at: &str, value: &Value, context: &Context) -> Result<Arc<dyn Hardware>, Complaints> {
    let (kind, mut settings) = kind::<dyn Hardware>(source, at, value)?;
    // temporary files must exist until the kind has read them
    let _sent = localize(source, at, kind, &mut settings)?;
    (kind.build)(&settings, context).map_err(|e| placed(source, at, e))
}

/// Makes the paths of a kind's settings relative to the working directory, because kinds do not have the configuration
/// file's path. Writes each file that was sent with the configuration to a temporary one, which lives as long as the
/// result; its setting's place is beside it.
fn localize<R: Role + ?Sized>(
    source: &Source,
    at: &str,
    kind: &Kind<R>,
    settings: &mut Value,
) -> Result<Vec<(String, NamedTempFile)>, ConfigError> {
    let mut sent = Vec::new();
    for PathSetting { place, path: file, is_folder, .. } in paths(R::NAME, kind.name, settings) {
        let mut path = Config::beside(source, Path::new(file.as_str()));
        let key = format!("{at}.{place}");
        // folders are not sent
        let is_sent = source.was_sent() && !is_folder && !path.is_dir();
        if is_sent && let Some(bytes) = source.bytes_sent(&key, &path).transpose()? {
            let unwritten =
                |e: std::io::Error| source.error(&key, format!("no room for it: {e}"), "make room on the disk");
            let mut copy = NamedTempFile::new().map_err(unwritten)?;
            copy.write_all(bytes).map_err(unwritten)?;
            path = copy.path().to_owned();
            sent.push((place, copy));
        }
        *file = path.to_string_lossy().into_owned();
    }
    Ok(sent)
}

/// Builds the bridges, through which external programs move robots, each with the place of its table.
fn bridges(config: &Config, source: &Source, wrong: &mut Complaints) -> Vec<(String, Arc<dyn Bridge>)> {
    let folder = Config::beside(source, Path::new(""));
    let mut all = Vec::new();
    for (at, table) in config.bridges() {
        let built =
            kind::<dyn Bridge>(source, &at, &table).map_err(Complaints::from).and_then(|(kind, mut settings)| {
                let _sent = localize(source, &at, kind, &mut settings)?;
                (kind.build)(&settings, &folder).map_err(|e| placed(source, &at, e))
            });
        let Some(bridge) = wrong.keep(built) else { continue };
        if config.clock == ClockMode::Virtual && !bridge.runs_in_virtual_time() {
            wrong.push(needs_real_clock(source, &at, "bridge"));
        }
        all.push((at, bridge));
    }
    all
}

fn needs_real_clock(source: &Source, at: &str, role: &str) -> ConfigError {
    let what = format!("this {role} runs by the wall clock, and this behavior's clock is virtual");
    source.error(at, what, "set clock = \"real\"")
}

fn agent(
    source: &Source,
    at: &str,
    value: &Value,
    context: Context,
    goals: Option<HandGoals>,
) -> Result<(AgentMaker, Requirements, Vec<ResolvedGoal>), Complaints> {
    let (kind, mut settings) = kind::<dyn Agent>(source, at, value)?;
    let sent = Arc::new(localize(source, at, kind, &mut settings)?);
    // agents take maps as JSON
    for (place, map) in crate::config::maps(<dyn Agent>::NAME, kind.name, &mut settings) {
        let Value::String(file) = &*map else { continue };
        let path = Config::beside(source, Path::new(file));
        let sent = source.text_sent(&format!("{at}.{place}"), &path).transpose()?;
        *map = crate::maps::for_agent(&path, sent)?;
    }
    let found = goals.map(|goals| goals.resolve(&mut settings)).transpose().map_err(|e| placed(source, at, e))?;
    let build = kind.build;
    let means = build(&settings, &context).map_err(|e| placed(source, at, e))?.requirements();
    let maker: AgentMaker = Arc::new(move || {
        let _sent = &sent;
        build(&settings, &context).map_err(|e| e.to_string())
    });
    Ok((maker, means, found.unwrap_or_default()))
}

/// A warning if the robot can't stop in time at the speed of its agent or of external programs: within its margin under
/// Algorithm 6, otherwise within its braking clearance of the predicted stop.
pub fn margin_warning(
    r: &crate::config::RobotConfig,
    robot: &Robot,
    hardware: &dyn Hardware,
    controller: &ControllerSettings,
    foreign: Option<f64>,
) -> Option<String> {
    if !hardware.runs_in_virtual_time() || !controller.drive.has_reflex() {
        return None;
    }
    let own = r.agent.as_ref().map(|a| a.get("speed").and_then(Value::as_f64).unwrap_or(0.1));
    let to_rest = r.rest.as_ref().map(|rest| rest.table().speed.or(own).unwrap_or(0.1));
    let speed = own.into_iter().chain(to_rest).chain(foreign).reduce(f64::max)?;
    let board = hardware.connect().ok()?.board().clone();
    let period = Duration::from_secs_f64(controller.period_s);
    if controller.reserve_m != Some(0.0) {
        let reaction = board.latency + period * 2;
        let needed = match controller.reserve_m {
            Some(_) => clearance_needed(robot, &board.axes, reaction, speed),
            // the automatic clearance grows with the speed
            None => stop_error(robot, &board.axes, reaction, speed),
        };
        let clearance = controller.reserve_m.unwrap_or(controller.margin_m);
        let remedy = match controller.reserve_m {
            Some(_) => "give a greater `reserve_mm`, or none: it then follows from the robot and its speed",
            None => "give a greater `margin_mm`",
        };
        return (clearance < needed).then(|| {
            format!(
                "{}: at this speed a stop may end {:.1} mm elsewhere than foreseen, which is more than its braking clearance of {:.1} mm; \
                 move more slowly, or {remedy}",
                r.name,
                needed * 1e3,
                clearance * 1e3
            )
        });
    }
    let warning = mobee_sim::stopping_path(robot, &board, period, speed).warning(controller.margin_m, robot)?;
    Some(format!("{}: {warning}", r.name))
}

/// The braking clearance that a robot needs at a share of its motors' maximum speeds, meters. Arguments as for [`stop_error`].
pub fn clearance_needed(robot: &Robot, axes: &[Axis], reaction: Duration, speed: f64) -> f64 {
    let way = |(axis, reach): (&Axis, f64)| {
        let speed = speed * axis.max_speed.abs();
        reach * (speed * reaction.as_secs_f64() + speed * speed / (2.0 * axis.max_acceleration.max(1e-6)))
    };
    let way: f64 = axes.iter().zip(robot.reach()).map(way).sum();
    stop_error(robot, axes, reaction, speed).max(FastClearance::new(robot, axes, reaction).after(way))
}

/// A seed for one part of the run, from the run's seed and the part's name (FNV-1a, then a final mix).
pub fn derive_seed(seed: u64, part: &str) -> u64 {
    let mut h =
        part.bytes().fold(0xcbf2_9ce4_8422_2325_u64 ^ seed, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h ^ (h >> 31)
}
