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

/// So many readings in motion, 20 ms apart.
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

/// A transaction gets its outcome by the readings of a robot that holds.
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
fn when_it_was_told_is_kept_and_senseless_readings_are_not() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    state(&mut tracks, ms(300), Status::Moving);
    pose(&mut tracks, ms(120), [0.1, 0.2]);
    pose(&mut tracks, ms(140), [f64::NAN, 0.2]);
    pose(&mut tracks, ms(141), [0.1, 0.2]);
    pose(&mut tracks, ms(143), [0.1, 0.2]);
    pose(&mut tracks, ms(320), [0.1, 0.2]);
    drop(tracks);
    let times: Vec<(Time, Time)> = all(dir.path()).iter().map(|r| (r.at, r.told)).collect();
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

/// What `per_hour` says, if the encoders lie as they can.
#[test]
fn a_file_stays_within_its_bound() {
    let dir = tempfile::tempdir().unwrap();
    let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
    state(&mut tracks, ms(0), Status::Moving);
    // senseless jumps, ten thousand times a second
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
                // opened anew, by the same process or the next
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

    /// A crash at any byte costs the tail, and the next process goes on there.
    #[test]
    fn a_cut_costs_the_tail_and_no_more(cut in 0_u64..2000, flip in any::<bool>()) {
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
        if flip {
            bytes[cut] ^= 0x40;
        } else {
            bytes.truncate(cut);
        }
        std::fs::write(&path, &bytes).unwrap();
        let Ok(readings) = read(&path) else { return Ok(()) }; // the beginning itself is damaged
        let left: Vec<TrackReading> = readings.map(Iterator::collect).unwrap_or_default();
        prop_assert_eq!(&left[..], &whole[..left.len()]);
        if cut > HEADER as usize {
            let mut tracks = Tracks::open(dir.path(), &robots()).unwrap();
            moves(&mut tracks, 1000, 20);
            drop(tracks);
            prop_assert_eq!(all(dir.path()).len(), left.len() + 20);
        }
    }
}
