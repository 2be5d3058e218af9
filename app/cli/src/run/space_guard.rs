//! A sink that ends before it uses disk space that the journal needs.

use super::disk_space::DiskSpace;
use mobee_contract::{Entry, Sink, Time};
use std::path::PathBuf;

/// Entries between two checks of the disk.
const ENTRIES_PER_CHECK: u32 = 1000;

/// Forwards entries while there is enough disk space.
pub(super) struct SpaceGuard {
    sink: Box<dyn Sink>,
    folder: PathBuf,
    entries: u32,
}

impl SpaceGuard {
    /// Wraps a sink that writes into this folder.
    pub(super) fn new(sink: Box<dyn Sink>, folder: PathBuf) -> SpaceGuard {
        SpaceGuard { sink, folder, entries: 0 }
    }

    fn check_space(&self) -> Result<(), String> {
        DiskSpace::at(&self.folder).and_then(DiskSpace::too_little_to_record).map_or(Ok(()), Err)
    }
}

impl Sink for SpaceGuard {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        self.entries += 1;
        if self.entries.is_multiple_of(ENTRIES_PER_CHECK) {
            self.check_space()?;
        }
        self.sink.write(at, entry)
    }

    fn flush(&mut self) -> Result<(), String> {
        self.check_space()?;
        self.sink.flush()
    }

    fn lost(&mut self) {
        self.sink.lost();
    }
}
