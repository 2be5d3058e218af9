//! Frames that a run records beside its journal: the exact images that its detectors processed, one file per
//! camera.
//!
//! ```text
//! "mobee frames 1\n" | record | record | ...       little endian; the file SENSOR.CAMERA.frames
//! record: length u32, head, PNG, CRC-32 of these   a crash at any byte costs the last frame at most, damage its own
//! head:   exposed (ns of the run) u64, width and height u32, focal lengths, center and distortion f64
//! ```
//! `length` is that of head and PNG. PNG is lossless, so that a detector that runs again sees the same bytes.
//! One file per camera, because eight hours of two cameras would be a hundred thousand files. The thread of
//! the tap writes them; only a virtual clock waits for it.

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

/// Start of a file, before its version.
const MAGIC: &[u8; 13] = b"mobee frames ";
/// Version that is written and read.
const VERSION: &[u8; 2] = b"1\n";
/// Bytes before the first record.
const START: u64 = (MAGIC.len() + VERSION.len()) as u64;
/// Bytes of a record's head.
const HEAD_BYTES: usize = 8 + 2 * 4 + 8 * 8;
/// Greatest width and height of a frame, pixels.
const MAX_SIDE_PX: u32 = mobee_contract::picture::MAX_SIDE;

/// File of a camera in the run's folder, given its name in the run (`SENSOR/CAMERA`).
pub(super) fn file(run: &Path, camera: &str) -> PathBuf {
    // neither name contains a dot
    run.join(camera.replace('/', ".") + ".frames")
}

/// Recorder of the frames of a run. Clones share the files; one is retained to open the sink again.
#[derive(Clone, Debug)]
pub struct KeptFrames {
    files: Arc<Mutex<BTreeMap<String, FrameFile>>>,
    damage: Arc<[String]>,
}

impl KeptFrames {
    /// Creates a file for each of these cameras in the run's folder, or continues that of an earlier process.
    /// A partial last frame is cut off. Earlier damage is preserved, see [`KeptFrames::damage`].
    ///
    /// # Errors
    /// The file that can't be written or is not a frame file, as a message.
    pub fn open(run: &Path, cameras: &[String]) -> Result<KeptFrames, String> {
        let mut files = BTreeMap::new();
        let mut damage = Vec::new();
        for camera in cameras {
            let (file, damaged) = FrameFile::open(file(run, camera))?;
            files.insert(camera.clone(), file);
            damage.extend(damaged);
        }
        Ok(KeptFrames { files: Arc::new(Mutex::new(files)), damage: damage.into() })
    }

    /// Messages about unreadable frames of earlier processes.
    pub fn damage(&self) -> &[String] {
        &self.damage
    }

    /// Sink that writes the frames. A new one continues where the last one failed.
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

/// File of one camera.
#[derive(Debug)]
struct FrameFile {
    path: PathBuf,
    file: File,
    /// Length of the valid part of the file, bytes.
    len: u64,
}

impl FrameFile {
    /// Opens a camera's file, and describes the damage in it.
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

    /// Appends a frame. If that fails the file may end with a partial frame, which the next one overwrites.
    fn put(&mut self, frame: &Frame) -> Result<(), String> {
        let at = self.path.display();
        let bytes = record(frame).map_err(|e| format!("{at}: {e}; mend the camera"))?;
        let written = self.file.seek(SeekFrom::Start(self.len)).and_then(|_| self.file.write_all(&bytes));
        written.map_err(|e| format!("{at}: {e}; make room on the disk"))?;
        self.len += bytes.len() as u64;
        Ok(())
    }
}

/// Record of a frame, with its length and checksum.
fn record(frame: &Frame) -> Result<Vec<u8>, String> {
    let Intrinsics { size: [width, height], focal, center, distortion } = frame.intrinsics;
    let bytes = u64::from(width) * u64::from(height) * 3;
    if bytes == 0 || width.max(height) > MAX_SIDE_PX || frame.pixels.len() as u64 != bytes {
        return Err(format!("a frame of {width}x{height} pixels in {} bytes can't be kept", frame.pixels.len()));
    }
    let mut record = vec![0; 4];
    record.extend(frame.exposed.0.to_le_bytes());
    record.extend([width, height].iter().flat_map(|n| n.to_le_bytes()));
    record.extend(focal.iter().chain(&center).chain(&distortion).flat_map(|x| x.to_le_bytes()));
    // an image with sensor noise gets within a hundredth of the size that the best filter per row gives, in a
    // fifth of its time
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
