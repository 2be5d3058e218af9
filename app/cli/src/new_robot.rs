//! `mobee new --robot` and `--arm`: a behavior for your own robot, from its URDF, or for an arm whose model is shipped.

mod chain;
mod driver;
#[cfg(feature = "feetech")]
mod own_arm;

pub use driver::NewDriver;

use crate::arms;
use crate::model_convert;
use crate::new::{SCHEMA, file_stem, save_all};
use crate::robot_import::ImportArgs;
use chain::Chain;
use driver::DriverText;
use miette::{Report, miette};
use mobee_compose::config::ConfigError;
use mobee_import::{Imported, plain_name};
use mobee_model::{JointMotion, Robot};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

/// Minimum number of motors of an SRDF group that counts as an arm.
const MIN_ARM_MOTORS: usize = 3;
/// Control period of the written behavior, milliseconds.
const PERIOD_MS: u64 = 20;
/// Share of the maximum speeds with which it explores.
const EXPLORE_SPEED: f64 = 0.1;
/// The margin of a controller that states none, millimeters.
const MARGIN_MM: f64 = 10.0;

/// Writes the robot, an empty world and a behavior that explores; returns a summary of the decisions.
///
/// # Errors
/// If the URDF can't be converted, or a file would be overwritten. Nothing is written then.
pub fn command(name: &str, from: &str, urdf: &Path, driver: NewDriver, import: &ImportArgs) -> Result<String, Report> {
    if from != "explore" {
        return Err(miette!(
            help = "leave --from out, and change the agent in the file that is written",
            "`--robot` can only be combined with `--from explore`, not with `{from}`"
        ));
    }
    let (dir, stem) = file_stem(name)?;
    let model = urdf.file_stem().and_then(|s| s.to_str()).unwrap_or("robot");
    let files = [format!("{stem}.toml"), format!("{stem}-world.xml"), format!("{model}.xml"), SCHEMA.to_owned()];
    let [behavior, world, robot, schema] = files.map(|file| dir.join(file));
    if let Some(there) = [&behavior, &world, &robot].into_iter().find(|f| f.exists()) {
        let help = "give another name, or work in another folder; nothing is written over";
        return Err(miette!(help = help, "{} exists already", there.display()));
    }
    let imported = import.import(urdf)?;
    let chain = chain::choose(&imported).ok_or_else(|| {
        miette!(help = "an exploration needs at least one movable joint", "{} has no motor that moves", urdf.display())
    })?;
    let driver = driver::text(
        driver,
        &imported.robot,
        (&plain_name(&imported.robot.name), model),
        imported.margin_mm.unwrap_or(MARGIN_MM),
    );
    let texts = [
        (&robot, imported.file_text(urdf, &robot)?),
        (&world, WORLD.to_owned()),
        (&behavior, behavior_text(&stem, &imported, (model, &driver), &chain.motors)),
        (&schema, mobee_compose::schema::text()),
    ];
    save_all(&texts.each_ref().map(|(file, text)| (file.as_path(), text.as_str())))?;
    let mut out = model_convert::summary(&robot, &imported);
    out += &explored(&imported.robot, &chain);
    out += &driver.note;
    texts.iter().for_each(|(file, _)| out += &format!("{}\n", file.display()));
    Ok(out + &format!("now: mobee run {}\n", behavior.display()))
}

/// Options of a behavior for an arm of servos.
#[derive(clap::Args)]
pub struct ArmArgs {
    /// An arm of servos on a serial bus, such as so101: a behavior that explores with it, its model and its table.
    #[arg(long, value_name = "ARM", conflicts_with_all = ["crate_name", "robot", "from"])]
    arm: Option<String>,
    /// The serial port of the arm, such as /dev/ttyACM0.
    #[arg(long, value_name = "PORT", requires = "arm")]
    port: Option<String>,
    /// The arm's calibration: that of LeRobot, or of `mobee calibrate`.
    #[arg(long, value_name = "FILE.json", requires = "arm")]
    calibration: Option<PathBuf>,
}

impl ArmArgs {
    /// Writes the behavior; `None` if no arm is given.
    ///
    /// # Errors
    /// If the arm is unknown, there is no port, this program lacks the driver, or as for [`command`].
    pub fn write(&self, name: &str) -> Option<Result<String, Report>> {
        self.arm.as_ref().map(|arm| self.write_arm(name, arm))
    }

    fn write_arm(&self, name: &str, arm: &str) -> Result<String, Report> {
        let arm = arms::known(arm)?;
        let Some(port) = self.port.as_deref().filter(|port| !port.trim().is_empty()) else {
            let help = "--port /dev/ttyACM0, for example: ls /dev/ttyACM* /dev/ttyUSB* lists the ports that are there";
            return Err(ConfigError::plain(format!("{} needs the serial port it is at", arm.name), help).into());
        };
        #[cfg(feature = "feetech")]
        return own_arm::command(name, arm, port, self.calibration.as_deref());
        #[cfg(not(feature = "feetech"))]
        Err({
            let _ = (name, port, &self.calibration);
            arms::lacks_driver().into()
        })
    }
}

/// A line for each written file.
pub(crate) fn files_text(files: &[PathBuf]) -> String {
    files.iter().map(|file| format!("{}\n", file.display())).collect()
}

/// The line about the motors of the exploration: their origin, the first and the last, and the excluded fingers.
fn explored(robot: &Robot, chain: &Chain) -> String {
    let names = names(robot, &chain.motors);
    let ends = match names.as_slice() {
        [first, .., last] => format!("{first} to {last}"),
        all => all.concat(),
    };
    let mut line = format!("  motors to explore with: {} ({}): {ends}", chain.named, names.len());
    if !chain.fingers.is_empty() {
        line += &format!("; without the hand's: {}", self::names(robot, &chain.fingers).join(", "));
    }
    line + "\n"
}

fn names(robot: &Robot, motors: &[usize]) -> Vec<String> {
    motors.iter().filter_map(|m| robot.motors.get(*m)).map(|m| m.name.clone()).collect()
}

/// Limits one revolution about home for each motor with a greater range: configurations a revolution apart are
/// equivalent, and free space between them is rarely connected.
fn one_turn(robot: &Robot, motors: &[usize]) -> String {
    let range = |m: &usize| {
        let motor = robot.motors.get(*m)?;
        let turns = motor.motion == JointMotion::Turn && !motor.continuous && motor.max - motor.min > TAU + 1e-6;
        let [min, max] = [motor.min.max(motor.home - PI), motor.max.min(motor.home + PI)].map(f64::to_degrees);
        let name = toml::Value::String(motor.name.clone());
        turns.then(|| format!("{name} = [{}, {}]", min.ceil(), max.floor()))
    };
    let ranges: Vec<String> = motors.iter().filter_map(range).collect();
    if ranges.is_empty() {
        String::new()
    } else {
        format!("range_deg = {{ {} }} # one turn about home\n", ranges.join(", "))
    }
}

const WORLD: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<!-- What the robot could touch but itself. Meters, in the frame of the robot's root link. Such as:
  <object name="table" persistent="1" px="0.6"><box width="0.6" height="1" depth="0.04"/></object>
-->
<WorldList version="1.0">
</WorldList>
"#;

fn behavior_text(stem: &str, imported: &Imported, (model, driver): (&str, &DriverText), chain: &[usize]) -> String {
    let robot: &Robot = &imported.robot;
    let name = plain_name(&robot.name);
    // quote as TOML requires
    let text = |s: &str| toml::Value::String(s.to_owned()).to_string();
    let motors: Vec<String> = names(robot, chain).iter().map(|m| text(m)).collect();
    format!(
        r#"#:schema ./{SCHEMA}
# {name} builds a roadmap: random configurations of the motors below, each joined to its nearest. A path is certified in the model
# before it is driven (validation = "lazy"); the robot drives the edges until it has tried all that can be reached.
# The paper's trial and error: validation = "optimistic".
#
#   mobee run {stem}.toml

seed = 1
{top}world.file = "{stem}-world.xml"

[[robot]]
name = "{name}"
model = {model}
controller = {{ period_ms = {PERIOD_MS}, history = 6000{margin}{implied} }} # the history holds a minute of poses{why}
{driver}
[robot.agent]
kind = "explorer"
motors = [{motors}]
vertices = 20
neighbors = 10
speed = {EXPLORE_SPEED}
validation = "lazy"
{ranges}{poses}"#,
        top = driver.top,
        implied = driver.controller,
        driver = driver.table,
        ranges = one_turn(robot, chain),
        poses = poses_text(&imported.poses),
        model = text(&format!("{model}.xml")),
        motors = motors.join(", "),
        margin = imported.margin_mm.map(|mm| format!(", margin_mm = {mm:.1}")).unwrap_or_default(),
        why = if imported.margin_mm.is_some() { "; no home is free by the default margin of 10 mm" } else { "" },
    )
}

/// An alternative agent that visits the SRDF's named poses, as a comment.
fn poses_text(poses: &BTreeMap<String, Vec<(String, f64)>>) -> String {
    if poses.is_empty() {
        return String::new();
    }
    let text = |s: &str| toml::Value::String(s.to_owned()).to_string();
    let mut out = "\n# The SRDF's named poses; an agent that goes from one to the next, instead of the one above:\n\
                   # [robot.agent]\n# kind = \"scripted\"\n# poses = [\n"
        .to_owned();
    for (name, motors) in poses {
        let q: Vec<String> = motors.iter().map(|(motor, q)| format!("{} = {q:.2}", text(motor))).collect();
        // a foreign name must not end the comment
        let name: String = name.chars().filter(|c| !c.is_control()).collect();
        out += &format!("#   {{ q_deg = {{ {} }} }}, # {name}\n", q.join(", "));
    }
    out + "# ]\n"
}
