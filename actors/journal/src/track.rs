//! The measured configurations of a run, beside its journal: data that invariants need and that no event
//! contains.
//!
//! ```text
//! "mobee track 2\n", motors u32 | frame | frame | ...        little endian; one file per robot, poses-ROBOT.track
//! frame: length u32, records, CRC-32 of them                 a crash at any byte loses at most the last frame; damage, only its own
//! ```
//! Every reading is stored while a commit is open, the filter is not at rest, or a motor has left its place,
//! beginning sixteen readings earlier; otherwise one per second. Positions are rounded to [`QUANTUM`]. A moving
//! motor usually takes two bytes per reading, one at rest takes one; a file grows by at most [`per_hour`]. A
//! separate thread writes it, as for the recording: no actor waits for it, and a run continues without it.

mod frame;
mod read;
pub use read::{Readings, TrackGap, TrackReading, read};

use frame::{HEADER, TrackFrame, header};
use mobee_contract::{Before, Entry, Event, Pose, Sink, Status, Time, create_private};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Rounding step of a position, rad.
pub const QUANTUM: f64 = 1e-6;
/// Greatest absolute position of a valid reading, rad.
const MAX_POSITION_RAD: f64 = 1000.0;
/// Least interval between readings; earlier ones are skipped.
const MIN_INTERVAL: Duration = Duration::from_millis(5);
/// Interval of the stored readings at rest.
const REST_INTERVAL: Duration = Duration::from_secs(1);
/// Number of readings that are stored from before a motion.
const LEAD_READINGS: usize = 16;
/// Number of readings from which a flush writes the frame; an outcome writes it at once.
const FLUSH_READINGS: usize = 16;
/// Size at which a frame is closed, bytes.
const FRAME_BYTES: usize = 1 << 14;

/// Path of a robot's measured configurations in a run's folder.
pub fn file(dir: &Path, robot: &str) -> PathBuf {
    dir.join(format!("poses-{robot}.track"))
}

/// Upper bound on the growth of the file of a robot with this number of motors, bytes per hour: two hundred
/// readings per second, each with at most forty bytes for its times and frame, and five bytes for a motor.
pub const fn per_hour(motors: u64) -> u64 {
    3600 * 200 * (40 + 5 * motors)
}

/// Sink that writes the measured configurations of all robots of a run. Clones share it: one remains to reopen
/// its sink.
#[derive(Clone, Debug)]
pub struct Tracks(Arc<Mutex<Vec<TrackFile>>>);

impl Tracks {
    /// Creates a file per robot (its name, number of motors, and the tolerance of its place, rad), or continues
    /// that of an earlier process, whose last frame is cut off if it is not complete. Earlier damage stays as
    /// it is.
    ///
    /// # Errors
    /// The file that can't be read to its end, can't be written, or is not such a file, as a message.
    pub fn open(dir: &Path, robots: &[(String, usize, f64)]) -> Result<Tracks, String> {
        let tracks = robots.iter().map(|(robot, motors, tolerance)| TrackFile::open(dir, robot, *motors, *tolerance));
        Ok(Tracks(Arc::new(Mutex::new(tracks.collect::<Result<_, _>>()?))))
    }

    /// Returns a sink that writes them. A new one continues where the last one failed.
    pub fn sink(&self) -> Box<dyn Sink> {
        self.tracks().iter_mut().for_each(|track| {
            // A frame that can't be written is lost, like readings that arrive without a sink.
            let _ = track.spill();
            track.before.clear();
            track.frame = TrackFrame::default();
        });
        Box::new(self.clone())
    }

    fn tracks(&self) -> MutexGuard<'_, Vec<TrackFile>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn spill(&self, at_least: usize) -> Result<(), String> {
        self.tracks().iter_mut().filter(|t| t.frame.readings() >= at_least).try_for_each(TrackFile::spill)
    }
}

impl Sink for Tracks {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        match entry {
            Entry::Event(event) => {
                self.tracks().iter_mut().try_for_each(|track| track.event(at, event))?;
                match &**event {
                    Event::Outcome { .. } | Event::Ended { .. } => self.spill(1),
                    _ => Ok(()),
                }
            }
            Entry::Pose { robot, q, .. } => self.tracks().get_mut(*robot).map_or(Ok(()), |track| track.pose(at, q)),
            Entry::Scene(_) | Entry::Picture { .. } => Ok(()),
        }
    }

    fn flush(&mut self) -> Result<(), String> {
        self.spill(FLUSH_READINGS)
    }

    fn lost(&mut self) {
        self.tracks().iter_mut().for_each(|track| {
            track.before.clear();
            track.frame.part();
        });
    }
}

/// The file of one robot, and the readings that are not in it yet.
#[derive(Debug)]
struct TrackFile {
    robot: String,
    path: PathBuf,
    file: File,
    /// Size of the complete frames, bytes.
    len: u64,
    motors: usize,
    /// Distance from the last written position beyond which a motor has left its place, rad.
    place: f64,
    frame: TrackFrame,
    /// True if the robot moves, by the state of the filter.
    busy: bool,
    /// True if a commit is open: it may also be while the filter holds.
    open: bool,
    /// Time of the newest event: a pose that is reported later may have been read earlier.
    newest_event: Time,
    /// Time of the newest reading.
    newest: Option<Time>,
    /// The newest reading that was written.
    written: Option<(Time, Pose)>,
    /// The newest readings at rest, not written yet.
    before: VecDeque<TrackReading>,
}

impl TrackFile {
    fn open(dir: &Path, robot: &str, motors: usize, tolerance: f64) -> Result<TrackFile, String> {
        let path = file(dir, robot);
        let explain = |e: std::io::Error| format!("{}: {e}; choose a folder that can be written", path.display());
        let mut whole = 0;
        if let Some(mut readings) = read(&path)? {
            readings.by_ref().for_each(drop);
            if readings.motors() != motors {
                let at = path.display();
                let of = readings.motors();
                return Err(format!(
                    "{at}: it has the measured poses of {of} motors, and {robot} has {motors}; put back the file as it was written, or take it away"
                ));
            }
            // The rest of the file may be readable: it is not cut off.
            if let Some(failure) = readings.failure() {
                return Err(format!("{failure}; check the disk, or move the file away to go on without it"));
            }
            whole = readings.whole();
        }
        let mut file = create_private(&path, Before::Keep).map_err(explain)?;
        file.set_len(whole).map_err(explain)?;
        if whole == 0 {
            file.write_all(&header(motors)).map_err(explain)?;
            whole = HEADER;
        }
        Ok(TrackFile {
            robot: robot.into(),
            path,
            file,
            len: whole,
            motors,
            place: 0.25 * tolerance,
            frame: TrackFrame::default(),
            busy: false,
            open: false,
            newest_event: Time::ZERO,
            newest: None,
            written: None,
            before: VecDeque::new(),
        })
    }

    fn event(&mut self, at: Time, event: &Event) -> Result<(), String> {
        self.newest_event = self.newest_event.max(at);
        match event {
            Event::State { robot, status } if *robot == self.robot => {
                self.busy = !matches!(status, Status::Starting | Status::Rest | Status::Holding(_));
                Ok(())
            }
            // The readings that led to a decision are stored with it.
            Event::Commit { robot, .. } if *robot == self.robot => {
                self.open = true;
                self.put_before()
            }
            Event::Outcome { robot, .. } if *robot == self.robot => {
                self.open = false;
                self.put_before()
            }
            _ => Ok(()),
        }
    }

    /// Stores the newest readings at rest.
    fn put_before(&mut self) -> Result<(), String> {
        while let Some(reading) = self.before.pop_front() {
            self.put(&reading)?;
        }
        Ok(())
    }

    fn pose(&mut self, at: Time, q: &Pose) -> Result<(), String> {
        let soon = self.newest.is_some_and(|newest| at < newest + MIN_INTERVAL);
        if soon || q.len() != self.motors || !q.iter().all(|q| q.abs() <= MAX_POSITION_RAD) {
            return Ok(());
        }
        self.newest = Some(at);
        let left =
            self.written.as_ref().is_none_or(|(_, w)| w.iter().zip(q.iter()).any(|(w, q)| (w - q).abs() > self.place));
        self.before.push_back(TrackReading { at, reported: at.max(self.newest_event), q: q.clone(), follows: true });
        if self.busy || self.open || left {
            self.put_before()?;
        } else if self.before.len() > LEAD_READINGS
            && let Some(oldest) = self.before.pop_front()
            && self.written.as_ref().is_none_or(|(last, _)| oldest.at >= *last + REST_INTERVAL)
        {
            self.put(&oldest)?;
        }
        Ok(())
    }

    fn put(&mut self, reading: &TrackReading) -> Result<(), String> {
        self.written = Some((reading.at, reading.q.clone()));
        self.frame.put(reading);
        if self.frame.len() >= FRAME_BYTES { self.spill() } else { Ok(()) }
    }

    /// Writes the frame. If that fails the file may end with a part of it, which the next write overwrites.
    fn spill(&mut self) -> Result<(), String> {
        if self.frame.readings() == 0 {
            return Ok(());
        }
        let bytes = self.frame.close();
        let written = self.file.seek(SeekFrom::Start(self.len)).and_then(|_| self.file.write_all(&bytes));
        written.map_err(|e| format!("{}: {e}; make room on the disk", self.path.display()))?;
        self.len += bytes.len() as u64;
        Ok(())
    }
}

impl Drop for TrackFile {
    fn drop(&mut self) {
        // There is no receiver for an error any more.
        let _ = self.spill();
    }
}

#[cfg(test)]
mod tests;
