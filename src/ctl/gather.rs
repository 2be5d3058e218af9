//! A configuration file as `mobee ctl swap` sends it: read and checked here, by the rights of who asks, with everything that it
//! names. The run opens nothing for others.

use super::wire::{LONGEST, Sent};
use crate::compose::from_source;
use crate::config::{Config, ConfigError, Source, maps};
use miette::{IntoDiagnostic, Report};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Reads and checks a whole file as `mobee check` does.
///
/// # Errors
/// Everything that is wrong with it, with its place.
pub(super) fn read(file: &Path) -> Result<Sent, Report> {
    let file = file.canonicalize().map_err(|e| {
        ConfigError::plain(format!("{}: {e}", file.display()), "give a configuration file that can be read")
    })?;
    let source = Source::load(&file, &[])?;
    of(file, &source)
}

/// The same of values that were read, of a file that stands there.
///
/// # Errors
/// As for [`read`].
pub(super) fn of(file: PathBuf, source: &Source) -> Result<Sent, Report> {
    let config = from_source(source)?.config;
    let value = serde_json::to_value(&config).into_diagnostic()?;
    let mut sent = Sent { file, config: value, texts: BTreeMap::new(), binaries: BTreeMap::new() };
    for path in named(config, source) {
        let bytes = mobee_model::file::read(&path, LONGEST as u64)
            .map_err(|e| ConfigError::plain(format!("{}: {e}", path.display()), "give a file that can be read"))?;
        sent.put(path, bytes);
    }
    Ok(sent)
}

/// The files that a configuration names.
fn named(mut config: Config, source: &Source) -> Vec<PathBuf> {
    let learned = config.sensor_paths().filter(|(at, _)| at.ends_with(".file"));
    let learned: Vec<PathBuf> = learned.map(|(_, file)| PathBuf::from(file.as_str())).collect();
    let agents = config.robot.iter_mut().flat_map(|r| r.agent.iter_mut());
    let roadmaps: Vec<PathBuf> =
        agents.flat_map(maps).filter_map(|(_, map)| Some(PathBuf::from(map.as_str()?))).collect();
    let models = config.robot.iter().map(|r| r.model.as_path());
    let tables = config.robot.iter().filter_map(|r| r.driver.get("file")?.as_str()).map(Path::new);
    let learned = learned.iter().map(PathBuf::as_path);
    let all = models
        .chain(tables)
        .chain(roadmaps.iter().map(PathBuf::as_path))
        .chain(learned)
        .chain(config.world.file.as_deref());
    all.map(|path| Config::beside(source, path)).collect()
}
