//! A map's settings: `configs/roadmaps/*.toml`.

use crate::config::{Complaints, Source, did_you_mean, misfits};
use mobee_behaviors::table_map::TableMapSettings;
use std::path::Path;

/// Reads a file of settings, with overrides as of `--set`; paths in it are then as seen from here.
///
/// # Errors
/// All that is wrong, each with its place.
pub fn read(path: &Path, set: &[String]) -> Result<(TableMapSettings, Source), Complaints> {
    let source = Source::load(path, set)?;
    let schema = schemars::schema_for!(TableMapSettings).to_value();
    let mut wrong = Complaints::default();
    for m in misfits(&schema, &source.value) {
        wrong.push(source.complain(&m.steps, m.at_key, m.what, m.help));
    }
    let mut settings: TableMapSettings = match serde_path_to_error::deserialize(&source.value) {
        Ok(settings) => settings,
        Err(_) if !wrong.is_empty() => return Err(wrong),
        Err(e) => {
            let message = e.inner().to_string();
            let help = did_you_mean(&message).unwrap_or_else(|| "see docs/roadmaps.md for every setting".into());
            return Err(source.error(&e.path().to_string(), message, help).into());
        }
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    settings.robot = folder.join(source.relocated("robot", &settings.robot));
    settings.world = settings.world.map(|world| folder.join(source.relocated("world", &world)));
    wrong.none_or((settings, source))
}
