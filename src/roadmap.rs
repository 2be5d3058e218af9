//! `mobee roadmap`: maps in files, from their first pose to a plan.

mod build;
mod cached;
mod certified;
mod improve;
mod info;
mod merge;
mod part;
mod path;
mod settings;
mod trajectory;
mod validate;
mod view;

pub(crate) use path::{positive, share};
pub(crate) use trajectory::{Speeds, Trajectory};

use crate::config::{Complaints, ConfigError};
use miette::{Report, miette};
use mobee_behaviors::map_file::MapFile;
use mobee_model::file::{MIB, read_text};
use mobee_model::{Labels, Robot, Scene, load_robot, load_world};
use nalgebra::Isometry3;
use serde_json::Value;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

pub use cached::built;
pub use improve::{ImproveSettings, improve};
pub use settings::{read as read_settings, read_table};

/// Maximum size of a map file, bytes.
const MAX_MAP_BYTES: u64 = 64 * MIB;

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
        scene(&self.robot, self.world.as_deref())
    }
}

/// A scene of one robot in a world.
pub(crate) fn scene(robot: &Path, world: Option<&Path>) -> Result<Scene, Report> {
    let loaded = Arc::new(load_robot(robot)?.value);
    let objects = world.map(load_world).transpose()?.map(|w| w.value).unwrap_or_default();
    Scene::new(vec![(loaded, Isometry3::identity())], objects).map_err(|e| miette!("{e}"))
}

/// The scene's robot.
pub(crate) fn robot(scene: &Scene) -> Result<&Arc<Robot>, Report> {
    scene.robots().first().ok_or_else(|| miette!("the scene has no robot"))
}

/// Loads a map and its text, for complaints.
fn load(path: &Path) -> Result<(MapFile, String), ConfigError> {
    let text = read_text(path, MAX_MAP_BYTES).map_err(|e| {
        let help = "give a map as `mobee roadmap build` or `mobee run` wrote it";
        ConfigError::plain(format!("can't read {}: {e}", path.display()), help)
    })?;
    Ok((parsed(path, &text)?, text))
}

fn parsed(path: &Path, text: &str) -> Result<MapFile, ConfigError> {
    MapFile::parse(text).map_err(|e| ConfigError::at(&path.display().to_string(), text, e.span, e.what, e.help))
}

/// A map for an agent, as JSON: from the disk, as sent by a client, or built from settings (a file `.toml`).
///
/// # Errors
/// If it can't be read, is not a map, or a client sent settings.
pub(crate) fn for_agent(path: &Path, sent: Option<&str>) -> Result<Value, Complaints> {
    let map = match sent {
        Some(_) if is_settings(path) => {
            let what = format!("{}: a map that is still to be built can't be sent", path.display());
            let help = "build it by `mobee roadmap build`, and name the map";
            return Err(ConfigError::plain(what, help).into());
        }
        Some(text) => parsed(path, text)?,
        None if is_settings(path) => cached::of_settings(path)?,
        None => load(path)?.0,
    };
    Ok(serde_json::to_value(map).unwrap_or_default())
}

fn is_settings(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "toml")
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
            let span = mobee_behaviors::map_file::span(&text, &e.path);
            Err(ConfigError::at(&path.display().to_string(), &text, span, e.what, e.help).into())
        }
    }
}

/// Writes a map atomically: a concurrent reader gets the old one.
fn save(path: &Path, map: &MapFile) -> Result<(), Report> {
    save_text(path, &map.text())
}

/// Like [`save`], for any text.
pub(crate) fn save_text(path: &Path, text: &str) -> Result<(), Report> {
    is_replaceable(path)?;
    let written = stage(path, text).and_then(|file| file.persist(path).map(drop).map_err(|e| e.error));
    written.map_err(|e| {
        let help = "check the folder's space and permissions; what was there before is unchanged";
        ConfigError::plain(format!("can't write {}: {e}", path.display()), help).into()
    })
}

/// Writes a text into a temporary file in the target's folder.
pub(crate) fn stage(path: &Path, text: &str) -> std::io::Result<tempfile::NamedTempFile> {
    let dir = path.parent().filter(|d| !d.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(dir)?;
    file.write_all(text.as_bytes())?;
    file.as_file().sync_all()?;
    // readable by all, as ordinary files are
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.as_file().set_permissions(std::fs::Permissions::from_mode(0o644))?;
    }
    Ok(file)
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

/// Checks that there is nothing or a regular file at this path: a device must not be replaced by a file.
fn is_replaceable(path: &Path) -> Result<(), ConfigError> {
    match std::fs::metadata(path) {
        Ok(there) if !there.is_file() => {
            let kind = if there.is_dir() { "a folder" } else { "a device or a pipe" };
            let what = format!("{} is {kind}, not a file", path.display());
            Err(ConfigError::plain(what, "name a new file, or one to replace"))
        }
        _ => Ok(()),
    }
}
