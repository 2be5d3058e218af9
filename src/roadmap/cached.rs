//! Maps that a behavior names by their settings: built when they are first asked for, and kept in the user's cache.

use super::build::map;
use super::part::inputs;
use super::{load_for, robot, save, scene};
use crate::config::{Complaints, ConfigError};
use miette::Report;
use mobee_behaviors::map_file::{MapFile, robot_digest, world_digest};
use mobee_behaviors::table_map::{Growth, PoseSearch};
use mobee_model::{Robot, Scene};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The map that these settings describe.
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
    let plan = Arc::new(settings.plan(robot).map_err(|e| super::build::complaints(&source, e))?);
    let kept = place(&inputs(&format!("{plan:?}"), &robot_digest(robot), &world_digest(&scene)));
    if let Some(map) = kept.as_deref().and_then(|kept| load_for(kept, robot).ok()) {
        return Ok(map);
    }
    eprintln!("building the map of {} (about a minute; it is kept in the cache for the next time)", path.display());
    let map = built(&scene, robot, &plan).map_err(|e| unusable(e.to_string()))?;
    if let Some(kept) = kept {
        // whoever has no cache builds it again
        let saved = kept.parent().is_some_and(|folder| std::fs::create_dir_all(folder).is_ok());
        let _ = saved.then(|| save(&kept, &map));
    }
    Ok(map)
}

fn built(
    scene: &Scene,
    robot: &Robot,
    plan: &Arc<mobee_behaviors::table_map::TableMapPlan>,
) -> Result<MapFile, Report> {
    let mut search = PoseSearch::new(scene, Arc::clone(plan)).map_err(|e| miette::miette!("{e}"))?;
    let mut growth = Growth::new(plan, &robot.home());
    while let Some(wish) = growth.next() {
        let trial = search.search(&growth, &wish);
        let found = trial.q.as_ref().and_then(|q| search.accept(&growth, &wish, q));
        growth.tell(trial.evaluations, found);
    }
    if growth.found().is_empty() {
        return Err(miette::miette!("no pose over the table is found"));
    }
    Ok(map(&growth, plan, robot, world_digest(scene)))
}

/// Where the user's programs keep what they can make again.
fn place(digest: &str) -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let cache = of("XDG_CACHE_HOME").or_else(|| of("HOME").map(|home| home.join(".cache")))?;
    Some(cache.join("mobee").join("maps").join(format!("{digest}.json")))
}
