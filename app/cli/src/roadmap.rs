//! `mobee roadmap`: maps in files, from their first pose to a plan.

mod build;
mod certified;
mod improve;
mod info;
mod merge;
mod part;
mod path;
mod trajectory;
mod validate;
mod view;

pub use improve::{ImproveSettings, improve};
pub(crate) use path::{positive, share};
pub(crate) use trajectory::{Speeds, Trajectory};

use miette::Report;
use mobee_compose::config::ConfigError;
use mobee_compose::maps::{is_replaceable, load, map, read_settings, robot, save_text, scene};
use mobee_model::{Labels, Robot, Scene, load_robot};
use mobee_planning::map_file::MapFile;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// The commands on maps.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum RoadmapCommand {
    /// Find poses of a hand over a table, and join them to a map. An interrupted build is continued.
    Build(build::BuildArgs),
    /// Show the contents of a map.
    Info {
        /// The map.
        map: PathBuf,
        /// Robot XML: names the links that block edges.
        #[arg(long, value_name = "FILE")]
        robot: Option<PathBuf>,
    },
    /// Certify every edge of a map by continuous collision checking, and store its obstacle.
    Validate(validate::ValidateArgs),
    /// Join unreachable parts of a map to the rest by a planner, add poses, and remove parts that stay apart.
    Improve(improve::ImproveArgs),
    /// Merge maps of one robot and world; their order does not matter.
    Merge(merge::MergeArgs),
    /// Plan a path on a map, from one vertex to another.
    Path(path::PathArgs),
    /// Show a map in the Rerun viewer: hand positions over the table, edges by obstacle.
    View(view::ViewMapArgs),
}

/// Runs the command. Exit code 1 means that there is no path.
///
/// # Errors
/// If a file can't be read or written, or does not fit the others, with its place and the remedy.
pub fn command(command: &RoadmapCommand) -> Result<ExitCode, Report> {
    let text = match command {
        RoadmapCommand::Build(args) => build::command(args)?,
        RoadmapCommand::Info { map, robot: None } => info::text(&load(map)?.0, None),
        RoadmapCommand::Info { map, robot: Some(file) } => {
            let robot = Arc::new(load_robot(file)?.value);
            info::text(&load_for(map, &robot)?, Some(&Labels::new(std::slice::from_ref(&robot))))
        }
        RoadmapCommand::Validate(args) => validate::command(args)?,
        RoadmapCommand::Improve(args) => improve::command(args)?,
        RoadmapCommand::Merge(args) => merge::command(args)?,
        RoadmapCommand::Path(args) => return path::command(args),
        RoadmapCommand::View(args) => view::command(args)?,
    };
    crate::terminal::out(&text);
    Ok(ExitCode::SUCCESS)
}

/// The robot of a map, and a world to show it in.
#[derive(clap::Args, Clone, Debug)]
struct PlaceArgs {
    /// Robot XML: the one that the map was made for.
    #[arg(long, value_name = "FILE")]
    robot: PathBuf,
    /// World XML.
    #[arg(long, value_name = "FILE")]
    world: Option<PathBuf>,
}

impl PlaceArgs {
    fn scene(&self) -> Result<Scene, Report> {
        Ok(scene(&self.robot, self.world.as_deref())?)
    }
}

/// The text of the map that an agent left at the end of a run; `None` if it is not a map of ours.
pub(crate) fn left_behind(map: &Value, run: &str) -> Option<String> {
    let mut map = MapFile::from_value(map).ok()?;
    map.label(run);
    Some(map.text())
}

/// Loads a map and checks that it belongs to this robot.
fn load_for(path: &Path, robot: &Robot) -> Result<MapFile, Report> {
    let (map, text) = load(path)?;
    match map.check(robot) {
        Ok(()) => Ok(map),
        Err(e) => {
            let span = mobee_planning::map_file::span(&text, &e.path);
            Err(ConfigError::at(&path.display().to_string(), &text, span, e.what, e.help).into())
        }
    }
}

/// Writes a map atomically: a concurrent reader gets the old one.
fn save(path: &Path, map: &MapFile) -> Result<(), Report> {
    Ok(save_text(path, &map.text())?)
}

/// Checks that a file may be written.
pub(crate) fn may_write(path: &Path, force: bool) -> Result<(), Report> {
    is_replaceable(path)?;
    if !path.exists() || force {
        return Ok(());
    }
    let help = "name another file, or replace it with --force";
    Err(ConfigError::plain(format!("{} exists already", path.display()), help).into())
}
