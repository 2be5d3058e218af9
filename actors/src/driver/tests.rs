use super::*;
use crate::controller::Controller;
use mobee_contract::Board;
use proptest::prelude::*;
use std::time::Duration;

/// A port to two motors, open to the reflex under token 0.
fn port() -> Port {
    let axis = |max_speed| Axis { name: "m".into(), min: -3.0, max: 3.0, max_speed, max_acceleration: 3.0 };
    let period = Duration::from_millis(10);
    let board = Board { axes: vec![axis(1.0), axis(2.0)], period, latency: Duration::ZERO, position_direct: true };
    let rules = Rules::new("r", vec!["p".into()], &Controller::default(), &board);
    Port::new(Arc::new(rules), Arc::new(Gate::default()))
}

fn write(port: &mut Port, command: Option<Command>, now: Time) -> Option<Vec<f64>> {
    let command = command?;
    assert!(port.took(0, Writer::Reflex, &command, now).is_empty());
    let Command::Direct { q, .. } = command else { return None };
    Some(q)
}

proptest! {
    /// Set-points of a way that a motor can follow, delivered late and in bunches: none of those written is a jump, the
    /// order is kept, and the last one is written soon after it came.
    #[test]
    fn a_bunch_of_set_points_is_no_jump(late in prop::collection::vec(0_u64..120, 1..40)) {
        let mut port = port();
        // a way at 0.72 of the first motor's greatest speed
        let asked = |k: usize| vec![0.0144 * k as f64, 0.0];
        let mut came: Vec<(u64, usize)> = Vec::new();
        for (k, late) in late.iter().enumerate() {
            let at = (20 * k as u64 + late).max(came.last().map_or(0, |(at, _)| *at));
            came.push((at, k));
        }
        let end = came.last().map_or(0, |(at, _)| *at) + 1000;
        let mut written: Vec<(u64, Vec<f64>)> = Vec::new();
        for ms in 0..=end {
            let now = Time(ms * 1_000_000);
            for (_, k) in came.iter().filter(|(at, _)| *at == ms) {
                let paced = port.pace(0, Writer::Reflex, Command::Direct { motors: vec![0, 1], q: asked(*k) }, now);
                written.extend(write(&mut port, paced, now).map(|q| (ms, q)));
            }
            if ms % 10 == 0 {
                let due = port.due(now).map(|(_, _, command)| command);
                written.extend(write(&mut port, due, now).map(|q| (ms, q)));
            }
        }
        for pair in written.windows(2) {
            let (secs, way) = ((pair[1].0 - pair[0].0) as f64 * 1e-3, pair[1].1[0] - pair[0].1[0]);
            prop_assert!((-1e-12..=secs + 1e-12).contains(&way), "{way} rad in {secs} s");
        }
        let last = written.last().map(|(_, q)| q.clone());
        prop_assert_eq!(last, Some(asked(late.len() - 1)));
    }
}

#[test]
fn supervise_itself_stops_and_moves_nothing() {
    let port = port();
    assert_eq!(port.admit(0, Writer::Supervise, &Command::Stop { motors: vec![] }), Ok(()));
    assert!(port.admit(0, Writer::Supervise, &Command::Velocity { motors: vec![0], speed: vec![0.1] }).is_err());
}

#[test]
fn what_waits_is_forgotten_when_anything_else_is_said() {
    let mut port = port();
    let direct = |q: f64| Command::Direct { motors: vec![0, 1], q: vec![q, 0.0] };
    let first = port.pace(0, Writer::Reflex, direct(0.0), Time(0));
    assert!(write(&mut port, first, Time(0)).is_some());
    assert_eq!(port.pace(0, Writer::Reflex, direct(0.5), Time(1)), None, "a jump");
    let stop = Command::Stop { motors: vec![] };
    assert_eq!(port.pace(0, Writer::Reflex, stop.clone(), Time(2)), Some(stop));
    assert_eq!(port.due(Time(1_000_000_000)), None);
}

/// The journal is told what was written, also of what should never have passed (I5).
#[test]
fn a_set_point_beyond_a_limit_is_told() {
    for (q, within) in [(3.0, true), (3.001, false), (f64::NAN, false)] {
        let mut port = port();
        let command = Command::Direct { motors: vec![1], q: vec![q] };
        assert!(port.took(0, Writer::Reflex, &command, Time(0)).is_empty());
        let Some(Event::Streamed { motors, within_limits, .. }) = port.end_stream() else { panic!("it was streamed") };
        assert_eq!((motors, within_limits), (vec![1], within), "{q}");
    }
}
