//! Maps of agents: read from files, or built from settings and stored in the user's cache.

mod cached;
mod settings;

pub use cached::built;
pub use settings::{read as read_settings, read_table};

use crate::config::{Complaints, ConfigError, Source};
use mobee_contract::KindError;
use mobee_model::file::{MIB, read_text};
use mobee_model::{Robot, Scene, load_robot, load_world};
use mobee_planning::map_file::MapFile;
use mobee_planning::roadmap::{Roadmap, Vertex};
use mobee_planning::table_map::{Growth, TableMapPlan};
use nalgebra::Isometry3;
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Maximum size of a map file, bytes.
const MAX_MAP_BYTES: u64 = 64 * MIB;
/// Version of the search, to be raised if it finds other poses for the same settings.
pub const BUILDER_VERSION: u32 = 1;

/// A scene of one robot in a world.
pub fn scene(robot: &Path, world: Option<&Path>) -> Result<Scene, Complaints> {
    let loaded = Arc::new(load_robot(robot)?.value);
    let objects = world.map(load_world).transpose()?.map(|w| w.value).unwrap_or_default();
    Scene::new(vec![(loaded, Isometry3::identity())], objects)
        .map_err(|e| ConfigError::plain(e.to_string(), "mend the world's or the robot's file").into())
}

/// The scene's robot.
pub fn robot(scene: &Scene) -> Result<&Arc<Robot>, ConfigError> {
    scene.robots().first().ok_or_else(|| ConfigError::plain("the scene has no robot", "name a robot"))
}

/// Loads a map and its text, for complaints.
pub fn load(path: &Path) -> Result<(MapFile, String), ConfigError> {
    let text = read_text(path, MAX_MAP_BYTES).map_err(|e| {
        let help = "give a map as `mobee roadmap build` or `mobee run` wrote it";
        ConfigError::plain(format!("can't read {}: {e}", path.display()), help)
    })?;
    Ok((parsed(path, &text)?, text))
}

/// Parses the text of a map file.
///
/// # Errors
/// The error in the text, with its place.
pub fn parsed(path: &Path, text: &str) -> Result<MapFile, ConfigError> {
    MapFile::parse(text).map_err(|e| ConfigError::at(&path.display().to_string(), text, e.span, e.what, e.help))
}

/// A map for an agent, as JSON: from the disk, as sent by a client, or built from settings (a file `.toml`).
///
/// # Errors
/// If it can't be read, is not a map, or a client sent settings.
pub fn for_agent(path: &Path, sent: Option<&str>) -> Result<Value, Complaints> {
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

/// All errors of the settings as complaints, with their places.
pub fn complaints(source: &Source, error: KindError) -> Complaints {
    let mut wrong = Complaints::default();
    error.all().into_iter().for_each(|e| wrong.push(source.error(&e.path, e.what, e.help)));
    wrong
}

/// The map of the poses that a search found, each joined to its nearest neighbors.
pub fn map(growth: &Growth, plan: &TableMapPlan, robot: &Robot, world: String) -> MapFile {
    let mut map = Roadmap::new(plan.motors.clone(), robot);
    for found in growth.found() {
        map.add(Vertex { name: None, q: found.whole.clone(), at: found.at });
    }
    map.join_nearest(plan.neighbors);
    let mut file = map.file(robot);
    file.world_sha256 = Some(world);
    file.hand = robot.markers.get(plan.hand).map(|m| m.name.clone());
    file
}

/// Digest of a build's inputs.
pub fn inputs(settings: &str, robot: &str, world: &str) -> String {
    let mut sum = Sha256::new();
    for text in [settings, robot, world] {
        sum.update((text.len() as u64).to_le_bytes());
        sum.update(text);
    }
    sum.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Like the map's, for any text.
pub fn save_text(path: &Path, text: &str) -> Result<(), ConfigError> {
    is_replaceable(path)?;
    let written = stage(path, text).and_then(|file| file.persist(path).map(drop).map_err(|e| e.error));
    written.map_err(|e| {
        let help = "check the folder's space and permissions; what was there before is unchanged";
        ConfigError::plain(format!("can't write {}: {e}", path.display()), help)
    })
}

/// Writes a text into a temporary file in the target's folder.
pub fn stage(path: &Path, text: &str) -> std::io::Result<tempfile::NamedTempFile> {
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

/// Checks that there is nothing or a regular file at this path: a device must not be replaced by a file.
pub fn is_replaceable(path: &Path) -> Result<(), ConfigError> {
    match std::fs::metadata(path) {
        Ok(there) if !there.is_file() => {
            let kind = if there.is_dir() { "a folder" } else { "a device or a pipe" };
            let what = format!("{} is {kind}, not a file", path.display());
            Err(ConfigError::plain(what, "name a new file, or one to replace"))
        }
        _ => Ok(()),
    }
}
