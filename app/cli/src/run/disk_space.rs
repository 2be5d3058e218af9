//! Free space on the disk of a run's folder, and the files that are not written as it shrinks.

use mobee_compose::config::ConfigError;
use std::path::{Path, PathBuf};

/// Below this only the journal is written: share of the disk and bytes. The smaller of the two counts, since five
/// percent of a large disk is enough for years.
const MIN_FREE_TO_RECORD: (f64, u64) = (0.05, 5 << 30);
/// Below this no run begins: share of the disk and bytes.
const MIN_FREE_TO_BEGIN: (f64, u64) = (0.01, 1 << 30);

/// Free space of a disk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DiskSpace {
    /// Bytes that this user can still write.
    free: u64,
    /// Free and used bytes together.
    all: u64,
}

impl DiskSpace {
    /// The space on the disk of this path, or of its nearest existing ancestor. `None` if the system does not report
    /// it.
    pub(super) fn at(path: &Path) -> Option<DiskSpace> {
        let path = if path.is_absolute() { path.to_owned() } else { Path::new(".").join(path) };
        let known = path.ancestors().find_map(|p| rustix::fs::statvfs(p).ok())?;
        let blocks = |n: u64| n.saturating_mul(known.f_frsize);
        let free = blocks(known.f_bavail);
        let used = blocks(known.f_blocks.saturating_sub(known.f_bfree));
        // file systems without a size of their own report zero
        (known.f_blocks > 0).then_some(DiskSpace { free, all: free.saturating_add(used) })
    }

    fn is_below(self, (share, bytes): (f64, u64)) -> bool {
        self.free < bytes && (self.free as f64) < share * self.all as f64
    }

    /// The reason why there is no recording, if the space is too small for it.
    pub(super) fn too_little_to_record(self) -> Option<String> {
        self.is_below(MIN_FREE_TO_RECORD)
            .then(|| format!("only {self} of the disk is free, which is left to the journal"))
    }

    /// Checks that a run may begin.
    ///
    /// # Errors
    /// If there is too little space.
    pub(super) fn check(self, at: &Path) -> Result<(), ConfigError> {
        if !self.is_below(MIN_FREE_TO_BEGIN) {
            return Ok(());
        }
        let what = format!("only {self} of the disk of {} is free: its journal could end before the run", at.display());
        Err(ConfigError::plain(what, "make room, or give an --out on another disk"))
    }
}

impl std::fmt::Display for DiskSpace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let share = 100.0 * self.free as f64 / (self.all as f64).max(1.0);
        write!(f, "{share:.1} % ({:.1} MB)", self.free as f64 * 1e-6)
    }
}

/// Checks that a run may begin in this folder, which need not exist yet.
///
/// # Errors
/// If there is too little space.
pub(super) fn check(at: Option<&Path>) -> Result<(), ConfigError> {
    let at = at.map_or_else(|| PathBuf::from("runs"), Path::to_owned);
    DiskSpace::at(&at).map_or(Ok(()), |room| room.check(&at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_fills_step_by_step() {
        let steps = |all: u64, free: u64| {
            let room = DiskSpace { free, all };
            (room.too_little_to_record().is_some(), room.check(Path::new("/")).is_err())
        };
        assert_eq!(steps(1_000_000, 51_000), (false, false));
        assert_eq!(steps(1_000_000, 49_000), (true, false));
        assert_eq!(steps(1_000_000, 9_000), (true, true));
        let large = 4_000_000_000_000;
        assert_eq!(steps(large, 6 << 30), (false, false), "a sliver of a large disk is room enough");
        assert_eq!(steps(large, 2 << 30), (true, false));
    }

    #[test]
    fn a_folder_that_is_yet_to_be_made_has_its_parents_room() {
        let dir = tempfile::tempdir().unwrap();
        let here = DiskSpace::at(dir.path()).unwrap();
        let below = DiskSpace::at(&dir.path().join("a/b")).unwrap();
        assert_eq!(here.all, below.all);
    }
}
