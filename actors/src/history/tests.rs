use super::*;
use mobee_contract::Sample;
use proptest::prelude::*;

/// As for a controller with a period of 20 ms.
const STALE: Duration = Duration::from_millis(100);

fn pulse(seq: u64, ms: u64, q: f64) -> Pulse {
    let sample = Sample { seq, at: Time(ms * 1_000_000), q: vec![q, 0.0].into(), done: vec![true; 2] };
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
    assert!(history.speed() > 0.3, "{}", history.speed());
}

#[test]
fn a_path_across_a_gap_is_refused() {
    let mut history = filled(100, 20, |_| 0.0);
    history.push(&mut pulse(29, 280, 0.2), STALE);
    assert!(path(&history, Time(150_000_000)).is_err(), "it went on while nobody looked");
    assert_eq!(path(&history, Time(280_000_000)).unwrap().len(), 1);
    history.push(&mut pulse(30, 500, 0.2), STALE);
    assert!(path(&history, Time(280_000_000)).is_err(), "the reading before was stale");
    history.mark_gap();
    history.push(&mut pulse(31, 510, 0.2), STALE);
    assert!(path(&history, Time(500_000_000)).is_err(), "a restart leaves one");
    history.push(&mut pulse(3, 520, 0.2), STALE);
    assert!(path(&history, Time(510_000_000)).is_err(), "and so does a board that counts anew");
}

#[test]
fn a_few_readings_that_a_late_thread_missed_are_no_gap() {
    let mut history = filled(100, 20, |_| 0.0);
    history.push(&mut pulse(26, 260, 0.3), STALE);
    assert_eq!(path(&history, Time(150_000_000)).unwrap().len(), 6);
    assert!((history.period() - 0.01).abs() < 1e-12, "the period is that of the robot");
}

/// A bunch of readings as from an encoder's clock that stood still: what is seen of the period then does not last.
#[test]
fn after_a_bunch_of_readings_the_speed_is_told_again() {
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
