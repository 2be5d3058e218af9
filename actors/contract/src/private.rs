//! Files of a run, accessible to their owner only, whatever the umask: they record what a robot did, and one of them
//! gives access to the control port.

use std::fs::{File, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::Path;

/// Mode: readable and writable by the owner only.
const OWNER: u32 = 0o600;

/// Treatment of an existing file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Before {
    /// Return an error.
    Refuse,
    /// Empty it.
    Empty,
    /// Overwrite it from its beginning, without truncating it.
    Keep,
}

/// Creates a file for writing that only its owner may read or write (mode 0600).
///
/// # Errors
/// As of [`OpenOptions::open`].
pub fn create_private(path: &Path, before: Before) -> io::Result<File> {
    let mut options = OpenOptions::new();
    match before {
        Before::Refuse => options.create_new(true),
        Before::Empty => options.create(true).truncate(true),
        Before::Keep => options.create(true).truncate(false),
    };
    let file = options.write(true).mode(OWNER).open(path)?;
    // The umask may have removed bits, and an existing file has its previous mode.
    file.set_permissions(Permissions::from_mode(OWNER))?;
    Ok(file)
}
