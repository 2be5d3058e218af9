//! The images of the collected rows, from the frames that the run stored.

use mobee_compose::config::ConfigError;
use mobee_contract::Time;
use mobee_sim::eyes::FrameReader;
use std::collections::BTreeMap;
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// Checks that images can be written into this folder: those of another table would be mistaken for this one's.
///
/// # Errors
/// If it is not empty.
pub(super) fn may_fill(dir: &Path) -> Result<(), ConfigError> {
    let is_free = !dir.exists() || dir.read_dir().is_ok_and(|mut entries| entries.next().is_none());
    let what = || format!("{} is no empty folder", dir.display());
    is_free.then_some(()).ok_or_else(|| ConfigError::plain(what(), "name a new folder for --images, or empty this one"))
}

/// Writes the images of both cameras for each row, all or none: `NUMBER_CAMERA.png`, where rows count from 1. Returns
/// their number as text.
///
/// # Errors
/// If the run stored no frames, or not those of a row; if they can't be read, or written.
pub(super) fn write(
    run: &Path,
    dir: &Path,
    cameras: &[String; 2],
    exposed: &[[Time; 2]],
) -> Result<String, ConfigError> {
    let unwritable = |e: std::io::Error| {
        let what = format!("can't write {}: {e}", dir.display());
        ConfigError::plain(what, "check the folder's space and permissions")
    };
    let beside = dir.parent().filter(|d| !d.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(beside).map_err(unwritable)?;
    let part = tempfile::tempdir_in(beside).map_err(unwritable)?;
    for (eye, camera) in cameras.iter().enumerate() {
        let unread = |what: String| {
            ConfigError::plain(what, "give the folder of a run as it was written, or leave out --images")
        };
        let mut reader = FrameReader::open(run, camera).map_err(|e| ConfigError::plain(e.what, e.help))?;
        let mut rows: BTreeMap<Time, usize> =
            exposed.iter().enumerate().filter_map(|(row, at)| Some((*at.get(eye)?, row + 1))).collect();
        let name = camera.rsplit('/').next().unwrap_or(camera);
        while let Some(frame) = reader.next_frame().map_err(unread)? {
            let Some(row) = rows.remove(&frame.exposed) else { continue };
            let png = reader.png(&frame).map_err(unread)?;
            std::fs::write(part.path().join(format!("{row:05}_{name}.png")), png).map_err(unwritable)?;
        }
        for damage in reader.damage() {
            eprintln!("warning: {damage}");
        }
        if let Some((at, row)) = rows.first_key_value() {
            let what = format!(
                "{}: of {camera}, the frames of {} rows are missing, the first of row {row}, exposed at {at}",
                run.display(),
                rows.len()
            );
            return Err(ConfigError::plain(
                what,
                "leave out --images: frames were dropped, damaged, or not kept from the beginning",
            ));
        }
    }
    std::fs::set_permissions(part.path(), Permissions::from_mode(0o755)).map_err(unwritable)?;
    let count = std::fs::read_dir(part.path()).map_err(unwritable)?.count();
    std::fs::rename(part.path(), dir).map_err(unwritable)?;
    // it was renamed
    let _ = part.keep();
    Ok(format!("{}: {count} pictures\n", dir.display()))
}
