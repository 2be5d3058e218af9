//! `mobee new --robot`: a behavior for a robot of one's own, from its URDF.

use crate::model_convert;
use crate::new::{SCHEMA, file_stem};
use crate::robot_import::{ImportArgs, Imported, plain_name};
use miette::{IntoDiagnostic, Report, WrapErr, miette};
use mobee_model::Robot;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// With more motors than this, an exploration by trial reaches little of what there is.
const MOST_MOTORS: usize = 12;
/// A group of fewer is no arm.
const FEWEST_MOTORS: usize = 3;

/// Writes the robot, an empty world and a behavior that explores; says what was decided.
///
/// # Errors
/// If the URDF can't be converted, or a file would be written over. Nothing is written then.
pub fn command(name: &str, from: &str, urdf: &Path, import: &ImportArgs) -> Result<String, Report> {
    if from != "explore" {
        return Err(miette!(
            help = "leave --from out, and change the agent in the file that is written",
            "a robot of one's own starts from `explore`, not from `{from}`"
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
    let (chosen, motors) = motors(&imported).ok_or_else(|| {
        miette!(help = "a robot explores with a motor at least", "{} has no motor that moves", urdf.display())
    })?;
    let texts = [
        (&robot, model_convert::text(urdf, &robot, &imported)?),
        (&world, WORLD.to_owned()),
        (&behavior, behavior_text(&stem, &imported, model, &motors)),
        (&schema, crate::schema::text()),
    ];
    for (file, text) in &texts {
        write(file, text)?;
    }
    let mut out = model_convert::summary(&robot, &imported);
    out += &format!("  motors to explore with: {chosen}\n");
    texts.iter().for_each(|(file, _)| out += &format!("{}\n", file.display()));
    Ok(out + &format!("now: mobee run {}\n", behavior.display()))
}

fn write(file: &PathBuf, text: &str) -> Result<(), Report> {
    let what = || format!("can't write {}; check the folder's space and permissions", file.display());
    std::fs::write(file, text).into_diagnostic().wrap_err_with(what)
}

const WORLD: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<!-- What the robot could touch but itself. Meters, in the frame of the robot's root link. Such as:
  <object name="table" persistent="1" px="0.6"><box width="0.6" height="1" depth="0.04"/></object>
-->
<WorldList version="1.0">
</WorldList>
"#;

fn behavior_text(stem: &str, imported: &Imported, model: &str, motors: &[String]) -> String {
    let robot: &Robot = &imported.robot;
    let name = plain_name(&robot.name);
    // what TOML writes between quotes is what it reads
    let text = |s: &str| toml::Value::String(s.to_owned()).to_string();
    let motors: Vec<String> = motors.iter().map(|m| text(m)).collect();
    format!(
        r#"#:schema ./{SCHEMA}
# {name} builds a roadmap by trial: random poses of the motors below, each joined to its nearest; the robot drives the edges until it
# knows which of them are feasible.
#
#   mobee run {stem}.toml

seed = 1
world.file = "{stem}-world.xml"

[[robot]]
name = "{name}"
model = {model}
controller = {{ period_ms = 20, history = 6000{margin} }} # the history holds a minute of poses{why}
driver = {{ kind = "sim" }}

[robot.agent]
kind = "explorer"
motors = [{motors}]
vertices = 20
neighbors = 10
speed = 0.1
{poses}"#,
        poses = poses_text(&imported.poses),
        model = text(&format!("{model}.xml")),
        motors = motors.join(", "),
        margin = imported.margin_mm.map(|mm| format!(", margin_mm = {mm:.1}")).unwrap_or_default(),
        why = if imported.margin_mm.is_some() { "; no home is free by the default margin of 10 mm" } else { "" },
    )
}

/// An agent that goes through the SRDF's named poses, for whoever wants it instead: as a comment.
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
        // a name from outside may not end the comment
        let name: String = name.chars().filter(|c| !c.is_control()).collect();
        out += &format!("#   {{ q_deg = {{ {} }} }}, # {name}\n", q.join(", "));
    }
    out + "# ]\n"
}

/// The motors to explore with, and whose they are: the SRDF's arm, or the longest chain.
fn motors(imported: &Imported) -> Option<(String, Vec<String>)> {
    let robot = &imported.robot;
    let names = |motors: &[usize]| motors.iter().filter_map(|m| robot.motors.get(*m)).map(|m| m.name.clone()).collect();
    let arm = imported.groups.iter().filter(|(name, motors)| {
        let name = name.to_lowercase();
        (name.contains("arm") || name.contains("manipulator")) && (FEWEST_MOTORS..=MOST_MOTORS).contains(&motors.len())
    });
    if let Some((name, motors)) = arm.max_by_key(|(_, motors)| motors.len()) {
        return Some((format!("the SRDF's group `{name}` ({})", motors.len()), names(motors)));
    }
    let mut chain = robot.longest_chain();
    chain.truncate(MOST_MOTORS);
    (!chain.is_empty()).then(|| (format!("the longest chain ({})", chain.len()), names(&chain)))
}
