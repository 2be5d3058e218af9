//! Files of a run: its user's alone, whatever the umask. They tell what a robot did and is about to do, and one of them
//! opens the control port.

use std::fs::{File, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::Path;

/// May be read and written by its owner, and by nobody else.
const OWNER: u32 = 0o600;

/// What to do about a file that stands there already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Before {
    /// It is an error.
    Refuse,
    /// It is emptied.
    Empty,
    /// It is written over from its beginning.
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
    // the umask may have taken bits away, and a file that stood there keeps those it had
    file.set_permissions(Permissions::from_mode(OWNER))?;
    Ok(file)
}
