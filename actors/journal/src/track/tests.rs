use super::*;
use mobee_contract::{CommitId, Outcome};
use proptest::prelude::*;

const ROBOT: &str = "a";

fn robots() -> Vec<(String, usize, f64)> {
    vec![(ROBOT.into(), 2, 0.002)]
}

fn pose(sink: &mut Tracks, at: Time, q: [f64; 2]) {
    let entry = Entry::Pose { robot: 0, q: q.as_slice().into(), contacts: Vec::new().into() };
    sink.write(at, &entry).unwrap();
}

fn state(sink: &mut Tracks, at: Time, status: Status) {
    let event = Event::State { robot: ROBOT.into(), status };
    sink.write(at, &Entry::Event(Arc::new(event))).unwrap();
}

fn ms(n: u64) -> Time {
    Time(n * 1_000_000)
}

fn all(dir: &Path) -> Vec<TrackReading> {
    read(&file(dir, ROBOT)).unwrap().map(Iterator::collect).unwrap_or_default()
}

/// A number of readings in motion, 20 ms apart.
fn moves(sink: &mut Tracks, from: u64, n: u64) {
    state(sink, ms(20 * from), Status::Moving);
    (from..from + n).for_each(|k| pose(sink, ms(20 * k), [0.001 * k as f64, -1.5]));
}

#[test]
fn what_moves_is_kept_in_full_and_what_rests_once_a_second_with_what_came_before() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    (0..500).for_each(|k| pose(&mut tracks, ms(20 * k), [0.0, 1e-4 * (k % 3) as f64]));
    moves(&mut tracks, 500, 50);
    drop(tracks);
    let readings = all(dir.path());
    let rest: Vec<u64> = readings.iter().map(|r| r.at.0 / 1_000_000).filter(|at| *at < 10_000).collect();
    assert_eq!(&rest[..9], [0, 1000, 2000, 3000, 4000, 5000, 6000, 7000, 8000]);
    let before: Vec<u64> = (484..500).map(|k| 20 * k).collect();
    assert!(rest.ends_with(&before), "sixteen readings before the motion: {rest:?}");
    assert_eq!(readings.iter().filter(|r| r.at >= ms(10_000)).count(), 50);
}

#[test]
fn a_robot_that_leaves_its_place_is_kept_in_full_whatever_its_filter_says() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    state(&mut tracks, ms(0), Status::Rest);
    (0..100).for_each(|k| pose(&mut tracks, ms(20 * k), [0.001 * k as f64, 0.0]));
    drop(tracks);
    assert_eq!(all(dir.path()).len(), 100);
}

/// The outcome of a transaction is given by the readings of a robot that holds.
#[test]
fn a_robot_that_holds_with_a_commit_open_is_kept_in_full() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    let (robot, agent, target) = (ROBOT.to_owned(), "a/agent".to_owned(), [0.0, 0.0].as_slice().into());
    let commit = Event::Commit { robot, id: CommitId(1), agent, target, escape: false, motors: vec![], stream: false };
    (0..5).for_each(|k| pose(&mut tracks, ms(20 * k), [0.0, 0.0]));
    tracks.write(ms(85), &Entry::Event(Arc::new(commit))).unwrap();
    state(&mut tracks, ms(90), Status::Holding(mobee_contract::Hold::Stale));
    (5..100).for_each(|k| pose(&mut tracks, ms(20 * k), [0.0, 0.0]));
    drop(tracks);
    assert_eq!(all(dir.path()).len(), 100);
}

#[test]
fn the_time_of_the_report_is_stored_and_invalid_readings_are_not() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    state(&mut tracks, ms(300), Status::Moving);
    pose(&mut tracks, ms(120), [0.1, 0.2]);
    pose(&mut tracks, ms(140), [f64::NAN, 0.2]);
    pose(&mut tracks, ms(141), [0.1, 0.2]);
    pose(&mut tracks, ms(143), [0.1, 0.2]);
    pose(&mut tracks, ms(320), [0.1, 0.2]);
    drop(tracks);
    let times: Vec<(Time, Time)> = all(dir.path()).iter().map(|r| (r.at, r.reported)).collect();
    assert_eq!(times, [(ms(120), ms(300)), (ms(141), ms(300)), (ms(320), ms(320))]);
}

#[test]
fn an_outcome_is_followed_by_its_poses_on_the_disk() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    moves(&mut tracks, 0, 5);
    assert_eq!(all(dir.path()).len(), 0);
    let (robot, q) = (ROBOT.to_owned(), [0.0, 0.0].as_slice().into());
    let event = Event::Outcome { robot, id: CommitId(1), outcome: Outcome::Committed, q, safe: None, cause: None };
    tracks.write(ms(100), &Entry::Event(Arc::new(event))).unwrap();
    assert_eq!(all(dir.path()).len(), 5);
}

#[test]
fn what_was_lost_on_the_way_shows() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    moves(&mut tracks, 0, 3);
    tracks.lost();
    moves(&mut tracks, 10, 3);
    drop(tracks);
    moves(&mut Tracks::open(dir.path(), &robots()).unwrap(), 20, 2);
    let follows: Vec<bool> = all(dir.path()).iter().map(|r| r.follows).collect();
    assert_eq!(follows, [false, true, true, false, true, true, false, true]);
}

/// The bound of `per_hour` holds for the worst encoder readings.
#[test]
fn a_file_stays_within_its_bound() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    state(&mut tracks, ms(0), Status::Moving);
    // Random jumps, ten thousand times a second.
    (0..600_000).for_each(|k| pose(&mut tracks, Time(k * 100_000), if k % 2 == 0 { [1e3; 2] } else { [-1e3; 2] }));
    drop(tracks);
    let bytes = std::fs::metadata(file(dir.path(), ROBOT)).unwrap().len();
    assert!(bytes < per_hour(2) / 60, "{bytes} bytes in a minute");
}

proptest! {
    #[test]
    fn readings_come_back_within_the_quantum(
        steps in prop::collection::vec((5_000_000_u64..1_000_000_000_000, -10.0..10.0, -1e3..1e3, 0_u64..3), 1..200),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
        let (mut at, mut written) = (Time(0), Vec::new());
        state(&mut tracks, at, Status::Moving);
        for (step, a, b, again) in steps {
            at = Time(at.0 + step);
            pose(&mut tracks, at, [a, b]);
            written.push((at, [a, b]));
            if again == 0 {
                // Reopened by the same process or the next one.
                drop(tracks);
                tracks = Tracks::open(dir.path(), &robots()).unwrap();
                state(&mut tracks, at, Status::Moving);
            } else if again == 1 {
                let _ = tracks.sink().flush();
            }
        }
        drop(tracks);
        let back = all(dir.path());
        prop_assert_eq!(back.len(), written.len());
        for (reading, (at, q)) in back.iter().zip(&written) {
            prop_assert_eq!(reading.at, *at);
            prop_assert!(reading.q.iter().zip(q).all(|(a, b)| (a - b).abs() <= 0.51 * QUANTUM));
        }
    }

    /// A crash at any byte loses the last frame, and damage to any byte loses its frame; the next process
    /// continues there.
    #[test]
    fn a_cut_costs_the_tail_and_damage_one_frame(cut in 0_u64..2000, damage in 0_usize..3) {
        let dir = tempfile::tempdir().unwrap();
        let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
        for k in 0..10 {
            moves(&mut tracks, 20 * k, 20);
            tracks.flush().unwrap();
        }
        drop(tracks);
        let (path, whole) = (file(dir.path(), ROBOT), all(dir.path()));
        let mut bytes = std::fs::read(&path).unwrap();
        let cut = (cut as usize).min(bytes.len() - 1);
        match damage {
            0 => bytes.truncate(cut),
            1 => bytes[cut] ^= 0x40,
            _ => bytes[cut..].iter_mut().take(9).for_each(|byte| *byte = 0xff),
        }
        std::fs::write(&path, &bytes).unwrap();
        let Ok(readings) = read(&path) else { return Ok(()) }; // the header is damaged
        if readings.as_ref().is_some_and(|r| r.motors() != 2) {
            prop_assert!(Tracks::open(dir.path(), &robots()).is_err_and(|e| e.contains("motors")));
            return Ok(());
        }
        let mut readings = readings.into_iter().flatten().collect::<Vec<_>>();
        readings.iter_mut().for_each(|r| r.follows = true);
        let lost = whole.iter().filter(|w| !readings.iter().any(|r| (r.at, &r.q) == (w.at, &w.q))).count();
        prop_assert_eq!(readings.len() + lost, whole.len(), "nothing is there that was not");
        prop_assert!(damage == 0 || lost <= 40, "{} lost", lost);
        if cut > HEADER as usize {
            let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
            moves(&mut tracks, 1000, 20);
            drop(tracks);
            prop_assert_eq!(all(dir.path()).len(), readings.len() + 20);
        }
    }
}

/// Starts of the frames of a file, and the end of the last one.
fn frames(bytes: &[u8]) -> Vec<usize> {
    let mut places = vec![HEADER as usize];
    while let Some(length) = bytes.get(places[places.len() - 1]..).and_then(|rest| rest.first_chunk::<4>()) {
        places.push(places[places.len() - 1] + 8 + u32::from_le_bytes(*length) as usize);
    }
    places
}

#[test]
fn what_can_not_be_read_is_named_with_its_place_and_times() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    for k in 0..5 {
        moves(&mut tracks, 20 * k, 20);
        tracks.flush().unwrap();
    }
    drop(tracks);
    let path = file(dir.path(), ROBOT);
    let whole = std::fs::read(&path).unwrap();
    let at = frames(&whole);
    assert_eq!(at.len(), 6);
    let read_all = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let mut readings = read(&path).unwrap().unwrap();
        let parted: Vec<Time> = readings.by_ref().filter(|r| !r.follows).map(|r| r.at).collect();
        (readings.gaps().to_vec(), parted)
    };
    let gap = |from: usize, to: usize, after, until| TrackGap { bytes: (from as u64, to as u64), after, until };
    assert_eq!(read_all(&whole), (vec![], vec![ms(0)]));
    for byte in [at[1], at[1] + 2, at[1] + 9, at[2] - 1] {
        let mut bytes = whole.clone();
        bytes[byte] ^= 0x20;
        let expected = vec![gap(at[1], at[2], Some(ms(380)), Some(ms(800)))];
        assert_eq!(read_all(&bytes), (expected, vec![ms(0), ms(800)]), "byte {byte}");
    }
    let without: Vec<u8> = [&whole[..at[1]], &whole[at[2]..]].concat();
    let expected = vec![gap(at[1], at[1], Some(ms(380)), Some(ms(800)))];
    assert_eq!(read_all(&without), (expected, vec![ms(0), ms(800)]), "a frame that is missing as a whole");
    let expected = vec![gap(at[4], at[5] - 3, Some(ms(1580)), None)];
    assert_eq!(read_all(&whole[..at[5] - 3]), (expected, vec![ms(0)]), "as a crash leaves it");
}

/// Damage that can't be searched to its end is an error: the readings behind it are not cut off.
#[test]
fn no_reading_is_cut_off_behind_damage_that_is_too_large_to_search() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    for k in 0..3 {
        moves(&mut tracks, 20 * k, 20);
        tracks.flush().unwrap();
    }
    drop(tracks);
    let path = file(dir.path(), ROBOT);
    let whole = std::fs::read(&path).unwrap();
    let at = frames(&whole)[1];
    // A quarter of these offsets look like the length of a frame: of 16 KB, of 257 bytes and of one byte.
    let lengths: [([u8; 4], usize); 3] = [([0x3e, 0x3e, 0, 0], 80_000), ([1, 1, 0, 0], 200), ([1, 0, 0, 0], 600)];
    let damage: Vec<u8> = lengths.iter().flat_map(|(length, n)| length.repeat(*n)).collect();
    let bytes = [&whole[..at], &damage, &whole[at..]].concat();
    std::fs::write(&path, &bytes).unwrap();
    let error = Tracks::open(dir.path(), &robots()).unwrap_err();
    assert!(error.contains("too large to be searched") && error.contains("move the file away"), "{error}");
    assert!(std::fs::read(&path).unwrap() == bytes, "the file is as it was");
}

/// A file of the previous version: after damage, reading resumes at a record that is readable by itself.
#[test]
fn a_file_of_the_version_before_is_read_and_continued() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    moves(&mut tracks, 0, 20);
    drop(tracks);
    let path = file(dir.path(), ROBOT);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[12] = b'1';
    std::fs::write(&path, bytes).unwrap();
    moves(&mut Tracks::open(dir.path(), &robots()).unwrap(), 20, 20);
    assert_eq!(all(dir.path()).len(), 40);
    assert_eq!(std::fs::read(&path).unwrap()[12], b'1', "it stays what it is");
}
