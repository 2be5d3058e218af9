use super::*;
use mobee_contract::Sample;
use proptest::prelude::*;

/// As for a controller with a period of 20 ms.
const STALE: Duration = Duration::from_millis(100);

fn pulse(seq: u64, ms: u64, q: f64) -> Pulse {
    let sample =
        Sample { seq, at: Time(ms * 1_000_000), q: vec![q, 0.0].into(), done: vec![true; 2], ..Sample::default() };
    Pulse::new(sample, &Vec::new().into())
}

fn filled(length: usize, n: u64, q: impl Fn(u64) -> f64) -> HistoryCore {
    let mut history = HistoryCore::new(length);
    (0..n).for_each(|k| history.push(&mut pulse(k, 10 * k, q(k)), STALE));
    history
}

#[test]
fn the_speed_of_a_steady_motion_is_found() {
    let mut history = filled(100, 50, |k| k as f64 * 0.01);
    let mut next = pulse(50, 500, 0.5);
    history.push(&mut next, STALE);
    assert!((next.speed - 1.0).abs() < 1e-9, "{}", next.speed);
    assert!((history.period() - 0.01).abs() < 1e-12);
}

#[test]
fn a_motor_that_turns_round_is_not_at_rest() {
    let history = filled(100, 8, |k| 0.01 * (k as f64 - 3.5).abs());
    assert!((history.speed() - 1.0 / 3.0).abs() < 1e-9, "a third counts: {}", history.speed());
    // in one half of the window only
    for turns in [[0.0, 0.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5], [0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 1.0, 1.0]] {
        let history = filled(100, 8, |k| 0.01 * turns[k as usize]);
        assert!((history.speed() - 1.0 / 6.0).abs() < 1e-9, "{turns:?}: {}", history.speed());
    }
}

#[test]
fn a_path_across_a_gap_is_refused() {
    let mut history = filled(100, 20, |_| 0.0);
    history.push(&mut pulse(29, 280, 0.2), STALE);
    assert!(path(&history, Time(150_000_000)).is_err(), "it went on while nobody looked");
    assert_eq!(path(&history, Time(280_000_000)).unwrap().len(), 1);
    history.push(&mut pulse(30, 500, 0.2), STALE);
    assert!(path(&history, Time(280_000_000)).is_err(), "the reading before was stale");
    assert!((history.period() - 0.01).abs() < 1e-12, "no gap tells how far readings are apart");
    history.mark_gap();
    history.push(&mut pulse(31, 510, 0.2), STALE);
    assert!(path(&history, Time(500_000_000)).is_err(), "a restart leaves one");
    history.push(&mut pulse(3, 520, 0.2), STALE);
    assert!(path(&history, Time(510_000_000)).is_err(), "and so does a board that counts anew");
    history.push(&mut pulse(3, 530, 0.2), STALE);
    assert!(path(&history, Time(520_000_000)).is_err(), "or one that does not count");
}

#[test]
fn a_few_readings_that_a_late_thread_missed_are_no_gap() {
    let mut history = filled(100, 20, |_| 0.0);
    history.push(&mut pulse(26, 260, 0.3), STALE);
    assert_eq!(path(&history, Time(150_000_000)).unwrap().len(), 6);
    assert!((history.period() - 0.01).abs() < 1e-12, "the period is that of the robot");
}

/// Before the period is known, readings count as those of a usual board: twenty missing ones are a gap.
#[test]
fn a_gap_is_known_before_the_period_is() {
    let late = |missing: u64| {
        let mut history = HistoryCore::new(100);
        history.push(&mut pulse(0, 0, 0.0), Duration::from_secs(1));
        history.push(&mut pulse(missing, 10 * missing, 0.2), Duration::from_secs(1));
        path(&history, Time(0)).is_err()
    };
    assert_eq!([late(MAX_MISSING), late(MAX_MISSING + 1), late(20)], [false, true, true]);
}

/// A burst of readings, as after a delay: its effect on the estimated period does not last.
#[test]
fn after_a_burst_of_readings_the_speed_is_estimated_again() {
    let mut history = HistoryCore::new(1000);
    let mut at = 0;
    for seq in 1..400_u64 {
        at += if (100..300).contains(&seq) { 1_000 } else { 20_000_000 };
        let mut pulse = Pulse { sample: Sample { at: Time(at), ..pulse(seq, 0, 0.3).sample }, ..pulse(seq, 0, 0.3) };
        history.push(&mut pulse, Duration::from_millis(100));
        assert!(!(320..).contains(&seq) || pulse.speed == 0.0, "{seq}: {}", pulse.speed);
    }
}

#[test]
fn readings_missing_from_a_short_way_are_no_gap() {
    let mut history = filled(100, 20, |_| 0.0);
    history.push(&mut pulse(35, 350, 0.08), Duration::from_secs(1));
    assert_eq!(path(&history, Time(150_000_000)).unwrap().len(), 6);
}

#[test]
fn a_start_about_to_fall_out_is_moved() {
    let history = filled(100, 130, |_| 0.0);
    assert!(path(&history, Time(10_000_000)).is_err());
    let later = history.later_start(Time(300_000_000)).unwrap();
    assert!(path(&history, later.at).is_ok());
    assert!(history.later_start(later.at).is_none());
}

fn path(history: &HistoryCore, since: Time) -> Result<Vec<Recorded>, HistoryTooShort> {
    history.past(since).map(|(past, start)| past[start..].to_vec())
}

fn reading(history: &mut HistoryCore, seq: u64, ms: u64, q: f64) -> Pulse {
    let mut pulse = pulse(seq, ms, q);
    history.push(&mut pulse, STALE);
    pulse
}

/// The period is a running mean, and a missing reading counts as one: 20 ms for two steps are 10 ms for each.
#[test]
fn the_period_is_that_between_readings() {
    let mut history = HistoryCore::new(100);
    assert_eq!(history.period(), 0.0, "none is known yet");
    reading(&mut history, 0, 0, 0.0);
    reading(&mut history, 2, 40, 0.0);
    assert!((history.period() - 0.02).abs() < 1e-12, "{}", history.period());
    reading(&mut history, 4, 60, 0.0);
    assert!((history.period() - 0.0195).abs() < 1e-12, "a twentieth of the way: {}", history.period());
    // a reading that is not newer is ignored
    reading(&mut history, 5, 60, 9.0);
    assert_eq!(history.newest().unwrap().q[0], 0.0);
    assert!((history.period() - 0.0195).abs() < 1e-12);
}

/// A board with a thousand readings per second rests like one with a hundred, although its noise is divided by less
/// time; and a pause of a few readings in a millisecond is none.
#[test]
fn readings_at_a_thousand_a_second_come_to_rest_too() {
    let mut history = HistoryCore::new(1000);
    let noise = |k: u64| if k.is_multiple_of(3) { 2e-4 } else { 0.0 };
    let speed = |history: &mut HistoryCore, k: u64| reading(history, k, k, noise(k)).speed;
    let last = (0..200).fold(0.0, |_, k| speed(&mut history, k));
    assert!(last < 0.1_f64.to_radians(), "{last}");
    let after = speed(&mut history, 220);
    assert!(after < 0.5_f64.to_radians(), "twenty readings later: {after}");
    assert!(speed(&mut history, 400).is_infinite());
}

/// From eight consecutive readings, and neither across a pause of more than a few readings nor across a gap.
/// The speed window of a board faster than 1600 Hz has more readings than a short history can store.
#[test]
fn a_history_shorter_than_the_window_has_a_speed() {
    for length in [0, 100, 127, 128] {
        let mut history = HistoryCore::new(length);
        let mut push = |k: u64, q: f64| {
            let sample = Sample { seq: k, at: Time(k * 500_000), q: vec![q].into(), ..Sample::default() };
            let mut pulse = Pulse::new(sample, &Vec::new().into());
            history.push(&mut pulse, STALE);
            pulse.speed
        };
        let moving = (0..400).fold(0.0, |_, k| push(k, k as f64 * 0.0005));
        assert!((moving - 1.0).abs() < 1e-9, "{length}: {moving} rad/s");
        let settled = (400..800).fold(moving, |_, k| push(k, 0.2));
        assert_eq!(settled, 0.0, "{length}");
    }
}

#[test]
fn no_speed_is_estimated_across_a_pause() {
    let known = |pause: u64| {
        let mut history = filled(100, 20, |k| 0.01 * k as f64);
        let seq = 19 + pause;
        (0..8)
            .map(|k| reading(&mut history, seq + k, 10 * (seq + k), 0.01 * (seq + k) as f64).speed)
            .collect::<Vec<_>>()
    };
    assert!(known(1).iter().all(|v| (v - 1.0).abs() < 1e-9), "{:?}", known(1));
    assert!(known(8).iter().all(|v| v.is_finite()), "eight steps are a few: {:?}", known(8));
    let after = known(9);
    assert!(after[..7].iter().all(|v| v.is_infinite()) && (after[7] - 1.0).abs() < 1e-9, "{after:?}");
    // late by the clock, although no reading is missing by its number
    let mut history = filled(100, 20, |_| 0.0);
    assert!(reading(&mut history, 20, 280, 0.0).speed.is_infinite());
    let mut history = filled(100, 20, |_| 0.0);
    assert_eq!(reading(&mut history, 20, 270, 0.0).speed, 0.0);
    let first = filled(100, 7, |k| k as f64);
    assert!(first.speed().is_infinite(), "seven are not enough");
}

/// A robot whose readings are unchanged for eight readings is at rest, with the time since then; a gap restarts it.
#[test]
fn the_time_since_which_readings_are_equal_is_reported() {
    let mut history = filled(100, 20, |k| if k < 5 { 0.1 } else { 0.2 });
    assert_eq!(reading(&mut history, 20, 200, 0.2).unchanged, Time(50_000_000));
    assert_eq!(reading(&mut history, 21, 210, 0.3).unchanged, Time(210_000_000));
    history.mark_gap();
    assert_eq!(reading(&mut history, 22, 220, 0.3).unchanged, Time(220_000_000));
    assert_eq!(reading(&mut HistoryCore::new(100), 1, 30, 0.0).unchanged, Time(30_000_000));
}

#[test]
fn a_shorter_ring_holds_the_newest_and_a_few_at_least() {
    let mut history = filled(100, 100, |k| k as f64);
    assert_eq!(history.span(), Duration::from_millis(990));
    history.resize(50);
    assert_eq!((history.span(), history.newest().unwrap().q[0]), (Duration::from_millis(490), 99.0));
    reading(&mut history, 100, 1000, 0.0);
    assert_eq!(history.span(), Duration::from_millis(490), "and it stays at that");
    history.resize(1);
    assert_eq!(history.span(), Duration::from_millis(150));
    assert_eq!(HistoryCore::new(100).span(), Duration::ZERO);
    let few = filled(1, 100, |k| k as f64);
    assert_eq!(few.span(), Duration::from_millis(150));
}

#[test]
fn the_recorded_pose_near_a_safe_pose_is_found() {
    let history = filled(100, 100, |k| (k as f64 - 50.0).abs());
    let found = |ms: u64, q: f64, within: u64| {
        let (at, within) = (Time(ms * 1_000_000), Duration::from_millis(within));
        history.recorded_near(at, &[q, 0.0], within).map(|r| (r.at.0 / 1_000_000, r.q[0]))
    };
    assert_eq!(found(400, 12.2, 100), Some((380, 12.0)), "not the equal one at 620 ms");
    assert_eq!(found(600, 12.2, 100), Some((620, 12.0)));
    assert_eq!(found(300, 0.0, 50), Some((350, 15.0)), "the bound itself counts");
    assert_eq!(found(700, 0.0, 50), Some((650, 15.0)));
    assert_eq!(found(1100, 0.0, 50), None);
}

/// After a crash the path goes on if the robot is near its last recorded configuration, and only once.
#[test]
fn a_restored_path_goes_on_near_its_end() {
    let restored = || {
        let mut history = HistoryCore::new(100);
        let poses: Vec<_> = (0..30).map(|k| (Time(10_000_000 * k), Pose::from(vec![0.0, 0.0]))).collect();
        history.restore(&poses);
        history
    };
    let reaches_back = |q: f64, motors: usize| {
        let mut history = restored();
        let sample = Sample {
            seq: 7,
            at: Time(9_000_000_000),
            q: vec![q; motors].into(),
            done: vec![true; motors],
            ..Sample::default()
        };
        history.push(&mut Pulse::new(sample, &Vec::new().into()), STALE);
        path(&history, Time(100_000_000)).is_ok()
    };
    assert!(reaches_back(0.08, 2), "it braked when its program died");
    assert!(!reaches_back(0.09, 2), "more than five degrees away nobody knows how it came there");
    let mut history = restored();
    reading(&mut history, 7, 9_000, 0.0);
    reading(&mut history, 8, 18_000, 0.0);
    assert!(path(&history, Time(100_000_000)).is_err(), "the second pause is one like any other");
    let mut empty = HistoryCore::new(100);
    empty.restore(&[]);
    reading(&mut empty, 1, 0, 0.0);
    reading(&mut empty, 2, 9_000, 0.0);
    assert!(path(&empty, Time(0)).is_err(), "there was nothing to go on from");
}

/// A start that is among the oldest fiftieth of a full ring is moved to a tenth after the oldest.
#[test]
fn a_start_is_moved_in_time_and_not_before() {
    let at = |k: u64| Time(k * 10_000_000);
    let full = filled(100, 130, |_| 0.0);
    assert_eq!(full.later_start(at(33)).map(|r| r.at), Some(at(42)), "the ring begins with the 30th");
    assert_eq!(full.later_start(at(34)).map(|r| r.at), None);
    let not_full = filled(100, 99, |_| 0.0);
    assert!(not_full.later_start(at(0)).is_none());
}

proptest! {
    #[test]
    fn a_path_is_what_was_recorded(n in 1_u64..200, since in 0_u64..200) {
        let history = filled(64, n, |k| k as f64);
        match path(&history, Time(since * 10_000_000)) {
            Ok(path) => {
                let recorded: Vec<f64> = path.iter().map(|r| r.q[0]).collect();
                prop_assert_eq!(recorded, (since..n).map(|k| k as f64).collect::<Vec<_>>());
            }
            Err(_) => prop_assert!(since >= n || n - since > 64),
        }
    }

    #[test]
    fn noise_at_rest_is_not_speed(noise in prop::collection::vec(-1e-4_f64..1e-4, 8)) {
        let history = filled(64, 8, |k| noise[k as usize]);
        prop_assert!(history.speed() < 0.5_f64.to_radians());
    }
}

/// A flickering count of a hobby servo's encoder looks like two degrees a second within the window; a joint that
/// creeps by more than its rest speed is not at rest.
#[test]
fn a_coarse_encoder_that_flickers_is_at_rest_and_one_that_creeps_is_not() {
    let count = std::f64::consts::TAU / 4096.0;
    let speed = |resolution: f64, q: &dyn Fn(u64) -> f64| {
        let mut history = HistoryCore::new(100);
        let rest_speed = 0.5_f64.to_radians();
        history.set_encoders(&[Axis { resolution, ..Default::default() }, Axis::default()], rest_speed);
        let speed = |k| {
            let mut pulse = pulse(k, 10 * k, (q(k) / count).floor() * count);
            history.push(&mut pulse, STALE);
            pulse.speed
        };
        (0..100).map(speed).skip(60).fold(0.0, f64::max) / rest_speed
    };
    let flickers = |k: u64| count * (100.5 + if k % 17 < 8 { 0.6 } else { 0.0 });
    assert!(speed(0.0, &flickers) > 2.0, "as if its encoder were fine");
    assert_eq!(speed(count, &flickers), 0.0);
    let creeps = |k: u64| 2.0_f64.to_radians() * 0.01 * k as f64;
    assert!(speed(count, &creeps) > 1.0);
}

/// Only a coarse encoder relaxes the detection of frozen readings: one count of a hobby servo, not one of an
/// industrial arm.
#[test]
fn only_a_hobby_servo_s_encoder_is_coarse() {
    let rest_speed = 0.5_f64.to_radians();
    assert!(is_coarse(std::f64::consts::TAU / 4096.0, rest_speed));
    assert!([0.0, 0.0005, 0.02].iter().all(|deg: &f64| !is_coarse(deg.to_radians(), rest_speed)));
}
