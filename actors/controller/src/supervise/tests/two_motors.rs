//! A robot of two motors, by its readings alone: interaction of a stream and a commit.

use super::*;

/// Supervise of two motors that move as its test defines.
struct Two {
    supervise: SuperviseCore,
    rules: Arc<Rules>,
    gate: Gate,
    book: TransactionState,
    joint_retreat: JointRetreat,
    now: Time,
    seq: u64,
}

impl Two {
    /// At rest, with the filter open.
    fn new() -> Two {
        let (axes, period) = (vec![axis(), axis()], Duration::from_millis(10));
        let board = Board { axes, period, latency: Duration::ZERO, position_direct: true };
        let rules = Arc::new(Rules::new("r", vec!["p".into()], &ControllerSettings::default(), &board));
        let (gate, mut book, joint_retreat, now) =
            (Gate::default(), TransactionState::new(1000), JointRetreat::default(), Time::ZERO);
        let shared = &mut Shared { rules: &rules, gate: &gate, book: &mut book, joint_retreat: &joint_retreat };
        let (supervise, _) = SuperviseCore::new(shared, now);
        let mut two = Two { supervise, rules, gate, book, joint_retreat, now, seq: 0 };
        (0..30).for_each(|_| _ = two.read([0.0, 0.0], [true, true]));
        assert_eq!(two.supervise.status(), Status::Rest);
        two
    }

    /// The next reading: positions of the motors, and which of them are done; the robot rests if both are.
    fn read(&mut self, q: [f64; 2], done: [bool; 2]) -> Vec<SuperviseOut> {
        (self.now, self.seq) = (self.now + Duration::from_millis(10), self.seq + 1);
        let sample = Sample { seq: self.seq, at: self.now, q: q.into(), done: done.into(), ..Sample::default() };
        let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
        self.book.history.push(&mut pulse, self.rules.fresh);
        pulse.speed = if done == [true, true] { 0.0 } else { 0.5 };
        (pulse.free, pulse.unchanged) = (true, self.now);
        self.on(SuperviseIn::Pulse(&pulse), self.now)
    }

    fn on(&mut self, input: SuperviseIn, now: Time) -> Vec<SuperviseOut> {
        let Two { rules, gate, book, joint_retreat, .. } = self;
        self.supervise.on(input, now, &mut Shared { rules, gate, book, joint_retreat })
    }

    fn stream(&mut self, values: Values) {
        self.stream_to(&[0, 1], values);
    }

    /// Set-points of these motors, and the resulting commands.
    fn stream_to(&mut self, motors: &[usize], values: Values) -> Vec<Command> {
        let setpoints = Setpoints { motors: motors.to_vec(), values };
        commands(self.on(SuperviseIn::Stream("a".into(), setpoints), self.now))
    }

    /// A move of one motor, and the resulting commands.
    fn commit(&mut self, motor: usize, q: f64) -> Vec<Command> {
        let target = Target { motors: vec![motor], q: vec![q], speed: 0.5 };
        commands(self.on(SuperviseIn::Commit(Commit { agent: "a".into(), target, speeds: None }), self.now))
    }

    fn target(&self) -> Vec<f64> {
        self.book.open.as_ref().map(|open| open.target.to_vec()).unwrap()
    }
}

/// Commands after an accepting verdict.
fn commands(out: Vec<SuperviseOut>) -> Vec<Command> {
    assert!(matches!(out[0], SuperviseOut::Verdict(Ok(_))), "{out:?}");
    out.into_iter()
        .filter_map(|o| match o {
            SuperviseOut::Command(_, Writer::Agent, command) => Some(command),
            _ => None,
        })
        .collect()
}

fn mode(motor: usize, mode: ControlMode) -> Command {
    Command::Mode { motors: vec![motor], mode }
}

/// A commit takes one motor over from a stream of velocities: the other goes on while there are set-points for it,
/// and the stream ends where that one rests, as soon as its stop may show, however long the first goes on.
#[test]
fn a_commit_takes_one_motor_over_and_the_other_goes_on() {
    let mut two = Two::new();
    for k in 1..10 {
        two.stream(Values::Velocity(vec![0.1, 0.1]));
        let _ = two.read([1e-3 * f64::from(k); 2], [false, false]);
    }
    let out = two.commit(0, 1.0);
    assert!(matches!(&out[..], [Command::Move(m)] if m.motors == [0]), "nothing but the move: {out:?}");
    for k in 10..200 {
        let out = two.stream_to(&[1], Values::Velocity(vec![0.2]));
        assert!(out.iter().all(|c| matches!(c, Command::Velocity { motors, .. } if motors == &[1])), "{out:?}");
        let _ = two.read([1e-3 * f64::from(k), 0.02], [false, false]);
        assert_eq!(two.supervise.status(), Status::Moving);
    }
    let stopped = (1..100).find(|k| {
        let out = two.read([0.2 + 1e-3 * f64::from(*k), 0.02], [false, true]);
        let stop =
            |o: &SuperviseOut| matches!(o, SuperviseOut::Command(_, _, Command::Stop { motors }) if motors == &[1]);
        out.iter().any(stop)
    });
    assert!(stopped.is_some(), "it went quiet, and is stopped");
    let stopped_at = two.now;
    let over = (1..100).find(|k| {
        let _ = two.read([0.4 + 1e-3 * f64::from(*k), 0.02], [false, true]);
        two.supervise.motion.stream.is_none()
    });
    assert!(over.is_some() && two.now == stopped_at + two.rules.reaction(), "{over:?}");
    assert_eq!((two.target(), two.supervise.status()), (vec![1.0, 0.02], Status::Moving));
}

/// Position set-points take a motor over from the move that it makes, as on a board; the rest of the move goes on.
#[test]
fn positions_take_a_motor_over_from_its_move() {
    for motor in [0, 1] {
        let mut two = Two::new();
        two.commit(0, 1.0);
        let _ = two.read([0.05, 0.0], [false, true]);
        let here = [0.05, 0.0];
        let out = two.stream_to(&[motor], Values::Position(vec![here[motor] + 0.005]));
        let direct = Command::Direct { motors: vec![motor], q: vec![here[motor] + 0.005] };
        assert_eq!(out, [mode(motor, ControlMode::PositionDirect), direct]);
        let expected = if motor == 0 { vec![0.055, 0.0] } else { vec![1.0, 0.005] };
        assert_eq!(two.target(), expected);
        let named = two.book.open.as_ref().map(|open| open.named.to_vec());
        assert_eq!(named, Some(if motor == 0 { vec![0] } else { vec![0, 1] }), "all that moved is taken back");
        let jump = Setpoints { motors: vec![motor], values: Values::Position(vec![here[motor] + 0.5]) };
        let refused = two.on(SuperviseIn::Stream("a".into(), jump), two.now);
        assert!(matches!(refused[0], SuperviseOut::Verdict(Err(Refusal::Jump { .. }))), "{refused:?}");
    }
}

/// Two programs stream, one velocities and one positions: each motor follows the last command, and a motor changes
/// over.
#[test]
fn two_streams_share_a_robot() {
    let mut two = Two::new();
    let out = two.stream_to(&[0], Values::Velocity(vec![0.1]));
    assert_eq!(out, [mode(0, ControlMode::Velocity), Command::Velocity { motors: vec![0], speed: vec![0.1] }]);
    let out = two.stream_to(&[1], Values::Position(vec![0.01]));
    assert_eq!(out, [mode(1, ControlMode::PositionDirect), Command::Direct { motors: vec![1], q: vec![0.01] }]);
    assert_eq!(two.target(), [0.0, 0.01]);
    (0..2).for_each(|_| _ = two.read([0.001, 0.01], [false, false]));
    let out = two.stream_to(&[0], Values::Position(vec![0.002]));
    assert_eq!(
        out,
        [mode(0, ControlMode::PositionDirect), Command::Direct { motors: vec![0, 1], q: vec![0.002, 0.01] }]
    );
    let out: Vec<_> = (0..200).flat_map(|_| two.read([0.002, 0.01], [true, true])).collect();
    let back = |o: &SuperviseOut| matches!(o, SuperviseOut::Command(_, _, Command::Mode { motors, mode: ControlMode::Position }) if motors == &[0, 1]);
    assert!(out.iter().any(back), "{out:?}");
    assert_eq!(two.supervise.status(), Status::Rest);
}

/// A stream of positions ends at its last set-points if the robot is close to them, else where it rests.
#[test]
fn a_stream_of_positions_ends_at_the_last_of_them() {
    for (off, end) in [(0.5, [0.01, 0.01]), (-0.5, [0.01, 0.01])] {
        let mut two = Two::new();
        two.stream(Values::Position(vec![0.01, 0.01]));
        let q = [0.01 + off * two.rules.tolerance, 0.01];
        let out: Vec<_> = (0..200).flat_map(|_| two.read(q, [true, true])).collect();
        let amended = out.iter().find_map(|o| match o {
            SuperviseOut::Event(Event::Amended { target, .. }) => Some(target.to_vec()),
            _ => None,
        });
        assert_eq!(amended, Some(end.to_vec()), "{off} tolerances beside it");
        assert_eq!(two.supervise.status(), Status::Rest);
    }
}

/// A motor that the open commit does not name, and that is moved nevertheless, causes a rollback.
#[test]
fn a_motor_that_is_moved_in_mid_motion_takes_the_motion_back() {
    let mut two = Two::new();
    two.commit(0, 1.0);
    let _ = two.read([0.1, 0.0], [false, true]);
    let away = 1.5 * two.rules.tolerance;
    let out: Vec<_> = (0..3).flat_map(|_| two.read([0.2, away], [false, true])).collect();
    let closed = |o: &SuperviseOut| matches!(o, SuperviseOut::Event(Event::Disabled { cause: Cause::Displaced { by, .. }, .. }) if *by == away);
    let back = |o: &SuperviseOut| matches!(o, SuperviseOut::RollBack { again: false, .. });
    assert!(out.iter().any(closed) && out.iter().any(back), "{out:?}");
    assert_eq!(two.supervise.status(), Status::Stopping);
}

/// A motor is journaled when it joins a stream, and not for each of its set-points.
#[test]
fn a_motor_that_joins_a_stream_is_journaled_once() {
    let mut two = Two::new();
    let mut joined = |motor: usize| {
        let setpoints = Setpoints { motors: vec![motor], values: Values::Velocity(vec![0.1]) };
        let out = two.on(SuperviseIn::Stream("a".into(), setpoints), two.now);
        let motors = |o: SuperviseOut| match o {
            SuperviseOut::Event(Event::Amended { motors, .. }) => Some(motors.into_iter().map(|(m, _)| m).collect()),
            _ => None,
        };
        out.into_iter().filter_map(motors).collect::<Vec<Vec<usize>>>()
    };
    assert!(joined(0).is_empty(), "it is the stream");
    assert_eq!(joined(1), [[1]]);
    assert!(joined(1).is_empty() && joined(0).is_empty());
}

/// A program that hit something by a move pushes no more: its set-points are accepted as soon as the filter opens.
#[test]
fn an_agent_that_moved_into_something_need_not_be_silent() {
    let mut two = Two::new();
    two.commit(0, 1.0);
    let token = two.gate.close();
    two.on(SuperviseIn::Closed(token, Cause::Contact(Vec::new()), None), two.now);
    let setpoints = Setpoints { motors: vec![0], values: Values::Velocity(vec![0.1]) };
    let out = two.on(SuperviseIn::Stream("a".into(), setpoints), two.now);
    assert_eq!(out[0], SuperviseOut::Verdict(Err(Refusal::Closed)));
}

/// Of two streaming programs, one hit something: the other can't have pushed, and is accepted though it never pauses.
#[test]
fn set_points_of_motors_without_a_part_in_a_contact_are_accepted() {
    for (blamed, accepted) in [(Some(1), [true, false]), (Some(0), [false, true]), (None, [false, false])] {
        let mut two = Two::new();
        two.stream(Values::Velocity(vec![0.1, 0.1]));
        let _ = two.read([0.01, 0.01], [false, false]);
        let token = two.gate.close();
        let blamed = blamed.map(|motor| [motor].into());
        two.on(SuperviseIn::Closed(token, Cause::Contact(Vec::new()), blamed), two.now);
        let mut is_accepted = |motors: &[usize]| {
            let setpoints = Setpoints { motors: motors.to_vec(), values: Values::Velocity(vec![0.1; motors.len()]) };
            let out = two.on(SuperviseIn::Stream("a".into(), setpoints), two.now);
            assert!(matches!(out[0], SuperviseOut::Verdict(Err(_))), "the filter is closed: {out:?}");
            out[0] != SuperviseOut::Verdict(Err(Refusal::Pushing))
        };
        assert_eq!([is_accepted(&[0]), is_accepted(&[1])], accepted);
        assert!(!is_accepted(&[0, 1]), "together they push");
    }
}
