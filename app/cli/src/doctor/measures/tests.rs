use super::*;

/// Time between two readings, s.
const PERIOD: f64 = 0.01;

/// A joint that sags, and is behind its commanded path; as its encoder shows it.
#[derive(Clone, Copy)]
struct Joint {
    sag: f64,
    lag: f64,
    count: f64,
    /// How long after the end of the commanded path *done* is reported.
    done: f64,
}

const JOINT: Joint = Joint { sag: 0.0, lag: 0.0, count: 0.001, done: 0.0 };

impl Joint {
    fn reads(self, at: f64, commanded: impl Fn(f64) -> f64) -> f64 {
        let q = commanded(at - self.lag) - self.sag;
        if self.count > 0.0 { (q / self.count).round() * self.count } else { q }
    }
}

/// To and fro by 6 deg, at this share of the reference of 5 deg/s; two seconds of rest after each move.
fn moved(joint: Joint, share: f64) -> Record {
    let way = |t: f64| (t * 5.0 * share).clamp(0.0, 6.0);
    let took = 6.0 / (5.0 * share);
    let each = 6.0 / (5.0 * share) + 2.0;
    let mut record = Record::default();
    for k in 0..4 {
        let to = if k % 2 == 0 { 6.0 } else { 0.0 };
        record.orders.push((each * f64::from(k), Order::Move { to, speed: 5.0 }));
    }
    let commanded = |t: f64| {
        let k = (t / each).floor().max(0.0);
        let gone = way(t - k * each);
        if (k as u64).is_multiple_of(2) { gone } else { 6.0 - gone }
    };
    record.readings = read(4.0 * each, |t| {
        let since = t - (t / each).floor() * each;
        // the newest reading before an order is fetched after it
        (joint.reads(t, commanded), since > took + joint.done && since < each - 0.02)
    });
    record
}

fn read(secs: f64, at: impl Fn(f64) -> (f64, bool)) -> Vec<Reading> {
    let times = (0..(secs / PERIOD) as u32).map(|i| f64::from(i) * PERIOD + 0.001);
    times.map(|t| Reading { at: t, q: at(t).0, done: at(t).1, torque: None }).collect()
}

/// A move of 20 deg at 10 deg/s from rest, stopped after a second, and where the joint is from then on, by the time since.
fn stopped(after: impl Fn(f64) -> f64) -> StopFigures {
    let orders = vec![(0.0, Order::Move { to: 20.0, speed: 10.0 }), (1.0, Order::Stop), (1.4, Order::Stop)];
    let readings = read(4.0, |t| (if t < 1.0 { 10.0 * t } else { after(t - 1.0) }, t > 1.5));
    Record { readings, orders }.figures().stop.unwrap()
}

fn near(a: f64, b: f64, by: f64) -> bool {
    (a - b).abs() <= by
}

#[test]
fn the_count_of_an_encoder_is_the_step_between_its_readings() {
    let coarse = moved(Joint { count: 360.0 / 4096.0, ..JOINT }, 1.0).figures();
    assert!(near(coarse.count, 360.0 / 4096.0, 1e-6), "{coarse:?}");
    assert!(near(coarse.noise, 0.0, 1e-9), "{coarse:?}");
}

#[test]
fn a_sag_is_commanded_minus_measured_at_rest() {
    let figures = moved(Joint { sag: 1.4, ..JOINT }, 1.0).figures();
    assert_eq!(figures.sags.len(), 4);
    assert!(figures.sags.iter().all(|sag| near(*sag, 1.4, 0.01)), "{figures:?}");
    assert_eq!(figures.torque, None);
}

#[test]
fn speeds_are_those_between_a_tenth_and_nine_tenths_of_the_way() {
    for share in [1.0, 0.3, 3.0] {
        let figures = moved(JOINT, share).figures();
        // the first one begins before there is a reading
        assert!(figures.speeds.len() >= 3 && figures.speeds.iter().all(|s| near(*s, share, 0.05)), "{figures:?}");
    }
}

#[test]
fn done_before_the_joint_has_arrived_is_early_and_after_it_is_late() {
    let early = moved(Joint { lag: 0.2, ..JOINT }, 1.0).figures().done;
    assert!(
        early.len() >= 3 && early.iter().all(|(by, off)| near(*by, 0.2, 0.03) && near(*off, 1.0, 0.1)),
        "{early:?}"
    );
    let late = moved(Joint { done: 0.5, ..JOINT }, 1.0).figures().done;
    assert!(late.iter().all(|(by, off)| near(*by, -0.5, 0.03) && *off < 0.02), "{late:?}");
}

#[test]
fn set_points_to_and_fro_show_the_lag_apart_from_the_sag() {
    let triangle = |t: f64| 5.0 * if t < 1.5 { t.max(0.0) } else { (3.0 - t).max(0.0) };
    let stream = |joint: Joint, secs: f64| {
        let points = (0..(secs / 0.02) as u32).map(|i| f64::from(i) * 0.02);
        let orders = points.map(|t| (t, Order::Point(triangle(t)))).collect();
        Record { readings: read(secs + 1.0, |t| (joint.reads(t, triangle), false)), orders }.figures().lag
    };
    let (lag, speed) = stream(Joint { sag: 1.4, lag: 0.09, ..JOINT }, 3.0).unwrap();
    assert!(near(lag, 0.09, 0.01) && near(speed, 5.0, 0.1), "{lag} s at {speed} deg/s");
    assert_eq!(stream(JOINT, 1.0), None, "too short to show any");
    // another stream a second later, of a retreat, is none of it
    let orders = (0..150).map(|i| f64::from(i) * 0.02).chain((200..220).map(|i| f64::from(i) * 0.02));
    let orders = orders.map(|t| (t, Order::Point(triangle(t)))).collect();
    let readings = read(5.0, |t| (Joint { lag: 0.09, ..JOINT }.reads(t, triangle), false));
    let (lag, speed) = Record { readings, orders }.figures().lag.unwrap();
    assert!(near(lag, 0.09, 0.01) && near(speed, 5.0, 0.1), "{lag} s at {speed} deg/s");
}

#[test]
fn a_stop_that_holds_where_the_joint_is_or_brakes_to_stays() {
    let held = stopped(|_| 10.0);
    assert!(held.end == StopEnd::Stays && near(held.speed, 10.0, 0.2) && near(held.on, 0.1, 0.1), "{held:?}");
    assert!(held.took.is_some_and(|took| took < 0.05) && near(held.drift, 0.0, 0.01));
    // it brakes at 50 deg/s^2
    let braked = stopped(|t| 10.0 + if t < 0.2 { 10.0 * t - 25.0 * t * t } else { 1.0 });
    assert!(braked.end == StopEnd::Stays && near(braked.on, 1.1, 0.1), "{braked:?}");
    assert!(braked.took.is_some_and(|took| near(took, 0.2, 0.05)), "{braked:?}");
    let back = stopped(|t| 10.0 - (10.0 * t).min(1.5));
    assert!(back.end == StopEnd::Stays && near(back.on, -1.4, 0.15), "{back:?}");
}

#[test]
fn a_stop_without_effect_runs_on_to_the_target() {
    let figures = stopped(|t| (10.0 + 10.0 * t).min(20.0));
    assert!(figures.end == StopEnd::RunsOn && near(figures.on, 10.1, 0.2), "{figures:?}");
}

#[test]
fn a_joint_that_goes_on_sinking_is_told_from_one_that_rests() {
    let fast = stopped(|t| 10.0 - 9.0 * t);
    assert!(fast.end == StopEnd::Sinks && fast.took.is_none() && near(fast.drift, -9.0, 1.0), "{fast:?}");
    let slow = stopped(|t| 10.0 - 0.09 * t);
    assert!(slow.end == StopEnd::Sinks && near(slow.drift, -0.09, 0.02), "{slow:?}");
}

/// A stop at rest, and one after a stream, are none in mid-motion.
#[test]
fn a_stop_of_a_joint_that_rests_counts_for_nothing() {
    let mut record = moved(JOINT, 1.0);
    let last = record.readings.last().map_or(0.0, |r| r.at);
    record.orders.push((last - 0.2, Order::Stop));
    assert_eq!(record.figures().stop, None);
    assert_eq!(Record::default().figures(), Figures::default());
}

#[test]
fn torques_count_by_their_amount_and_by_their_change_in_a_move() {
    let mut record = moved(JOINT, 1.0);
    for reading in &mut record.readings {
        reading.torque = Some(if reading.done { 3.0 } else { -1.0 });
    }
    assert_eq!(record.figures().torque, Some((3.0, 4.0)));
}
