//! A run's folder: `runs/NAME-TIME/`, newly created, never overwritten, and accessible to its user only.

use mobee_compose::config::ConfigError;
use mobee_contract::{Before, create_private};
use std::fs::{DirBuilder, File, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Mode bits: only the owner may read or write, because the folder holds the address of the control port.
const OWNER_ONLY: u32 = 0o700;

/// A new folder for one run.
#[derive(Clone, Debug)]
pub struct Folder {
    path: PathBuf,
    /// The open folder; valid even if the folder is renamed.
    handle: Arc<File>,
}

impl Folder {
    /// Creates `out`, or `runs/NAME-TIME` below the working directory.
    ///
    /// # Errors
    /// If it exists and is not empty, belongs to another user, or can't be created.
    pub fn create(name: &str, out: Option<&Path>) -> Result<Folder, ConfigError> {
        let path = match out {
            Some(path) => given(path)?,
            None => unused(name)?,
        };
        claim(&path)?;
        Folder::at(path)
    }

    /// Opens the folder of a run that is continued.
    ///
    /// # Errors
    /// If it is not a run's folder, or belongs to another user.
    pub fn of_run(path: &Path) -> Result<Folder, ConfigError> {
        Folder::must_be_run(path)?;
        claim(path)?;
        Folder::at(path.to_owned())
    }

    fn at(path: PathBuf) -> Result<Folder, ConfigError> {
        let handle = File::open(&path).map_err(|e| cannot_create(&path, &e))?;
        Ok(Folder { path, handle: Arc::new(handle) })
    }

    /// The current path, which follows the folder if it is renamed during the run.
    pub(crate) fn now(&self) -> PathBuf {
        let handle = PathBuf::from(format!("/proc/self/fd/{}", self.handle.as_raw_fd()));
        if handle.exists() { handle } else { self.path.clone() }
    }

    /// A complaint if the folder was renamed.
    pub(crate) fn renamed(&self) -> Option<String> {
        let now = self.now().canonicalize().ok()?;
        let own = self.path.canonicalize().ok();
        (Some(&now) != own.as_ref())
            .then(|| format!("the run's folder was renamed while it was under way: to {}", now.display()))
    }

    /// Checks that a folder is a run's; writes nothing.
    ///
    /// # Errors
    /// If it contains no `config.json`.
    pub fn must_be_run(path: &Path) -> Result<(), ConfigError> {
        if path.join("config.json").is_file() {
            return Ok(());
        }
        let what = format!("{} is not a run's folder: it contains no config.json", path.display());
        Err(ConfigError::plain(what, "give a folder that `mobee run` made, such as runs/explore-..."))
    }

    /// A path in the folder at which no file exists: `NAME.EXT`, else `NAME-2.EXT` and so on.
    pub fn unused(&self, name: &str, extension: &str) -> PathBuf {
        let names =
            std::iter::once(format!("{name}.{extension}")).chain((2..).map(|n| format!("{name}-{n}.{extension}")));
        names.map(|n| self.path.join(n)).find(|p| !p.exists()).unwrap_or_default()
    }

    /// The path at which the folder was created or opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a file atomically.
    ///
    /// # Errors
    /// If the file can't be written.
    pub fn write(&self, name: &str, text: &str) -> Result<(), ConfigError> {
        let now = self.now();
        let file = self.path.join(name);
        let part = now.join(format!("{name}.part"));
        let write = || create_private(&part, Before::Empty)?.write_all(text.as_bytes());
        write().and_then(|()| std::fs::rename(&part, now.join(name))).map_err(|e| {
            let _ = std::fs::remove_file(&part);
            ConfigError::plain(format!("can't write {}: {e}", file.display()), "check the disk's space and permissions")
        })
    }
}

/// Creates the given folder; an existing empty folder is accepted.
fn given(path: &Path) -> Result<PathBuf, ConfigError> {
    path.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(|e| cannot_create(path, &e))?;
    let empty = || path.read_dir().is_ok_and(|mut d| d.next().is_none());
    match make(path) {
        Ok(()) => Ok(path.to_owned()),
        Err(e) if e.kind() == ErrorKind::AlreadyExists && empty() => Ok(path.to_owned()),
        Err(e) if e.kind() == ErrorKind::AlreadyExists => Err(ConfigError::plain(
            format!("{} exists already", path.display()),
            "give another --out; a run never writes over another one",
        )),
        Err(e) => Err(cannot_create(path, &e)),
    }
}

/// Creates a folder with an unused name. Creating it is the test: another process may choose the same name at this
/// moment.
fn unused(name: &str) -> Result<PathBuf, ConfigError> {
    #[expect(
        clippy::disallowed_methods,
        reason = "the folder's name tells people when the run was; nothing depends on it"
    )]
    let now = std::time::SystemTime::now();
    let stamp = stamp(now.duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_secs()));
    let names = std::iter::once(format!("{name}-{stamp}")).chain((2..).map(|n| format!("{name}-{stamp}-{n}")));
    let runs = Path::new("runs");
    std::fs::create_dir_all(runs).map_err(|e| cannot_create(runs, &e))?;
    for path in names.map(|n| runs.join(n)) {
        match make(&path) {
            Ok(()) => return Ok(path),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            Err(e) => return Err(cannot_create(&path, &e)),
        }
    }
    Err(ConfigError::plain("there is no name left for a folder in runs/", "give an --out"))
}

fn make(path: &Path) -> io::Result<()> {
    DirBuilder::new().mode(OWNER_ONLY).create(path)?;
    // the umask may have removed bits
    std::fs::set_permissions(path, Permissions::from_mode(OWNER_ONLY))
}

fn cannot_create(path: &Path, why: &io::Error) -> ConfigError {
    let what = format!("can't make the folder {}: {why}", path.display());
    ConfigError::plain(what, "give an --out that can be written")
}

/// Checks that the folder belongs to this user, and closes it to all others. Another owner could replace files that the
/// run reads again.
fn claim(path: &Path) -> Result<(), ConfigError> {
    let ours = || -> io::Result<bool> {
        // a temporary file shows our user id, and whether we may write here
        let us = tempfile::tempfile_in(path)?.metadata()?.uid();
        let ours = std::fs::metadata(path)?.uid() == us;
        if ours {
            std::fs::set_permissions(path, Permissions::from_mode(OWNER_ONLY))?;
        }
        Ok(ours)
    };
    match ours() {
        Ok(true) => Ok(()),
        Ok(false) => Err(ConfigError::plain(
            format!("the folder {} belongs to another user", path.display()),
            "give an --out in a folder of your own",
        )),
        Err(e) => {
            let what = format!("can't write into the folder {}: {e}", path.display());
            Err(ConfigError::plain(what, "give an --out that can be written"))
        }
    }
}

/// `20261121-143000` (UTC) of seconds since 1970 (civil-from-days, proleptic Gregorian calendar).
fn stamp(secs: u64) -> String {
    let days = (secs / 86400) as i64 + 719_468;
    let era = days / 146_097;
    let day_of_era = days % 146_097;
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = era * 400 + year_of_era + i64::from(month <= 2);
    let s = secs % 86400;
    format!("{year:04}{month:02}{day:02}-{:02}{:02}{:02}", s / 3600, s / 60 % 60, s % 60)
}

#[cfg(test)]
mod tests {
    use super::stamp;

    #[test]
    fn stamps_are_calendar_dates() {
        assert_eq!(stamp(0), "19700101-000000");
        assert_eq!(stamp(951_782_399), "20000228-235959");
        assert_eq!(stamp(951_782_400), "20000229-000000");
        assert_eq!(stamp(1_798_761_600), "20270101-000000");
    }
}
