//! The measured poses of a run, beside its journal: what invariants are judged by that no event tells.
//!
//! ```text
//! "mobee track 2\n", motors u32 | frame | frame | ...        little endian; one file per robot, poses-ROBOT.track
//! frame: length u32, records, CRC-32 of them                 a crash at any byte costs the last frame at most, damage its own
//! ```
//! Every reading is kept while a commit is open, the robot's filter is not at rest, or a motor leaves its place, from sixteen readings before; else one
//! a second. Positions are rounded to [`QUANTUM`]. A motor that moves costs two bytes a reading as a rule, one that rests one byte; no
//! file grows faster than [`per_hour`] says. It is written by a thread of its own, as the
//! recording is: nobody waits for it, and a run goes on without.

mod frame;
mod read;
pub use read::{Readings, TrackGap, TrackReading, read};

use frame::{Frame, HEADER, header};
use mobee_contract::{Before, Entry, Event, Pose, Sink, Status, Time, create_private};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// To what a position is rounded, rad.
pub const QUANTUM: f64 = 1e-6;
/// Positions beyond this are no reading's, rad.
const FARTHEST: f64 = 1000.0;
/// Readings that come sooner after the one before are passed over.
const SOONEST: Duration = Duration::from_millis(5);
/// How far apart readings at rest are.
const SPARSE: Duration = Duration::from_secs(1);
/// How many readings are kept from before something begins.
const BEFORE: usize = 16;
/// So many readings wait for a frame at most, unless an outcome makes it urgent.
const GATHER: usize = 16;
/// A frame is closed when it is as long as this, bytes.
const LONG: usize = 1 << 14;

/// The file of a robot's measured poses in a run's folder.
pub fn file(dir: &Path, robot: &str) -> PathBuf {
    dir.join(format!("poses-{robot}.track"))
}

/// The most by which the file of a robot with so many motors can grow in an hour, bytes: two hundred readings a second, each with its
/// times and frame in forty bytes at most, and five bytes for a motor.
pub const fn per_hour(motors: u64) -> u64 {
    3600 * 200 * (40 + 5 * motors)
}

/// Writes the measured poses of all robots of a run. Clones share it: one is kept to open its sink anew.
#[derive(Clone, Debug)]
pub struct Tracks(Arc<Mutex<Vec<Track>>>);

impl Tracks {
    /// Begins a file per robot (its name, motors, and the tolerance within which it is in its place, rad), or goes on in that of an
    /// earlier process, whose last frame is cut off if it is not whole. What is damaged before stays as it is.
    ///
    /// # Errors
    /// The file that can't be written or is none of these, in words.
    pub fn open(dir: &Path, robots: &[(String, usize, f64)]) -> Result<Tracks, String> {
        let tracks = robots.iter().map(|(robot, motors, tolerance)| Track::open(dir, robot, *motors, *tolerance));
        Ok(Tracks(Arc::new(Mutex::new(tracks.collect::<Result<_, _>>()?))))
    }

    /// The sink that writes them. A new one continues where the last one failed.
    pub fn sink(&self) -> Box<dyn Sink> {
        self.tracks().iter_mut().for_each(|track| {
            // what can't be written is lost, as what comes while nobody writes
            let _ = track.spill();
            track.before.clear();
            track.frame = Frame::default();
        });
        Box::new(self.clone())
    }

    fn tracks(&self) -> MutexGuard<'_, Vec<Track>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn spill(&self, at_least: usize) -> Result<(), String> {
        self.tracks().iter_mut().filter(|t| t.frame.readings() >= at_least).try_for_each(Track::spill)
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
        self.spill(GATHER)
    }

    fn lost(&mut self) {
        self.tracks().iter_mut().for_each(|track| {
            track.before.clear();
            track.frame.part();
        });
    }
}

/// One robot's file, and what is not in it yet.
#[derive(Debug)]
struct Track {
    robot: String,
    path: PathBuf,
    file: File,
    /// Bytes of the file that are whole frames.
    len: u64,
    motors: usize,
    /// How far a motor may be from where it was written before it has left its place, rad.
    place: f64,
    frame: Frame,
    /// Whether something is under way, by the state of the filter.
    busy: bool,
    /// Whether a commit is open: it may well be while the filter holds.
    open: bool,
    /// The time of the newest event: a pose that is told later was read earlier.
    told: Time,
    /// The newest reading, and the newest that was written.
    newest: Option<Time>,
    written: Option<(Time, Pose)>,
    /// The newest readings at rest.
    before: VecDeque<TrackReading>,
}

impl Track {
    fn open(dir: &Path, robot: &str, motors: usize, tolerance: f64) -> Result<Track, String> {
        let path = file(dir, robot);
        let explain = |e: std::io::Error| format!("{}: {e}; choose a folder that can be written", path.display());
        let mut whole = 0;
        if let Some(mut readings) = read(&path)? {
            readings.by_ref().for_each(drop);
            if readings.motors() != motors {
                let (at, of) = (path.display(), readings.motors());
                return Err(format!(
                    "{at}: it has the measured poses of {of} motors, and {robot} has {motors}; put back the file as it was written, or take it away"
                ));
            }
            whole = readings.whole();
        }
        let mut file = create_private(&path, Before::Keep).map_err(explain)?;
        file.set_len(whole).map_err(explain)?;
        if whole == 0 {
            file.write_all(&header(motors)).map_err(explain)?;
            whole = HEADER;
        }
        Ok(Track {
            robot: robot.into(),
            path,
            file,
            len: whole,
            motors,
            place: 0.25 * tolerance,
            frame: Frame::default(),
            busy: false,
            open: false,
            told: Time::ZERO,
            newest: None,
            written: None,
            before: VecDeque::new(),
        })
    }

    fn event(&mut self, at: Time, event: &Event) -> Result<(), String> {
        self.told = self.told.max(at);
        match event {
            Event::State { robot, status } if *robot == self.robot => {
                self.busy = !matches!(status, Status::Starting | Status::Rest | Status::Holding(_));
                Ok(())
            }
            // what was decided by a reading is told with it
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

    /// The newest readings at rest are of interest.
    fn put_before(&mut self) -> Result<(), String> {
        while let Some(reading) = self.before.pop_front() {
            self.put(&reading)?;
        }
        Ok(())
    }

    fn pose(&mut self, at: Time, q: &Pose) -> Result<(), String> {
        let soon = self.newest.is_some_and(|newest| at < newest + SOONEST);
        if soon || q.len() != self.motors || !q.iter().all(|q| q.abs() <= FARTHEST) {
            return Ok(());
        }
        self.newest = Some(at);
        let left =
            self.written.as_ref().is_none_or(|(_, w)| w.iter().zip(q.iter()).any(|(w, q)| (w - q).abs() > self.place));
        self.before.push_back(TrackReading { at, told: at.max(self.told), q: q.clone(), follows: true });
        if self.busy || self.open || left {
            self.put_before()?;
        } else if self.before.len() > BEFORE
            && let Some(oldest) = self.before.pop_front()
            && self.written.as_ref().is_none_or(|(last, _)| oldest.at >= *last + SPARSE)
        {
            self.put(&oldest)?;
        }
        Ok(())
    }

    fn put(&mut self, reading: &TrackReading) -> Result<(), String> {
        self.written = Some((reading.at, reading.q.clone()));
        self.frame.put(reading);
        if self.frame.len() >= LONG { self.spill() } else { Ok(()) }
    }

    /// Writes the frame. If that fails the file may end with a part of it, which the next one overwrites.
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

impl Drop for Track {
    fn drop(&mut self) {
        // nobody is left to be told
        let _ = self.spill();
    }
}

#[cfg(test)]
mod tests;
