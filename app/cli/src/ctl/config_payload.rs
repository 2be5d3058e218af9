//! Collects a configuration file and all files that it names for `mobee ctl swap`. They are read and checked here, with
//! the client's rights: the run opens no files on behalf of a client.

use super::wire::{MAX_LINE_BYTES, SentConfig};
use miette::{IntoDiagnostic, Report};
use mobee_compose::config::{Config, ConfigError, KindTable, Source, maps, paths};
use mobee_compose::from_source;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Reads and checks a whole file as `mobee check` does.
///
/// # Errors
/// All complaints about it, with their places.
pub(super) fn read(file: &Path) -> Result<SentConfig, Report> {
    let file = file.canonicalize().map_err(|e| {
        ConfigError::plain(format!("{}: {e}", file.display()), "give a configuration file that can be read")
    })?;
    let source = Source::load(&file, &[])?;
    of(file, &source)
}

/// Like [`read`], for values that were read from this file.
///
/// # Errors
/// As for [`read`].
pub(super) fn of(file: PathBuf, source: &Source) -> Result<SentConfig, Report> {
    let config = from_source(source)?.config;
    let value = serde_json::to_value(&config).into_diagnostic()?;
    let mut sent = SentConfig { file, config: value, texts: BTreeMap::new(), binaries: BTreeMap::new() };
    for path in named(config, source) {
        let bytes = mobee_model::file::read(&path, MAX_LINE_BYTES as u64)
            .map_err(|e| ConfigError::plain(format!("{}: {e}", path.display()), "give a file that can be read"))?;
        sent.put(path, bytes);
    }
    Ok(sent)
}

/// The files that a configuration names. Folders are not sent.
fn named(mut config: Config, source: &Source) -> Vec<PathBuf> {
    let models: Vec<PathBuf> = config.robot.iter().map(|r| r.model.clone()).chain(config.world.file.clone()).collect();
    let mut files = Vec::new();
    let mut roadmaps = Vec::new();
    for KindTable { role, kind, table, .. } in config.kind_tables() {
        let of_kind = paths(role, &kind, table).filter(|setting| !setting.is_folder);
        files.extend(of_kind.map(|setting| PathBuf::from(setting.path.as_str())));
        roadmaps.extend(maps(role, &kind, table).into_iter().filter_map(|(_, map)| Some(PathBuf::from(map.as_str()?))));
    }
    let files = files.into_iter().map(|path| Config::beside(source, &path)).filter(|path| !path.is_dir());
    let all = models.iter().chain(&roadmaps).map(|path| Config::beside(source, path));
    all.chain(files).collect()
}
