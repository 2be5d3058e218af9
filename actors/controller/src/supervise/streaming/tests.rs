use super::*;
use crate::ControllerSettings;
use mobee_contract::Board;

/// Two motors with greatest speeds of 1 and 2 rad/s, and a deceleration of 4 rad/s^2; readings every 10 ms, fresh for
/// 50.
fn rules() -> Rules {
    let axis = |max_speed| Axis {
        name: "m".into(),
        min: -3.0,
        max: 3.0,
        max_speed,
        max_acceleration: 4.0,
        ..Default::default()
    };
    let period = Duration::from_millis(10);
    let axes = vec![axis(1.0), axis(2.0)];
    let board = Board { axes, period, latency: Duration::from_millis(10), position_direct: true };
    let controller = ControllerSettings { period_s: 0.01, ..ControllerSettings::default() };
    Rules { tolerance: 0.002, ..Rules::new("r", vec!["p".into()], &controller, &board) }
}

fn ms(ms: u64) -> Time {
    Time(1_000_000_000 + ms * 1_000_000)
}

const HERE: [f64; 2] = [0.0, 0.5];

fn stream() -> OpenStream {
    OpenStream::new(&rules(), ms(0))
}

fn positions(motors: &[usize], q: &[f64]) -> Setpoints {
    Setpoints { motors: motors.to_vec(), values: Values::Position(q.to_vec()) }
}

fn velocities(motors: &[usize], v: &[f64]) -> Setpoints {
    Setpoints { motors: motors.to_vec(), values: Values::Velocity(v.to_vec()) }
}

/// Written values, rounded to a millionth.
fn written(stream: &mut OpenStream, here: [f64; 2], now: u64) -> Option<(Vec<usize>, Vec<f64>)> {
    let round = |values: Vec<f64>| values.iter().map(|v| (v * 1e6).round() / 1e6).collect();
    let mut commands = stream.write(&here, &rules(), ms(now));
    assert!(commands.len() < 2, "{commands:?}");
    match commands.pop()? {
        Command::Direct { motors, q } => Some((motors, round(q))),
        Command::Velocity { motors, speed } => Some((motors, round(speed))),
        other => panic!("{other:?}"),
    }
}

#[test]
fn positions_are_gone_to_at_the_axis_speed_and_not_oftener_than_the_period() {
    let mut stream = stream();
    assert_eq!(written(&mut stream, [0.0, 0.5], 100), None, "nothing was asked");
    stream.take(&positions(&[1], &[0.55]), (&HERE, ms(0)), &rules()).unwrap();
    // one period at 95 in 100 of 2 rad/s; the other motor is not named, and not commanded
    assert_eq!(written(&mut stream, [0.0, 0.5], 0), Some((vec![1], vec![0.519])));
    assert_eq!(written(&mut stream, [0.0, 0.5], 7), None);
    assert_eq!(written(&mut stream, [0.0, 0.5], 8), Some((vec![1], vec![0.5342])));
    assert_eq!(written(&mut stream, [0.0, 0.5], 38), Some((vec![1], vec![0.55])));
    assert_eq!(written(&mut stream, [0.0, 0.5], 60), None, "it was written to its end");
    assert!(
        (stream.freeze_watch.moved - 0.05).abs() < 1e-9,
        "how far the set-points went: {}",
        stream.freeze_watch.moved
    );
    // after a pause at most a period and a half is made up for, in both directions
    stream.take(&positions(&[0, 1], &[-0.1, 0.5]), (&HERE, ms(100)), &rules()).unwrap();
    assert_eq!(written(&mut stream, [0.0, 0.5], 100), Some((vec![0, 1], vec![-0.01425, 0.5215])));
    assert!(
        (stream.freeze_watch.moved - 0.0785).abs() < 1e-9,
        "by the motor with the longest way: {}",
        stream.freeze_watch.moved
    );
}

#[test]
fn a_position_too_far_ahead_changes_nothing() {
    // a tenth of a second at the axis' speed, and the tolerance
    for (motor, q, fits) in
        [(0, 0.101, true), (0, 0.103, false), (0, -0.103, false), (1, 0.701, true), (1, 0.703, false)]
    {
        let mut stream = stream();
        let took = stream.take(&positions(&[motor], &[q]), (&HERE, ms(0)), &rules());
        assert_eq!(
            (took.is_ok(), stream.goes_on(), stream.names(motor)),
            (fits, fits, fits),
            "{motor} to {q}: {took:?}"
        );
    }
    let mut stream = stream();
    let Err(Refusal::Jump { by_deg, most_deg, .. }) = stream.take(&positions(&[0], &[0.2]), (&HERE, ms(0)), &rules())
    else {
        panic!("it is a jump")
    };
    assert!((by_deg - 0.2_f64.to_degrees()).abs() < 1e-9 && (most_deg - 0.102_f64.to_degrees()).abs() < 1e-9);
}

#[test]
fn velocities_are_lowered_to_what_the_axis_can_do() {
    let mut stream = stream();
    stream.take(&velocities(&[0, 1], &[-5.0, 1.5]), (&HERE, ms(0)), &rules()).unwrap();
    assert_eq!(written(&mut stream, [0.0, 0.5], 0), Some((vec![0, 1], vec![-1.0, 1.5])));
    assert_eq!(written(&mut stream, [0.0, 0.5], 50), None, "nothing new was asked");
    stream.take(&velocities(&[1], &[1.6]), (&HERE, ms(50)), &rules()).unwrap();
    assert_eq!(written(&mut stream, [0.0, 0.5], 57), Some((vec![0, 1], vec![-1.0, 1.6])));
    stream.take(&velocities(&[1], &[1.7]), (&HERE, ms(60)), &rules()).unwrap();
    assert_eq!(written(&mut stream, [0.0, 0.5], 64), None, "not three quarters of a period");
    stream.take(&velocities(&[1], &[1.5]), (&HERE, ms(64)), &rules()).unwrap();
    assert_eq!(written(&mut stream, [0.0, 0.5], 64), Some((vec![0, 1], vec![-1.0, 1.5])), "slower at once");
}

/// Without further commands, a motor moves on until its lease expires and the stop takes effect, and then brakes.
#[test]
fn a_motor_can_brake_before_its_limit() {
    let rules = rules();
    let late = (rules.fresh + rules.latency).as_secs_f64();
    let axis = &rules.axes[1];
    let rests = |q: f64, v: f64| q + v * late + v * v.abs() / (2.0 * axis.max_acceleration);
    for room in [0.02, 0.1, 0.3] {
        let v = before_limit(axis, 3.0 - room, 2.0, &rules);
        assert!(v < 2.0 && (rests(3.0 - room, v) - 2.999).abs() < 1e-9, "{v} at {room}: half of the tolerance is left");
        let back = before_limit(axis, room - 3.0, -2.0, &rules);
        assert!((v + back).abs() < 1e-12, "{back}");
        assert_eq!(before_limit(axis, 3.0 - room, -2.0, &rules), -2.0, "away from it");
    }
    assert_eq!(before_limit(axis, 0.0, 2.0, &rules), 2.0);
    assert_eq!(before_limit(axis, 2.9995, 1.0, &rules), 0.0);
    assert_eq!(before_limit(axis, 3.5, 1.0, &rules), 0.0);
    assert_eq!(before_limit(&Axis { max_acceleration: 0.0, ..axis.clone() }, 0.0, 1.0, &rules), 0.0);
}

#[test]
fn motors_that_are_not_named_stay() {
    let mut stream = stream();
    stream.take(&positions(&[1], &[0.55]), (&HERE, ms(5)), &rules()).unwrap();
    assert_eq!((stream.named(), stream.names(0), stream.names(1), stream.names(2)), (vec![1], false, true, false));
    assert_eq!(stream.requested(&[7.0, 8.0])[..], [7.0, 0.55]);
    assert_eq!(stream.with(&[7.0, 8.0], &[1.0, 2.0])[..], [7.0, 2.0]);
    assert_eq!((stream.sent(0), stream.sent(1), stream.last_request), (None, Some(0.5), ms(5)));
    stream.request(&[0], ControlMode::PositionDirect, &[0.1, 0.9], (&HERE, ms(9)), &rules());
    assert_eq!(
        (stream.named(), &stream.requested(&HERE)[..], stream.last_request),
        (vec![0, 1], &[0.1, 0.55][..], ms(9))
    );
    stream.request(&[1], ControlMode::PositionDirect, &[], (&HERE, ms(9)), &rules());
    assert_eq!(stream.requested(&HERE)[..], [0.1, 0.55], "without a value it is asked for what it was");
}

/// Two programs share a robot: one streams velocities, the other positions, each to its own motor.
#[test]
fn motors_follow_the_last_command_that_names_them() {
    let (mut stream, rules) = (stream(), rules());
    stream.take(&velocities(&[0], &[0.5]), (&HERE, ms(0)), &rules).unwrap();
    stream.take(&positions(&[1], &[0.51]), (&HERE, ms(0)), &rules).unwrap();
    let direct = |q: f64| Command::Direct { motors: vec![1], q: vec![q] };
    let velocity = |v: f64| Command::Velocity { motors: vec![0], speed: vec![v] };
    assert_eq!(stream.write(&HERE, &rules, ms(0)), [velocity(0.5), direct(0.51)]);
    assert_eq!(
        (stream.named_in(ControlMode::Velocity), stream.named_in(ControlMode::PositionDirect)),
        (vec![0], vec![1])
    );
    // the stream of velocities ends, and the other one goes on
    let quiet = rules.stream_quiet.as_millis() as u64;
    stream.take(&positions(&[1], &[0.52]), (&HERE, ms(quiet - 1)), &rules).unwrap();
    assert_eq!(stream.write(&HERE, &rules, ms(quiet - 1)), [direct(0.52)]);
    stream.take(&positions(&[1], &[0.53]), (&HERE, ms(quiet + 9)), &rules).unwrap();
    assert_eq!(stream.write(&HERE, &rules, ms(quiet + 9)), [velocity(0.0), direct(0.53)], "it stops");
    // a motor that changes the mode begins at its position
    stream.take(&positions(&[0], &[0.2]), (&[0.15, 0.53], ms(500)), &rules).unwrap();
    assert_eq!((stream.sent(0), stream.named_in(ControlMode::PositionDirect)), (Some(0.15), vec![0, 1]));
    stream.take(&velocities(&[1], &[0.3]), (&[0.15, 0.53], ms(500)), &rules).unwrap();
    assert_eq!((stream.sent(1), stream.named_in(ControlMode::Velocity), stream.fastest()), (None, vec![1], 0.0));
    assert_eq!(stream.brake(ms(600)), [1], "positions end at the last of them");
    assert_eq!((stream.braking, stream.goes_on()), (Some(ms(600)), true));
    stream.leave(&[0]);
    assert_eq!(stream.named(), [1]);
}

/// I26: an agent that moves in small steps, with pauses between them, behind frozen encoders.
#[test]
fn steps_with_pauses_between_them_add_up() {
    let pause = Duration::from_millis(500);
    let mut watch = StreamFreezeWatch::begin(Time::ZERO);
    for second in 1..=3 {
        watch.moved += 0.01;
        watch.count(Time::from_secs(f64::from(second)), pause);
        watch.count(Time::from_secs(f64::from(second) + 0.4), pause);
    }
    assert_eq!(watch.began, Some(Time::from_secs(3.0)));
    assert!(watch.moved > 0.029);
}
