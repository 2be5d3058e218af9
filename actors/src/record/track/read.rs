//! Reading a robot's measured poses again: a frame that is not whole is left out and named, and the next whole one is searched for.

use super::LONG;
use super::frame::{Decoder, HEADER, motors};
use mobee_contract::{Pose, Time};
use mobee_model::file::find_record;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// So many gaps are told apart at most.
const GAPS: usize = 100;
/// Bytes whose sums are taken at most in search of the frames of one file: no file keeps its reader busy for more than a second or two.
const SEARCH: u64 = 1 << 30;

/// A pose that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackReading {
    /// When it was read.
    pub at: Time,
    /// When the reflex told it: before the events from then on.
    pub told: Time,
    /// The pose, rad.
    pub q: Pose,
    /// Whether all readings between the one before and this one are known to be passed over on purpose: none was lost.
    pub follows: bool,
}

/// A part of a file that can't be read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrackGap {
    /// Where it begins, and where readings can be read again: bytes of the file.
    pub bytes: (u64, u64),
    /// The time of the last reading before it.
    pub after: Option<Time>,
    /// The time of the first reading after it; none if nothing can be read after it, as a crash leaves the end of a file.
    pub until: Option<Time>,
}

/// The readings of a file, in the order in which they were told. Reading resumes behind damage.
#[derive(Debug)]
pub struct Readings {
    path: PathBuf,
    file: File,
    motors: usize,
    decoder: Decoder,
    frame: std::vec::IntoIter<TrackReading>,
    /// Where the next frame begins.
    at: u64,
    /// The end of the last whole frame.
    whole: u64,
    /// The time of the newest reading of a frame.
    newest: Option<Time>,
    gaps: Vec<TrackGap>,
    /// The part that can't be read and whose end was not found yet.
    gap: Option<TrackGap>,
    /// Bytes whose sums may still be taken in search of frames.
    search: u64,
}

/// Opens a file of measured poses; none if there is no such file.
///
/// # Errors
/// A file that is something else, or can't be read, in words.
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
        search: SEARCH,
    }))
}

impl Readings {
    /// The number of motors that it is of.
    pub fn motors(&self) -> usize {
        self.motors
    }

    /// The end of the last whole frame, once all was read: bytes.
    pub fn whole(&self) -> u64 {
        self.whole
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The parts that can't be read, once all was read.
    pub fn gaps(&self) -> &[TrackGap] {
        &self.gaps
    }

    /// The next one, which stays the next one.
    pub fn peek(&mut self) -> Option<&TrackReading> {
        while self.frame.as_slice().is_empty() {
            self.frame = self.next_frame()?.into_iter();
        }
        self.frame.as_slice().first()
    }

    /// The next frame that can be read; none at the end.
    fn next_frame(&mut self) -> Option<Vec<TrackReading>> {
        while !self.bytes(self.at, 1)?.is_empty() {
            let begins = self.at;
            let Some((records, ends)) = self.records(begins) else {
                self.damaged();
                let Some(next) = self.find(begins + 1) else { break };
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
            return Some(readings);
        }
        let rest = self.gap.take()?;
        let end = self.file.metadata().map_or(rest.bytes.0, |m| m.len());
        // a file that is being read while it is written grows
        (self.at, self.decoder) = (end, Decoder::default());
        self.put(TrackGap { bytes: (rest.bytes.0, end), ..rest });
        None
    }

    /// What begins here, or was just read, is no frame that can be read.
    fn damaged(&mut self) {
        let (at, after) = (self.whole, self.newest);
        self.gap.get_or_insert(TrackGap { bytes: (at, at), after, until: None });
        self.decoder = Decoder::default();
    }

    /// Notes a gap; the last of many stands for all that follow.
    fn put(&mut self, gap: TrackGap) {
        let full = self.gaps.len() >= GAPS;
        match self.gaps.last_mut().filter(|_| full) {
            Some(last) => (last.bytes.1, last.until) = (gap.bytes.1, gap.until),
            None => self.gaps.push(gap),
        }
    }

    /// The records of the whole frame that begins here, and where it ends.
    fn records(&self, at: u64) -> Option<(Vec<u8>, u64)> {
        let length = u64::from(u32::from_le_bytes(self.bytes(at, 4)?.try_into().ok()?));
        self.is_length(length).then_some(())?;
        let mut bytes = self.bytes(at + 4, length + 4)?;
        let (records, sum) = bytes.split_last_chunk::<4>()?;
        let whole = records.len() as u64 == length && crc32fast::hash(records) == u32::from_le_bytes(*sum);
        bytes.truncate(usize::try_from(length).ok()?);
        whole.then_some((bytes, at + 4 + length + 4))
    }

    /// Whether a frame may have this length: it is closed once it is long, and a record has a byte for its kind, three numbers, and a number
    /// for each motor.
    fn is_length(&self, length: u64) -> bool {
        (1..=LONG as u64 + 40 + 10 * self.motors as u64).contains(&length)
    }

    /// Where the next whole frame begins, from this place on.
    fn find(&mut self, from: u64) -> Option<u64> {
        let mut left = self.search;
        let end = self.file.metadata().ok()?.len();
        let found = find_record(&self.file, from, |at, length: &[u8; 4]| {
            let length = u64::from(u32::from_le_bytes(*length));
            if !self.is_length(length) || at + 8 + length > end || left < length {
                return Ok(false);
            }
            left -= length;
            Ok(self.records(at).is_some())
        });
        self.search = left;
        found.ok().flatten()
    }

    fn bytes(&self, at: u64, most: u64) -> Option<Vec<u8>> {
        let (mut reader, mut bytes) = (&self.file, Vec::new());
        reader.seek(SeekFrom::Start(at)).ok()?;
        reader.take(most).read_to_end(&mut bytes).ok()?;
        Some(bytes)
    }
}

impl Iterator for Readings {
    type Item = TrackReading;

    fn next(&mut self) -> Option<TrackReading> {
        self.peek()?;
        self.frame.next()
    }
}
