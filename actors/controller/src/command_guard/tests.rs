use super::*;
use crate::ControllerSettings;
use mobee_contract::{Board, ControlMode, Move};
use proptest::prelude::*;
use std::time::Duration;

/// A guard of two motors, open to the reflex under token 0.
fn guard() -> CommandGuard {
    let axis = |max_speed| Axis {
        name: "m".into(),
        min: -3.0,
        max: 3.0,
        max_speed,
        max_acceleration: 3.0,
        ..Default::default()
    };
    let period = Duration::from_millis(10);
    let board = Board { axes: vec![axis(1.0), axis(2.0)], period, latency: Duration::ZERO, position_direct: true };
    let rules = Rules::new("r", vec!["p".into()], &ControllerSettings::default(), &board);
    CommandGuard::new(Arc::new(rules))
}

fn write(guard: &mut CommandGuard, command: Option<Command>, now: Time) -> Option<Vec<f64>> {
    let command = command?;
    assert!(guard.took(0, Writer::Reflex, &command, now).is_empty());
    let Command::Direct { q, .. } = command else { return None };
    Some(q)
}

proptest! {
    /// Set-points that a motor can follow, delivered late and in bursts: none of the written ones is a jump, the
    /// order is preserved, and the last one is written soon after it arrived.
    #[test]
    fn a_bunch_of_set_points_is_no_jump(late in prop::collection::vec(0_u64..120, 1..40)) {
        let mut guard = guard();
        // a path at 0.72 of the first motor's greatest speed
        let setpoint = |k: usize| vec![0.0144 * k as f64, 0.0];
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
                let paced = guard.pace(0, Writer::Reflex, Command::Direct { motors: vec![0, 1], q: setpoint(*k) }, now);
                written.extend(write(&mut guard, paced, now).map(|q| (ms, q)));
            }
            if ms % 10 == 0 {
                let due = guard.due(now).map(|(_, _, command)| command);
                written.extend(write(&mut guard, due, now).map(|q| (ms, q)));
            }
        }
        for pair in written.windows(2) {
            let (secs, way) = ((pair[1].0 - pair[0].0) as f64 * 1e-3, pair[1].1[0] - pair[0].1[0]);
            prop_assert!((-1e-12..=secs + 1e-12).contains(&way), "{way} rad in {secs} s");
        }
        let last = written.last().map(|(_, q)| q.clone());
        prop_assert_eq!(last, Some(setpoint(late.len() - 1)));
    }
}

#[test]
fn supervise_itself_stops_and_moves_nothing() {
    let guard = guard();
    assert_eq!(guard.admit(&Gate::default(), 0, Writer::Supervise, &Command::Stop { motors: vec![] }), Ok(()));
    assert!(
        guard
            .admit(&Gate::default(), 0, Writer::Supervise, &Command::Velocity { motors: vec![0], speed: vec![0.1] })
            .is_err()
    );
}

#[test]
fn waiting_set_points_are_dropped_by_any_other_command() {
    let mut guard = guard();
    let direct = |q: f64| Command::Direct { motors: vec![0, 1], q: vec![q, 0.0] };
    let first = guard.pace(0, Writer::Reflex, direct(0.0), Time(0));
    assert!(write(&mut guard, first, Time(0)).is_some());
    assert_eq!(guard.pace(0, Writer::Reflex, direct(0.5), Time(1)), None, "a jump");
    let stop = Command::Stop { motors: vec![] };
    assert_eq!(guard.pace(0, Writer::Reflex, stop.clone(), Time(2)), Some(stop));
    assert_eq!(guard.due(Time(1_000_000_000)), None);
}

/// Everything written is journaled, also what should never have passed (I5).
#[test]
fn a_set_point_beyond_a_limit_is_journaled() {
    for (q, within) in [(3.0, true), (3.001, false), (f64::NAN, false)] {
        let mut guard = guard();
        let command = Command::Direct { motors: vec![1], q: vec![q] };
        assert!(guard.took(0, Writer::Reflex, &command, Time(0)).is_empty());
        let Some(Event::Streamed { motors, within_limits, .. }) = guard.end_stream() else { panic!("it was streamed") };
        assert_eq!((motors, within_limits), (vec![1], within), "{q}");
    }
    for (v, within) in [(-2.0, true), (2.1, false), (f64::NAN, false)] {
        let mut guard = guard();
        let command = Command::Velocity { motors: vec![1], speed: vec![v] };
        assert!(guard.took(0, Writer::Reflex, &command, Time(0)).is_empty());
        let Some(Event::Streamed { within_limits, .. }) = guard.end_stream() else { panic!("it was streamed") };
        assert_eq!(within_limits, within, "{v} rad/s");
    }
}

fn target(motors: &[usize], q: &[f64]) -> Move {
    Move { motors: motors.to_vec(), q: q.to_vec(), relative: false, speed: None, acceleration: None }
}

/// Feasible commands pass, up to the exact limit; commands beyond a limit, and invalid ones, are refused with the
/// reason (I5).
#[test]
fn only_feasible_commands_pass() {
    let (nan, inf) = (f64::NAN, f64::INFINITY);
    let direct = |motors: &[usize], q: &[f64]| Command::Direct { motors: motors.to_vec(), q: q.to_vec() };
    let velocity =
        |motors: &[usize], speed: &[f64]| Command::Velocity { motors: motors.to_vec(), speed: speed.to_vec() };
    let moves = |motors: &[usize], q: &[f64]| Command::Move(target(motors, q));
    let at = |speed: &[f64]| Command::Move(Move { speed: Some(speed.to_vec()), ..target(&[0, 1], &[0.0, 0.0]) });
    let rising = |a: &[f64]| Command::Move(Move { acceleration: Some(a.to_vec()), ..target(&[0, 1], &[0.0, 0.0]) });
    let mode = |motors: &[usize]| Command::Mode { motors: motors.to_vec(), mode: ControlMode::Position };
    let stop = |motors: &[usize]| Command::Stop { motors: motors.to_vec() };
    let reference = |motors: &[usize], speed: &[f64], acceleration: &[f64]| {
        let (motors, speed, acceleration) = (motors.to_vec(), speed.to_vec(), acceleration.to_vec());
        Command::Reference { motors, speed, acceleration }
    };
    let passes = [
        moves(&[0, 1], &[3.0, -3.0]),
        at(&[0.0, 1.0]),
        rising(&[0.0, 1.0]),
        direct(&[1], &[-3.0]),
        velocity(&[0, 1], &[-1.0, 2.0]),
        mode(&[1]),
        stop(&[]),
        stop(&[0]),
        stop(&[1, 0]),
        reference(&[0], &[1.0], &[0.0]),
        reference(&[1, 0], &[1.0, 0.0], &[2.0, 2.0]),
    ];
    for command in passes {
        assert_eq!(guard().admit(&Gate::default(), 0, Writer::Reflex, &command), Ok(()), "{command:?}");
    }
    let refused = [
        (moves(&[0], &[3.001]), "m is commanded to 171.945 deg"),
        (moves(&[0], &[-3.001]), "commanded to"),
        (moves(&[0], &[nan]), "commanded to"),
        (moves(&[2], &[0.0]), "there is no motor 2"),
        (moves(&[0, 1], &[0.0]), "different length"),
        (Command::Move(Move { relative: true, ..target(&[0], &[0.1]) }), "relative"),
        (at(&[0.1, -0.1]), "a reference of -0.1"),
        (at(&[0.1, inf]), "a reference of inf"),
        (rising(&[nan, 0.1]), "a reference of NaN"),
        (rising(&[0.1, -0.1]), "a reference of -0.1"),
        (direct(&[], &[]), "0 set-points for 0 motors"),
        (direct(&[0], &[0.0, 0.0]), "2 set-points for 1 motors"),
        (direct(&[0, 1], &[0.0, 3.1]), "commanded to 177.617 deg"),
        (velocity(&[], &[]), "0 velocities for 0 motors"),
        (velocity(&[0, 1], &[0.1]), "1 velocities for 2 motors"),
        (velocity(&[0], &[1.001]), "commanded to move at 57.353 deg/s"),
        (velocity(&[0], &[-1.001]), "commanded to move at -57.353 deg/s"),
        (velocity(&[0], &[nan]), "commanded to move at NaN"),
        (velocity(&[2], &[0.0]), "there is no motor 2"),
        (mode(&[]), "a mode for no motor"),
        (mode(&[0, 2]), "there is no motor 2"),
        (stop(&[2]), "there is no motor 2"),
        (reference(&[], &[], &[]), "references for no motor"),
        (reference(&[0], &[1.0], &[]), "different length"),
        (reference(&[0], &[], &[1.0]), "different length"),
        (reference(&[2], &[1.0], &[1.0]), "there is no motor 2"),
        (reference(&[0], &[nan], &[1.0]), "a reference of NaN"),
        (reference(&[0, 1], &[1.0, 1.0], &[1.0, -0.1]), "a reference of -0.1"),
        (reference(&[0], &[inf], &[1.0]), "a reference of inf"),
    ];
    for (command, why) in refused {
        let refusal = guard().admit(&Gate::default(), 0, Writer::Reflex, &command);
        assert!(refusal.as_ref().is_err_and(|refusal| refusal.contains(why)), "{command:?}: {refusal:?}");
    }
}

/// No command of another token passes, and no command of an agent while the filter is closed (I1).
#[test]
fn only_the_present_token_passes_and_agents_only_while_open() {
    let (guard, gate) = (guard(), Gate::default());
    let command = Command::Move(target(&[0], &[0.1]));
    let passes = |token, writer| guard.admit(&gate, token, writer, &command).is_ok();
    assert!(passes(0, Writer::Reflex) && !passes(0, Writer::Agent) && !passes(1, Writer::Agent));
    let open = gate.open(0).unwrap();
    assert!(passes(open, Writer::Agent) && !passes(0, Writer::Reflex) && !passes(open + 2, Writer::Agent));
    let closed = gate.close();
    assert!(passes(closed, Writer::Reflex) && !passes(open, Writer::Agent) && !passes(closed, Writer::Agent));
    let mode = Command::Mode { motors: vec![0], mode: ControlMode::Position };
    assert_eq!(guard.admit(&gate, closed, Writer::Supervise, &mode), Ok(()));
}

#[test]
fn a_reading_has_a_number_for_each_motor() {
    let reading = |q: &[f64], done: usize| Sample {
        seq: 1,
        at: Time(0),
        q: q.into(),
        done: vec![true; done],
        ..Sample::default()
    };
    let wrong = |q: &[f64], done| guard().makes_no_sense(&reading(q, done));
    assert_eq!(wrong(&[0.0, -9.0], 2), None);
    assert_eq!(wrong(&[0.0], 2).as_deref(), Some("1 positions of 2 motors"));
    assert_eq!(wrong(&[0.0, 0.0], 1).as_deref(), Some("2 positions of 2 motors"));
    for not in [f64::NAN, f64::INFINITY] {
        assert_eq!(wrong(&[0.0, not], 2).as_deref(), Some("m is not a finite number"));
    }
    let torques =
        |external: &[f64]| guard().makes_no_sense(&Sample { external: external.to_vec(), ..reading(&[0.0, 0.0], 2) });
    assert_eq!([torques(&[]), torques(&[0.0, -80.0])], [None, None]);
    assert_eq!(torques(&[1.0]).as_deref(), Some("1 external torques of 2 motors"));
    assert_eq!(torques(&[1.0, f64::NAN]).as_deref(), Some("m's torque is not a finite number"));
    let pushes = |contact_n| guard().makes_no_sense(&Sample { contact_n, ..reading(&[0.0, 0.0], 2) });
    assert_eq!(pushes(30.0), None);
    // not journaled
    assert_eq!(pushes(f64::INFINITY).as_deref(), Some("the contact force is not a finite number"));
}

/// A motor may rest slightly outside its limits (-1..1 rad here), and no robot is farther out than 20 degrees.
#[test]
fn a_reading_far_beyond_the_limits_is_named() {
    let beyond = |q: f64| {
        guard().is_beyond(&Sample {
            seq: 1,
            at: Time(0),
            q: vec![0.0, q].into(),
            done: vec![true; 2],
            ..Sample::default()
        })
    };
    let (min, max) = (guard().rules.axes[1].min, guard().rules.axes[1].max);
    assert_eq!([min - 0.34, max + 0.34].map(beyond), [None, None]);
    assert_eq!(
        [min - MAX_BEYOND_LIMIT, max + MAX_BEYOND_LIMIT].map(beyond),
        [None, None],
        "the very bound is within it"
    );
    for q in [min - 0.36, max + 0.36] {
        let what = beyond(q).unwrap();
        assert!(
            what.starts_with(&format!("m reads {:.1} deg", q.to_degrees())) && what.contains("calibrate"),
            "{what}"
        );
    }
}

/// A single command is journaled as it was written; a stream is journaled once, at its end, as a summary.
#[test]
fn written_commands_are_journaled() {
    let mut guard = guard();
    let ms = |ms: u64| Time(ms * 1_000_000);
    let direct = |motors: &[usize], q: &[f64]| Command::Direct { motors: motors.to_vec(), q: q.to_vec() };
    assert_eq!(guard.took(0, Writer::Reflex, &direct(&[0], &[0.0]), ms(0)), []);
    assert_eq!(guard.took(0, Writer::Reflex, &direct(&[1, 0], &[1.0, 0.01]), ms(20)), []);
    assert_eq!(guard.took(0, Writer::Reflex, &direct(&[0], &[-0.01]), ms(60)), []);
    // another writer's stream ends this one, and so do velocities
    let journaled = guard.took(0, Writer::Agent, &direct(&[0], &[0.0]), ms(80));
    let [Event::Streamed { writer, motors, count, span, greatest_step, within_limits, last, .. }] = &journaled[..]
    else {
        panic!("{journaled:?}")
    };
    assert_eq!((*writer, &motors[..], *count, *span), (Writer::Reflex, &[0, 1][..], 3, (ms(0), ms(60))));
    assert_eq!((*within_limits, &last[..]), (true, &[(0, -0.01), (1, 1.0)][..]));
    assert!(
        (greatest_step - 0.5).abs() < 1e-9,
        "0.01 rad in 20 ms at 1 rad/s, and then as much in 40: {greatest_step}"
    );
    let journaled = guard.took(0, Writer::Agent, &Command::Velocity { motors: vec![1], speed: vec![-1.5] }, ms(100));
    assert!(matches!(&journaled[..], [Event::Streamed { count: 1, .. }]), "{journaled:?}");

    let slow = Move { speed: Some(vec![0.5]), ..target(&[1], &[0.2]) };
    let journaled = guard.took(0, Writer::Agent, &Command::Move(slow), ms(120));
    let [Event::Streamed { greatest_step, last, .. }, Event::Command { kind, motors, q, speed, .. }] = &journaled[..]
    else {
        panic!("{journaled:?}")
    };
    assert_eq!((*greatest_step, &last[..]), (0.75, &[][..]), "velocities have no last place");
    assert_eq!((kind.word(), &motors[..], &q[..], &speed[..]), ("move", &[1][..], &[(1, 0.2)][..], &[(1, 0.5)][..]));
    assert_eq!(guard.end_stream(), None);
    for (command, name) in [
        (Command::Stop { motors: vec![1] }, "stop"),
        (Command::Mode { motors: vec![1], mode: ControlMode::Position }, "mode"),
        (Command::Reference { motors: vec![1], speed: vec![0.3], acceleration: vec![] }, "reference"),
    ] {
        let journaled = guard.took(0, Writer::Agent, &command, ms(140));
        let [Event::Command { kind, motors, q, speed, .. }] = &journaled[..] else { panic!("{journaled:?}") };
        assert_eq!((kind.word(), &motors[..], q.len()), (name, &[1][..], 0));
        assert_eq!(&speed[..], if name == "reference" { &[(1, 0.3)][..] } else { &[] });
    }
}

/// A driver that converts moves to set-points leads moves, and nothing else; another one leads nothing.
#[test]
fn a_move_converted_to_set_points_is_journaled_as_led() {
    let led = |leads: bool, command: &Command| {
        let mut guard = CommandGuard { leads, ..guard() };
        let journaled = guard.took(0, Writer::Agent, command, Time(0));
        let [Event::Command { led, .. }] = &journaled[..] else { panic!("{journaled:?}") };
        *led
    };
    let (to, stop) = (Command::Move(target(&[0], &[0.1])), Command::Stop { motors: vec![0] });
    assert_eq!([led(true, &to), led(true, &stop), led(false, &to), led(false, &stop)], [true, false, false, false]);
}

/// Waiting set-points are approached at the greatest speed of the motors at most, not before most of a period is
/// over, and by no more than a period and a half.
#[test]
fn waiting_set_points_are_approached_in_steps() {
    let mut guard = guard();
    let ms = |ms: u64| Time(ms * 1_000_000);
    let to = |q: f64| Command::Direct { motors: vec![0, 1], q: vec![q, 0.0] };
    let period = guard.rules.period.as_millis() as u64;
    let _ = guard.took(0, Writer::Reflex, &to(0.0), ms(0));
    assert_eq!(guard.pace(0, Writer::Reflex, to(1.0), ms(1)), None);
    assert_eq!(guard.due(ms(period * 3 / 4 - 1)), None, "too soon");
    let step = |guard: &mut CommandGuard, now: u64| match guard.due(ms(now)) {
        Some((0, Writer::Reflex, Command::Direct { motors, q })) if motors == [0, 1] => {
            let _ = guard.took(0, Writer::Reflex, &Command::Direct { motors, q: q.clone() }, ms(now));
            q[0]
        }
        other => panic!("{other:?}"),
    };
    let secs = |periods: f64| periods * period as f64 * 1e-3;
    let first = step(&mut guard, period * 3 / 4);
    assert!((first - MAX_SPEED_SHARE * secs(0.75)).abs() < 1e-9, "{first}");
    let second = step(&mut guard, 5 * period);
    assert!((second - first - MAX_SPEED_SHARE * secs(1.5)).abs() < 1e-9, "{second} after a pause of four periods");
    // the next command is written at once if it is no jump, and nothing waits any more
    assert!(guard.pace(0, Writer::Reflex, to(second + 0.9 * secs(1.0)), ms(6 * period)).is_some());
    assert_eq!(guard.due(ms(9 * period)), None);
    // a stream of another token has no last set-points to step from
    assert!(guard.pace(2, Writer::Reflex, to(-2.0), ms(6 * period)).is_some());
}
