//! Maps that a behavior names by their settings: built at their first use, and stored in the user's cache.
//!
//! ```text
//! {"inputs":"<digest of builder's version, settings, robot and world>","map_sha256":"<digest of what follows>"}
//! the map, as `mobee roadmap build` writes it
//! ```
//! A map that does not match its first line, or these settings, is built again. A new map is read back before use, so
//! that its first run is the same as later ones.

use super::{BUILDER_VERSION, MAX_MAP_BYTES, complaints, inputs, map, robot, save_text, scene};
use crate::config::{Complaints, ConfigError};
use mobee_model::file::read_text;
use mobee_model::{Robot, Scene};
use mobee_planning::map_file::{MapFile, robot_digest, world_digest};
use mobee_planning::table_map::{Growth, PoseSearch, TableMapPlan};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io::ErrorKind;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The first line of a cached map.
#[derive(Serialize, Deserialize, PartialEq)]
struct Head {
    inputs: String,
    map_sha256: String,
}

/// The map of these settings.
///
/// # Errors
/// If the settings, or the robot or world that they name, can't be used; or no pose is found.
pub(super) fn of_settings(path: &Path) -> Result<MapFile, Complaints> {
    let (settings, source) = super::read_settings(path, &[])?;
    let unusable = |what: String| {
        let help = "see docs/roadmaps.md; `mobee roadmap build` builds the same map and says more";
        Complaints::from(ConfigError::plain(format!("{}: {what}", path.display()), help))
    };
    let scene = scene(&settings.robot, settings.world.as_deref()).map_err(|e| unusable(e.to_string()))?;
    let robot = robot(&scene).map_err(|e| unusable(e.to_string()))?;
    let plan = Arc::new(settings.plan(robot).map_err(|e| complaints(&source, e))?);
    let inputs = inputs(&format!("{BUILDER_VERSION} {plan:?}"), &robot_digest(robot), &world_digest(&scene));
    let cache_file = place(&inputs);
    match cache_file.as_deref().map(|cache_file| cached(cache_file, &inputs, &scene, &plan)) {
        Some(Ok(Some(map))) => return Ok(map),
        Some(Err(why)) => {
            let at = cache_file.as_deref().unwrap_or(path).display();
            tracing::warn!("the map in the cache is not used, and is built again: {at}: {why}");
        }
        Some(Ok(None)) | None => {}
    }
    tracing::warn!(
        "building the map of {} (about a minute; it is kept in the cache for the next time)",
        path.display()
    );
    let text =
        built(&scene, robot, &plan, &mut |_| ControlFlow::Continue(())).map_err(|e| unusable(e.to_string()))?.text();
    let map = MapFile::parse(&text).map_err(|e| unusable(e.what))?;
    if let Some(cache_file) = cache_file {
        let head = serde_json::to_string(&Head { inputs, map_sha256: digest(&text) }).unwrap_or_default();
        // without a cache, the map is built again next time
        let saved = cache_file.parent().is_some_and(|folder| std::fs::create_dir_all(folder).is_ok());
        let _ = saved.then(|| save_text(&cache_file, &format!("{head}\n{text}")));
    }
    Ok(map)
}

/// The map in the cache, if there is one.
///
/// # Errors
/// The reason why it is not the requested map.
fn cached(cache_file: &Path, inputs: &str, scene: &Scene, plan: &TableMapPlan) -> Result<Option<MapFile>, String> {
    let text = match read_text(cache_file, MAX_MAP_BYTES) {
        Ok(text) => text,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(e.to_string()),
    };
    let (head, text) = text.split_once('\n').unwrap_or_default();
    let head: Head = serde_json::from_str(head).map_err(|_| "it does not begin as a map in the cache")?;
    if head.inputs != inputs {
        return Err("it was built from other settings, for another robot or world, or by another version".into());
    }
    if head.map_sha256 != digest(text) {
        return Err("it was changed since it was built".into());
    }
    let map = MapFile::parse(text).map_err(|e| e.what)?;
    let robot = robot(scene).map_err(|e| e.to_string())?;
    map.check(robot).map_err(|e| e.what)?;
    let motors = plan.motors.iter().filter_map(|m| robot.motors.get(*m)).map(|m| m.name.clone());
    let hand = robot.markers.get(plan.hand).map(|m| m.name.clone());
    if map.hand != hand || map.world_sha256 != Some(world_digest(scene)) || !motors.eq(map.motors.iter().cloned()) {
        return Err("it has another hand, other motors, or another world".into());
    }
    Ok(Some(map))
}

fn digest(text: &str) -> String {
    Sha256::digest(text).iter().map(|b| format!("{b:02x}")).collect()
}

/// Builds a map.
///
/// # Arguments
/// * `watch`: called with the share that is done; ends the search.
///
/// # Errors
/// A scene that can't be compiled, or a table without any pose.
pub fn built(
    scene: &Scene,
    robot: &Robot,
    plan: &Arc<TableMapPlan>,
    watch: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<MapFile, ConfigError> {
    let mut search = PoseSearch::new(scene, Arc::clone(plan))
        .map_err(|e| ConfigError::plain(e.to_string(), "mend the robot's or the world's file"))?;
    let mut growth = Growth::new(plan, &robot.home());
    while let Some(wish) = growth.next() {
        if watch(growth.found().len() as f64 / growth.most().max(1) as f64).is_break() {
            break;
        }
        let trial = search.search(&growth, &wish);
        let found = trial.q.as_ref().and_then(|q| search.accept(&growth, &wish, q));
        growth.tell(trial.evaluations, found);
    }
    if growth.found().is_empty() {
        return Err(ConfigError::plain("no pose over the table is found", "check height, offset, hand and palm"));
    }
    Ok(map(&growth, plan, robot, world_digest(scene)))
}

/// Path of a map in the user's cache.
fn place(digest: &str) -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let cache = of("XDG_CACHE_HOME").or_else(|| of("HOME").map(|home| home.join(".cache")))?;
    Some(cache.join("mobee").join("maps").join(format!("{digest}.json")))
}
