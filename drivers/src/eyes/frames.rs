//! The frames that a run keeps beside its journal: what its detectors looked at, to the byte, one file for each camera.
//!
//! ```text
//! "mobee frames 1\n" | record | record | ...       little endian; the file SENSOR.CAMERA.frames
//! record: length u32, head, PNG, CRC-32 of these   a crash at any byte costs the last frame at most, damage its own
//! head:   exposed (ns of the run) u64, width and height u32, focal lengths, center and distortion f64
//! ```
//! `length` is that of head and PNG. PNG, since a detector that looks again is to see the same bytes; one file, since eight hours of two
//! cameras would be a hundred thousand. The thread of the tap writes them: nobody waits for it but a virtual clock.

mod read;
pub use read::{FrameReader, KeptFrame};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use mobee_contract::{Before, Entry, Frame, Intrinsics, Sink, Time, create_private};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// What a file begins with, but for its version.
const MAGIC: &[u8; 13] = b"mobee frames ";
/// What follows: the version that is written and read.
const VERSION: &[u8; 2] = b"1\n";
/// Bytes before the first record.
const START: u64 = (MAGIC.len() + VERSION.len()) as u64;
/// Bytes of a record's head.
const HEAD: usize = 8 + 2 * 4 + 8 * 8;
/// The longest side that a frame may have, pixels.
const LONGEST: u32 = mobee_contract::picture::MAX_SIDE;

/// The file of a camera, by its name in the run (`SENSOR/CAMERA`), in the run's folder.
pub(super) fn file(run: &Path, camera: &str) -> PathBuf {
    // neither name has a dot
    run.join(camera.replace('/', ".") + ".frames")
}

/// Writes the frames of a run. Clones share it: one is kept to open its sink anew.
#[derive(Clone, Debug)]
pub struct KeptFrames {
    files: Arc<Mutex<BTreeMap<String, FrameFile>>>,
    damage: Arc<[String]>,
}

impl KeptFrames {
    /// Begins a file for each of these cameras in the run's folder, or goes on in that of an earlier process, whose last frame is cut off
    /// if it is not whole. What is damaged before that stays as it is, see [`KeptFrames::damage`].
    ///
    /// # Errors
    /// The file that can't be written or is none of these, in words.
    pub fn open(run: &Path, cameras: &[String]) -> Result<KeptFrames, String> {
        let (mut files, mut damage) = (BTreeMap::new(), Vec::new());
        for camera in cameras {
            let (file, damaged) = FrameFile::open(file(run, camera))?;
            files.insert(camera.clone(), file);
            damage.extend(damaged);
        }
        Ok(KeptFrames { files: Arc::new(Mutex::new(files)), damage: damage.into() })
    }

    /// What of the frames of earlier processes can't be read, in words.
    pub fn damage(&self) -> &[String] {
        &self.damage
    }

    /// The sink that writes them. A new one continues where the last one failed.
    pub fn sink(&self) -> Box<dyn Sink> {
        Box::new(self.clone())
    }
}

impl Sink for KeptFrames {
    fn write(&mut self, _: Time, entry: &Entry) -> Result<(), String> {
        let Entry::Picture { camera, seen } = entry else { return Ok(()) };
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        files.get_mut(&**camera).map_or(Ok(()), |file| file.put(&seen.frame))
    }

    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

/// One camera's file.
#[derive(Debug)]
struct FrameFile {
    path: PathBuf,
    file: File,
    /// Bytes of the file that are whole.
    len: u64,
}

impl FrameFile {
    /// Opens a camera's file, and names what is damaged in it.
    fn open(path: PathBuf) -> Result<(FrameFile, Vec<String>), String> {
        let explain = |e: std::io::Error| format!("{}: {e}; choose a folder that can be written", path.display());
        let before = if path.exists() {
            FrameReader::of(&path).map_err(|(what, help)| format!("{what}; {help}"))?
        } else {
            None
        };
        let (mut len, damage) = before.map_or_else(Default::default, FrameReader::whole);
        let mut file = create_private(&path, Before::Keep).map_err(explain)?;
        file.set_len(len).map_err(explain)?;
        if len == 0 {
            file.write_all(&[MAGIC.as_slice(), VERSION].concat()).map_err(explain)?;
            len = START;
        }
        Ok((FrameFile { path, file, len }, damage))
    }

    /// Adds a frame. If that fails the file may end with a part of it, which the next one overwrites.
    fn put(&mut self, frame: &Frame) -> Result<(), String> {
        let at = self.path.display();
        let bytes = record(frame).map_err(|e| format!("{at}: {e}; mend the camera"))?;
        let written = self.file.seek(SeekFrom::Start(self.len)).and_then(|_| self.file.write_all(&bytes));
        written.map_err(|e| format!("{at}: {e}; make room on the disk"))?;
        self.len += bytes.len() as u64;
        Ok(())
    }
}

/// A frame with its length and its sum.
fn record(frame: &Frame) -> Result<Vec<u8>, String> {
    let Intrinsics { size: [width, height], focal, center, distortion } = frame.intrinsics;
    let bytes = u64::from(width) * u64::from(height) * 3;
    if bytes == 0 || width.max(height) > LONGEST || frame.pixels.len() as u64 != bytes {
        return Err(format!("a frame of {width}x{height} pixels in {} bytes can't be kept", frame.pixels.len()));
    }
    let mut record = vec![0; 4];
    record.extend(frame.exposed.0.to_le_bytes());
    record.extend([width, height].iter().flat_map(|n| n.to_le_bytes()));
    record.extend(focal.iter().chain(&center).chain(&distortion).flat_map(|x| x.to_le_bytes()));
    // a picture with a sensor's noise gets within a hundredth of what the best filter for each row gives, in a fifth of its time
    PngEncoder::new_with_quality(&mut record, CompressionType::Fast, FilterType::Avg)
        .write_image(&frame.pixels, width, height, ExtendedColorType::Rgb8)
        .map_err(|e| e.to_string())?;
    let length = u32::try_from(record.len() - 4).map_err(|e| e.to_string())?;
    record.splice(..4, length.to_le_bytes());
    let sum = crc32fast::hash(&record);
    record.extend(sum.to_le_bytes());
    Ok(record)
}

#[cfg(test)]
mod tests;
