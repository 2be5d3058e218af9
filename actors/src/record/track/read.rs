//! Reading a robot's measured poses again, up to the first frame that is not whole.

use super::frame::{Decoder, HEADER, motors};
use mobee_contract::{Pose, Time};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

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

/// The readings of a file, in the order in which they were told.
#[derive(Debug)]
pub struct Readings {
    path: PathBuf,
    reader: BufReader<File>,
    motors: usize,
    decoder: Decoder,
    frame: std::vec::IntoIter<TrackReading>,
    whole: u64,
    cut: bool,
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
    let mut reader = BufReader::with_capacity(1 << 16, file);
    let mut header = Vec::new();
    reader.by_ref().take(HEADER).read_to_end(&mut header).map_err(|e| format!("{}: {e}", path.display()))?;
    if (header.len() as u64) < HEADER {
        return Ok(None); // a crash as it was made
    }
    let motors = motors(&header).ok_or_else(|| {
        format!("{}: this is no file of measured poses; take it away to go on without", path.display())
    })?;
    let frame = Vec::new().into_iter();
    Ok(Some(Readings {
        path: path.into(),
        reader,
        motors,
        decoder: Decoder::default(),
        frame,
        whole: HEADER,
        cut: false,
    }))
}

impl Readings {
    /// The number of motors that it is of.
    pub fn motors(&self) -> usize {
        self.motors
    }

    /// Bytes that are whole, once all was read.
    pub fn whole(&self) -> u64 {
        self.whole
    }

    /// What is wrong with the rest of the file, once all was read that is good.
    pub fn cut(&self) -> Option<String> {
        let at = self.whole;
        self.cut
            .then(|| format!("{}: the measured poses stop at byte {at}, as a crash leaves them", self.path.display()))
    }

    /// The next frame; none at the end, or if it is not whole.
    fn next_frame(&mut self) -> Option<Vec<TrackReading>> {
        let mut length = Vec::new();
        self.reader.by_ref().take(4).read_to_end(&mut length).ok()?;
        if length.is_empty() {
            return None;
        }
        self.cut = true;
        let length = u64::from(u32::from_le_bytes(length.try_into().ok()?));
        let mut bytes = Vec::new();
        self.reader.by_ref().take(length + 4).read_to_end(&mut bytes).ok()?;
        let (records, sum) = bytes.split_last_chunk::<4>()?;
        if records.len() as u64 != length || crc32fast::hash(records) != u32::from_le_bytes(*sum) {
            return None;
        }
        let readings = self.decoder.frame(records, self.motors)?;
        self.whole += 4 + length + 4;
        self.cut = false;
        Some(readings)
    }
}

impl Readings {
    /// The next one, which stays the next one.
    pub fn peek(&mut self) -> Option<&TrackReading> {
        while self.frame.as_slice().is_empty() && !self.cut {
            self.frame = self.next_frame()?.into_iter();
        }
        self.frame.as_slice().first()
    }
}

impl Iterator for Readings {
    type Item = TrackReading;

    fn next(&mut self) -> Option<TrackReading> {
        self.peek()?;
        self.frame.next()
    }
}
