//! A sink that ends before it uses disk space that the journal needs.

use super::space::Room;
use mobee_contract::{Entry, Sink, Time};
use std::path::PathBuf;

/// Entries between two checks of the disk.
const OFTEN: u32 = 1000;

/// Forwards entries while there is enough disk space.
pub(super) struct Guarded {
    sink: Box<dyn Sink>,
    folder: PathBuf,
    entries: u32,
}

impl Guarded {
    /// Wraps a sink that writes into this folder.
    pub(super) fn new(sink: Box<dyn Sink>, folder: PathBuf) -> Guarded {
        Guarded { sink, folder, entries: 0 }
    }

    fn look(&self) -> Result<(), String> {
        Room::at(&self.folder).and_then(Room::forbids_recording).map_or(Ok(()), Err)
    }
}

impl Sink for Guarded {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        self.entries += 1;
        if self.entries.is_multiple_of(OFTEN) {
            self.look()?;
        }
        self.sink.write(at, entry)
    }

    fn flush(&mut self) -> Result<(), String> {
        self.look()?;
        self.sink.flush()
    }

    fn lost(&mut self) {
        self.sink.lost();
    }
}
