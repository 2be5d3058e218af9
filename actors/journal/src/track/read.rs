//! Reader of a robot's measured configurations: a damaged frame is skipped and reported as a gap, and the next
//! complete one is searched for.

use super::FRAME_BYTES;
use super::frame::{Decoder, HEADER, motors};
use mobee_contract::{Pose, Time};
use mobee_model::file::find_record;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Most gaps that are listed separately.
const MAX_GAPS: usize = 100;
/// Bytes that are checksummed at most in the search for the frames of one file, so that no file takes longer
/// than a second or two.
const MAX_SEARCH_BYTES: u64 = 1 << 30;

/// A configuration that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackReading {
    /// Time of the reading.
    pub at: Time,
    /// Time at which the reflex reported it: before the events from then on.
    pub reported: Time,
    /// The configuration, rad.
    pub q: Pose,
    /// True if no reading between the previous one and this one was lost; readings that were skipped on purpose
    /// don't count.
    pub follows: bool,
}

/// A part of a file that can't be read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrackGap {
    /// Start of the part, and the place at which readings continue: bytes of the file.
    pub bytes: (u64, u64),
    /// Time of the last reading before it.
    pub after: Option<Time>,
    /// Time of the first reading after it; `None` if nothing can be read after it, as at the end of a file
    /// after a crash.
    pub until: Option<Time>,
}

/// The readings of a file, in the order in which they were reported. Reading resumes behind damage.
#[derive(Debug)]
pub struct Readings {
    path: PathBuf,
    file: File,
    motors: usize,
    decoder: Decoder,
    frame: std::vec::IntoIter<TrackReading>,
    /// Start of the next frame, bytes.
    at: u64,
    /// End of the last complete frame, bytes.
    whole: u64,
    /// Time of the newest decoded reading.
    newest: Option<Time>,
    gaps: Vec<TrackGap>,
    /// The current unreadable part, until its end is found.
    gap: Option<TrackGap>,
    /// Bytes that may still be checksummed in the search for frames.
    search: u64,
    /// Failure that ended the reading before the end of the file, as a message.
    failure: Option<String>,
}

/// Opens a file of measured configurations; `None` if there is no such file.
///
/// # Errors
/// A file that is something else, or can't be read, as a message.
pub fn read(path: &Path) -> Result<Option<Readings>, String> {
    let file = match mobee_model::file::open(path) {
        Ok(file) => file,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(format!("{}: {e}", path.display())),
    };
    let mut header = Vec::new();
    (&file).take(HEADER).read_to_end(&mut header).map_err(|e| format!("{}: {e}", path.display()))?;
    if (header.len() as u64) < HEADER {
        return Ok(None); // a crash as it was made
    }
    let motors = motors(&header).ok_or_else(|| {
        format!("{}: this is no file of measured poses; take it away to go on without", path.display())
    })?;
    Ok(Some(Readings {
        path: path.into(),
        file,
        motors,
        decoder: Decoder::default(),
        frame: Vec::new().into_iter(),
        at: HEADER,
        whole: HEADER,
        newest: None,
        gaps: Vec::new(),
        gap: None,
        search: MAX_SEARCH_BYTES,
        failure: None,
    }))
}

impl Readings {
    /// Number of motors in the file.
    pub fn motors(&self) -> usize {
        self.motors
    }

    /// Failure that ended the reading: the disk, or a search that took too long. Frames may follow that were not
    /// read. `None` once all was read.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// End of the last complete frame, bytes, once all was read without a failure.
    pub fn whole(&self) -> u64 {
        self.whole
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Unreadable parts, once all was read.
    pub fn gaps(&self) -> &[TrackGap] {
        &self.gaps
    }

    /// Returns the next reading without taking it.
    pub fn peek(&mut self) -> Option<&TrackReading> {
        while self.frame.as_slice().is_empty() {
            self.frame = self.next_frame()?.into_iter();
        }
        self.frame.as_slice().first()
    }

    /// Reads the next readable frame; `None` at the end, and after a failure.
    fn next_frame(&mut self) -> Option<Vec<TrackReading>> {
        if self.failure.is_some() {
            return None;
        }
        match self.find_frame() {
            Ok(Some(readings)) => return Some(readings),
            Ok(None) => {}
            Err(e) => {
                self.damaged();
                let file = self.path.display();
                let failure = format!("{file}: the frames from byte {} on can't be read: {e}", self.whole);
                self.failure = Some(failure);
            }
        }
        let rest = self.gap.take()?;
        let end = self.file.metadata().map_or(rest.bytes.0, |m| m.len());
        // A file that grows while it is read is not read again from here.
        self.at = end;
        self.decoder = Decoder::default();
        self.put(TrackGap { bytes: (rest.bytes.0, end), ..rest });
        None
    }

    /// Reads the next frame, and searches for it behind damage; `None` at the end.
    fn find_frame(&mut self) -> std::io::Result<Option<Vec<TrackReading>>> {
        while !self.bytes(self.at, 1)?.is_empty() {
            let begins = self.at;
            let Some((records, ends)) = self.records(begins)? else {
                self.damaged();
                let Some(next) = self.find(begins + 1)? else { break };
                self.at = next;
                continue;
            };
            self.at = ends;
            let Some(mut readings) = self.decoder.frame(&records, self.motors) else {
                self.damaged();
                continue;
            };
            self.whole = ends;
            if std::mem::take(&mut self.decoder.skips) {
                self.gap.get_or_insert(TrackGap { bytes: (begins, begins), after: self.newest, until: None });
            }
            if let (Some(gap), Some(first)) = (self.gap.take(), readings.first_mut()) {
                first.follows = false;
                self.put(TrackGap { bytes: (gap.bytes.0, begins), until: Some(first.at), ..gap });
            }
            self.newest = readings.last().map(|last| last.at).or(self.newest);
            return Ok(Some(readings));
        }
        Ok(None)
    }

    /// Starts a gap: the bytes here, or the frame that was just read, can't be decoded.
    fn damaged(&mut self) {
        let at = self.whole;
        let after = self.newest;
        self.gap.get_or_insert(TrackGap { bytes: (at, at), after, until: None });
        self.decoder = Decoder::default();
    }

    /// Records a gap; once [`MAX_GAPS`] are listed, the last one is extended.
    fn put(&mut self, gap: TrackGap) {
        let full = self.gaps.len() >= MAX_GAPS;
        match self.gaps.last_mut().filter(|_| full) {
            Some(last) => (last.bytes.1, last.until) = (gap.bytes.1, gap.until),
            None => self.gaps.push(gap),
        }
    }

    /// Reads the complete frame that starts here: its records and its end.
    fn records(&self, at: u64) -> std::io::Result<Option<(Vec<u8>, u64)>> {
        let Ok(length) = <[u8; 4]>::try_from(self.bytes(at, 4)?) else { return Ok(None) };
        let length = u64::from(u32::from_le_bytes(length));
        if !self.is_length(length) {
            return Ok(None);
        }
        let mut bytes = self.bytes(at + 4, length + 4)?;
        let Some((records, sum)) = bytes.split_last_chunk::<4>() else { return Ok(None) };
        let whole = records.len() as u64 == length && crc32fast::hash(records) == u32::from_le_bytes(*sum);
        bytes.truncate(bytes.len() - 4);
        Ok(whole.then_some((bytes, at + 4 + length + 4)))
    }

    /// True if a frame may have this length: it is closed at [`FRAME_BYTES`], and a record has a byte for its
    /// kind, three numbers, and a number for each motor.
    fn is_length(&self, length: u64) -> bool {
        (1..=FRAME_BYTES as u64 + 40 + 10 * self.motors as u64).contains(&length)
    }

    /// Searches for the next complete frame from this place on, and returns its start.
    ///
    /// # Errors
    /// If the file can't be read, or has more bytes to checksum than the search may.
    fn find(&mut self, from: u64) -> std::io::Result<Option<u64>> {
        let mut left = self.search;
        let end = self.file.metadata()?.len();
        let found = find_record(&self.file, from, |at, length: &[u8; 4]| {
            let length = u64::from(u32::from_le_bytes(*length));
            if !self.is_length(length) || at + 8 + length > end {
                return Ok(false);
            }
            if left < length {
                return Err(std::io::Error::other("the damage there is too large to be searched for frames"));
            }
            left -= length;
            Ok(self.records(at)?.is_some())
        })?;
        self.search = left;
        Ok(found)
    }

    /// Reads at most this number of bytes; fewer only at the end of the file.
    fn bytes(&self, at: u64, most: u64) -> std::io::Result<Vec<u8>> {
        let mut reader = &self.file;
        let mut bytes = Vec::new();
        reader.seek(SeekFrom::Start(at))?;
        reader.take(most).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

impl Iterator for Readings {
    type Item = TrackReading;

    fn next(&mut self) -> Option<TrackReading> {
        self.peek()?;
        self.frame.next()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A read that fails is not the end of the file: a resumed run would otherwise cut off the frames behind it.
    #[test]
    fn a_failed_read_is_a_failure_and_no_end() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("poses-a.track");
        std::fs::write(&path, super::super::frame::header(1)).unwrap();
        let mut readings = read(&path).unwrap().unwrap();
        // A file that is open for writing alone can't be read.
        readings.file = File::options().write(true).open(&path).unwrap();
        assert_eq!(readings.next(), None);
        let failure = readings.failure().unwrap();
        assert!(failure.contains("poses-a.track: the frames from byte"), "{failure}");
        assert_eq!(readings.next(), None, "no second attempt");
    }
}
