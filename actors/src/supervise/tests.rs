//! Supervise and reflex together, with a plant of one motor, under random interleavings: I1, I2, I4, I9 and I15.

use super::*;
use crate::controller::Controller;
use crate::driver::Port;
use crate::reflex::{ReflexCore, ReflexIn, ReflexOut};
use mobee_contract::{Axis, Board, ControlMode, Refusal, Sample, Target, Values};
use mobee_model::{Contact, ShapeId};
use proptest::prelude::*;
use std::collections::VecDeque;
use std::time::Duration;

const STEP: u64 = 10_000_000;

fn rules() -> Arc<Rules> {
    let axis = Axis { name: "m".into(), min: -3.0, max: 3.0, max_speed: 1.7, max_acceleration: 3.5 };
    let period = Duration::from_millis(10);
    let board = Board { axes: vec![axis], period, latency: Duration::ZERO, position_direct: true };
    Arc::new(Rules::new("r", vec!["p".into()], &Controller::default(), &board))
}

#[derive(Clone, Debug)]
enum Op {
    Commit(f64, bool),
    /// A set-point of position, so far from where the motor is, or a velocity.
    Position(f64, bool),
    Velocity(f64, bool),
    /// So many set-points of a velocity, one per two readings.
    Stream(f64, u8),
    /// So many readings.
    Samples(u8),
    /// Time without readings.
    Silence(u8),
    /// Something stands beyond this position, or goes away.
    Wall(Option<f64>),
    Stop,
    AgentDies,
    SuperviseDies,
    ReflexDies,
    Recover,
    /// Deliver one message on this link.
    Deliver(u8),
}

fn op() -> impl Strategy<Value = Op> {
    prop_oneof![
        4 => (-2.5_f64..2.5, any::<bool>()).prop_map(|(q, own)| Op::Commit(q, own)),
        2 => (-0.3_f64..0.3, any::<bool>()).prop_map(|(q, own)| Op::Position(q, own)),
        2 => (-3.0_f64..3.0, any::<bool>()).prop_map(|(v, own)| Op::Velocity(v, own)),
        3 => (-3.0_f64..3.0, 1_u8..60).prop_map(|(v, n)| Op::Stream(v, n)),
        6 => (1_u8..60).prop_map(Op::Samples),
        1 => (1_u8..30).prop_map(Op::Silence),
        2 => prop::option::of(-2.0_f64..2.0).prop_map(Op::Wall),
        1 => Just(Op::Stop),
        1 => Just(Op::AgentDies),
        1 => Just(Op::SuperviseDies),
        1 => Just(Op::ReflexDies),
        1 => Just(Op::Recover),
        6 => (0_u8..3).prop_map(Op::Deliver),
    ]
}

enum ToSupervise {
    Pulse(Pulse),
    Closed(u64, Cause),
    Word(Word),
}
enum ToReflex {
    Pulse(Pulse),
    RollBack(u64, Motion, bool),
}

/// Two cores, a port and a plant that moves at a constant speed and stops at once.
struct Cell {
    rules: Arc<Rules>,
    gate: Arc<Gate>,
    ledger: Ledger,
    supervise: SuperviseCore,
    reflex: ReflexCore,
    port: Port,
    driver: VecDeque<(u64, Writer, Command)>,
    to_supervise: VecDeque<ToSupervise>,
    to_reflex: VecDeque<ToReflex>,
    now: Time,
    seq: u64,
    q: f64,
    goal: f64,
    speed: f64,
    /// The velocity at which it goes, and until when.
    running: Option<(f64, Time)>,
    mode: ControlMode,
    /// The last set-point of supervise: token, position, time.
    written: Option<(u64, f64, Time)>,
    wall: Option<f64>,
    commits: u64,
    outcomes: Vec<CommitId>,
}

impl Cell {
    fn new() -> Cell {
        let (rules, gate, ledger) = (rules(), Arc::new(Gate::default()), Ledger::new(3000));
        let (supervise, first) = SuperviseCore::new(rules.clone(), gate.clone(), ledger.clone(), Time::ZERO);
        let mut cell = Cell {
            reflex: ReflexCore::new(rules.clone(), gate.clone()),
            port: Port::new(rules.clone(), gate.clone()),
            rules,
            gate,
            ledger,
            supervise,
            driver: VecDeque::new(),
            to_supervise: VecDeque::new(),
            to_reflex: VecDeque::new(),
            now: Time::ZERO,
            seq: 0,
            q: 0.0,
            goal: 0.0,
            speed: 0.0,
            running: None,
            mode: ControlMode::Position,
            written: None,
            wall: None,
            commits: 0,
            outcomes: Vec::new(),
        };
        cell.supervise_out(first);
        cell
    }

    fn near(&self) -> Arc<[Contact]> {
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let contact = |wall: f64| Contact { pair, distance: (wall - self.q).abs() - 0.05, points: Default::default() };
        self.wall.map(contact).into_iter().filter(|c| c.distance < 0.012).collect()
    }

    fn supervise_out(&mut self, outputs: Vec<SuperviseOut>) {
        for output in outputs {
            match output {
                SuperviseOut::Command(token, writer, command) => {
                    let q = if let Command::Direct { q } = &command { Some((token, q[0], self.now)) } else { None };
                    if let (Some((before, old, at)), Some((token, q, now))) = (self.written, q)
                        && before == token
                    {
                        let most = 1.7 * now.since(at).as_secs_f64();
                        assert!((q - old).abs() <= most + 1e-9, "I5: a step from {old} to {q}, {most} is allowed");
                    }
                    self.written = q;
                    self.driver.push_back((token, writer, command));
                }
                SuperviseOut::RollBack { token, motion, again } => {
                    self.to_reflex.push_back(ToReflex::RollBack(token, motion, again));
                }
                SuperviseOut::Event(Event::Commit { .. }) => self.commits += 1,
                SuperviseOut::Event(Event::Outcome { id, .. }) => self.outcomes.push(id),
                SuperviseOut::Event(Event::SafePose { q, age, .. }) => {
                    assert!(age <= self.rules.fresh.as_secs_f64(), "I4: the reading is {age} s old");
                    assert!((q[0] - self.q).abs() < 0.01, "I4: {q:?} while the motor is at {}", self.q);
                }
                _ => {}
            }
        }
    }

    fn reflex_on(&mut self, input: ReflexIn) {
        for output in self.reflex.on(input, self.now, &|_| Default::default()) {
            match output {
                ReflexOut::Command(token, command) => self.driver.push_back((token, Writer::Reflex, command)),
                ReflexOut::Closed { token, cause } => self.to_supervise.push_back(ToSupervise::Closed(token, cause)),
                ReflexOut::Word(word) => self.to_supervise.push_back(ToSupervise::Word(word)),
                ReflexOut::AskPath(since) => {
                    let path = self.ledger.book().history.path(since);
                    self.reflex_on(ReflexIn::Path(path));
                }
                ReflexOut::Event(_) => {}
            }
        }
    }

    fn deliver(&mut self, link: u8) {
        match link {
            0 => {
                let Some((token, writer, command)) = self.driver.pop_front() else { return };
                let Ok(()) = self.port.admit(token, writer, &command) else { return };
                assert!(
                    writer != Writer::Agent || self.gate.is_open(),
                    "I1: an agent's command passed a closed filter"
                );
                self.port.took(token, writer, &command, self.now);
                let runs = self.running.take();
                match command {
                    Command::Move(m) => {
                        self.mode = ControlMode::Position;
                        self.goal = m.q[0];
                        self.speed = m.speed.map_or(1.0, |s| s[0]);
                    }
                    Command::Direct { q } => {
                        assert_eq!(self.mode, ControlMode::PositionDirect, "a set-point in the wrong mode");
                        self.goal = q[0];
                        self.speed = 1.7;
                    }
                    Command::Velocity { speed, .. } => {
                        assert_eq!(self.mode, ControlMode::Velocity, "a velocity in the wrong mode");
                        self.running = Some((speed[0], self.now + Duration::from_millis(100)));
                    }
                    Command::Stop { .. } => self.goal = self.q,
                    Command::Mode { mode, .. } if mode != self.mode => {
                        self.mode = mode;
                        self.goal = self.q;
                    }
                    _ => self.running = runs,
                }
            }
            1 => match self.to_reflex.pop_front() {
                Some(ToReflex::Pulse(mut pulse)) => {
                    let (motion, status) = {
                        let book = self.ledger.book();
                        (book.open.as_ref().map(|o| Motion { id: o.id, safe: o.safe.clone() }), book.status)
                    };
                    self.reflex_on(ReflexIn::Pulse(&mut pulse, motion.as_ref(), status));
                    self.to_supervise.push_back(ToSupervise::Pulse(pulse));
                }
                Some(ToReflex::RollBack(token, motion, again)) => {
                    self.reflex_on(ReflexIn::RollBack { token, motion, again });
                }
                None => {}
            },
            _ => {
                let out = match self.to_supervise.pop_front() {
                    Some(ToSupervise::Pulse(pulse)) => self.supervise.on(SuperviseIn::Pulse(&pulse), self.now),
                    Some(ToSupervise::Closed(token, cause)) => {
                        self.supervise.on(SuperviseIn::Closed(token, cause), self.now)
                    }
                    Some(ToSupervise::Word(word)) => self.supervise.on(SuperviseIn::Word(word), self.now),
                    None => return,
                };
                self.supervise_out(out);
            }
        }
    }

    fn flush(&mut self) {
        while !(self.driver.is_empty() && self.to_reflex.is_empty() && self.to_supervise.is_empty()) {
            (0..3).for_each(|link| self.deliver(link));
        }
    }

    fn sample(&mut self) {
        self.now = Time(self.now.0 + STEP);
        if let Some((v, until)) = self.running {
            if self.now <= until {
                self.goal = self.q + v * 0.01;
                self.speed = 1.7;
            } else {
                (self.running, self.goal) = (None, self.q);
            }
        }
        let way = (self.goal - self.q).clamp(-self.speed * 0.01, self.speed * 0.01);
        self.q += way;
        assert!(self.q.abs() <= 3.0 + 1e-9, "I5: past the limit, at {}", self.q);
        self.seq += 1;
        let done = vec![self.q == self.goal && self.running.is_none()];
        let sample = Sample { seq: self.seq, at: self.now, q: vec![self.q].into(), done };
        let mut pulse = Pulse::new(sample, &Vec::new().into());
        self.ledger.book().history.push(&mut pulse);
        pulse.contacts = self.near();
        self.to_reflex.push_back(ToReflex::Pulse(pulse));
    }

    fn tick(&mut self) {
        let out = self.supervise.on(SuperviseIn::Tick, self.now);
        self.supervise_out(out);
    }

    fn dies(&mut self, supervise: bool) {
        self.gate.close();
        self.ledger.book().died = Some("somebody".into());
        self.to_reflex.clear();
        self.reflex = ReflexCore::new(self.rules.clone(), self.gate.clone());
        if supervise {
            self.to_supervise.clear();
            let (core, first) =
                SuperviseCore::new(self.rules.clone(), self.gate.clone(), self.ledger.clone(), self.now);
            self.supervise = core;
            self.supervise_out(first);
        }
    }

    /// Two minutes of readings at most.
    fn heal(&mut self) {
        for round in 0..120 {
            self.apply(Op::Samples(100));
            if round > 0 && self.supervise.is_settled() {
                return;
            }
        }
    }

    fn stream(&mut self, own: bool, values: Values) -> Verdict {
        let agent: Arc<str> = if own { "a" } else { "b" }.into();
        let setpoints = Setpoints { motors: vec![0], values };
        let out = self.supervise.on(SuperviseIn::Stream(agent, setpoints), self.now);
        let verdict = match out.first() {
            Some(SuperviseOut::Verdict(verdict)) => verdict.clone(),
            other => panic!("no verdict but {other:?}"),
        };
        self.supervise_out(out);
        verdict
    }

    fn apply(&mut self, op: Op) {
        match op {
            Op::Position(by, own) => {
                let _ = self.stream(own, Values::Position(vec![self.q + by]));
            }
            Op::Velocity(v, own) => {
                let _ = self.stream(own, Values::Velocity(vec![v]));
            }
            Op::Stream(v, n) => (0..n).for_each(|_| {
                let _ = self.stream(true, Values::Velocity(vec![v]));
                self.apply(Op::Samples(2));
            }),
            Op::Commit(q, own) => {
                let agent: Arc<str> = if own { "a" } else { "b" }.into();
                let commit = Commit { agent, target: Target { motors: vec![0], q: vec![q], speed: 0.5 }, speeds: None };
                let out = self.supervise.on(SuperviseIn::Commit(commit), self.now);
                self.supervise_out(out);
            }
            Op::Samples(n) => (0..n).for_each(|i| {
                self.sample();
                if i % 8 == 7 {
                    self.tick();
                }
                self.flush();
            }),
            Op::Silence(n) => {
                self.now = Time(self.now.0 + u64::from(n) * STEP);
                self.tick();
            }
            Op::Wall(wall) => self.wall = wall,
            Op::Stop => {
                let out = self.supervise.on(SuperviseIn::Stop("a".into()), self.now);
                self.supervise_out(out);
            }
            Op::AgentDies => {
                let out = self.supervise.on(SuperviseIn::AgentDied("a".into()), self.now);
                self.supervise_out(out);
            }
            Op::SuperviseDies => self.dies(true),
            Op::ReflexDies => self.dies(false),
            Op::Recover => {
                let out = self.supervise.on(SuperviseIn::Recover, self.now);
                self.supervise_out(out);
            }
            Op::Deliver(link) => self.deliver(link),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn any_interleaving_keeps_the_promises(ops in prop::collection::vec(op(), 1..60)) {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        for op in ops {
            cell.apply(op);
            prop_assert!(cell.outcomes.len() as u64 <= cell.commits, "I2: more outcomes than commits");
        }
        // the healed phase: everything ends, and the filter is open, or holds where an escape frees it (I15)
        cell.wall = None;
        cell.heal();
        if matches!(cell.supervise.status(), Status::Holding(_)) {
            cell.apply(Op::Commit(cell.q, true));
            cell.heal();
        }
        prop_assert_eq!(cell.supervise.status(), Status::Rest);
        prop_assert!(cell.gate.is_open());
        let expected: Vec<CommitId> = (1..=cell.commits).map(CommitId).collect();
        prop_assert_eq!(cell.outcomes, expected, "I2: exactly one outcome each, in order");
    }
}

#[test]
fn commits_that_do_not_fit_are_refused_with_their_code() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let mut code = |motors: Vec<usize>, q: Vec<f64>, speed: f64| {
        let commit = Commit { agent: "a".into(), target: Target { motors, q, speed }, speeds: None };
        match cell.supervise.on(SuperviseIn::Commit(commit), cell.now).first() {
            Some(SuperviseOut::Verdict(Err(refusal))) => refusal.code(),
            _ => "accepted",
        }
    };
    assert_eq!(code(vec![], vec![], 0.5), "malformed");
    assert_eq!(code(vec![0, 0], vec![0.1, 0.1], 0.5), "malformed");
    assert_eq!(code(vec![1], vec![0.1], 0.5), "malformed");
    assert_eq!(code(vec![0], vec![], 0.5), "malformed");
    assert_eq!(code(vec![0], vec![f64::NAN], 0.5), "not_finite");
    assert_eq!(code(vec![0], vec![3.1], 0.5), "limits");
    assert_eq!(code(vec![0], vec![0.1], f64::NAN), "speed");
    assert_eq!(code(vec![0], vec![0.1], 0.0), "speed");
    assert_eq!(code(vec![0], vec![0.1], 0.5), "accepted");
}

#[test]
fn set_points_that_do_not_fit_are_refused_with_their_code() {
    let mut cell = Cell::new();
    let code = |cell: &mut Cell, values: Values| cell.stream(true, values).map_err(|e| e.code());
    assert_eq!(code(&mut cell, Values::Velocity(vec![0.1])), Err("not_ready"));
    cell.apply(Op::Samples(30));
    assert_eq!(code(&mut cell, Values::Velocity(vec![f64::NAN])), Err("not_finite"));
    assert_eq!(code(&mut cell, Values::Velocity(vec![0.1, 0.1])), Err("malformed"));
    assert_eq!(code(&mut cell, Values::Position(vec![f64::INFINITY])), Err("not_finite"));
    assert_eq!(code(&mut cell, Values::Position(vec![3.1])), Err("limits"));
    assert_eq!(code(&mut cell, Values::Position(vec![1.0])), Err("jump"));
    assert_eq!(cell.commits, 0);
    assert_eq!(code(&mut cell, Values::Position(vec![0.1])), Ok(CommitId(1)));
    assert_eq!(code(&mut cell, Values::Position(vec![0.12])), Ok(CommitId(1)));
    assert_eq!(code(&mut cell, Values::Velocity(vec![0.1])), Err("not_ready"));
    assert_eq!(cell.stream(false, Values::Position(vec![0.12])), Err(Refusal::Busy));
    // quiet: it ends where it was brought
    cell.apply(Op::Samples(100));
    assert_eq!(cell.outcomes, [CommitId(1)]);
    assert!((cell.q - 0.12).abs() < 1e-6, "{}", cell.q);
    assert_eq!(cell.mode, ControlMode::Position);
}

#[test]
fn a_stream_is_refused_while_the_robot_holds_and_gives_way_to_a_move() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Stream(1.0, 20));
    let before = cell.q;
    assert!(before > 0.3, "{before}");
    // a move in mid-stream joins the transaction
    cell.apply(Op::Commit(0.1, true));
    cell.apply(Op::Samples(200));
    assert_eq!((cell.commits, cell.outcomes.len()), (1, 1));
    assert!((cell.q - 0.1).abs() < 1e-6, "{}", cell.q);
    cell.apply(Op::Wall(Some(cell.q)));
    cell.apply(Op::Samples(30));
    assert_eq!(cell.supervise.status(), Status::Holding(Hold::InContact));
    let refused = cell.stream(true, Values::Velocity(vec![0.1]));
    assert_eq!(refused, Err(Refusal::Holding { reason: Hold::InContact }));
}
