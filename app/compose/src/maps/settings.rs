//! A map's settings: `configs/roadmaps/*.toml`.

use crate::config::{Complaints, Source, did_you_mean, misfits};
use mobee_planning::table_map::TableMapSettings;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use std::path::Path;

/// Reads a settings file, with overrides as of `--set`; its paths are then relative to the working directory.
///
/// # Errors
/// All errors, each with its place.
pub fn read(path: &Path, set: &[String]) -> Result<(TableMapSettings, Source), Complaints> {
    let (mut settings, source) = read_table::<TableMapSettings>(path, set, "docs/roadmaps.md")?;
    let folder = path.parent().unwrap_or(Path::new(""));
    settings.robot = folder.join(source.relocated("robot", &settings.robot));
    settings.world = settings.world.map(|world| folder.join(source.relocated("world", &world)));
    Ok((settings, source))
}

/// Reads a settings file of any kind, which `docs` describes.
///
/// # Errors
/// All errors, each with its place.
pub fn read_table<T: DeserializeOwned + JsonSchema>(
    path: &Path,
    set: &[String],
    docs: &str,
) -> Result<(T, Source), Complaints> {
    let source = Source::load(path, set)?;
    let mut wrong = Complaints::default();
    for m in misfits(&schemars::schema_for!(T).to_value(), &source.value) {
        wrong.push(source.complain(&m.steps, m.at_key, m.what, m.help));
    }
    match serde_path_to_error::deserialize(&source.value) {
        Ok(settings) => wrong.none_or((settings, source)),
        Err(_) if !wrong.is_empty() => Err(wrong),
        Err(e) => {
            let message = e.inner().to_string();
            let help = did_you_mean(&message).unwrap_or_else(|| format!("see {docs} for every setting"));
            Err(source.error(&e.path().to_string(), message, help).into())
        }
    }
}
