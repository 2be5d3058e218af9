//! Digest of the inputs of a robot file: if the inputs are unchanged, the fit need not be repeated.

use super::ImportError;
use crate::LinkSurface;
use mobee_text::file::{MIB, read, read_text};
use sha2::{Digest, Sha256};
use std::path::Path;

/// Version of the import. Increase it with every change of the fit, the survey or the writer that changes the resulting
/// robot.
const VERSION: u32 = 7;
/// Maximum file size; the readers reject longer files.
const MAX_FILE_BYTES: u64 = 64 * MIB;
/// Text before the digest in the robot file's comment.
const DIGEST_LABEL: &str = "Made from inputs ";

/// The digest of a URDF with its meshes (`links`), the SRDF and all options.
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
        let bytes =
            read(path, MAX_FILE_BYTES).map_err(|source| ImportError::Unreadable { path: path.to_owned(), source })?;
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

/// The line with the digest for the robot file's comment.
pub(super) fn line(digest: &str) -> String {
    format!("{DIGEST_LABEL}{digest}.")
}

/// The digest in a robot file's comment.
pub(super) fn named(xml: &Path) -> Option<String> {
    let text = read_text(xml, MAX_FILE_BYTES).ok()?;
    let (_, rest) = text.split_once(DIGEST_LABEL)?;
    Some(rest.split_once('.')?.0.to_owned())
}
