//! A robot of two motors, by its readings alone: what a stream and a commit leave to each other.

use super::*;

/// Supervise of two motors that go where its test says.
struct Two {
    supervise: SuperviseCore,
    rules: Arc<Rules>,
    ledger: Ledger,
    now: Time,
    seq: u64,
}

impl Two {
    /// At rest, with the filter open.
    fn new() -> Two {
        let axis = Axis { name: "m".into(), min: -3.0, max: 3.0, max_speed: 1.7, max_acceleration: 3.5 };
        let (axes, period) = (vec![axis.clone(), axis], Duration::from_millis(10));
        let board = Board { axes, period, latency: Duration::ZERO, position_direct: true };
        let rules = Arc::new(Rules::new("r", vec!["p".into()], &Controller::default(), &board));
        let (ledger, now) = (Ledger::new(1000), Time::ZERO);
        let (supervise, _) = SuperviseCore::new(rules.clone(), Arc::new(Gate::default()), ledger.clone(), now);
        let mut two = Two { supervise, rules, ledger, now, seq: 0 };
        (0..30).for_each(|_| _ = two.read([0.0, 0.0], [true, true]));
        assert_eq!(two.supervise.status(), Status::Rest);
        two
    }

    /// The next reading: where the motors are, and which of them are done; the robot rests if both are.
    fn read(&mut self, q: [f64; 2], done: [bool; 2]) -> Vec<SuperviseOut> {
        (self.now, self.seq) = (self.now + Duration::from_millis(10), self.seq + 1);
        let sample = Sample { seq: self.seq, at: self.now, q: q.into(), done: done.into() };
        let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
        self.ledger.book().history.push(&mut pulse, self.rules.fresh);
        pulse.speed = if done == [true, true] { 0.0 } else { 0.5 };
        (pulse.free, pulse.unchanged) = (true, self.now);
        self.supervise.on(SuperviseIn::Pulse(&pulse), self.now)
    }

    fn stream(&mut self, values: Values) {
        let setpoints = Setpoints { motors: vec![0, 1], values };
        let out = self.supervise.on(SuperviseIn::Stream("a".into(), setpoints), self.now);
        assert!(matches!(out[0], SuperviseOut::Verdict(Ok(_))), "{out:?}");
    }

    fn target(&self) -> Vec<f64> {
        self.ledger.book().open.as_ref().map(|open| open.target.to_vec()).unwrap()
    }
}

/// A commit takes one motor over from a stream of velocities: the other is stopped, and the stream ends where that one rests, as soon
/// as its stop may show, however long the first goes on.
#[test]
fn a_commit_takes_one_motor_over_and_the_other_is_stopped() {
    let mut two = Two::new();
    for k in 1..10 {
        two.stream(Values::Velocity(vec![0.1, 0.1]));
        let _ = two.read([1e-3 * f64::from(k); 2], [false, false]);
    }
    let target = Target { motors: vec![0], q: vec![1.0], speed: 0.5 };
    let out = two.supervise.on(SuperviseIn::Commit(Commit { agent: "a".into(), target, speeds: None }), two.now);
    let stops = |o: &SuperviseOut| matches!(o, SuperviseOut::Command(_, Writer::Agent, Command::Stop { motors }) if motors == &[1]);
    assert!(out.iter().any(stops), "{out:?}");
    let told = two.now;
    let over = (1..100).find(|k| {
        let _ = two.read([0.01 + 1e-3 * f64::from(*k), 0.02], [false, true]);
        two.supervise.stream.is_none()
    });
    assert!(over.is_some() && two.now == told + two.rules.reaction(), "{over:?}");
    assert_eq!((two.target(), two.supervise.status()), (vec![1.0, 0.02], Status::Moving));
}

/// A stream of positions ends at its last set-points if the robot counts as being there, else where it rests.
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
