//! The configuration ring in a file: the last minutes of a robot's motion, for the process that resumes after a
//! crash.
//!
//! ```text
//! "mobee poses 1\n", motors u32, capacity u32 | record 0 | record 1 | ...        little endian
//! record: time of the run u64 ns, position of each motor f64 rad, CRC-32 of both
//! ```
//! Records are written cyclically, in one write each. They reach the operating system immediately, and so
//! survive the process; unlike the journal's outcomes they are not synced to disk.

use mobee_contract::{Before, Entry, Pose, Sink, Time, create_private};
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 14] = b"mobee poses 1\n";
const HEADER: usize = MAGIC.len() + 8;
/// Limit on the number of motors and of records.
const MAX_COUNT: usize = 1 << 24;
/// Largest size of a file, bytes: a million configurations of 30 motors.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// Path of a robot's ring in a run's folder.
pub fn file(dir: &Path, robot: &str) -> PathBuf {
    dir.join(format!("poses-{robot}.ring"))
}

/// Sink that writes the configurations of all robots of a run.
#[derive(Debug)]
pub struct Rings(Vec<RingFile>);

#[derive(Debug)]
struct RingFile {
    path: PathBuf,
    file: File,
    motors: usize,
    capacity: usize,
    next: usize,
}

impl Rings {
    /// Creates a ring per robot (its name, number of motors, and number of configurations to store), in place
    /// of those of an earlier process.
    ///
    /// # Errors
    /// The file that can't be written, as a message.
    pub fn create(dir: &Path, robots: &[(String, usize, usize)]) -> Result<Rings, String> {
        let begin = |(robot, motors, capacity): &(String, usize, usize)| {
            let path = file(dir, robot);
            let begin = || -> std::io::Result<File> {
                let mut file = create_private(&path, Before::Empty)?;
                file.write_all(MAGIC)?;
                for n in [*motors, *capacity] {
                    file.write_all(&u32::try_from(n).unwrap_or(u32::MAX).to_le_bytes())?;
                }
                Ok(file)
            };
            let file = begin().map_err(|e| format!("{}: {e}; choose a folder that can be written", path.display()))?;
            Ok(RingFile { path, file, motors: *motors, capacity: (*capacity).max(1), next: 0 })
        };
        robots.iter().map(begin).collect::<Result<_, String>>().map(Rings)
    }
}

fn record(at: Time, q: &[f64]) -> Vec<u8> {
    let mut bytes = at.0.to_le_bytes().to_vec();
    q.iter().for_each(|q| bytes.extend(q.to_le_bytes()));
    let sum = crc32fast::hash(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

impl Sink for Rings {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        let Entry::Pose { robot, q, .. } = entry else { return Ok(()) };
        let Some(ring) = self.0.get_mut(*robot).filter(|r| r.motors == q.len()) else { return Ok(()) };
        let bytes = record(at, q);
        let place = HEADER as u64 + (ring.next * bytes.len()) as u64;
        ring.next = (ring.next + 1) % ring.capacity;
        let written = ring.file.seek(SeekFrom::Start(place)).and_then(|_| ring.file.write_all(&bytes));
        written.map_err(|e| format!("{}: {e}; make room on the disk", ring.path.display()))
    }

    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

/// Reads the configurations of a ring file, oldest first; truncated or damaged ones are skipped. Empty without
/// a file.
///
/// # Errors
/// A file that is not a ring, or can't be read, as a message.
pub fn read(path: &Path) -> Result<Vec<(Time, Pose)>, String> {
    let bytes = match mobee_model::file::read(path, MAX_FILE_BYTES) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(format!("{}: {e}", path.display())),
    };
    let number = |at: usize| {
        let four: [u8; 4] = bytes.get(at..at + 4)?.try_into().ok()?;
        usize::try_from(u32::from_le_bytes(four)).ok()
    };
    let (motors, capacity) = match (bytes.starts_with(MAGIC), number(MAGIC.len()), number(MAGIC.len() + 4)) {
        (true, Some(motors), Some(capacity)) if motors < MAX_COUNT && capacity < MAX_COUNT => (motors, capacity),
        _ => {
            return Err(format!(
                "{}: this is no file of recorded poses; take it away to go on without",
                path.display()
            ));
        }
    };
    let size = 8 + 8 * motors + 4;
    let mut poses: Vec<(Time, Pose)> =
        bytes.get(HEADER..).unwrap_or_default().chunks_exact(size).take(capacity).filter_map(pose).collect();
    poses.sort_by_key(|(at, _)| *at);
    Ok(poses)
}

/// Parses a complete record with a valid checksum and finite numbers.
fn pose(bytes: &[u8]) -> Option<(Time, Pose)> {
    let (body, sum) = bytes.split_last_chunk::<4>()?;
    if crc32fast::hash(body) != u32::from_le_bytes(*sum) {
        return None;
    }
    let (at, q) = body.split_first_chunk::<8>()?;
    let q: Vec<f64> = q.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
    q.iter().all(|q| q.is_finite()).then(|| (Time(u64::from_le_bytes(*at)), q.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn write_poses(ring: &mut Rings, n: u64) {
        for k in 0..n {
            let entry = Entry::Pose { robot: 0, q: vec![k as f64, -0.5].into(), contacts: Vec::new().into() };
            ring.write(Time(k), &entry).unwrap();
        }
    }

    proptest! {
        #[test]
        fn the_newest_poses_come_back_in_order(n in 0_u64..50, room in 1_usize..20) {
            let dir = tempfile::tempdir().unwrap();
            write_poses(&mut Rings::create(dir.path(), &[("a".into(), 2, room)]).unwrap(), n);
            let back = read(&file(dir.path(), "a")).unwrap();
            let times: Vec<u64> = back.iter().map(|(at, _)| at.0).collect();
            prop_assert_eq!(times, (n.saturating_sub(room as u64)..n).collect::<Vec<_>>());
            prop_assert!(back.iter().all(|(at, q)| q[0] == at.0 as f64));
        }

        #[test]
        fn damage_costs_poses_and_nothing_else(cut in 0_usize..400, flip in 0_usize..400) {
            let dir = tempfile::tempdir().unwrap();
            write_poses(&mut Rings::create(dir.path(), &[("a".into(), 2, 12)]).unwrap(), 12);
            let path = file(dir.path(), "a");
            let mut bytes = std::fs::read(&path).unwrap();
            bytes.truncate(cut.max(1));
            if let Some(byte) = bytes.get_mut(flip) {
                *byte ^= 0x10;
            }
            std::fs::write(&path, bytes).unwrap();
            if let Ok(back) = read(&path) {
                prop_assert!(back.iter().all(|(at, q)| q[0] == at.0 as f64 && q[1] == -0.5));
            }
        }
    }
}
