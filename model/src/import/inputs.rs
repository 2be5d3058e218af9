//! What a robot file was made from, as one number: who asks for the same again needs no second fit.

use super::ImportError;
use crate::LinkSurface;
use crate::file::{MIB, read, read_text};
use sha2::{Digest, Sha256};
use std::path::Path;

/// To be raised with every change of the fit, the survey or the writer that gives another robot for the same files.
const VERSION: u32 = 6;
/// Longer files are refused by their readers.
const LONGEST: u64 = 64 * MIB;
/// What the number stands behind in the robot file's comment.
const WORD: &str = "Made from inputs ";

/// The number of a URDF with its meshes (`links`), the SRDF and all options.
///
/// # Errors
/// If a file can't be read.
pub(super) fn digest(
    options: &str,
    urdf: &Path,
    srdf: Option<&Path>,
    links: &[LinkSurface],
) -> Result<String, ImportError> {
    let mut all = Sha256::new();
    all.update(format!("{VERSION} {} {options}", env!("CARGO_PKG_VERSION")));
    for path in std::iter::once(urdf).chain(srdf) {
        let bytes = read(path, LONGEST).map_err(|source| ImportError::Unreadable { path: path.to_owned(), source })?;
        all.update((bytes.len() as u64).to_le_bytes());
        all.update(bytes);
    }
    for link in links {
        all.update(&link.link);
        for mesh in &link.meshes {
            all.update((mesh.vertices.len() as u64).to_le_bytes());
            mesh.vertices.iter().flatten().for_each(|x| all.update(x.to_le_bytes()));
            mesh.triangles.iter().flatten().for_each(|i| all.update(i.to_le_bytes()));
        }
    }
    Ok(all.finalize().iter().take(16).map(|byte| format!("{byte:02x}")).collect())
}

/// The line that says it in the robot file's comment.
pub(super) fn line(digest: &str) -> String {
    format!("{WORD}{digest}.")
}

/// The number that a robot file says it was made from.
pub(super) fn named(xml: &Path) -> Option<String> {
    let text = read_text(xml, LONGEST).ok()?;
    let (_, rest) = text.split_once(WORD)?;
    Some(rest.split_once('.')?.0.to_owned())
}
