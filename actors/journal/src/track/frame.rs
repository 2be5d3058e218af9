//! Readings as bytes: numbers of variable length, each as the difference from the previous reading.
//!
//! ```text
//! record: 0, time ns, lag ns, each position         absolute: the first after the file was opened, or readings were lost
//!         1, change of the time's step, each step   positions in units of the quantum, steps zigzag
//!         2, the same with the lag after the time   a reading that was reported later than it was read
//!         3, time, time since the reading before,
//!            lag, each position                     absolute, the first of a frame: a frame is read without those before
//! ```
//! Version 1 has no record of kind 3: its frames can only be read up to the first damage.

use super::{QUANTUM, TrackReading};
use mobee_contract::{Pose, Time};
use std::time::Duration;

/// Start of a file, before its number of motors.
const MAGIC: &[u8; 14] = b"mobee track 2\n";
/// The same for the previous version, which is also read and continued.
const MAGIC_1: &[u8; 14] = b"mobee track 1\n";
/// Size of the header before the first frame, bytes.
pub(super) const HEADER: u64 = MAGIC.len() as u64 + 4;

const WHOLE: u8 = 0;
const STEP: u8 = 1;
const DELAYED: u8 = 2;
const KEY: u8 = 3;

/// Header of a file.
pub(super) fn header(motors: usize) -> Vec<u8> {
    [MAGIC.as_slice(), &u32::try_from(motors).unwrap_or(u32::MAX).to_le_bytes()].concat()
}

/// Number of motors in a header; `None` if it is not a header.
pub(super) fn motors(header: &[u8]) -> Option<usize> {
    let number = header.strip_prefix(MAGIC).or_else(|| header.strip_prefix(MAGIC_1))?;
    let number: [u8; 4] = number.try_into().ok()?;
    usize::try_from(u32::from_le_bytes(number)).ok()
}

/// The previous reading, in whole units.
#[derive(Clone, Debug, Default)]
struct Last {
    at: u64,
    step: u64,
    q: Vec<i64>,
}

/// Records that are not written yet.
#[derive(Debug, Default)]
pub(super) struct TrackFrame {
    bytes: Vec<u8>,
    readings: usize,
    last: Option<Last>,
}

impl TrackFrame {
    pub(super) fn readings(&self) -> usize {
        self.readings
    }

    pub(super) fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Marks the next reading as not connected to the previous one.
    pub(super) fn part(&mut self) {
        self.last = None;
    }

    pub(super) fn put(&mut self, reading: &TrackReading) {
        let q: Vec<i64> = reading.q.iter().map(|q| (q / QUANTUM).round() as i64).collect();
        let at = reading.at.0;
        let lag = reading.reported.since(reading.at).as_nanos() as u64;
        let step = match self.last.take().filter(|last| at >= last.at) {
            None => {
                self.bytes.push(WHOLE);
                number(&mut self.bytes, at);
                self.put_whole(lag, &q);
                0
            }
            Some(last) if self.readings == 0 => {
                self.bytes.push(KEY);
                number(&mut self.bytes, at);
                number(&mut self.bytes, at - last.at);
                self.put_whole(lag, &q);
                0
            }
            Some(last) => {
                let step = at - last.at;
                self.bytes.push(if lag == 0 { STEP } else { DELAYED });
                number(&mut self.bytes, zigzag(step.wrapping_sub(last.step) as i64));
                if lag != 0 {
                    number(&mut self.bytes, lag);
                }
                q.iter().zip(&last.q).for_each(|(q, l)| number(&mut self.bytes, zigzag(q - l)));
                step
            }
        };
        self.last = Some(Last { at, step, q });
        self.readings += 1;
    }

    /// Writes the rest of a record with absolute values.
    fn put_whole(&mut self, lag: u64, q: &[i64]) {
        number(&mut self.bytes, lag);
        q.iter().for_each(|q| number(&mut self.bytes, zigzag(*q)));
    }

    /// Returns the frame with its length and checksum, and starts the next one.
    pub(super) fn close(&mut self) -> Vec<u8> {
        let records = std::mem::take(&mut self.bytes);
        self.readings = 0;
        let length = u32::try_from(records.len()).unwrap_or(u32::MAX).to_le_bytes();
        let sum = crc32fast::hash(&records).to_le_bytes();
        [length.as_slice(), &records, &sum].concat()
    }
}

/// Decoder of the records in frames.
#[derive(Debug, Default)]
pub(super) struct Decoder {
    last: Option<Last>,
    /// True if a frame did not directly follow the frame before it.
    pub(super) skips: bool,
}

impl Decoder {
    /// Decodes the readings of a complete frame; `None` if it depends on a previous frame that was not read.
    pub(super) fn frame(&mut self, mut bytes: &[u8], motors: usize) -> Option<Vec<TrackReading>> {
        let mut readings = Vec::new();
        while !bytes.is_empty() {
            readings.push(self.record(&mut bytes, motors)?);
        }
        Some(readings)
    }

    fn record(&mut self, bytes: &mut &[u8], motors: usize) -> Option<TrackReading> {
        let (kind, rest) = bytes.split_first()?;
        *bytes = rest;
        let last = self.last.take();
        let (base, at, step, follows) = match *kind {
            // Each position takes at least one byte.
            WHOLE | KEY if motors > bytes.len() => return None,
            WHOLE => (vec![0; motors], take(bytes)?, 0, false),
            KEY => {
                let at = take(bytes)?;
                let step = take(bytes)?;
                let before = last.map(|last| last.at);
                let follows = before.is_some_and(|before| before.checked_add(step) == Some(at));
                self.skips |= before.is_some() && !follows;
                (vec![0; motors], at, 0, follows)
            }
            STEP | DELAYED => {
                let last = last?;
                let step = last.step.wrapping_add(unzigzag(take(bytes)?) as u64);
                (last.q, last.at.checked_add(step)?, step, true)
            }
            _ => return None,
        };
        let lag = if *kind == STEP { 0 } else { take(bytes)? };
        let mut units = Vec::with_capacity(motors);
        for before in base {
            units.push(before.wrapping_add(unzigzag(take(bytes)?)));
        }
        let q: Pose = units.iter().map(|q| *q as f64 * QUANTUM).collect();
        self.last = Some(Last { at, step, q: units });
        Some(TrackReading { at: Time(at), reported: Time(at) + Duration::from_nanos(lag), q, follows })
    }
}

/// Appends a number with seven bits per byte, the lowest first.
fn number(bytes: &mut Vec<u8>, mut n: u64) {
    while n >= 0x80 {
        bytes.push(n as u8 | 0x80);
        n >>= 7;
    }
    bytes.push(n as u8);
}

fn take(bytes: &mut &[u8]) -> Option<u64> {
    let mut n = 0_u64;
    for shift in (0..64).step_by(7) {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        n |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Some(n);
        }
    }
    None
}

/// Maps small numbers of either sign to small numbers.
fn zigzag(n: i64) -> u64 {
    ((n << 1) ^ (n >> 63)) as u64
}

fn unzigzag(n: u64) -> i64 {
    (n >> 1) as i64 ^ -((n & 1) as i64)
}
