//! Reader of recorded frames. A damaged record is skipped and reported, and the next valid one is searched
//! for.

use super::{HEAD_BYTES, MAGIC, MAX_SIDE_PX, START, VERSION, file};
use mobee_contract::{Frame, Intrinsics, KindError, Time, picture, suggestion};
use mobee_model::file::find_record;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Greatest length of a record, bytes: noise is incompressible.
const MAX_RECORD_BYTES: u64 = HEAD_BYTES as u64 + 4 * MAX_SIDE_PX as u64 * MAX_SIDE_PX as u64;
/// Greatest plausible duration of a run.
const MAX_RUN_TIME: Duration = Duration::from_secs(100 * 366 * 86_400);
/// Largest number of cameras, and of damaged places of a file, that are reported.
const MAX_REPORTED: usize = 100;
/// Limit of the bytes that are checksummed in search of the records of one file.
const MAX_SEARCHED_BYTES: u64 = 8 << 30;

/// Description of an error, and its remedy.
type FrameProblem = (String, String);

/// Reader of the file of a camera's frames. Holds no frame in memory.
#[derive(Debug)]
pub struct FrameReader {
    path: PathBuf,
    file: File,
    /// Start of the next record.
    at: u64,
    /// Damaged parts: start and end of each, bytes.
    damage: Vec<(u64, u64)>,
    /// Rest of the file without a valid frame: after a crash, or while it is written.
    tail: Option<(u64, u64)>,
    /// Number of bytes that may still be checksummed in search of records.
    search: u64,
}

/// A frame in a file, without its pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeptFrame {
    /// Exposure time, by the clock of its run.
    pub exposed: Time,
    /// Projection of the camera.
    pub intrinsics: Intrinsics,
    /// Start of its record, and the length of head and PNG.
    at: u64,
    length: u64,
}

impl FrameReader {
    /// Opens the frames that the run in this folder recorded of a camera, given its name there:
    /// `SENSOR/CAMERA`.
    ///
    /// # Errors
    /// A folder without frames, a camera that is not among them, or a file of another kind, as errors of the
    /// settings `run` and `camera`.
    pub fn open(run: &Path, camera: &str) -> Result<FrameReader, KindError> {
        let path = file(run, camera);
        if !path.exists() {
            return Err(missing(run, camera));
        }
        let wrong = |(what, help): FrameProblem| KindError::new("run", what, help);
        let reader = FrameReader::of(&path).map_err(wrong)?;
        reader.ok_or_else(|| wrong((format!("{} has no frame", path.display()), again())))
    }

    /// Opens a file of frames; `None` if it ends before the first frame, as after a crash.
    pub(super) fn of(path: &Path) -> Result<Option<FrameReader>, FrameProblem> {
        let at = path.display();
        let io =
            |e: std::io::Error| (format!("{at} can't be read: {e}"), "give a run's folder as it was written".into());
        let file = mobee_model::file::open(path).map_err(io)?;
        let mut start = [0; START as usize];
        if file.metadata().map_err(io)?.len() < START {
            return Ok(None);
        }
        file.read_exact_at(&mut start, 0).map_err(io)?;
        match start.strip_prefix(MAGIC) {
            Some(version) if version == VERSION => {
                let path = path.into();
                Ok(Some(FrameReader {
                    path,
                    file,
                    at: START,
                    damage: Vec::new(),
                    tail: None,
                    search: MAX_SEARCHED_BYTES,
                }))
            }
            Some(_) => Err((
                format!("{at} is of another version"),
                "read it by the program that wrote it, or run again".into(),
            )),
            None => Err((format!("{at} holds no frames of a run"), "give a run's folder as it was written".into())),
        }
    }

    /// Next frame; `None` at the end, or if only a partial frame is left, as after a crash. Damaged parts on
    /// the way are skipped, see [`FrameReader::damage`].
    ///
    /// # Errors
    /// The file can't be read.
    pub fn next_frame(&mut self) -> Result<Option<KeptFrame>, String> {
        let unreadable = |e: std::io::Error| format!("{} can't be read: {e}", self.path.display());
        let len = self.file.metadata().map_err(unreadable)?.len();
        let begins = self.at;
        let frame = match self.head(begins, len).map_err(unreadable)? {
            // its length and time are accepted only if a later record follows or the checksum is right
            Some(frame) if self.is_followed(&frame, len).map_err(unreadable)? || self.png(&frame).is_ok() => {
                Some(frame)
            }
            _ => self.find(begins + 1, len).map_err(|e| self.unreadable(&e))?,
        };
        self.tail = (frame.is_none() && begins < len).then_some((begins, len));
        let Some(frame) = frame else { return Ok(None) };
        if frame.at > begins {
            self.leave_out(begins, frame.at);
        }
        self.at = frame.end();
        Ok(Some(frame))
    }

    /// Messages about the parts read so far that contain no valid frame.
    pub fn damage(&self) -> Vec<String> {
        let path = self.path.display();
        let tail = self.tail.map(|(from, _)| format!("{path} ends with a part of a frame, from byte {from} on"));
        self.left_out().into_iter().chain(tail).collect()
    }

    /// Messages about the damaged parts that are followed by valid frames.
    fn left_out(&self) -> Vec<String> {
        let path = self.path.display();
        let words = |(from, to): &(u64, u64)| {
            format!(
                "{path} is damaged from byte {from} to {to}: the frames there are left out; those before and after can be read"
            )
        };
        self.damage.iter().map(words).collect()
    }

    /// Restarts at the first frame.
    pub fn rewind(&mut self) {
        self.at = START;
    }

    /// End of the last valid frame, and messages about the damage before it.
    pub(super) fn whole(mut self) -> (u64, Vec<String>) {
        while let Ok(Some(_)) = self.next_frame() {}
        (self.at, self.left_out())
    }

    /// Frame whose record starts here, if it is plausible and lies within the file.
    fn head(&self, at: u64, len: u64) -> std::io::Result<Option<KeptFrame>> {
        let mut start = [0; 4 + HEAD_BYTES];
        if len < at + start.len() as u64 {
            return Ok(None);
        }
        self.file.read_exact_at(&mut start, at)?;
        Ok(parse(&start, at).filter(|frame| frame.end() <= len))
    }

    /// True if another record follows, of a later frame.
    fn is_followed(&self, frame: &KeptFrame, len: u64) -> std::io::Result<bool> {
        let mut start = [0; 4 + HEAD_BYTES];
        if len < frame.end() + start.len() as u64 {
            return Ok(false);
        }
        self.file.read_exact_at(&mut start, frame.end())?;
        Ok(parse(&start, frame.end()).is_some_and(|next| next.exposed >= frame.exposed))
    }

    /// First frame from this position on with a valid record.
    fn find(&mut self, from: u64, len: u64) -> std::io::Result<Option<KeptFrame>> {
        let mut left = self.search;
        let mut found = None;
        find_record(&self.file, from, |at, start: &[u8; 4 + HEAD_BYTES]| {
            let frame = parse(start, at).filter(|frame| frame.end() <= len && frame.length <= left);
            left -= frame.map_or(0, |frame| frame.length);
            found = frame.filter(|frame| self.png(frame).is_ok());
            Ok(found.is_some())
        })?;
        self.search = left;
        Ok(found)
    }

    /// Records a damaged part, once.
    fn leave_out(&mut self, from: u64, to: u64) {
        if self.damage.len() < MAX_REPORTED && self.damage.last().is_none_or(|(last, _)| *last < from) {
            self.damage.push((from, to));
        }
    }

    /// Image of a frame, as a PNG file.
    ///
    /// # Errors
    /// A damaged record, with its place and the remedy.
    pub fn png(&self, frame: &KeptFrame) -> Result<Vec<u8>, String> {
        let bytes = usize::try_from(frame.length + 8).map_err(|_| self.damaged(frame.at))?;
        let mut record = vec![0; bytes];
        self.file.read_exact_at(&mut record, frame.at).map_err(|e| self.unreadable(&e))?;
        let whole =
            record.split_last_chunk::<4>().filter(|(rest, sum)| crc32fast::hash(rest) == u32::from_le_bytes(**sum));
        let png = whole.and_then(|(rest, _)| rest.get(4 + HEAD_BYTES..));
        png.map(<[u8]>::to_vec).ok_or_else(|| self.damaged(frame.at))
    }

    /// Decodes a frame.
    ///
    /// # Errors
    /// As for [`FrameReader::png`].
    pub fn frame(&self, frame: &KeptFrame) -> Result<Frame, String> {
        let KeptFrame { exposed, intrinsics, at, .. } = *frame;
        let png = self.png(frame)?;
        let [width, height] = intrinsics.size;
        let picture = picture::decode(&png).ok().filter(|p| p.dimensions() == (width, height));
        let picture = picture.ok_or_else(|| self.damaged(at))?;
        Ok(Frame { exposed, intrinsics, pixels: picture.into_raw().into() })
    }

    fn unreadable(&self, e: &std::io::Error) -> String {
        format!("{} can't be read: {e}", self.path.display())
    }

    fn damaged(&self, at: u64) -> String {
        let path = self.path.display();
        format!("{path} is damaged at byte {at}: the frame there can't be read; those before and after it can")
    }
}

impl KeptFrame {
    /// Same frame, exposed later by `by`.
    pub(in crate::eyes) fn later(self, by: Duration) -> KeptFrame {
        KeptFrame { exposed: self.exposed + by, ..self }
    }

    /// Start of the next record.
    fn end(&self) -> u64 {
        self.at + 4 + self.length + 4
    }
}

fn again() -> String {
    "set keep_frames = true in the [[sensor]] of that run, and run it again".into()
}

/// Explains why there are no frames of a camera.
fn missing(run: &Path, camera: &str) -> KindError {
    let at = run.display();
    let entries = match std::fs::read_dir(run) {
        Ok(entries) => entries,
        Err(e) => return KindError::new("run", format!("can't read {at}: {e}"), "give the folder of a run"),
    };
    let names = entries.flatten().filter_map(|e| e.file_name().into_string().ok());
    let mut known: Vec<String> =
        names.filter_map(|n| Some(n.strip_suffix(".frames")?.replace('.', "/"))).take(MAX_REPORTED).collect();
    known.sort();
    if known.is_empty() {
        return KindError::new("run", format!("the run {at} kept no frames"), again());
    }
    let known: Vec<&str> = known.iter().map(String::as_str).collect();
    let what = format!("the run {at} kept no frames of a camera {camera}");
    KindError::new("camera", what, suggestion(camera, "camera", &known))
}

/// Frame whose record starts with these bytes at `at`, if they are plausible.
fn parse(start: &[u8; 4 + HEAD_BYTES], at: u64) -> Option<KeptFrame> {
    let (length, rest) = start.split_first_chunk()?;
    let (exposed, rest) = rest.split_first_chunk()?;
    let (width, rest) = rest.split_first_chunk()?;
    let (height, rest) = rest.split_first_chunk()?;
    let mut numbers = [0.0; 8];
    for (number, bytes) in numbers.iter_mut().zip(rest.as_chunks().0) {
        *number = f64::from_le_bytes(*bytes);
    }
    let [fx, fy, cx, cy, k1, k2, p1, p2] = numbers;
    let length = u64::from(u32::from_le_bytes(*length));
    let exposed = Time(u64::from_le_bytes(*exposed));
    let size = [u32::from_le_bytes(*width), u32::from_le_bytes(*height)];
    let intrinsics = Intrinsics { size, focal: [fx, fy], center: [cx, cy], distortion: [k1, k2, p1, p2] };
    let is_sound = (HEAD_BYTES as u64 + 1..=MAX_RECORD_BYTES).contains(&length)
        && exposed.since(Time::ZERO) <= MAX_RUN_TIME
        && size.iter().all(|n| (1..=MAX_SIDE_PX).contains(n))
        && numbers.iter().all(|x| x.is_finite());
    is_sound.then_some(KeptFrame { exposed, intrinsics, at, length })
}
